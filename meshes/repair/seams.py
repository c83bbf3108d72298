"""Seams that do not quite meet: rim points merged, edges cut at points on them, edges flipped.

Bodies made of patches, and files of unconnected facets, have rims that run along each other with
different points, or with the same points a little apart.
"""

from __future__ import annotations

import itertools

import numpy as np

from palpate.meshes.arrays import Indices, Integers, Points
from palpate.meshes.surface_checks import find_near_duplicates
from palpate.meshes.triangles import edge_uses, facet_normals, side_lengths

# Points on rims within this fraction of the shortest edge at either of them are merged.
_WELD = 0.01
_MOST_PASSES = 10


def rim_pairs(points: Points, facets: Indices) -> Integers:
    """Pairs of points on open edges that are so near to each other that they must be the same."""
    uses = edge_uses(facets)
    rim = np.unique(uses.edges[uses.counts == 1])
    if not len(rim):
        return np.zeros((0, 2), dtype=np.int64)
    lengths = np.linalg.norm(points[uses.edges[:, 0]] - points[uses.edges[:, 1]], axis=1)
    shortest = np.full(len(points), np.inf)
    for end in range(2):
        np.minimum.at(shortest, uses.edges[:, end], lengths)
    # `find_near_duplicates` refuses far more points within this reach than a seam has.
    reach = _WELD * float(np.median(shortest[rim]))
    pairs = rim[find_near_duplicates(points[rim], reach)]
    apart = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    found: Integers = pairs[apart <= _WELD * shortest[pairs].min(axis=1)]
    return found


def cut_at_hanging_points(
    points: Points, facets: Indices, reach: float
) -> tuple[Indices, Integers, int]:
    """Cut facets whose open edge runs through points of other open edges.

    Such a point is within `reach` [m] of the edge. Returns the facets, the number of each before,
    and how many edges were cut.
    """
    kept, count = np.arange(len(facets)), 0
    for _ in range(_MOST_PASSES):
        uses = edge_uses(facets)
        sides = np.flatnonzero(uses.crowd == 1)
        # One side of each facet at a time.
        through = _points_within(points, uses.directed[sides], reach)
        first: dict[int, tuple[int, list[int]]] = {}
        for side, inner in zip(sides.tolist(), through, strict=True):
            apex = int(facets[side // 3, (side % 3 + 2) % 3])
            inner = [v for v in inner if v != apex]
            if inner and side // 3 not in first:
                first[side // 3] = side % 3, inner
        if not first:
            break
        rows, owners = [], []
        for f, (k, inner) in first.items():
            a, b, c = (int(facets[f, (k + i) % 3]) for i in range(3))
            chain = [a, *inner, b]
            rows += [(u, v, c) for u, v in itertools.pairwise(chain)]
            owners += [int(kept[f])] * (len(chain) - 1)
        stays = np.ones(len(facets), dtype=bool)
        stays[list(first)] = False
        facets = np.vstack([facets[stays], np.array(rows, dtype=np.int32)])
        kept = np.concatenate([kept[stays], owners])
        count += len(first)
    return facets, kept, count


def _points_within(points: Points, edges: Integers, reach: float) -> list[list[int]]:
    """For each edge the points of other edges on it, in order from its start to its end."""
    rim = np.unique(edges)
    rim = rim[np.argsort(points[rim, 0], kind="stable")]
    x = points[rim, 0]
    a, b = points[edges[:, 0]], points[edges[:, 1]]
    first = np.searchsorted(x, np.minimum(a[:, 0], b[:, 0]) - reach)
    last = np.searchsorted(x, np.maximum(a[:, 0], b[:, 0]) + reach, side="right")
    found: list[list[int]] = []
    for start, along, low, high in zip(a, b - a, first.tolist(), last.tolist(), strict=True):
        length = float(np.linalg.norm(along))
        if length <= 4.0 * reach:
            found.append([])
            continue
        offset = points[rim[low:high]] - start
        part = offset @ along / length
        off = np.linalg.norm(offset - np.outer(part / length, along), axis=1)
        on = np.flatnonzero((off <= reach) & (part > 2.0 * reach) & (part < length - 2.0 * reach))
        found.append(rim[low:high][on[np.argsort(part[on], kind="stable")]].tolist())
    return found


# A facet is flat below this height over its longest edge: some roundings of single precision.
_FLAT = 1e-6


def flip_flat_facets(points: Points, facets: Indices) -> tuple[Indices, int]:
    """Flip the longest edge of each flat facet unless its neighbour there is flat as well.

    Facets are consistently oriented, at most two at an edge. Returns as many, and how many edges
    were flipped.
    """
    out = facets.copy()
    count = 0
    for _ in range(_MOST_PASSES):
        flipped = _flip_once(points, out)
        if not flipped:
            break
        count += flipped
    return out, count


def _flip_once(points: Points, facets: Indices) -> int:
    corners = points[facets]
    sides = side_lengths(corners)
    area = np.linalg.norm(facet_normals(corners), axis=1)
    flat = np.flatnonzero(area <= _FLAT * sides.max(axis=1) ** 2)
    if not len(flat):
        return 0
    uses = edge_uses(facets)
    sides_of = {(int(a), int(b)): row for row, (a, b) in enumerate(uses.directed)}
    touched: set[int] = set()
    count = 0
    for f in flat.tolist():
        k = int(np.argmax(sides[f]))
        a, b, c = (int(facets[f, (k + i) % 3]) for i in range(3))
        row = sides_of.get((b, a))
        if row is None or uses.counts[uses.edge[3 * f + k]] != 2:
            continue
        g = row // 3
        d = int(facets[g, (row % 3 + 2) % 3])
        is_new = (c, d) not in sides_of and (d, c) not in sides_of
        if {f, g} & touched or not is_new or c == d:
            continue
        made = [(c, a, d), (d, b, c)]
        if _smallest(points, made) <= _smallest(points, [(a, b, c), (b, a, d)]):
            continue
        facets[f], facets[g] = made
        touched |= {f, g}
        count += 1
    return count


def _smallest(points: Points, facets: list[tuple[int, int, int]]) -> float:
    """Smallest area over longest edge squared."""
    corners = points[np.array(facets)]
    area = np.linalg.norm(facet_normals(corners), axis=1)
    return float((area / side_lengths(corners).max(axis=1) ** 2).min())
