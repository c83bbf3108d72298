"""TriSurface: a triangulated surface, and the checks that it bounds a solid."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.meshes.arrays import Indices, Points, checked_indices, checked_points


@dataclass(frozen=True, eq=False)
class TriSurface:
    """Triangles on points; arrays are checked, closedness is not (see `surface_checks`).

    Args:
        points: Positions [m], shape (num_points, 3), finite.
        facets: Point indices, shape (num_facets, 3), counter-clockwise seen from outside.

    Raises:
        ShapeError, NonFiniteError, IndexRangeError: The arrays cannot be used.

    >>> import palpate
    >>> corner = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    >>> facets = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    >>> round(6.0 * palpate.TriSurface(corner, facets).volume, 12)
    1.0
    """

    points: Points
    facets: Indices

    def __post_init__(self) -> None:
        points = checked_points(self.points)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "facets", checked_indices(self.facets, 3, len(points), "facets"))

    @property
    def num_facets(self) -> int:
        """Number of triangles."""
        return len(self.facets)

    @cached_property
    def area_vectors(self) -> Points:
        """Half the cross product of two edges of each facet [m2], shape (num_facets, 3)."""
        a, b, c = (self.points[self.facets[:, k]] for k in range(3))
        vectors: Points = 0.5 * np.cross(b - a, c - a)
        return vectors

    @cached_property
    def area(self) -> float:
        """Total area [m2]."""
        return float(np.linalg.norm(self.area_vectors, axis=1).sum())

    @cached_property
    def volume(self) -> float:
        """Volume inside a closed surface by the divergence theorem [m3]; < 0 if turned inward.

        Summed about the centre of the points, so that a far-off origin costs no digits.
        """
        if self.num_facets == 0:
            return 0.0
        centre = self.points.mean(axis=0)
        height = (self.points - centre)[self.facets].mean(axis=1)
        return float(np.einsum("ij,ij->", height, self.area_vectors) / 3.0)
