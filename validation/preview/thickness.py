"""How many cells lie between one side of a body and the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.quality import edge_lengths
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh

_MOST_RAYS = 400


@dataclass(frozen=True)
class Thickness:
    """Of the median ray from the boundary straight inwards.

    Attributes:
        length: From side to side [m].
        num_edges: In mean edge lengths of the cells on the way [-].
    """

    length: float
    num_edges: float


def measure_thickness(mesh: TetMesh, *, seed: int = 0) -> Thickness:
    """Follow rays from boundary facets inwards, from cell to cell, to the other side.

    Facets are drawn by their area, so that many small ones do not count for more.
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
    length, edges, count = np.zeros(len(drawn)), np.zeros(len(drawn)), np.zeros(len(drawn))
    means = edge_lengths(mesh.points, mesh.cells).mean(axis=1)
    inside = np.arange(len(drawn))
    for _ in range(mesh.num_cells):
        if not inside.size:
            break
        here = cell[inside]
        edges[inside] += means[here]
        count[inside] += 1
        face, length[inside] = _leave(
            mesh, here, entered[inside], origin[inside], direction[inside]
        )
        beyond = neighbours[here, face]
        goes_on = beyond >= 0
        inside, here, beyond = inside[goes_on], here[goes_on], beyond[goes_on]
        cell[inside] = beyond
        entered[inside] = (neighbours[beyond] == here[:, None]).argmax(axis=1)
    return Thickness(float(np.median(length)), float(np.median(length * count / edges)))


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
