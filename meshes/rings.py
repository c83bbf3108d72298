"""Triangulated bands between rings of points: the pattern behind caps, tubes and ovals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points


def stitch_rings(lower: NDArray[np.int64], upper: NDArray[np.int64]) -> list[list[int]]:
    """Triangulate the band between two closed rings that start at the same angle.

    Both rings are evenly spaced and run counter-clockwise seen from above; the facets face
    outwards of the band. Walks up both at once, each time closing the shorter diagonal.

    Args:
        lower: Point indices of the lower ring, at least 1 (1 makes a fan).
        upper: Point indices of the upper ring, at least 1.
    """
    low, up = len(lower), len(upper)
    facets: list[list[int]] = []
    i = j = 0
    while i < (low if low > 1 else 0) or j < (up if up > 1 else 0):
        next_low, next_up = (i + 1) / low, (j + 1) / up
        advance_low = low > 1 and i < low and (up == 1 or j >= up or next_low <= next_up)
        if advance_low:
            facets.append([int(lower[i % low]), int(lower[(i + 1) % low]), int(upper[j % up])])
            i += 1
        else:
            facets.append([int(lower[i % low]), int(upper[(j + 1) % up]), int(upper[j % up])])
            j += 1
    return facets


def flip_to_delaunay(points: Points, facets: Indices, max_passes: int = 20) -> Indices:
    """Flip edges whose two opposite angles sum to more than pi, until none is left.

    Raises the smallest angles; the surface stays closed, and no edge is made twice.
    """
    triangles = facets.astype(np.int64).copy()
    for _ in range(max_passes):
        directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        place = {(int(a), int(b)): k for k, (a, b) in enumerate(directed)}
        cosines = _corner_cosines(points, triangles)
        touched = np.zeros(len(triangles), dtype=bool)
        flipped = 0
        for (a, b), k in place.items():
            if a > b:
                continue
            opposite = place[(b, a)]
            (s, side), (t, other) = divmod(k, 3), divmod(opposite, 3)
            if touched[s] or touched[t]:
                continue
            # Opposite angles alpha + beta > pi  <=>  cos alpha + cos beta < 0.
            if cosines[s, (side + 2) % 3] + cosines[t, (other + 2) % 3] >= -1e-12:
                continue
            c = int(triangles[s, (side + 2) % 3])
            d = int(triangles[t, (other + 2) % 3])
            if (c, d) in place or (d, c) in place:
                continue
            triangles[s] = (c, a, d)
            triangles[t] = (d, b, c)
            touched[s] = touched[t] = True
            flipped += 1
        if flipped == 0:
            break
    result: Indices = triangles.astype(np.int32)
    return result


def _corner_cosines(points: Points, facets: NDArray[np.int64]) -> Floats:
    """Cosine of the angle at each corner, shape (num_facets, 3)."""
    corners = points[facets]
    to_next = corners[:, [1, 2, 0]] - corners
    to_last = corners[:, [2, 0, 1]] - corners
    dots = np.einsum("ijk,ijk->ij", to_next, to_last)
    cosines: Floats = dots / (
        np.linalg.norm(to_next, axis=2) * np.linalg.norm(to_last, axis=2) + np.finfo(float).tiny
    )
    return cosines
