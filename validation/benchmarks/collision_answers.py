"""Whether tools found the same: pairs by number, and which of them truly lie within the distance.

Distances are computed here in NumPy, by none of the code that is timed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points

Pairs = NDArray[np.int64]
Flags = NDArray[np.bool_]


def keys_of(pairs: NDArray[np.generic]) -> Pairs:
    """One number for each row of whole numbers, ascending, each once."""
    rows = np.asarray(pairs, dtype=np.int64)
    keys = rows[:, 0] if rows.shape[1] == 1 else rows[:, 0] << 32 | rows[:, 1]
    unique: Pairs = np.unique(keys)
    return unique


def rows_of(keys: Pairs) -> Pairs:
    """The pairs that `keys_of` numbered, shape (n, 2)."""
    return np.column_stack([keys >> 32, keys & 0xFFFFFFFF])


def point_segment_squared(p: Points, a: Points, b: Points) -> NDArray[np.float64]:
    """Squared distances of points from segments [m2]."""
    ab = b - a
    squared = np.einsum("ij,ij->i", ab, ab)
    t = np.einsum("ij,ij->i", p - a, ab) / np.where(squared > 0.0, squared, 1.0)
    gap = p - a - np.clip(t, 0.0, 1.0)[:, None] * ab
    distances: NDArray[np.float64] = np.einsum("ij,ij->i", gap, gap)
    return distances


def vertices_within(p: Points, corners: Points, distance: float) -> Flags:
    """Which vertices (n, 3) lie within a distance of their triangles (n, 3, 3)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    best = np.minimum(point_segment_squared(p, a, b), point_segment_squared(p, b, c))
    best = np.minimum(best, point_segment_squared(p, c, a))
    normal = np.cross(b - a, c - a)
    squared = np.einsum("ij,ij->i", normal, normal)
    is_over = np.ones(len(p), dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        is_over &= np.einsum("ij,ij->i", np.cross(end - start, p - start), normal) >= 0.0
    height = np.einsum("ij,ij->i", p - a, normal) ** 2 / np.where(squared > 0.0, squared, 1.0)
    best = np.where(is_over & (squared > 0.0), np.minimum(best, height), best)
    within: Flags = best <= distance**2
    return within


def edges_within(first: Points, second: Points, distance: float) -> Flags:
    """Which edges (n, 2, 3) lie within a distance of each other."""
    a, b, c, d = first[:, 0], first[:, 1], second[:, 0], second[:, 1]
    best = np.minimum(point_segment_squared(a, c, d), point_segment_squared(b, c, d))
    best = np.minimum(best, point_segment_squared(c, a, b))
    best = np.minimum(best, point_segment_squared(d, a, b))
    # Both ends of each on different sides of the plane through the other and the common normal.
    normal = np.cross(b - a, d - c)
    squared = np.einsum("ij,ij->i", normal, normal)
    across = np.cross(b - a, normal)
    other = np.cross(d - c, normal)

    def side(p: Points, origin: Points, plane: Points) -> NDArray[np.float64]:
        sides: NDArray[np.float64] = np.einsum("ij,ij->i", p - origin, plane)
        return sides

    crosses = (side(c, a, across) * side(d, a, across) <= 0.0) & (
        side(a, c, other) * side(b, c, other) <= 0.0
    )
    gap = side(c, a, normal) ** 2 / np.where(squared > 0.0, squared, 1.0)
    best = np.where(crosses & (squared > 0.0), np.minimum(best, gap), best)
    within: Flags = best <= distance**2
    return within
