"""Signed distance to a closed triangulated surface with its first two derivatives.

The nearest place is on a facet, an edge or a point of the surface; there d = s |P (x - c)| with a
projection P that is constant (see `tool_distance`). The side s is told by the facet's normal, or by
the pseudo-normal of the edge or point: facets' normals weighted by their angle there (J. A.
Baerentzen, H. Aanaes, IEEE Trans. Vis. Comput. Graph. 11, 2005).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.rigid_tool import SurfaceShape
from palpate.meshes.surface_checks import require_closed

# Edge k runs from corner k to the next; the two after it complete the facet.
_NEXT = np.array([1, 2, 0])
# Nearer than this to an edge or point, in sizes of the surface, its pseudo-normal is the normal.
_ON_IT = 1e-10
# Places by facets that are measured at once.
_AT_ONCE = 2_000_000


@dataclass(frozen=True, eq=False)
class ClosedSurface:
    """A surface made ready to be measured from.

    Attributes:
        corners: Of each facet [m], shape (m, 3, 3).
        normals: Of each facet, outward [-], shape (m, 3).
        edge_normals: Pseudo-normals of each facet's edges [-], shape (m, 3, 3).
        corner_normals: Of its corners [-], shape (m, 3, 3).
        size: Diagonal of its bounding box [m].
    """

    corners: Points
    normals: Points
    edge_normals: Points
    corner_normals: Points
    size: float


@lru_cache(maxsize=8)
def closed_surface(shape: SurfaceShape) -> ClosedSurface:
    """Make a tool's surface ready.

    Raises:
        InputError: It bounds no solid (see `require_closed`).
    """
    surface = shape.surface
    require_closed(surface)
    facets = surface.facets
    corners = surface.points[facets]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = across / np.linalg.norm(across, axis=1)[:, None]
    at_points = np.zeros((len(surface.points), 3))
    for k in range(3):
        one = _unit(corners[:, _NEXT[k]] - corners[:, k])
        other = _unit(corners[:, _NEXT[_NEXT[k]]] - corners[:, k])
        angles = np.arccos(np.clip(np.sum(one * other, axis=1), -1.0, 1.0))
        np.add.at(at_points, facets[:, k], angles[:, None] * normals)
    edges = np.sort(np.stack([facets, facets[:, _NEXT]], axis=2), axis=2).reshape(-1, 2)
    _, edge = np.unique(edges, axis=0, return_inverse=True)
    edge = edge.reshape(-1, 3)
    at_edges = np.zeros((int(edge.max()) + 1, 3))
    for k in range(3):
        np.add.at(at_edges, edge[:, k], normals)
    points = surface.points[np.unique(facets)]
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    return ClosedSurface(corners, normals, _unit(at_edges)[edge], _unit(at_points)[facets], size)


def surface_distance(surface: ClosedSurface, places: Points) -> tuple[Floats, Points, Floats]:
    """Distance, normal and curvature at places in the surface's frame; see `Distance`.

    Args:
        surface: Made ready.
        places: [m], shape (n, 3).
    """
    facet, weights = _nearest(surface, places)
    rows = np.arange(len(places))
    corners = surface.corners[facet]
    arms = places - np.einsum("nk,nki->ni", weights, corners)
    is_inner = weights > 0.0
    count = is_inner.sum(axis=1)
    # The one corner that is not in an edge names it: that after its end.
    out = np.argmin(is_inner, axis=1)
    along = _unit(corners[rows, _NEXT[_NEXT[out]]] - corners[rows, _NEXT[out]])
    on_edge, on_corner = count == 2, count == 1
    pseudo = np.where(
        on_edge[:, None],
        surface.edge_normals[facet, _NEXT[out]],
        surface.corner_normals[facet, np.argmax(is_inner, axis=1)],
    )
    length = np.linalg.norm(arms, axis=1)
    is_off = (on_edge | on_corner) & (length > _ON_IT * surface.size)
    side = np.where(np.sum(arms * pseudo, axis=1) < 0.0, -1.0, 1.0)
    safe = np.where(is_off, length, 1.0)
    radial = (side / safe)[:, None] * arms
    kept = np.eye(3) - np.where(on_edge[:, None, None], along[:, :, None] * along[:, None, :], 0.0)
    bend = (side / safe)[:, None, None] * (kept - radial[:, :, None] * radial[:, None, :])
    flat = np.where((on_edge | on_corner)[:, None], pseudo, surface.normals[facet])
    return (
        np.where(is_off, side * length, np.sum(arms * flat, axis=1)),
        np.where(is_off[:, None], radial, flat),
        np.where(is_off[:, None, None], bend, 0.0),
    )


def _unit(rows: Points) -> Points:
    lengths = np.linalg.norm(rows, axis=-1, keepdims=True)
    unit: Points = rows / np.where(lengths > 0.0, lengths, 1.0)
    return unit


def _nearest(surface: ClosedSurface, places: Points) -> tuple[Indices, Floats]:
    """The facet that is nearest to each place, and the weights of its corners at the place there.

    Returns:
        Shape (n,), and (n, 3): exactly 0 for corners that are no part of what is nearest.
    """
    chosen = np.zeros(len(places), dtype=np.int32)
    weights = np.zeros((len(places), 3))
    step = max(1, _AT_ONCE // len(surface.corners))
    for start in range(0, len(places), step):
        part = places[start : start + step]
        found = _weights(surface.corners, part)
        arms = part[:, None] - np.einsum("nmk,mki->nmi", found, surface.corners)
        nearest = np.argmin(np.sum(arms**2, axis=2), axis=1)
        chosen[start : start + step] = nearest
        weights[start : start + step] = found[np.arange(len(part)), nearest]
    return chosen, weights


def _weights(corners: Points, places: Points) -> Floats:
    """Weights of the nearest place of each of m triangles to each of n places, shape (n, m, 3)."""
    a, b, c = (corners[:, k] for k in range(3))
    across = np.cross(b - a, c - a)
    squared = np.sum(across**2, axis=1)
    arms = places[:, None] - a
    # Of the foot on the plane.
    second = np.einsum("nmi,mi->nm", arms, np.cross(c - a, across)) / squared
    third = np.einsum("nmi,mi->nm", arms, np.cross(across, b - a)) / squared
    foot = np.stack([1.0 - second - third, second, third], axis=2)
    is_in = (foot > 0.0).all(axis=2)
    best: Floats = foot
    least = np.where(is_in, 0.0, np.inf)
    for k in range(3):
        start, way = corners[:, k], corners[:, _NEXT[k]] - corners[:, k]
        t = np.einsum("nmi,mi->nm", places[:, None] - start, way) / np.sum(way**2, axis=1)
        t = np.clip(t, 0.0, 1.0)
        apart = places[:, None] - start - t[:, :, None] * way
        distance = np.sum(apart**2, axis=2)
        on_edge = np.zeros_like(foot)
        on_edge[:, :, k], on_edge[:, :, _NEXT[k]] = 1.0 - t, t
        is_nearer = ~is_in & (distance < least)
        best = np.where(is_nearer[:, :, None], on_edge, best)
        least = np.where(is_nearer, distance, least)
    return best
