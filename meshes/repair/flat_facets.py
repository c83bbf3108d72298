"""Facets without area between points that are apart: the edge across is flipped, nothing moves."""

from __future__ import annotations

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.facet_topology import edge_uses

# Height over the longest edge below which a facet is flat: some roundings of single precision.
_FLAT = 1e-6
_MOST_PASSES = 10


def flip_flat_facets(points: Points, facets: Indices) -> tuple[Indices, int]:
    """Flip the longest edge of each flat facet, where its neighbour across is not flat as well.

    Args:
        points: [m].
        facets: Consistently oriented, at most two at an edge.

    Returns:
        Facets, as many as before, and how many edges were flipped.
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
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
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
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    return float((area / sides**2).min())
