"""The law of contact: its form and stiffness, the tools' largest speed, and checks of tools.

Penalty: pressure k max(0, -g). A vertex of mass m and area A then has a frequency of its own, and

    omega^2 <= omega_body^2 + max k A / m,      dt_critical = 2 / omega

(the largest eigenvalue of a sum is at most the sum of the largest). The default stiffness,

    k = min(10 (lambda + 2 mu) / h,  0.5625 omega_body^2 min(m / A)),

presses a layer of cells ten times as much as the gap, or less where the critical step would
shrink by more than a fifth. Under a time step that is given, the second bound is
(0.9 (2 / dt)^2 - omega_body^2) min(m / A).

Speed: before a vertex is turned round, the tool may come a quarter of the way to its own middle
over it, or through a cell, and the vertex itself another quarter (more than that ends the run). It
takes one step with the constraint; under a penalty the time of the vertex' own bounce,
sqrt(m / (k A)), and as far as a wave of speed c loads it, rho c / k (of the material where that is
largest):

    v_max = 0.25 min(half thickness of the tool, smallest cell height) / max(dt, those).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from palpate.fastsim.body import materials_of_cells
from palpate.fastsim.contact.errors import ToolInsideError, ToolTooSmallError
from palpate.fastsim.contact.tool_contact import ToolContact, poses_at
from palpate.fastsim.errors import UnstableStepError
from palpate.meshes.arrays import Floats, Indices, Points
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
from palpate.meshes.tet_mesh import CELL_FACETS, signed_volumes

# Layers of cells that are as stiff as the default penalty.
_LAYERS = 0.1
# Stiffness that shortens the critical step by a fifth: 1 / 0.8^2 - 1.
_PART_OF_SQUARED_FREQUENCY = 0.5625
# Fraction used of the bound that a given time step leaves.
_PART_OF_BOUND = 0.9


class ContactForm(StrEnum):
    """Penalty, or the constraint itself (no vertex inside)."""

    PENALTY = "penalty"
    CONSTRAINT = "constraint"


@dataclass(frozen=True)
class ContactLaw:
    """How contact is enforced.

    Args:
        form: Penalty or constraint.
        stiffness: Penalty stiffness k [Pa/m]; None derives it from material, mesh and time step.
            Not used by the constraint in motion; in statics its multipliers are found with it.

    Raises:
        InputError: A stiffness that is not above 0.
    """

    form: ContactForm = ContactForm.CONSTRAINT
    stiffness: float | None = None

    def __post_init__(self) -> None:
        if self.stiffness is not None and not (
            np.isfinite(self.stiffness) and self.stiffness > 0.0
        ):
            raise InputError(f"contact stiffness = {self.stiffness:g} Pa/m: needs a value above 0")


def layer_stiffness(problem: Problem, facets: Indices) -> float:
    """(lambda + 2 mu) / h [Pa/m], h the mean edge of the contact facets: one layer of cells.

    The stiffest of the cells behind the facets counts.
    """
    behind = np.isin(problem.mesh.cells, facets).sum(axis=1) >= 3
    table, row = materials_of_cells(problem.mesh, problem.material, problem.inclusions)
    lmbda, mu, _, _ = table[row[behind]].T
    return float((lmbda + 2.0 * mu).max()) / mean_edge(problem, facets)


def mean_edge(problem: Problem, facets: Indices) -> float:
    """Mean edge of the contact facets [m]."""
    corners = problem.mesh.points[facets]
    edges = corners - np.roll(corners, 1, axis=1)
    return float(np.linalg.norm(edges, axis=2).mean())


def explicit_stiffness(
    law: ContactLaw,
    layer: float,
    lightest: float,
    critical_time_step: float,
    time_step: float | None,
    *,
    pressing: float = 1.0,
) -> float:
    """Penalty stiffness k [Pa/m] for explicit steps (formula above).

    Args:
        law: A stiffness given in it is used unchanged.
        layer: Stiffness of a layer of cells [Pa/m].
        lightest: Smallest mass per area of the vertices [kg/m2].
        critical_time_step: Critical time step of the body alone [s].
        time_step: Chosen step [s], or None.
        pressing: How many vertices' stiffnesses add up in omega^2.

    Raises:
        UnstableStepError: The step is too long for any penalty.
    """
    if law.stiffness is not None:
        return law.stiffness
    squared = (2.0 / critical_time_step) ** 2
    room = _PART_OF_SQUARED_FREQUENCY * squared
    if time_step is not None:
        room = _PART_OF_BOUND * (2.0 / time_step) ** 2 - squared
        if room <= 0.0:
            raise UnstableStepError(time_step, float(np.sqrt(_PART_OF_BOUND)) * critical_time_step)
    return min(layer / _LAYERS, room * lightest / pressing)


def critical_with_penalty(critical_time_step: float, added: float) -> float:
    """Critical step [s] of a body to whose omega^2 a penalty adds so much [1/s2]."""
    total = (2.0 / critical_time_step) ** 2 + added
    return float(2.0 / np.sqrt(total)) if total > 0.0 else float("inf")


def largest_speed(
    problem: Problem,
    contact: ToolContact,
    mass: Floats,
    time_step: float,
    stiffness: float | None,
) -> float:
    """Relative speed up to which no vertex passes through the tool [m/s] (formula above).

    Args:
        problem: Mesh and material.
        contact: The tool.
        mass: Lumped [kg], shape (num_points,).
        time_step: [s].
        stiffness: Stiffness of the penalty [Pa/m]; None for the constraint.
    """
    duration = time_step
    if stiffness is not None and len(contact.vertices):
        materials, _ = materials_of_cells(problem.mesh, problem.material, problem.inclusions)
        lmbda, mu, _, rho = materials.T
        bounce = float(np.sqrt((mass[contact.vertices] / contact.areas).max() / stiffness))
        impedance = float((rho * np.sqrt((lmbda + 2.0 * mu) / rho)).max())
        duration = max(time_step, bounce, impedance / stiffness)
    way = min(half_thickness(contact.tool.shape), _smallest_height(problem))
    return 0.25 * way / duration


def half_thickness(shape: ToolShape) -> float:
    """Half of the smallest way through a shape [m]; infinite for a half space."""
    match shape:
        case SphereShape() | CapsuleShape():
            return shape.radius
        case BoxShape():
            return min(shape.half_widths)
        case PlaneShape():
            return float("inf")
        case _:
            surface = shape.surface
            return 0.5 * float(_ways_through(surface.points[surface.facets]).min())


def _ways_through(corners: Points) -> Points:
    """Distance from the centre of each facet straight inwards to the next facet [m], (n,).

    Moeller and Trumbore 1997, every facet against every other.
    """
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    inwards = -np.cross(u, v)
    inwards /= np.linalg.norm(inwards, axis=1)[:, None]
    centres = corners.mean(axis=1)
    ways = np.empty(len(corners))
    for k in range(len(corners)):
        p = np.cross(inwards[k], v)
        det = np.sum(u * p, axis=1)
        det[np.abs(det) < 1e-14 * np.abs(det).max()] = np.inf
        s = centres[k] - a
        q = np.cross(s, u)
        first, second = np.sum(s * p, axis=1) / det, q @ inwards[k] / det
        length = np.sum(v * q, axis=1) / det
        hit = (first >= 0.0) & (second >= 0.0) & (first + second <= 1.0) & (length > 0.0)
        hit[k] = False
        ways[k] = length[hit].min(initial=np.inf)
    return ways


def _smallest_height(problem: Problem) -> float:
    """Smallest height of a cell [m]: three volumes over the largest facet."""
    mesh = problem.mesh
    corners = mesh.points[mesh.cells[:, CELL_FACETS]]
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]), axis=2
    )
    return float((3.0 * signed_volumes(mesh.points, mesh.cells) / areas.max(axis=1)).min())


# A tool may overlap the body at the start by this fraction of the mean contact edge.
ALLOWED_OVERLAP = 0.1


def require_outside(
    problem: Problem, contact: ToolContact, number: int, displacement: Points
) -> None:
    """Refuse a tool that is in the body at the first time of its path.

    Raises:
        ToolInsideError: A vertex, or point of a facet, deeper than a tenth of the mean edge, or the
            tool's middle in a cell.
    """
    pose = poses_at(contact.tool.path, contact.tool.path.times[:1])[0]
    allowed = ALLOWED_OVERLAP * mean_edge(problem, contact.facets)
    depths = -contact.gaps(displacement, pose).distances
    if depths.size and depths.max() > allowed:
        worst = int(np.argmax(depths))
        position = contact.sampling.positions(displacement)[worst]
        raise ToolInsideError(number, float(depths[worst]), allowed, _as_tuple(position))
    middle = _middle_points(contact.tool.shape) @ pose["rotation"].T + pose["position"]
    for position in middle:
        if _is_in_a_cell(problem, displacement, position):
            raise ToolInsideError(number, float("inf"), allowed, _as_tuple(position))


def require_larger_than_gaps(problem: Problem, contact: ToolContact, number: int) -> None:
    """Refuse a tool that fits between the corners of a facet in its way.

    Its way is the box around its positions at the knots, widened by its own size; a tool that is
    driven by a force may go anywhere. Averages over facets are no better: a ball of that size dents
    the middle of an equilateral facet by 0.32 radii before one is zero, one of 0.7 goes through.

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


