"""Where places lie in a tetrahedral mesh, and linear fields read there.

1. Cells are entered into the voxels of a uniform grid that their boxes touch.
2. Each place tries the cells of its voxel and takes the one that holds it.
3. A place in no cell is outside: the nearest point of the nearest cells takes its part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points

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
    low, high = corners.min(axis=1), corners.max(axis=1)
    grid = _Grid(low, high)
    found = np.full(len(places), -1)
    weights = np.zeros((len(places), 4))
    starts, counts = grid.candidates(places)
    for nth in range(int(counts.max(initial=0))):
        rows = np.flatnonzero((found < 0) & (counts > nth))
        if not rows.size:
            break
        tried = grid.entries[starts[rows] + nth]
        bary = _barycentric(corners[tried], places[rows])
        inside = bary.min(axis=1) >= _INSIDE
        found[rows[inside]] = tried[inside]
        weights[rows[inside]] = bary[inside]
    distances = np.zeros(len(places))
    for row in np.flatnonzero(found < 0):
        found[row], weights[row], distances[row] = _nearest(corners, low, high, places[row])
    weights = np.clip(weights, 0.0, None)
    weights /= weights.sum(axis=1, keepdims=True)
    return Location(found, weights, distances)


class _Grid:
    """Cells by the voxels that their boxes touch."""

    def __init__(self, low: Points, high: Points) -> None:
        self._origin = low.min(axis=0)
        self._size = float((high - low).mean()) or 1.0
        self._shape = np.maximum(
            1, np.ceil((high.max(axis=0) - self._origin) / self._size + 1e-9).astype(np.int64)
        )
        first, last = self._voxel(low), self._voxel(high)
        spans = last - first + 1
        per_cell = spans.prod(axis=1)
        owner = np.repeat(np.arange(len(low)), per_cell)
        within = np.arange(len(owner)) - np.repeat(np.cumsum(per_cell) - per_cell, per_cell)
        ny, nz = spans[owner, 1], spans[owner, 2]
        steps = np.column_stack([within // (ny * nz), within // nz % ny, within % nz])
        keys = self._key(first[owner] + steps)
        order = np.argsort(keys, kind="stable")
        self.entries = owner[order]
        self._keys = keys[order]

    def candidates(self, places: Points) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Where in `entries` the cells of each place's voxel start, and how many there are."""
        voxels = np.floor((places - self._origin) / self._size).astype(np.int64)
        # A place on the far face belongs to the last voxel.
        on_grid = ((voxels >= -1) & (voxels <= self._shape)).all(axis=1)
        keys = self._key(np.clip(voxels, 0, self._shape - 1))
        start = np.searchsorted(self._keys, keys, side="left")
        count = np.searchsorted(self._keys, keys, side="right") - start
        return start, np.where(on_grid, count, 0)

    def _voxel(self, places: Points) -> NDArray[np.int64]:
        voxels = np.floor((places - self._origin) / self._size).astype(np.int64)
        inside: NDArray[np.int64] = np.clip(voxels, 0, self._shape - 1)
        return inside

    def _key(self, voxels: NDArray[np.int64]) -> NDArray[np.int64]:
        strides = np.array([self._shape[1] * self._shape[2], self._shape[2], 1])
        key: NDArray[np.int64] = np.asarray(voxels @ strides, dtype=np.int64)
        return key


def _barycentric(corners: NDArray[np.float64], places: Points) -> NDArray[np.float64]:
    edges = corners[:, 1:] - corners[:, :1]
    rest = np.linalg.solve(edges.transpose(0, 2, 1), (places - corners[:, 0])[..., None])[..., 0]
    return np.column_stack([1.0 - rest.sum(axis=1), rest])


def _nearest(
    corners: NDArray[np.float64], low: Points, high: Points, place: Points
) -> tuple[int, NDArray[np.float64], float]:
    """Nearest cell by its box, then the nearest point in it: some cells more than the best box."""
    box = np.linalg.norm(np.maximum(np.maximum(low - place, place - high), 0.0), axis=1)
    best = (0, np.zeros(4), np.inf)
    for cell in np.argsort(box)[:64]:
        if box[cell] > best[2]:
            break
        weights, distance = _nearest_in_cell(corners[cell], place)
        if distance < best[2]:
            best = (int(cell), weights, distance)
    return best


def _nearest_in_cell(
    corners: NDArray[np.float64], place: Points
) -> tuple[NDArray[np.float64], float]:
    """Nearest point of a tetrahedron: the best over its faces' planes, edges and corners."""
    best_weights, best = np.zeros(4), np.inf
    for subset in _SUBSETS:
        base, others = corners[subset[0]], corners[list(subset[1:])]
        inner = np.zeros(0)
        if len(others):
            edges = (others - base).T
            inner = np.linalg.lstsq(edges, place - base, rcond=None)[0]
        shares = np.concatenate([[1.0 - inner.sum()], inner])
        if shares.min() < -1e-12:
            continue
        distance = float(np.linalg.norm(shares @ corners[list(subset)] - place))
        if distance < best:
            best, best_weights = distance, np.zeros(4)
            best_weights[list(subset)] = shares
    return best_weights, best


_SUBSETS = tuple(tuple(k for k in range(4) if mask >> k & 1) for mask in range(1, 16))
