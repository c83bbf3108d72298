"""What can be told of a problem before it is solved: cells through it, its error, its cost."""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.body import Body
from palpate.fastsim.explicit_body import SAFETY
from palpate.fastsim.springs import PatchSprings
from palpate.fastsim.viscosity import damped_time_step
from palpate.meshes.field_norms import l2_norm
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh, signed_volumes
from palpate.validation.exchange.nodal_arrays import are_among
from palpate.validation.solving import solve
from palpate.validation.states import CandidateFailedError, State

_MOST_RAYS = 400
# A straight line crosses three tetrahedra of a brick cut in six, of whatever proportions, from side
# to side; and as many equal-sided ones in a height of theirs, in the mean: a mean chord is 4 V / S
# (Cauchy), a third of the height 3 V / (S / 4).
_CROSSED_IN_A_CELL = 3.0


@dataclass(frozen=True)
class Thickness:
    """Of rays from the boundary straight inwards: the lower quartile, where the body is thin.

    Attributes:
        length: From side to side [m].
        num_cells: Layers of cells between the sides [-], a third of the tetrahedra crossed.
        slenderness: How many times as long as high a cell is there [-], the median: the side of a
            square on which six of them fill a brick of a layer's height, over that height.
    """

    length: float
    num_cells: float
    slenderness: float


def measure_thickness(
    mesh: TetMesh, *, held: NDArray[Any] | None = None, seed: int = 0
) -> Thickness:
    """Follow rays from boundary facets inwards, from cell to cell, to the other side.

    Facets are drawn by their area, so that many small ones do not count for more.

    Args:
        mesh: The body.
        held: Facets that supports hold, shape (num_facets, 3): what lies against one does not bend
            that way, so rays count that begin and end elsewhere, where there are any.
        seed: Of the draw.
    """
    neighbours = _neighbours(mesh)
    owners = np.argwhere(neighbours < 0)
    corners = mesh.points[mesh.cells[owners[:, :1], CELL_FACETS[owners[:, 1]]]]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(areas, axis=1)
    rng = np.random.default_rng(seed)
    drawn = rng.choice(len(owners), size=_MOST_RAYS, p=size / size.sum())
    origin, direction = corners[drawn].mean(axis=1), -areas[drawn] / size[drawn, None]
    cell, entered = owners[drawn, 0].copy(), owners[drawn, 1].copy()
    length, count, volume = (np.zeros(len(drawn)) for _ in range(3))
    volumes = signed_volumes(mesh.points, mesh.cells)
    first, last = mesh.cells[cell[:, None], CELL_FACETS[entered]], np.zeros((len(drawn), 3), int)
    inside = np.arange(len(drawn))
    for _ in range(mesh.num_cells):
        if not inside.size:
            break
        here = cell[inside]
        count[inside] += 1
        volume[inside] += volumes[here]
        face, length[inside] = _leave(
            mesh, here, entered[inside], origin[inside], direction[inside]
        )
        beyond = neighbours[here, face]
        last[inside] = mesh.cells[here[:, None], CELL_FACETS[face]]
        goes_on = beyond >= 0
        inside, here, beyond = inside[goes_on], here[goes_on], beyond[goes_on]
        cell[inside] = beyond
        entered[inside] = (neighbours[beyond] == here[:, None]).argmax(axis=1)
    if held is not None and len(held):
        is_free = ~(are_among(first, held) | are_among(last, held))
        if is_free.any():
            length, count, volume = length[is_free], count[is_free], volume[is_free]
    layers = count / _CROSSED_IN_A_CELL
    num_cells = float(np.quantile(layers, 0.25))
    height = length / layers
    slenderness = np.sqrt(6.0 * volume / count / height**3)[layers <= num_cells]
    return Thickness(float(np.quantile(length, 0.25)), num_cells, float(np.median(slenderness)))


