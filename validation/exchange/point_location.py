"""Where points lie in a tetrahedral mesh or nearest on a surface, and linear fields read there.

Of the cells that hold a point that one counts in which it lies deepest. A point in no cell is
outside: the nearest point of the boundary takes its part. Cells and facets are searched by the
spheres around them, in one k-d tree for each size.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh

Rows = NDArray[np.int64]
# Barycentric coordinates this far below 0 still count as inside: rounding on shared facets.
_INSIDE = -1e-9
# Points that are searched together: bounds the memory.
_CHUNK = 2048
# Coordinates beyond this are taken for this by the trees, which square distances [m].
_LARGEST = 1e150


@dataclass(frozen=True, eq=False)
class Location:
    """Points in a mesh.

    Attributes:
        cells: Cell of each point, (num_positions,).
        weights: Barycentric coordinates in it, each in 0..1, (num_positions, 4).
        distances: Distance outside the mesh [m], 0 inside, (num_positions,).
    """

    cells: Rows
    weights: Floats
    distances: Points

    def read(self, mesh_cells: Indices | Rows, field: Points) -> Points:
        """A linear field, (num_points, ...), at these points."""
        corners = field[mesh_cells[self.cells]]
        read: Points = np.einsum("pa,pa...->p...", self.weights, corners)
        return read


@dataclass(frozen=True, eq=False)
class Nearest:
    """The nearest points of a surface.

    Attributes:
        facets: Number of the facet, (num_positions,).
        weights: Barycentric coordinates in it, (num_positions, 3), each in 0..1.
        distances: [m], (num_positions,).
    """

    facets: Rows
    weights: Floats
    distances: Points


def locate(points: Points, cells: Indices | Rows, positions: Points) -> Location:
    """Find the cell that contains each of some points.

    Args:
        points: Points of the mesh [m], (num_points, 3).
        cells: Its tetrahedra, (num_cells, 4), none flat.
        positions: Positions that are located [m], (num_positions, 3), finite.
    """
    corners = points[cells]
    inverse = np.linalg.inv((corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1))
    found, weights = np.full(len(positions), -1), np.zeros((len(positions), 4))
    for searched, tried in _within_reach(positions, np.zeros(len(positions)), corners):
        inner = np.einsum("pij,pj->pi", inverse[tried], positions[searched] - corners[tried, 0])
        tried_weights = np.column_stack([1.0 - inner.sum(axis=1), inner])
        depth = tried_weights.min(axis=1)
        order = np.lexsort([tried, -depth, searched])
        order = order[depth[order] >= _INSIDE]
        rows, first = np.unique(searched[order], return_index=True)
        found[rows], weights[rows] = tried[order[first]], tried_weights[order[first]]
    distances = np.zeros(len(positions))
    outside = np.flatnonzero(found < 0)
    if outside.size:
        facets = cells[:, CELL_FACETS].reshape(-1, 3)
        _, first, count = np.unique(
            np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True
        )
        boundary = first[count == 1]
        nearest = nearest_on_surface(positions[outside], points, facets[boundary])
        chosen = boundary[nearest.facets]
        found[outside], distances[outside] = chosen // 4, nearest.distances
        weights[outside[:, None], CELL_FACETS[chosen % 4]] = nearest.weights
    weights = np.clip(weights, 0.0, None)
    return Location(found, weights / weights.sum(axis=1, keepdims=True), distances)


@lru_cache(maxsize=4)
def locate_points(mesh: TetMesh, other: TetMesh) -> Location:
    """Where the points of another mesh lie in this one; the last few are cached."""
    return locate(mesh.points, mesh.cells, other.points)


def nearest_on_surface(
    positions: Points, points: Points, facets: Indices | Rows, within: Points | None = None
) -> Nearest:
    """Find the nearest point on any facet; of equally near facets the first.

    Args:
        positions: Positions from which is searched [m], (num_positions, 3), finite.
        points: Points of the surface [m], (num_points, 3).
        facets: One or more, (num_facets, 3).
        within: No farther than this is the surface known to be [m], (num_positions,).
    """
    from scipy.spatial import cKDTree

    corners = points[facets]
    tree = cKDTree(_bounded(corners.mean(axis=1)))
    likely = tree.query(_bounded(positions))[1] if len(positions) else []
    reach = _on_triangles(positions, corners[likely])[1]
    if within is not None:
        reach = np.minimum(reach, within)
    chosen = np.zeros(len(positions), dtype=np.int64)
    for searched, tried in _within_reach(positions, reach, corners):
        order = np.lexsort([tried, _on_triangles(positions[searched], corners[tried])[1], searched])
        rows, first = np.unique(searched[order], return_index=True)
        chosen[rows] = tried[order[first]]
    weights, distances = _on_triangles(positions, corners[chosen])
    return Nearest(chosen, weights, distances)


def _within_reach(positions: Points, reach: Points, corners: Floats) -> Iterator[tuple[Rows, Rows]]:
    """Points with the items whose spheres come within their reach, some points at a time.

    Args:
        positions: Positions [m], (num_positions, 3).
        reach: Reach of each position [m], (num_positions,).
        corners: Corners of the items, which lie between them [m], (num_items, 3 or 4, 3).

    Yields:
        Numbers of points and of items, one of each for every pair. Rounding adds a few that lie
        just outside, and loses none.
    """
    from scipy.spatial import cKDTree

    if not len(positions):
        return
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    largest = max(float(np.abs(corners).max()), float(np.abs(positions).max()))
    # What `_INSIDE` allows, and rounding.
    radii = (1.0 + 1e-7) * radii + 64.0 * float(np.finfo(float).eps) * largest
    # One tree for items of one power of two: a few large ones widen no search among small ones.
    sizes = np.frexp(radii)[1]
    kinds = [np.flatnonzero(sizes == size) for size in np.unique(sizes)]
    trees = [cKDTree(_bounded(centres[items])) for items in kinds]
    for start in range(0, len(positions), _CHUNK):
        some = positions[start : start + _CHUNK]
        pairs = []
        for items, tree in zip(kinds, trees, strict=True):
            far = reach[start : start + _CHUNK] + radii[items].max()
            near = tree.query_ball_point(_bounded(some), np.minimum(far, 4.0 * _LARGEST))
            counts = np.array([len(found) for found in near])
            rows = np.repeat(np.arange(len(some)), counts)
            tried = items[np.fromiter(itertools.chain.from_iterable(near), np.int64, counts.sum())]
            apart = np.linalg.norm(some[rows] - centres[tried], axis=1)
            is_near = apart <= reach[start + rows] + radii[tried]
            pairs.append((start + rows[is_near], tried[is_near]))
        yield np.concatenate([rows for rows, _ in pairs]), np.concatenate([i for _, i in pairs])


def _bounded(positions: Points) -> Points:
    """Positions whose squared distances are finite: none is farther from another than it was."""
    bounded: Points = np.clip(positions, -_LARGEST, _LARGEST)
    return bounded


def _on_triangles(positions: Points, corners: Floats) -> tuple[Floats, Points]:
    """Weights and distance of the nearest point of a triangle each: (n, 3), (n,)."""
    a, b, c = (corners[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    squared = np.einsum("ij,ij->i", normal, normal)
    has_area = squared > 0.0
    squared = np.where(has_area, squared, 1.0)
    w = positions - a
    v_b = np.einsum("ij,ij->i", np.cross(w, c - a), normal) / squared
    v_c = np.einsum("ij,ij->i", np.cross(b - a, w), normal) / squared
    weights = np.column_stack([1.0 - v_b - v_c, v_b, v_c])
    to_plane = np.abs(np.einsum("ij,ij->i", w, normal)) / np.sqrt(squared)
    best = np.where(has_area & (weights.min(axis=1) >= 0.0), to_plane, np.inf)
    for start, end in ((0, 1), (1, 2), (2, 0)):
        along = corners[:, end] - corners[:, start]
        from_start = positions - corners[:, start]
        length = np.einsum("ij,ij->i", along, along)
        fraction = np.einsum("ij,ij->i", from_start, along) / np.where(length > 0.0, length, 1.0)
        fraction = np.clip(fraction, 0.0, 1.0)
        distance = np.linalg.norm(from_start - fraction[:, None] * along, axis=1)
        nearer = distance < best
        best = np.where(nearer, distance, best)
        on_edge = np.zeros((len(positions), 3))
        on_edge[:, start], on_edge[:, end] = 1.0 - fraction, fraction
        weights = np.where(nearer[:, None], on_edge, weights)
    return weights, best
