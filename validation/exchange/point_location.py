"""Where places lie in a tetrahedral mesh, and linear fields read there.

Of the cells whose boxes hold a place that one holds it in which it lies deepest. A place in no
cell is outside: the nearest place of the boundary takes its part.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh
from palpate.validation.exchange.box_tree import BoxTree
from palpate.validation.exchange.surface_search import nearest_on_surface

# Barycentric coordinates this far below 0 still count as inside: rounding on shared facets.
_INSIDE = -1e-9


@dataclass(frozen=True, eq=False)
class Location:
    """Places in a mesh.

    Attributes:
        cells: Cell of each place, (num_places,).
        weights: Barycentric coordinates in it, each in 0..1, (num_places, 4).
        distances: Distance outside the mesh [m], 0 inside, (num_places,).
    """

    cells: NDArray[np.int64]
    weights: NDArray[np.float64]
    distances: Points

    def read(self, mesh_cells: Indices | NDArray[np.int64], field: Points) -> Points:
        """A linear field, (num_points, ...), at the places."""
        corners = field[mesh_cells[self.cells]]
        read: Points = np.einsum("pa,pa...->p...", self.weights, corners)
        return read


def locate(points: Points, cells: Indices | NDArray[np.int64], places: Points) -> Location:
    """Find the cell that holds each place.

    Args:
        points: Of the mesh [m], (num_points, 3).
        cells: Its tetrahedra, (num_cells, 4), none flat.
        places: [m], (num_places, 3), finite.
    """
    corners = points[cells]
    edges = corners[:, 1:] - corners[:, :1]
    inverse = np.linalg.inv(edges.transpose(0, 2, 1))
    low, high = corners.min(axis=1), corners.max(axis=1)
    # As far out as `_INSIDE` allows, and rounding.
    slack = 1e-8 * (high - low).max(axis=1, keepdims=True)
    who, tried = BoxTree(low - slack, high + slack).holding(places)
    inner = np.einsum("pij,pj->pi", inverse[tried], places[who] - corners[tried, 0])
    weights = np.column_stack([1.0 - inner.sum(axis=1), inner])
    depth = weights.min(axis=1)
    order = np.lexsort([tried, -depth, who])
    order = order[depth[order] >= _INSIDE]
    held, first = np.unique(who[order], return_index=True)
    found = np.full(len(places), -1)
    coordinates, distances = np.zeros((len(places), 4)), np.zeros(len(places))
    found[held], coordinates[held] = tried[order[first]], weights[order[first]]
    outside = np.flatnonzero(found < 0)
    if outside.size:
        found[outside], coordinates[outside], distances[outside] = _nearest(
            points, cells, places[outside]
        )
    coordinates = np.clip(coordinates, 0.0, None)
    coordinates /= coordinates.sum(axis=1, keepdims=True)
    return Location(found, coordinates, distances)


@lru_cache(maxsize=4)
def locate_points(mesh: TetMesh, other: TetMesh) -> Location:
    """Where the points of another mesh lie in this one; the last few are remembered."""
    return locate(mesh.points, mesh.cells, other.points)


def _nearest(
    points: Points, cells: Indices | NDArray[np.int64], places: Points
) -> tuple[NDArray[np.int64], NDArray[np.float64], Points]:
    """Cell, weights in it and distance of the nearest place of the boundary."""
    facets = cells[:, CELL_FACETS].reshape(-1, 3)
    _, first, count = np.unique(
        np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True
    )
    boundary = first[count == 1]
    found = nearest_on_surface(places, points, facets[boundary])
    chosen = boundary[found.facets]
    weights = np.zeros((len(places), 4))
    rows = np.arange(len(places))[:, None]
    weights[rows, CELL_FACETS[chosen % 4]] = found.weights
    return chosen // 4, weights, found.distances
