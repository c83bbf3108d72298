"""Which tools driven by a force have an equilibrium to look for; no mechanics here."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.meshes.rigid_tool import RigidTool, ToolError


def require_drive_of_statics(tools: Sequence[RigidTool]) -> None:
    """Refuse a force on a tool that leaves no one equilibrium to look for.

    Statics drive one tool, alone, along its line until the body takes the whole force; drag on the
    way there would depend on the steps taken.

    Args:
        tools: All of a problem's.

    Raises:
        ToolError: A tool driven by a force beside others, or with friction; a force that does not
            push.
    """
    for number, tool in enumerate(tools, start=1):
        if tool.drive is None:
            continue
        driven = f"tool {number} is driven by"
        if len(tools) > 1:
            raise ToolError(f"{driven} a force, beside others: statics drive one tool, alone")
        if tool.friction_coefficient > 0.0:
            raise ToolError(
                f"{driven} a force and has friction, whose drag depends on the way: statics drive "
                "a tool without friction; set 0, or give a path"
            )
        if not tool.drive.force > 0.0:
            raise ToolError(
                f"{driven} {tool.drive.force:g} N: statics need a force above 0; turn the "
                "direction round"
            )
