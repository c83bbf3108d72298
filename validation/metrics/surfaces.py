"""Distances between two surfaces: Hausdorff (the worst place) and mean.

Sampled at vertices, edge midpoints and centroids of every facet, each against the other
surface's nearest facet, both ways. The sampled maximum is a lower bound of the Hausdorff distance;
on flat facets it misses it by less than half the sampling distance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.problem import Problem
from palpate.validation.metrics.finite import largest
from palpate.validation.metrics.pairs import Difference, ratio
from palpate.validation.states import State

Array = NDArray[np.float64]
_CHUNK = 256


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
    for from_points, from_facets, to_points, to_facets in pairs:
        corners = from_points[from_facets]
        samples = np.concatenate(
            [corners, 0.5 * (corners + corners[:, [1, 2, 0]]), corners.mean(axis=1)[:, None]],
            axis=1,
        )
        places, index = np.unique(samples.reshape(-1, 3), axis=0, return_inverse=True)
        distances = distances_to_surface(places, to_points, to_facets)
        farthest.append(largest(distances))
        by_facet = distances[index.reshape(samples.shape[:2])]
        areas = np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        # Corners 1/20 each, midpoints 2/15, centroid 9/20: exact for cubics on a triangle.
        weights = np.array([0.05] * 3 + [2.0 / 15.0] * 3 + [0.45])
        means.append(float(areas @ (by_facet @ weights) / areas.sum()))
    return largest(farthest), sum(means) / 2.0


def distances_to_surface(places: Points, points: Points, facets: Indices) -> Array:
    """Distance of each place to the nearest facet [m], (num_places,)."""
    corners = points[facets]
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    out = np.empty(len(places))
    for start in range(0, len(places), _CHUNK):
        rows = places[start : start + _CHUNK]
        to_centre = np.sqrt(
            np.maximum(
                (rows**2).sum(1)[:, None] + (centres**2).sum(1) - 2.0 * rows @ centres.T, 0.0
            )
        )
        # No facet is nearer than its centre less its radius, or farther than its centre.
        rounding = 1e-7 * np.sqrt((rows**2).sum(1) + (centres**2).sum(1).max())
        bound = to_centre.min(axis=1) + rounding
        place, facet = np.nonzero(to_centre - radii <= (bound + rounding)[:, None])
        distance = _to_triangles(rows[place], corners[facet])
        best = np.full(len(rows), np.inf)
        np.minimum.at(best, place, distance)
        out[start : start + _CHUNK] = best
    return out


def _to_triangles(places: Array, corners: Array) -> Array:
    """Distance of each place to its triangle, (n,)."""
    a, b, c = (corners[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    squared = np.einsum("ij,ij->i", normal, normal)
    squared = np.where(squared > 0.0, squared, 1.0)
    w = places - a
    v_b = np.einsum("ij,ij->i", np.cross(w, c - a), normal) / squared
    v_c = np.einsum("ij,ij->i", np.cross(b - a, w), normal) / squared
    inside = (v_b >= 0.0) & (v_c >= 0.0) & (v_b + v_c <= 1.0)
    to_plane = np.abs(np.einsum("ij,ij->i", w, normal)) / np.sqrt(squared)
    edges = [_to_segments(places, p, q) for p, q in ((a, b), (b, c), (c, a))]
    on_edge = np.minimum(np.minimum(edges[0], edges[1]), edges[2])
    distance: Array = np.where(inside, np.minimum(to_plane, on_edge), on_edge)
    return distance


def _to_segments(places: Array, start: Array, end: Array) -> Array:
    along = end - start
    squared = np.einsum("ij,ij->i", along, along)
    share = np.einsum("ij,ij->i", places - start, along) / np.where(squared > 0.0, squared, 1.0)
    nearest = start + np.clip(share, 0.0, 1.0)[:, None] * along
    distance: Array = np.linalg.norm(places - nearest, axis=1)
    return distance


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
