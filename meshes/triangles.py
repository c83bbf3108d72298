"""Triangles on points: normals, areas, sides; their common edges, fans and connected parts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Integers, Points


def facet_normals(corners: Points) -> Points:
    """Normals (x1 - x0) x (x2 - x0) of triangles, twice their area long [m2], (..., 3).

    Of corners [m], shape (..., 3, 3); outward where they run counter-clockwise seen from outside.
    """
    start = corners[..., 0, :]
    return np.cross(corners[..., 1, :] - start, corners[..., 2, :] - start)


def facet_areas(corners: Points) -> Floats:
    """Areas of triangles [m2], shape (num_facets,), from corners [m], (num_facets, 3, 3)."""
    areas: Floats = 0.5 * np.linalg.norm(facet_normals(corners), axis=1)
    return areas


def side_lengths(corners: Points) -> Floats:
    """Lengths of the sides 01, 12 and 20 of triangles [m], (n, 3), from corners [m], (n, 3, 3)."""
    lengths: Floats = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    return lengths


def normals_at_points(points: Points, facets: Indices) -> Points:
    """Sum of the `facet_normals` around each point [m2], shape (num_points, 3)."""
    total = np.zeros_like(points)
    np.add.at(total, facets, facet_normals(points[facets])[:, None, :])
    return total


def unit_normals_at_points(points: Points, facets: Indices) -> Points:
    """`normals_at_points` of length 1, or 0 where they cancel [-], shape (num_points, 3)."""
    total = normals_at_points(points, facets)
    size = np.linalg.norm(total, axis=1, keepdims=True)
    units: Points = total / np.where(size > 0.0, size, 1.0)
    return units


@dataclass(frozen=True, eq=False)
class EdgeUses:
    """The three directed edges of each facet, and which of them lie on the same undirected edge.

    Row 3 f + k is the edge of facet f from its corner k to its corner k + 1.

    Attributes:
        directed: The two points of each row, shape (3 num_facets, 2).
        owner: Facet of each row, shape (3 num_facets,).
        edge: Number of the undirected edge of each row, shape (3 num_facets,).
        counts: Number of rows of each undirected edge, shape (num_edges,).
        edges: Points of each undirected edge, ascending, shape (num_edges, 2).
    """

    directed: Integers
    owner: Integers
    edge: Integers
    counts: Integers
    edges: Integers

    @cached_property
    def by_edge(self) -> Integers:
        """Rows in the order of their edges, shape (3 num_facets,)."""
        return np.argsort(self.edge, kind="stable")

    @property
    def crowd(self) -> Integers:
        """Number of uses of the edge of each row, shape (3 num_facets,)."""
        return self.counts[self.edge]

    @property
    def plain_pairs(self) -> Integers:
        """The two rows of each edge that two facets use, shape (num_such_edges, 2)."""
        pairs: Integers = self.by_edge[self.crowd[self.by_edge] == 2].reshape(-1, 2)
        return pairs

    @property
    def neighbours(self) -> Integers:
        """Pairs of facets with a common edge, shape (num_pairs, 2): a chain for each edge."""
        edge, owner = self.edge[self.by_edge], self.owner[self.by_edge]
        pairs: Integers = np.column_stack([owner[:-1], owner[1:]])[edge[1:] == edge[:-1]]
        return pairs


def edge_uses(facets: Indices) -> EdgeUses:
    """Table of the edges of facets, shape (num_facets, 3)."""
    directed = facets.astype(np.int64)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    # One number for a pair of points sorts much faster than the pair.
    base = int(facets.max(initial=0)) + 1
    keys, edge, counts = np.unique(
        directed.min(axis=1) * base + directed.max(axis=1), return_inverse=True, return_counts=True
    )
    edges = np.column_stack(np.divmod(keys, base))
    owner = np.repeat(np.arange(len(facets), dtype=np.int64), 3)
    return EdgeUses(directed, owner, edge.reshape(-1), counts, edges)


def connected_parts(num_items: int, pairs: Integers) -> Integers:
    """Part of each item of a graph, 0, 1, ... in the order of their first items.

    `pairs` are connected items, shape (num_pairs, 2).
    """
    # Hook the larger root below the smaller one, then shorten all paths (Shiloach, Vishkin 1982).
    parent = np.arange(num_items)
    while True:
        a, b = parent[pairs[:, 0]], parent[pairs[:, 1]]
        apart = a != b
        if not apart.any():
            break
        np.minimum.at(parent, np.maximum(a, b)[apart], np.minimum(a, b)[apart])
        while True:
            shorter = parent[parent]
            if np.array_equal(shorter, parent):
                break
            parent = shorter
    parts: Integers = np.unique(parent, return_inverse=True)[1].reshape(-1)
    return parts


def facet_parts(facets: Indices, uses: EdgeUses | None = None) -> Integers:
    """Part of each facet, where those with a common edge belong together; `uses` is their table."""
    uses = edge_uses(facets) if uses is None else uses
    return connected_parts(len(facets), uses.neighbours)


def parts_by_plain_edges(uses: EdgeUses) -> Integers:
    """Part of each facet, where facets belong together across an edge that only they share."""
    return connected_parts(len(uses.owner) // 3, uses.owner[uses.plain_pairs])


def points_with_several_fans(facets: Indices, uses: EdgeUses | None = None) -> Integers:
    """Points at which sheets touch: their facets form more than one closed fan.

    Facets are closed, edge-manifold and consistently oriented; `uses` is their table of edges.
    """
    uses = edge_uses(facets) if uses is None else uses
    # The two uses of an edge, as rows of `directed`.
    first, second = uses.by_edge.reshape(-1, 2).T
    opposite = np.empty(len(uses.edge), dtype=np.int64)
    opposite[first], opposite[second] = second, first
    # Around a point, from corner k of a facet over the facet's side k - 1 -> k.
    corner = np.arange(len(uses.edge))
    before = corner - 1 + 3 * (corner % 3 == 0)
    after = opposite[before]
    label = corner.copy()
    # Pointer doubling: after n rounds a label is the smallest of 2^n corners ahead.
    while True:
        smaller = np.minimum(label, label[after])
        if np.array_equal(smaller, label):
            break
        label, after = smaller, after[after]
    # Each fan has one corner that is its own label.
    fans = np.bincount(facets.reshape(-1)[label == corner], minlength=1)
    return np.flatnonzero(fans > 1)
