"""What mesher and remesher both need of a surface before the core sees it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.meshes.arrays import Indices, Points
from palpate.meshes.errors import SelfIntersectionError
from palpate.meshes.tri_surface import TriSurface


def compact_facets(surface: TriSurface) -> tuple[NDArray[np.int32], Indices]:
    """Points that facets use, ascending, and the facets numbered by them, shape (num_facets, 3)."""
    used = np.unique(surface.facets)
    renumber = np.full(len(surface.points), -1, dtype=np.int32)
    renumber[used] = np.arange(len(used), dtype=np.int32)
    return used, np.ascontiguousarray(renumber[surface.facets])


def mean_edge_length(points: Points, facets: Indices) -> float:
    """Mean over the facets' sides [m]; each edge of a closed surface counts twice."""
    corners = points[facets]
    return float(np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).mean())


def require_no_self_intersection(points: Points, facets: Indices, *, most: int) -> None:
    """Refuse facets that meet anywhere but at shared corners and edges, by exact tests.

    Args:
        points: [m], shape (num_points, 3).
        facets: Shape (num_facets, 3).
        most: Pairs that the error names at most: a surface on itself has millions.

    Raises:
        SelfIntersectionError: With the pairs of facets.
    """
    pairs = _core.find_self_intersections(points, facets, most)
    if len(pairs):
        raise SelfIntersectionError([(a, b) for a, b in pairs.tolist()])
