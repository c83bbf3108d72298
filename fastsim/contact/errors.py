"""Errors of tools beside a body, each with its data."""

from __future__ import annotations

from palpate.fastsim.body import CrushedCell
from palpate.fastsim.errors import FOLDING, FastsimError
from palpate.meshes.rigid_tool import ToolError


class ToolInsideError(ToolError):
    """A tool overlaps the body before anything has moved.

    Attributes:
        tool: Number of the tool, from 0.
        depth: How deep its deepest vertex is [m]; infinite where the tool is inside as a whole.
        allowed: How deep it may be at the start [m]; 0 for an average over facets.
        position: Position of that vertex, or of the tool's point that is inside [m].
    """

    def __init__(
        self, tool: int, depth: float, allowed: float, position: tuple[float, float, float]
    ) -> None:
        self.tool = tool
        self.depth = depth
        self.allowed = allowed
        self.position = position
        where = ", ".join(f"{x:.4g}" for x in position)
        how = "has its middle in the body" if depth == float("inf") else f"is {depth:.3g} m deep"
        why = (
            f"at most {allowed:.3g} m is allowed (a tenth of the edges there): begin its path "
            "outside of the body"
            if allowed > 0.0
            else "so deep is the average over the facets there: begin its path farther out, or "
            "make the facets smaller beside the tool"
        )
        super().__init__(f"tool {tool + 1} {how} at the start, at ({where}) m; {why}")


class ToolTooSmallError(ToolError):
    """A tool that fits between the vertices at which contact is checked.

    Attributes:
        tool: Number of the tool, from 0.
        half_thickness: Half thickness of the tool where it is thinnest [m].
        spacing: Largest radius of a circle through the corners of a facet in its way [m].
    """

    def __init__(self, tool: int, half_thickness: float, spacing: float) -> None:
        self.tool = tool
        self.half_thickness = half_thickness
        self.spacing = spacing
        super().__init__(
            f"tool {tool + 1} is {half_thickness:.3g} m thick (half), facets in its way have "
            f"corners {spacing:.3g} m from their centre: it would slip between them; refine the "
            "mesh there, or take a larger tool"
        )


class FacetContactError(ToolError):
    """Contact over facets of a kind that is known at vertices only.

    Attributes:
        tool: Number of the tool, from 0.
        what: What knows it at vertices only.
    """

    def __init__(self, tool: int, what: str) -> None:
        self.tool = tool
        self.what = what
        super().__init__(
            f'tool {tool + 1} asks for contact over facets; {what}; give it contact = "vertices"'
        )


class ToolTooFastError(ToolError):
    """A tool that moves too far in one step for its side to be known.

    Attributes:
        tool: Number of the tool, from 0.
        speed: Largest speed of a point of the tool on its path [m/s].
        allowed: Speed up to which nothing passes through [m/s].
    """

    def __init__(self, tool: int, speed: float, allowed: float) -> None:
        self.tool = tool
        self.speed = speed
        self.allowed = allowed
        super().__init__(
            f"tool {tool + 1} moves at {speed:.4g} m/s; with this time step and mesh vertices may "
            f"pass through it above {allowed:.4g} m/s: move it more slowly, or take a shorter step"
        )


class ContactLostError(FastsimError):
    """No equilibrium with the tool beyond a point of its path.

    Attributes:
        time: Last time of the path at which equilibrium was found.
        reason: What ended the iteration beyond it.
        partial: Result up to there (`ContactResult`).
        crushed: The cell of smallest det F there, of a body whose cells fold (`Body.folds`).
    """

    def __init__(
        self, time: float, reason: str, partial: object, *, crushed: CrushedCell | None = None
    ) -> None:
        self.time = time
        self.reason = reason
        self.partial = partial
        self.crushed = crushed
        where, ways_out = "", "refine below the tool, or take linear strain"
        if crushed is not None:
            where, ways_out = f"; {crushed}", f"or {FOLDING}"
        super().__init__(
            f"no equilibrium with the tool beyond t = {time:.6g} of its path: {reason}{where}; "
            f"press less deep, {ways_out}"
        )
