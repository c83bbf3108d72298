"""Where points lie in a tetrahedral mesh or on a surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh

Rows = NDArray[np.int64]
Distance = Callable[[Rows, Rows], Points]
# Places that go down the tree together: bounds the memory.
_CHUNK = 2048
_BITS = 20


class BoxTree:
    """Boxes of items: which of them hold a place, and which item is nearest to it.

    Args:
        low: Smallest corner of each item's box [m], (num_items, 3), finite; one item or more.
        high: Largest corner, likewise.
        inner: A place of each item itself [m], (num_items, 3); needed for `nearest` alone.
    """

    def __init__(self, low: Points, high: Points, inner: Points | None = None) -> None:
        self._largest = float(max(np.abs(low).max(), np.abs(high).max()))
        order = _along_curve(0.5 * (low + high))
        count, self._depth = len(low), max(len(low) - 1, 0).bit_length()
        leaves = 2**self._depth
        self._items = np.full(leaves, -1)
        self._items[:count] = order
        # Node k has the children 2k and 2k + 1; the root is 1, an empty box holds nothing.
        self._low = np.full((2 * leaves, 3), np.inf)
        self._high = np.full((2 * leaves, 3), -np.inf)
        self._inner = np.full((2 * leaves, 3), np.inf)
        self._low[leaves : leaves + count] = low[order]
        self._high[leaves : leaves + count] = high[order]
        if inner is not None:
            self._inner[leaves : leaves + count] = inner[order]
        for level in range(self._depth - 1, -1, -1):
            nodes = np.arange(2**level, 2 ** (level + 1))
            left, right = 2 * nodes, 2 * nodes + 1
            self._low[nodes] = np.minimum(self._low[left], self._low[right])
            self._high[nodes] = np.maximum(self._high[left], self._high[right])
            self._inner[nodes] = self._inner[left]

    def holding(self, places: Points) -> tuple[Rows, Rows]:
        """Every place with every item whose box holds it: two arrays of the same length."""
        found = [(np.zeros(0, dtype=np.int64),) * 2]
        for rows in _in_chunks(len(places)):
            who, nodes = self._descend(places[rows])
            found.append((rows[who], self._items[nodes - len(self._items)]))
        return np.concatenate([w for w, _ in found]), np.concatenate([i for _, i in found])

    def nearest(self, places: Points, distance: Distance, within: Points | None = None) -> Rows:
        """The item nearest to each place, (num_places,); of equals the first.

        Args:
            places: [m], (num_places, 3), finite.
            distance: Of places from items [m], both given by number, (n,) each.
            within: No farther than this is an item known to be [m], (num_places,): where that is
                near, much less has to be looked at.
        """
        nearest = np.empty(len(places), dtype=np.int64)
        for rows in _in_chunks(len(places)):
            some = places[rows]
            known = np.full(len(some), np.inf) if within is None else within[rows]
            who, nodes = self._descend(some, known)
            items = self._items[nodes - len(self._items)]
            # The likeliest first: most others are then too far by their boxes.
            order = np.lexsort([_length(some[who] - self._inner[nodes]), who])
            likely = order[_starts(who)]
            bound = distance(rows, items[likely])
            kept = self._apart(some[who], nodes) <= bound[who] + self._rounding(some)
            who, items = who[kept], items[kept]
            apart = distance(rows[who], items)
            order = np.lexsort([items, apart, who])
            nearest[rows] = items[order[_starts(who)]]
        return nearest

    def _descend(self, places: Points, known: Points | None = None) -> tuple[Rows, Rows]:
        """Places, in order, with the leaves that hold them; that may be nearest where told how far.

        `known` is how far the nearest is at most [m], (num_places,).
        """
        who, nodes = np.arange(len(places)), np.ones(len(places), dtype=np.int64)
        for level in range(self._depth + 1):
            if level:
                who, nodes = np.repeat(who, 2), np.repeat(2 * nodes, 2)
                nodes[1::2] += 1
            bound = np.zeros(len(places))
            if known is not None:
                to_inner = _length(places[who] - self._inner[nodes])
                nearest = np.minimum(np.minimum.reduceat(to_inner, _starts(who)), known)
                bound = nearest + self._rounding(places)
            kept = self._apart(places[who], nodes) <= bound[who]
            who, nodes = who[kept], nodes[kept]
        return who, nodes

    def _rounding(self, places: Points) -> float:
        """What a distance may be off: an item's inner place may lie a hair outside of its box."""
        return 64.0 * float(np.finfo(float).eps) * max(self._largest, float(np.abs(places).max()))

    def _apart(self, places: Points, nodes: Rows) -> Points:
        """Distance from each place to its box, infinite for an empty one."""
        outside = np.maximum(self._low[nodes] - places, places - self._high[nodes])
        return _length(np.maximum(outside, 0.0))


