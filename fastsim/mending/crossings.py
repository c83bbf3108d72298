"""Where a part of a surface meets the rest of it, by the exact test, and how far two are apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.meshes.arrays import Indices, Points

# Pairs that are looked at: where there are more, the first ones say enough.
MOST_PAIRS = 20_000


def all_crossings(points: Points, facets: Indices) -> NDArray[np.int32]:
    """Pairs of facets that meet beyond shared corners and edges, shape (num_pairs, 2)."""
    pairs: NDArray[np.int32] = _core.find_self_intersections(
        np.ascontiguousarray(points), np.ascontiguousarray(facets), MOST_PAIRS
    )
    return pairs


def crossings_of(
    points: Points, facets: Indices, rows: NDArray[np.int64] | NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Pairs of facets of which at least one is among `rows`, shape (num_pairs, 2)."""
    near = facets_near(points, facets, points[facets[rows]].reshape(-1, 3))
    is_one = np.zeros(len(facets), dtype=bool)
    is_one[rows] = True
    pairs = near[all_crossings(points, facets[near])]
    found: NDArray[np.int64] = pairs[is_one[pairs].any(axis=1)]
    return found


def facets_near(
    points: Points, facets: Indices, places: Points, reach: float = 0.0
) -> NDArray[np.int64]:
    """Facets whose box comes within `reach` of the box of places."""
    if not len(places):
        return np.zeros(0, dtype=np.int64)
    low, high = places.min(axis=0) - reach, places.max(axis=0) + reach
    corners = points[facets]
    meets = (corners.min(axis=1) <= high) & (corners.max(axis=1) >= low)
    return np.flatnonzero(meets.all(axis=1))


def samples_of(points: Points, facets: Indices) -> Points:
    """Corners, middles of edges and centres of facets [m], shape (num_samples, 3)."""
    corners = points[facets]
    middles = 0.5 * (corners + corners[:, [1, 2, 0]])
    return np.vstack([points[np.unique(facets)], middles.reshape(-1, 3), corners.mean(axis=1)])


def one_way_distance(places: Points, points: Points, facets: Indices) -> float:
    """Largest distance of places from a surface [m]; 0 without places."""
    if not len(places):
        return 0.0
    surface = _core.SurfaceDistance(np.ascontiguousarray(points), np.ascontiguousarray(facets))
    return float(surface.distances(np.ascontiguousarray(places)).max())


def distance_apart(
    points: Points, facets: Indices, new_points: Points, new_facets: Indices
) -> float:
    """Largest distance of either surface from the other [m], over `samples_of` what they differ in.

    Facets with the same places as corners are left out: there the distance is zero.
    """
    old, new = _places_of(points, facets), _places_of(new_points, new_facets)
    _, inverse = np.unique(np.vstack([old, new]), axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    only_old = ~np.isin(inverse[: len(old)], inverse[len(old) :])
    only_new = ~np.isin(inverse[len(old) :], inverse[: len(old)])
    there = one_way_distance(samples_of(points, facets[only_old]), new_points, new_facets)
    back = one_way_distance(samples_of(new_points, new_facets[only_new]), points, facets)
    return max(there, back)


def _places_of(points: Points, facets: Indices) -> Points:
    """Corners of facets, the smallest place first, shape (num_facets, 9), to compare facets by."""
    _, number = np.unique(points, axis=0, return_inverse=True)
    number = number.reshape(-1)[facets]
    first = np.argmin(number, axis=1)
    turned = facets[np.arange(len(facets))[:, None], (first[:, None] + np.arange(3)) % 3]
    places: Points = points[turned].reshape(-1, 9) + 0.0
    return places
