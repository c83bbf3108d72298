"""Polygons of any number of corners, cut into triangles between their own corners.

Quadrilaterals are cut along the shorter of the diagonals that lie inside; others by clipping ears
(Meisters 1975, "Polygons have ears"), in the plane of their vector area, the sum of
x_i cross x_(i+1) / 2 over the edges (Newell). No point is added, so that a neighbour's edge is
still an edge, whether or not the corners are in one plane.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.errors import MeshError

# Clipping ears takes the square of the number of corners.
MOST_CORNERS = 2000

Indices = NDArray[np.int64]


class PolygonError(MeshError):
    """A polygon that no triangles between its corners fill; `.polygon` are its corners."""

    def __init__(self, polygon: Indices, reason: str) -> None:
        self.polygon = tuple(int(corner) for corner in polygon)
        listed = ", ".join(map(str, self.polygon[:8])) + (", ..." if len(polygon) > 8 else "")
        super().__init__(
            f"the polygon of {len(self.polygon)} corners with the points {listed} {reason}"
        )


def cut_into_triangles(points: Points, polygons: Iterable[Indices]) -> Indices:
    """Triangles that fill the polygons, in their order and orientation.

    A corner that is named twice in a row counts once; what is left with two corners has no area
    and no triangle.

    Args:
        points: Shape (num_points, 3).
        polygons: Blocks of polygons of as many corners each, shape (m, corners); all indices are
            within the points.

    Returns:
        Triangles, shape (n, 3).

    Raises:
        PolygonError: One whose edges cross, or of more than `MOST_CORNERS` corners.
    """
    found = [np.zeros((0, 3), dtype=np.int64)]
    for block in polygons:
        corners = block.shape[1]
        if corners == 3:
            found.append(block)
            continue
        is_whole = (block != np.roll(block, -1, axis=1)).all(axis=1)
        if corners == 4:
            found.append(_cut_quadrilaterals(points, block[is_whole]))
        else:
            found += [_clip_ears(points, polygon) for polygon in block[is_whole]]
        for polygon in block[~is_whole]:
            rest = polygon[polygon != np.roll(polygon, -1)]
            if len(rest) >= 3:
                found.append(cut_into_triangles(points, [rest[None]]))
    return np.concatenate(found)


def _cut_quadrilaterals(points: Points, quads: Indices) -> Indices:
    a, b, c, d = points[quads].transpose(1, 0, 2)
    normal = np.cross(c - a, d - b)  # twice the vector area

    def is_turned(p: Points, q: Points, r: Points) -> NDArray[np.bool_]:
        turned: NDArray[np.bool_] = np.einsum("ni,ni->n", np.cross(q - p, r - p), normal) > 0.0
        return turned

    by_ac = is_turned(a, b, c) & is_turned(a, c, d)
    by_bd = is_turned(a, b, d) & is_turned(b, c, d)
    if not (by_ac | by_bd).all():
        worst = quads[np.flatnonzero(~(by_ac | by_bd))[0]]
        raise PolygonError(worst, "crosses itself or has no area")
    is_shorter = ((c - a) ** 2).sum(axis=1) <= ((d - b) ** 2).sum(axis=1)
    choice = (by_ac & (is_shorter | ~by_bd))[:, None]
    first = np.where(choice, quads[:, [0, 1, 2]], quads[:, [0, 1, 3]])
    second = np.where(choice, quads[:, [0, 2, 3]], quads[:, [1, 2, 3]])
    triangles: Indices = np.stack([first, second], axis=1).reshape(-1, 3)
    return triangles


def _clip_ears(points: Points, polygon: Indices) -> Indices:
    """Always the ear with the largest smallest angle that is left."""
    if len(polygon) > MOST_CORNERS:
        raise PolygonError(polygon, f"has more than {MOST_CORNERS} of them; split it first")
    x = points[polygon] - points[polygon].mean(axis=0)
    normal = np.cross(x, np.roll(x, -1, axis=0)).sum(axis=0)
    if not np.linalg.norm(normal) > 0.0:
        raise PolygonError(polygon, "has no area")
    flat = _in_plane(x, normal)
    if _crosses_itself(flat):
        raise PolygonError(polygon, "crosses itself")
    left = list(range(len(polygon)))
    quality = {k: _ear(flat, left, k) for k in range(len(left))}
    triangles = []
    while len(left) > 3:
        best = max(range(len(left)), key=lambda at: quality[left[at]])
        if not quality[left[best]] > 0.0:
            raise PolygonError(polygon, "crosses itself")
        before, after = left[best - 1], left[(best + 1) % len(left)]
        triangles.append((before, left[best], after))
        del left[best]
        for corner in (before, after):
            quality[corner] = _ear(flat, left, left.index(corner))
    triangles.append((left[0], left[1], left[2]))
    cut: Indices = polygon[np.array(triangles)]
    return cut


def _in_plane(x: Points, normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coordinates in the plane across the normal, anticlockwise about it; (n, 2)."""
    normal = normal / np.linalg.norm(normal)
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first /= np.linalg.norm(first)
    flat: NDArray[np.float64] = x @ np.stack([first, np.cross(normal, first)], axis=1)
    return flat


def _crosses_itself(flat: NDArray[np.float64]) -> bool:
    """Whether two edges cross between their ends."""
    start, end = flat, np.roll(flat, -1, axis=0)
    for p, q in zip(start, end, strict=True):
        sides = _cross(q - p, start - p) * _cross(q - p, end - p)
        others = _cross(end - start, p - start) * _cross(end - start, q - start)
        if ((sides < 0.0) & (others < 0.0)).any():
            return True
    return False


def _ear(flat: NDArray[np.float64], left: list[int], at: int) -> float:
    """Sine of the smallest angle of the triangle at a corner; 0 where it cannot be cut off."""
    p, q, r = flat[left[at - 1]], flat[left[at]], flat[left[(at + 1) % len(left)]]
    twice = _cross(q - p, r - p)
    if not twice > 0.0:
        return 0.0
    others = flat[
        [k for k in left if k not in (left[at - 1], left[at], left[(at + 1) % len(left)])]
    ]
    if len(others):
        is_inside = np.ones(len(others), dtype=bool)
        for start, end in ((p, q), (q, r), (r, p)):
            is_inside &= _cross(end - start, others - start) >= 0.0
        # A corner in the same position as one of these is another pass through it, not inside.
        for corner in (p, q, r):
            is_inside &= (others != corner).any(axis=1)
        if is_inside.any():
            return 0.0
    sides = sorted(
        (float(np.hypot(*(q - p))), float(np.hypot(*(r - q))), float(np.hypot(*(p - r))))
    )
    return float(twice) / (sides[1] * sides[2])


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    product: NDArray[np.float64] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product