def _is_in_a_cell(problem: Problem, displacement: Points, position: Points) -> bool:
    corners = (problem.mesh.points + displacement)[problem.mesh.cells]
    low, high = corners.min(axis=1), corners.max(axis=1)
    corners = corners[np.all((low <= position) & (position <= high), axis=1)]
    if not len(corners):
        return False
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    weights = np.linalg.solve(edges, (position - corners[:, 0])[:, :, None])[:, :, 0]
    return bool(((weights >= 0.0).all(axis=1) & (weights.sum(axis=1) <= 1.0)).any())


def _as_tuple(position: Points) -> tuple[float, float, float]:
    return float(position[0]), float(position[1]), float(position[2])


def read_pose(
    number: int, position: ArrayLike, rotation: ArrayLike | None
) -> tuple[list[float], list[float] | None]:
    """Check a pose to which a tool is sent: position [m], unit quaternion or None.

    Args:
        number: Number of the tool, from 0.
        position: Position of its origin [m], shape (3,).
        rotation: Unit quaternion (w, x, y, z), shape (4,), or None.

    Raises:
        InputError: The numbers are no pose.
    """
    origin = read_numbers(position, 3, f"position of tool {number + 1}")
    if rotation is None:
        return origin, None
    turn = read_numbers(rotation, 4, f"rotation of tool {number + 1}")
    length = math.hypot(*turn)
    if not abs(length - 1.0) < UNIT_TOLERANCE:
        raise InputError(
            f"the rotation of tool {number + 1} has length {length:g}; give a unit quaternion "
            "(w, x, y, z)"
        )
    return origin, [q / length for q in turn]


def read_numbers(given: ArrayLike, count: int, what: str) -> list[float]:
    """Check `count` finite numbers; faster than arrays where a tool moves at every step."""
    try:
        numbers = [float(number) for number in given]  # type: ignore[union-attr, arg-type]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise InputError(f"{what}: needs {count} finite numbers, got {given!r}")
    return numbers
