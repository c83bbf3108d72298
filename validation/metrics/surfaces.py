"""Distances between two surfaces: Hausdorff (the worst place) and mean.

Sampled at vertices, edge midpoints and centroids of every facet, each against the other
surface's nearest facet, both ways. The sampled maximum is a lower bound of the Hausdorff distance;
on flat facets it misses it by less than half the sampling distance.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.problem import Problem
from palpate.validation.exchange.nodal_arrays import facet_areas
from palpate.validation.exchange.point_location import nearest_on_surface
from palpate.validation.metrics.finite import largest
from palpate.validation.metrics.pairs import Difference, ratio
from palpate.validation.states import State

Array = NDArray[np.float64]
# Facets this many times as large as those they are compared with are torn.
_TORN = 2.0
# Facets that are sampled at least.
_FEWEST = 64


def surface_distances(
    points: Points, facets: Indices, other_points: Points, other_facets: Indices
) -> tuple[float, float]:
    """Hausdorff and mean distance of two triangulated surfaces [m].

    Both are the larger (mean: the average) of the two directions; the mean is by facet area.
    """
    farthest, means = [], []
    pairs = (
        (points, facets, other_points, other_facets),
        (other_points, other_facets, points, facets),
    )
    for pair in pairs:
        from_points, from_facets, to_points, to_facets = pair
        chosen = from_facets[:: _stride(pair)]
        samples = _samples(from_points[chosen])
        places, first, index = np.unique(
            samples.reshape(-1, 3), axis=0, return_index=True, return_inverse=True
        )
        within = None
        if from_facets is to_facets and len(from_points) == len(to_points):
            # Of one body in two states, a place's own in the other is near already.
            there = _samples(to_points[chosen]).reshape(-1, 3)[first]
            within = np.linalg.norm(places - there, axis=1)
        distances = distances_to_surface(places, to_points, to_facets, within)
        farthest.append(largest(distances))
        by_facet = distances[index.reshape(samples.shape[:2])]
        areas = facet_areas(from_points, from_facets[:: _stride(pair)])
        # Corners 1/20 each, midpoints 2/15, centroid 9/20: exact for cubics on a triangle.
        weights = np.array([0.05] * 3 + [2.0 / 15.0] * 3 + [0.45])
        means.append(float(areas @ (by_facet @ weights) / areas.sum()))
    return largest(farthest), sum(means) / 2.0


def _samples(corners: Array) -> Array:
    """Corners, edge midpoints and centroid of triangles (n, 3, 3): (n, 7, 3)."""
    middles = 0.5 * (corners + corners[:, [1, 2, 0]])
    return np.concatenate([corners, middles, corners.mean(axis=1)[:, None]], axis=1)


def _stride(pair: tuple[Points, Indices, Points, Indices]) -> int:
    """Every how many facets are sampled: all, but towards facets torn much larger than they are.

    Each place is then near to very many of them, and a few tell that the surfaces are apart.
    """
    sizes = [
        float(np.ptp(points[facets], axis=1).max(axis=1).mean())
        for points, facets in (pair[:2], pair[2:])
    ]
    torn = (sizes[1] / (_TORN * sizes[0])) ** 2 if sizes[0] > 0.0 else 1.0
    return int(min(max(torn, 1.0), max(len(pair[1]) / _FEWEST, 1.0)))


def distances_to_surface(
    places: Points, points: Points, facets: Indices, within: Points | None = None
) -> Array:
    """Distance of each place to the nearest facet [m], (num_places,); known to be `within`."""
    return nearest_on_surface(places, points, facets, within).distances


@lru_cache(maxsize=2)
def _distances(problem: Problem, candidate: State, reference: State) -> tuple[float, float]:
    mesh = problem.mesh
    facets = mesh.boundary_facets
    moved = [mesh.points + state.displacement for state in (candidate, reference)]
    return surface_distances(moved[0], facets, moved[1], facets)


def surface_hausdorff(problem: Problem, candidate: State, reference: State) -> Difference:
    """Hausdorff distance of the deformed surfaces, over the reference's largest displacement.

    What one sees and touches: sliding along the surface does not count.
    """
    found = _distances(problem, candidate, reference)[0]
    return ratio(found, reference.max_displacement, "the reference's largest displacement")


def surface_mean_distance(problem: Problem, candidate: State, reference: State) -> Difference:
    """Mean distance of the deformed surfaces, over the reference's largest displacement."""
    found = _distances(problem, candidate, reference)[1]
    return ratio(found, reference.max_displacement, "the reference's largest displacement")
