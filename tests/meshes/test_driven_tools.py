"""Tools driven by a force that no equilibrium belongs to."""

from __future__ import annotations

import dataclasses

import pytest

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.rigid_tool import (
    ForceDrive,
    RigidTool,
    SphereShape,
    ToolError,
    ToolPath,
    require_drive_of_statics,
)

ALWAYS = TabularAmplitude((0.0,), (1.0,))
ON_A_PATH = RigidTool(SphereShape(1.0), ToolPath([0.0], [[0.0, 0.0, 0.0]]))


def driven(force: float, friction: float = 0.0) -> RigidTool:
    drive = ForceDrive((0.0, 0.0, -1.0), force, ALWAYS, mass=1.0)
    return dataclasses.replace(ON_A_PATH, drive=drive, friction_coefficient=friction)


def test_one_that_pushes_alone_and_tools_on_paths_are_taken() -> None:
    require_drive_of_statics(())
    require_drive_of_statics((ON_A_PATH, ON_A_PATH))
    require_drive_of_statics((driven(0.1),))


@pytest.mark.parametrize(
    ("tools", "words"),
    [
        ((driven(-0.1),), "tool 1 is driven by -0.1 N.* above 0"),
        ((driven(0.0),), "above 0"),
        ((ON_A_PATH, driven(0.1)), "tool 2 is driven by a force, beside others"),
        ((driven(0.1, friction=0.2),), "friction, whose drag depends on the way"),
    ],
)
def test_others_are_refused(tools: tuple[RigidTool, ...], words: str) -> None:
    with pytest.raises(ToolError, match=words):
        require_drive_of_statics(tools)
