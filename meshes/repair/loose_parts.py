"""Loose parts of a surface, by their size: crumbs of a segmentation beside the organ."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.facet_topology import facet_parts

# Of the longest side of the surface's largest part: what is smaller is told to the user.
SMALL = 0.05


def part_sizes(points: Points, facets: Indices) -> tuple[NDArray[np.int64], Floats]:
    """Part of each facet, and the longest side of each part's box [m]."""
    part = facet_parts(facets)
    count = int(part.max(initial=-1)) + 1
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, part, points[facets].min(axis=1))
    np.maximum.at(high, part, points[facets].max(axis=1))
    return part, (high - low).max(axis=1, initial=0.0)


def loose_facets(points: Points, facets: Indices, smallest: float) -> NDArray[np.bool_]:
    """Facets of parts whose box is shorter than `smallest` [m]; the largest part is never one."""
    part, sizes = part_sizes(points, facets)
    is_small = sizes < smallest
    if len(sizes):
        is_small[np.argmax(sizes)] = False
    found: NDArray[np.bool_] = is_small[part]
    return found
