"""Small cells where tools press: a mesh of its own, bisected before anything is solved.

The force on a tool wants contact that is integrated over facets; the shape under it wants cells
that are small beside the radius of contact, which for a ball of radius R pressed in by d is
(R d)^(1/2) (Johnson, *Contact Mechanics*, equation 4.23).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from palpate.fastsim.contact.tool_contact import core_shape, gaps_at, poses_at
from palpate.fastsim.grading.graded_mesh import GradedMesh, carry_problem
from palpate.fastsim.grading.size_fields import (
    distance_to_points,
    grow_with_distance,
    refine_to_size,
)
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.rigid_tool import BoxShape, CapsuleShape, RigidTool, SphereShape
from palpate.meshes.shapes import require_positive

# Edges at a tool over the radius of contact.
PART_OF_CONTACT = 0.5
# Edge length over the distance from what is touched.
GROWTH = 0.5
# Poses of a path at which the body at rest is looked at.
_POSES = 24
# A tool touches that is as near as this part of the body's size.
_NEAR_ENOUGH = 1e-4
# Most cells of a refined mesh.
MOST_CELLS = 400_000
# Points on a facet, as barycentric coordinates: a tool smaller than a facet is found between them.
_ON_FACET = np.array([[a, b, 6 - a - b] for a in range(7) for b in range(7 - a)]) / 6.0


def refine_near_tools(problem: Problem, edge: float | None = None) -> Problem:
    """The problem on its mesh with cells bisected where tools go through the body at rest.

    Args:
        problem: With tools that are moved along paths.
        edge: Mean edge of the cells there [m]; where None, half of the radius of contact
            (R d)^(1/2) of each tool: R is its radius (a box's smallest half width), d how deep its
            path enters the body at rest. Farther away edges grow by half of the distance.

    Returns:
        The problem on the finer mesh, the points of the given one first. A motion's step becomes
        0.8 of the critical one.

    Raises:
        InputError: No tool; one that a force drives, or that touches nothing at rest; without
            `edge`, one that has no radius.
        TooManyCellsError: More than MOST_CELLS cells.
    """
    if edge is not None:
        require_positive(edge=edge)
    if not problem.tools:
        raise InputError("cells are refined near tools, and the problem has none")
    graded = GradedMesh(problem.mesh)
    for number, tool in enumerate(problem.tools, 1):
        if tool.drive is not None:
            raise InputError(
                f"tool {number} is driven by a force: where it goes is not known before; give it "
                "a path, or grade the case's mesh ([[mesh.grade]])"
            )
        touched, depth = _touched(problem, tool)
        if not len(touched):
            raise InputError(
                f"tool {number} goes through no facet of the body at rest: nowhere to refine"
            )
        smallest = edge or PART_OF_CONTACT * float(np.sqrt(_radius(tool, number) * depth))
        refine_to_size(
            graded,
            grow_with_distance(distance_to_points(touched), smallest=smallest, growth=GROWTH),
            max_cells=MOST_CELLS,
        )
    finer = carry_problem(problem, graded)
    if finer.time is None:
        return finer
    return dataclasses.replace(finer, time=dataclasses.replace(finer.time, time_step=None))


def first_touched(problem: Problem, direction: ArrayLike) -> Floats:
    """Where the first tool, moved straight from its first pose, meets the body at rest first [m].

    Args:
        problem: With a tool that is outside the body.
        direction: Unit vector of its way [-], shape (3,).

    Returns:
        A position on a facet, shape (3,).

    Raises:
        InputError: The tool passes the body.
    """
    tool, way = problem.tools[0], np.asarray(direction, dtype=np.float64)
    seen, shape = _on_facets(problem), core_shape(tool.shape)
    pose = poses_at(tool.path, tool.path.times[:1])[0]
    size = float(np.linalg.norm(np.ptp(seen, axis=0)))
    farthest = 2.0 * size + float(np.linalg.norm(seen.mean(axis=0) - pose["position"]))
    gone = 0.0
    while gone < farthest:
        # No point is nearer than the nearest, whichever way the tool goes.
        gaps = gaps_at(shape, seen, pose).distances
        nearest = int(np.argmin(gaps))
        if gaps[nearest] <= _NEAR_ENOUGH * size:
            touched: Floats = seen[nearest]
            return touched
        gone += float(gaps[nearest])
        pose["position"] += gaps[nearest] * way
    raise InputError("the tool passes the body on its way straight in: start it elsewhere")


def _on_facets(problem: Problem) -> Points:
    """Positions on the facets at rest [m], shape (n, 3)."""
    facets = problem.mesh.points[problem.mesh.boundary_facets]
    seen: Points = np.einsum("ka,fai->fki", _ON_FACET, facets).reshape(-1, 3)
    return seen


def _touched(problem: Problem, tool: RigidTool) -> tuple[Points, float]:
    """Positions on facets at rest that a tool's path goes through, (n, 3), and how deep [m]."""
    seen = _on_facets(problem)
    least: Floats = np.full(len(seen), np.inf)
    times = np.linspace(tool.path.times[0], tool.path.times[-1], _POSES)
    shape = core_shape(tool.shape)
    for pose in poses_at(tool.path, np.union1d(times, tool.path.times)):
        np.minimum(least, gaps_at(shape, seen, pose).distances, out=least)
    inside = least < 0.0
    return seen[inside], -float(least.min(initial=0.0))


def _radius(tool: RigidTool, number: int) -> float:
    """Radius of a tool, or what stands for it [m]."""
    shape = tool.shape
    if isinstance(shape, SphereShape | CapsuleShape):
        return shape.radius
    if isinstance(shape, BoxShape):
        return float(min(shape.half_widths))
    raise InputError(
        f"tool {number} has no radius that a size of cells could follow from: say how long edges "
        "are to be there"
    )