def _in_chunks(count: int) -> list[Rows]:
    return [np.arange(start, min(start + _CHUNK, count)) for start in range(0, count, _CHUNK)]


def _starts(who: Rows) -> Rows:
    """Where each run of equal numbers begins."""
    return np.flatnonzero(np.concatenate([[True], who[1:] != who[:-1]]))


def _length(vectors: Points) -> Points:
    length: Points = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return length


def _along_curve(places: Points) -> Rows:
    """Order along a Morton curve: the bits of three whole numbers, one after the other."""
    size = float(np.ptp(places, axis=0).max()) or 1.0
    steps = ((places - places.min(axis=0)) / size * (2**_BITS - 1)).astype(np.int64)
    code = np.zeros(len(steps), dtype=np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            code |= ((steps[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Nearest:
    """The nearest place on a surface.

    Attributes:
        facets: Number of the facet, (num_places,).
        weights: Barycentric coordinates in it, (num_places, 3), each in 0..1.
        distances: [m], (num_places,).
    """

    facets: NDArray[np.int64]
    weights: Array
    distances: Points


def nearest_on_surface(
    places: Points,
    points: Points,
    facets: Indices | NDArray[np.int64],
    within: Points | None = None,
) -> Nearest:
    """Find the nearest place on any facet.

    Args:
        places: [m], (num_places, 3), finite.
        points: Of the surface [m], (num_points, 3).
        facets: One or more, (num_facets, 3).
        within: No farther than this is the surface known to be [m], (num_places,).
    """
    corners = points[facets]
    tree = BoxTree(corners.min(axis=1), corners.max(axis=1), corners.mean(axis=1))
    chosen = tree.nearest(
        places, lambda who, items: _on_triangles(places[who], corners[items])[1], within
    )
    weights, distances = _on_triangles(places, corners[chosen])
    return Nearest(chosen, weights, distances)


def _on_triangles(places: Points, corners: Array) -> tuple[Array, Points]:
    """Weights and distance of the nearest place of a triangle each: (n, 3), (n,)."""
    a, b, c = (corners[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    squared = np.einsum("ij,ij->i", normal, normal)
    has_area = squared > 0.0
    squared = np.where(has_area, squared, 1.0)
    w = places - a
    v_b = np.einsum("ij,ij->i", np.cross(w, c - a), normal) / squared
    v_c = np.einsum("ij,ij->i", np.cross(b - a, w), normal) / squared
    weights = np.column_stack([1.0 - v_b - v_c, v_b, v_c])
    to_plane = np.abs(np.einsum("ij,ij->i", w, normal)) / np.sqrt(squared)
    best = np.where(has_area & (weights.min(axis=1) >= 0.0), to_plane, np.inf)
    for start, end in ((0, 1), (1, 2), (2, 0)):
        fraction, distance = _on_segments(places, corners[:, start], corners[:, end])
        nearer = distance < best
        best = np.where(nearer, distance, best)
        on_edge = np.zeros((len(places), 3))
        on_edge[:, start], on_edge[:, end] = 1.0 - fraction, fraction
        weights = np.where(nearer[:, None], on_edge, weights)
    return weights, best


def _on_segments(places: Points, start: Points, end: Points) -> tuple[Points, Points]:
    along = end - start
    squared = np.einsum("ij,ij->i", along, along)
    fraction = np.einsum("ij,ij->i", places - start, along) / np.where(squared > 0.0, squared, 1.0)
    fraction = np.clip(fraction, 0.0, 1.0)
    return fraction, np.linalg.norm(places - start - fraction[:, None] * along, axis=1)


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