def _leave(
    mesh: TetMesh,
    cell: NDArray[Any],
    entered: NDArray[Any],
    origin: NDArray[Any],
    direction: NDArray[Any],
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Facet by which each ray leaves its cell, and how far from its origin that is [m]."""
    corners = mesh.points[mesh.cells[cell][:, CELL_FACETS]]
    normals = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    speed = np.einsum("rfi,ri->rf", normals, direction)
    away = np.einsum("rfi,rfi->rf", normals, corners[:, :, 0] - origin[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(speed > 0.0, away / speed, np.inf)
    far[np.arange(len(cell)), entered] = np.inf
    face = far.argmin(axis=1)
    return face, far[np.arange(len(cell)), face]


def _neighbours(mesh: TetMesh) -> NDArray[Any]:
    """Cell beyond each facet of each cell, -1 on the boundary, shape (num_cells, 4)."""
    facets = np.sort(mesh.cells[:, CELL_FACETS].reshape(-1, 3), axis=1)
    order = np.lexsort(facets.T)
    ordered = facets[order]
    first = np.flatnonzero((ordered[1:] == ordered[:-1]).all(axis=1))
    beyond = np.full(len(facets), -1)
    one, other = order[first], order[first + 1]
    beyond[one], beyond[other] = other // 4, one // 4
    return beyond.reshape(-1, 4)


STUDY = "palpate study elements"


def expected_error(
    num_cells: float, slenderness: float, poissons_ratio: float, element: Element
) -> float:
    """Part of the displacement in bending that is missing [-], 0 to 1.

    Args:
        num_cells: Through the thickness, > 0.
        slenderness: Length of a cell, across the thickness, over its height, > 0.
        poissons_ratio: Below 0.5; of negative ones as of 0.
        element: Whose tetrahedra.
    """
    nu, a, n = max(poissons_ratio, 0.0), slenderness, num_cells
    x = 2.0 * nu / (1.0 - 2.0 * nu)
    if element is Element.LINEAR:
        k = (2.0 + 1.4 * a**2 + x) / n**2
    else:
        k = 0.5 * a**2.3 / n**3 + 1.4 * x / (28.0 + x) * a**1.5 / n**2
    return k / (1.0 + k)


ORDER = 1.5
# Cut in eight some three seconds; more cells are not worth the wait.
MOST_CELLS = 10_000


def guess_errors(problem: Problem) -> dict[Element, float] | None:
    """Part of the displacement that each element misses, relative L2 over the mesh's points [-].

    Args:
        problem: Statics without tools, which linear solves know nothing of.

    Returns:
        None where there is no guess: a motion, a tool, more than `MOST_CELLS` cells, nothing that
        moves, or no answer with linear strain.
    """
    mesh = problem.mesh
    if problem.time is not None or problem.tools or mesh.num_cells > MOST_CELLS:
        return None
    both = (problem, refine_problem(problem))
    try:
        coarse, fine = (
            solve(each, strain=Strain.LINEAR, element=Element.SMOOTHED).displacement
            for each in both
        )
        linear = solve(problem, strain=Strain.LINEAR).displacement
    except CandidateFailedError:
        return None
    # The given points come first.
    fine = fine[: mesh.num_points]
    converged = fine + (fine - coarse) / (2.0**ORDER - 1.0)
    size = l2_norm(mesh, converged)
    if size == 0.0:
        return None
    answers = {Element.LINEAR: linear, Element.SMOOTHED: coarse}
    return {who: l2_norm(mesh, found - converged) / size for who, found in answers.items()}


def edge_that_would_do(error: float, limit: float) -> float:
    """Length of edges for an error within the limit, over that of now [-], by the same rate."""
    return float((limit / error) ** (1.0 / ORDER))


# A Newton solve in linear ones: 3 to 12 on the built-in kidney, beam and block.
_NEWTON = 8.0
# Seconds of the reference at 20 000 unknowns; 9 s (kidney) and 40 s (beam) were measured there.
_REFERENCE_SECONDS, _REFERENCE_UNKNOWNS, _REFERENCE_POWER = 20.0, 20_000, 1.2
_REFERENCE_START = 1.0
# Bytes of a block of 3 x 3 with its index, in the matrix and again in what is made of it.
_FAST_BLOCK, _REFERENCE_BLOCK = 2 * 76, 4 * 108
_BASE_BYTES = 100e6
# Nodes that share a cell with one, of quadratic tetrahedra.
_QUADRATIC_NEIGHBOURS = 28


@dataclass(frozen=True, eq=False)
class Costs:
    """Before solving.

    Attributes:
        critical_time_step: Of explicit steps about rest [s].
        num_steps: Of a motion, explicitly; 0 in statics.
        num_unknowns: Of linear tetrahedra.
        num_quadratic_unknowns: Of the truth on the same mesh.
        fast_seconds: Of fastsim with Green strain, None where nothing could be measured.
        fast_bytes: Its memory.
        truth_seconds: Of one quadratic solve by the reference; None for a motion.
        truth_bytes: Its memory.
        linear: The answer with linear strain, where it was quick: None for motions, tools.
        trouble: Why there is none though it was tried.
    """

    critical_time_step: float
    num_steps: int
    num_unknowns: int
    num_quadratic_unknowns: int
    fast_seconds: float | None
    fast_bytes: float
    truth_seconds: float | None
    truth_bytes: float
    linear: State | None = None
    trouble: str = ""


def expected_costs(problem: Problem) -> Costs:
    """Measure a step or a linear solve, and reckon from there."""
    body = Body.of(problem)
    mesh, span = problem.mesh, problem.time
    springs = PatchSprings(mesh.points, problem.springs) if problem.springs else None
    critical = damped_time_step(
        body.critical_time_step(springs=springs), 0.0 if span is None else span.stiffness_damping
    )
    ends = mesh.cells[:, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]].reshape(-1, 2)
    low, high = ends.min(axis=1).astype(np.int64), ends.max(axis=1)
    num_edges = len(np.unique(low * mesh.num_points + high))
    num_nodes = mesh.num_points + num_edges
    linear, trouble, num_steps, seconds = None, "", 0, None
    if span is not None:
        step = span.time_step or SAFETY * critical
        num_steps = math.ceil(span.end_time / step)
        seconds = num_steps * _seconds_of_force(body)
    elif not problem.tools:
        try:
            linear = solve(dataclasses.replace(problem, time=None), strain=Strain.LINEAR)
            seconds = _NEWTON * linear.seconds
        except CandidateFailedError as error:
            trouble = str(error)
    ratio = 3 * num_nodes / _REFERENCE_UNKNOWNS
    truth = _REFERENCE_START + _REFERENCE_SECONDS * ratio**_REFERENCE_POWER
    return Costs(
        critical_time_step=critical,
        num_steps=num_steps,
        num_unknowns=3 * mesh.num_points,
        num_quadratic_unknowns=3 * num_nodes,
        fast_seconds=seconds,
        fast_bytes=_BASE_BYTES + _FAST_BLOCK * (mesh.num_points + 2 * num_edges),
        truth_seconds=truth if span is None else None,
        truth_bytes=_BASE_BYTES + _REFERENCE_BLOCK * _QUADRATIC_NEIGHBOURS * num_nodes,
        linear=linear,
        trouble=trouble,
    )


def _seconds_of_force(body: Body) -> float:
    """Of the internal forces, which are most of a step; the best of three."""
    rest = np.zeros_like(body.mesh.points)
    best = math.inf
    for _ in range(3):
        start = time.perf_counter()
        body.internal_force(rest)
        best = min(best, time.perf_counter() - start)
    return best
