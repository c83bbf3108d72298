"""The nearest place of a triangulated surface, for many places at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points
from palpate.validation.exchange.box_tree import BoxTree

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Nearest:
    """The nearest place on a surface.

    Attributes:
        facets: Number of the facet, (num_places,).
        weights: Barycentric coordinates in it, (num_places, 3), each in 0..1.
        distances: [m], (num_places,).
    """

    facets: NDArray[np.int64]
    weights: Array
    distances: Points


def nearest_on_surface(
    places: Points,
    points: Points,
    facets: Indices | NDArray[np.int64],
    within: Points | None = None,
) -> Nearest:
    """Find the nearest place on any facet.

    Args:
        places: [m], (num_places, 3), finite.
        points: Of the surface [m], (num_points, 3).
        facets: One or more, (num_facets, 3).
        within: No farther than this is the surface known to be [m], (num_places,).
    """
    corners = points[facets]
    tree = BoxTree(corners.min(axis=1), corners.max(axis=1), corners.mean(axis=1))
    chosen = tree.nearest(
        places, lambda who, items: _on_triangles(places[who], corners[items])[1], within
    )
    weights, distances = _on_triangles(places, corners[chosen])
    return Nearest(chosen, weights, distances)


def _on_triangles(places: Points, corners: Array) -> tuple[Array, Points]:
    """Weights and distance of the nearest place of a triangle each: (n, 3), (n,)."""
    a, b, c = (corners[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    squared = np.einsum("ij,ij->i", normal, normal)
    has_area = squared > 0.0
    squared = np.where(has_area, squared, 1.0)
    w = places - a
    v_b = np.einsum("ij,ij->i", np.cross(w, c - a), normal) / squared
    v_c = np.einsum("ij,ij->i", np.cross(b - a, w), normal) / squared
    weights = np.column_stack([1.0 - v_b - v_c, v_b, v_c])
    to_plane = np.abs(np.einsum("ij,ij->i", w, normal)) / np.sqrt(squared)
    best = np.where(has_area & (weights.min(axis=1) >= 0.0), to_plane, np.inf)
    for start, end in ((0, 1), (1, 2), (2, 0)):
        fraction, distance = _on_segments(places, corners[:, start], corners[:, end])
        nearer = distance < best
        best = np.where(nearer, distance, best)
        on_edge = np.zeros((len(places), 3))
        on_edge[:, start], on_edge[:, end] = 1.0 - fraction, fraction
        weights = np.where(nearer[:, None], on_edge, weights)
    return weights, best


def _on_segments(places: Points, start: Points, end: Points) -> tuple[Points, Points]:
    along = end - start
    squared = np.einsum("ij,ij->i", along, along)
    fraction = np.einsum("ij,ij->i", places - start, along) / np.where(squared > 0.0, squared, 1.0)
    fraction = np.clip(fraction, 0.0, 1.0)
    return fraction, np.linalg.norm(places - start - fraction[:, None] * along, axis=1)
