"""How many cells lie between one side of a body and the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh, signed_volumes
from palpate.validation.exchange.nodal_arrays import are_among

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
