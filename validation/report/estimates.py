"""Estimates for a problem before it is solved: cells through its thickness, and its error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.field_norms import l2_norm
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh, signed_volumes
from palpate.validation.exchange.nodal_arrays import are_among
from palpate.validation.solving import solve
from palpate.validation.states import CandidateFailedError

_MOST_RAYS = 400
# A straight line from side to side of a brick of any proportions, cut in six tetrahedra, crosses
# three of them; on average it also crosses three equilateral ones in one of their heights: a mean
# chord is 4 V / S (Cauchy), a third of the height 3 V / (S / 4).
_CROSSED_IN_A_CELL = 3.0


@dataclass(frozen=True)
class Thickness:
    """Where the body is thin: lower quartile over rays from the boundary straight inwards.

    Attributes:
        length: Distance from side to side [m].
        num_cells: Layers of cells between the sides [-], a third of the tetrahedra crossed.
        slenderness: Median ratio of length to height of the cells there [-]: the side of a square
            on which six of them fill a brick of a layer's height, over that height.
        num_between: Layers of cells between clamps that face each other [-]: the lower quartile
            over rays that begin and end on clamped facets; None where there are none.
    """

    length: float
    num_cells: float
    slenderness: float
    num_between: float | None = None


def measure_thickness(
    mesh: TetMesh,
    *,
    fixed: NDArray[Any] | None = None,
    clamped: NDArray[Any] | None = None,
    seed: int = 0,
) -> Thickness:
    """Follow rays from boundary facets inwards, from cell to cell, to the other side.

    Facets are sampled by their area, so that many small ones do not count for more. A body does not
    bend towards a support: only rays count that begin and end elsewhere than on `fixed` facets,
    (num_facets, 3), where there are any. `clamped` are those of them that cannot slide.
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
    between = None
    if clamped is not None and len(clamped):
        is_between = are_among(first, clamped) & are_among(last, clamped)
        if is_between.any():
            between = float(np.quantile(count[is_between] / _CROSSED_IN_A_CELL, 0.25))
    if fixed is not None and len(fixed):
        is_free = ~(are_among(first, fixed) | are_among(last, fixed))
        if is_free.any():
            length, count, volume = length[is_free], count[is_free], volume[is_free]
    layers = count / _CROSSED_IN_A_CELL
    num_cells = float(np.quantile(layers, 0.25))
    height = length / layers
    slenderness = np.sqrt(6.0 * volume / count / height**3)[layers <= num_cells]
    thin = float(np.quantile(length, 0.25))
    return Thickness(thin, num_cells, float(np.median(slenderness)), between)


def _leave(
    mesh: TetMesh,
    cell: NDArray[Any],
    entered: NDArray[Any],
    origin: NDArray[Any],
    direction: NDArray[Any],
) -> tuple[NDArray[Any], NDArray[Any]]:
    """The facet by which each ray leaves its cell, and its distance from the origin [m]."""
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
    """The fraction of the displacement in bending that is missing [-], 0 to 1.

    By cells through the thickness, length of a cell across it over its height, and Poisson's ratio,
    of which negative ones are taken as 0.
    """
    nu, a, n = max(poissons_ratio, 0.0), slenderness, num_cells
    x = 2.0 * nu / (1.0 - 2.0 * nu)
    if element is Element.LINEAR:
        k = (2.0 + 1.4 * a**2 + x) / n**2
    else:
        k = 0.5 * a**2.3 / n**3 + 1.4 * x / (28.0 + x) * a**1.5 / n**2
    return k / (1.0 + k)


ORDER = 1.5
# This many cells, cut in eight, take some three seconds; more are not worth the wait.
MOST_CELLS = 10_000


def guess_errors(problem: Problem) -> dict[Element, float] | None:
    """The fraction of the displacement that each element misses, relative L2 over the points [-].

    None where there is no guess: a motion, a tool, more than `MOST_CELLS` cells, nothing that
    moves, or no solution with linear strain.
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
    # The points of the given mesh come first.
    fine = fine[: mesh.num_points]
    converged = fine + (fine - coarse) / (2.0**ORDER - 1.0)
    size = l2_norm(mesh, converged)
    if size == 0.0:
        return None
    answers = {Element.LINEAR: linear, Element.SMOOTHED: coarse}
    return {who: l2_norm(mesh, found - converged) / size for who, found in answers.items()}


def edge_that_would_do(error: float, limit: float) -> float:
    """The edge length for an error within the limit, over the present one [-], by one rate."""
    return float((limit / error) ** (1.0 / ORDER))
