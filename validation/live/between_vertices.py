"""How deep a tool is between the vertices of a surface, which alone it touches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.fastsim.contact.contact_law import half_thickness
from palpate.fastsim.contact.tool_contact import POSE, ToolContact, gaps_at
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Problem

# The surface may be so deep in the tool, of half its thickness, unmentioned; deeper than the
# second, the tool is on its way through the surface.
_DEEP, _THROUGH = 0.1, 0.5


class BetweenVertices:
    """Depth of a body's flat facets in the first tool of a problem.

    Args:
        problem: With the tool, turned as it is at the start.
    """

    def __init__(self, problem: Problem) -> None:
        self._mesh = problem.mesh
        self._shape = ToolContact(problem, problem.tools[0]).shape
        self._thickness = half_thickness(problem.tools[0].shape)
        self._pose = np.zeros(1, POSE)
        self._pose["rotation"] = problem.tools[0].path.pose_at(0.0)[1]

    def depth(self, place: Floats, displacement: Points) -> float:
        """Of the deepest middle of an edge or a facet [m], >= 0.

        Args:
            place: Of the tool [m], shape (3,).
            displacement: Of the body [m], shape (num_points, 3).
        """
        corners = (self._mesh.points + displacement)[self._mesh.boundary_facets]
        middles = 0.5 * (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3)
        self._pose["position"] = place
        gaps = gaps_at(self._shape, np.vstack([middles, corners.mean(axis=1)]), self._pose)
        return max(0.0, -float(gaps.distances.min()))

    def is_deep(self, depth: float) -> bool:
        """Whether a depth [m] is worth a word."""
        return depth > _DEEP * self._thickness

    def is_through(self, depth: float) -> bool:
        """Whether the tool has parted the vertices, and would go through the surface."""
        return depth > _THROUGH * self._thickness


def warn_between_vertices(problem: Problem, place: Floats, displacements: Sequence[Points]) -> str:
    """What to say where a body's facets are deep in the tool between its vertices; else nothing.

    Args:
        problem: See `BetweenVertices`.
        place: Of the tool [m], shape (3,).
        displacements: Of each body [m], shape (num_points, 3).
    """
    between = BetweenVertices(problem)
    deep = max(between.depth(place, u) for u in displacements)
    if not between.is_deep(deep):
        return ""
    return (
        f"between its vertices the surface is up to {1e3 * deep:.2g} mm inside the tool, "
        "which only vertices touch: tissue would not let it in, so the truth will be far off, "
        "or none be found; take a finer mesh or a larger tool"
    )
