"""Triangles of a boundary: their areas, and which of them are among others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points


def area_vectors(points: Points, facets: Indices) -> Points:
    """Outward, as long as the area [m2], (num_facets, 3)."""
    a, b, c = (points[facets[:, k]] for k in range(3))
    vectors: Points = 0.5 * np.cross(b - a, c - a)
    return vectors


def facet_areas(points: Points, facets: Indices) -> Points:
    """Area of each facet [m2], (num_facets,)."""
    areas: Points = np.linalg.norm(area_vectors(points, facets), axis=1)
    return areas


def are_among(facets: Indices, others: Indices) -> NDArray[np.bool_]:
    """Which facets are among others, whatever the order of their corners, (num_facets,)."""
    known = {tuple(row) for row in np.sort(others, axis=1).tolist()}
    rows = np.sort(facets, axis=1).tolist()
    return np.array([tuple(row) in known for row in rows], dtype=bool)
