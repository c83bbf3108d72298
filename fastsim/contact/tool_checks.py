"""What a tool may not be before a run begins, inside the body or too small; and what is no pose."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from palpate.fastsim.contact.contact_law import half_thickness, mean_edge
from palpate.fastsim.contact.errors import ToolInsideError, ToolTooSmallError
from palpate.fastsim.contact.tool_contact import ToolContact, poses_at
from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.rigid_tool import (
    UNIT_TOLERANCE,
    BoxShape,
    CapsuleShape,
    PlaneShape,
    SphereShape,
    ToolShape,
)

# A tool may overlap the body at the start by this part of the mean edge where it may touch.
ALLOWED_OVERLAP = 0.1


def require_outside(
    problem: Problem, contact: ToolContact, number: int, displacement: Points
) -> None:
    """Refuse a tool that is in the body at the first time of its path.

    Raises:
        ToolInsideError: A vertex deeper than a tenth of the mean edge, or the tool's middle in a
            cell.
    """
    pose = poses_at(contact.tool.path, contact.tool.path.times[:1])[0]
    allowed = ALLOWED_OVERLAP * mean_edge(problem, contact.facets)
    depths = -contact.gaps(displacement, pose).distances
    if depths.size and depths.max() > allowed:
        worst = int(np.argmax(depths))
        place = contact.places(displacement)[worst]
        raise ToolInsideError(number, float(depths[worst]), allowed, _as_tuple(place))
    middle = _middle_points(contact.tool.shape) @ pose["rotation"].T + pose["position"]
    for place in middle:
        if _is_in_a_cell(problem, displacement, place):
            raise ToolInsideError(number, float("inf"), allowed, _as_tuple(place))


def require_larger_than_gaps(problem: Problem, contact: ToolContact, number: int) -> None:
    """Refuse a tool that fits between the corners of a facet in its way.

    The way is the box around the tool's poses at its knots, wider by its own size; a tool that is
    driven by a force may go anywhere.

    Raises:
        ToolTooSmallError: Its half thickness is below the radius of such a facet's circle.
    """
    thin = half_thickness(contact.tool.shape)
    corners = problem.mesh.points[contact.facets]
    a, b, c = (np.linalg.norm(corners[:, k] - corners[:, k - 1], axis=1) for k in range(3))
    area = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    radius = a * b * c / (4.0 * area)
    if contact.tool.drive is None and np.isfinite(thin):
        reach = farthest(contact.tool.shape)
        low = contact.tool.path.positions.min(axis=0) - reach
        high = contact.tool.path.positions.max(axis=0) + reach
        is_near = np.all((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high), axis=1)
        radius = radius[is_near]
    if radius.size and thin < radius.max():
        raise ToolTooSmallError(number, thin, float(radius.max()))


def farthest(shape: ToolShape) -> float:
    """Distance of the tool's farthest point from its origin [m]; infinite for a half space."""
    match shape:
        case SphereShape():
            return shape.radius
        case CapsuleShape():
            return shape.radius + shape.half_length
        case BoxShape():
            return float(np.linalg.norm(shape.half_widths))
        case PlaneShape():
            return float("inf")
        case _:
            return float(np.linalg.norm(shape.surface.points, axis=1).max())


def _middle_points(shape: ToolShape) -> Points:
    """Points in the tool, in its own frame; none in a half space, which is inside everywhere."""
    match shape:
        case CapsuleShape():
            return np.array([[0.0, 0.0, z * shape.half_length] for z in (-1.0, 0.0, 1.0)])
        case SphereShape() | BoxShape():
            return np.zeros((1, 3))
        case PlaneShape():
            return np.zeros((0, 3))
        case _:
            return np.array(shape.surface.points[:1])


def _is_in_a_cell(problem: Problem, displacement: Points, place: Points) -> bool:
    corners = (problem.mesh.points + displacement)[problem.mesh.cells]
    low, high = corners.min(axis=1), corners.max(axis=1)
    corners = corners[np.all((low <= place) & (place <= high), axis=1)]
    if not len(corners):
        return False
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    weights = np.linalg.solve(edges, (place - corners[:, 0])[:, :, None])[:, :, 0]
    return bool(((weights >= 0.0).all(axis=1) & (weights.sum(axis=1) <= 1.0)).any())


def _as_tuple(place: Points) -> tuple[float, float, float]:
    return float(place[0]), float(place[1]), float(place[2])


def read_pose(
    number: int, position: ArrayLike, rotation: ArrayLike | None
) -> tuple[list[float], list[float] | None]:
    """A pose that somebody sends a tool to: position [m], unit quaternion or None.

    Args:
        number: Of the tool, from 0.
        position: Of its origin [m], shape (3,).
        rotation: Unit quaternion (w, x, y, z), shape (4,), or None.

    Raises:
        InputError: The numbers are no pose.
    """
    place = read_numbers(position, 3, f"position of tool {number + 1}")
    if rotation is None:
        return place, None
    turn = read_numbers(rotation, 4, f"rotation of tool {number + 1}")
    length = math.hypot(*turn)
    if not abs(length - 1.0) < UNIT_TOLERANCE:
        raise InputError(
            f"the rotation of tool {number + 1} has length {length:g}; give a unit quaternion "
            "(w, x, y, z)"
        )
    return place, [q / length for q in turn]


def read_numbers(given: ArrayLike, count: int, what: str) -> list[float]:
    """So many finite numbers; quicker than arrays for a loop that moves a tool at every step."""
    try:
        numbers = [float(number) for number in given]  # type: ignore[union-attr, arg-type]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise InputError(f"{what}: needs {count} finite numbers, got {given!r}")
    return numbers
