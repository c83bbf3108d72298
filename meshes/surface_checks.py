"""Does a surface bound a solid? Typed refusals that list the guilty facets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices
from palpate.meshes.errors import (
    DegenerateFacetError,
    DuplicateFacetError,
    EmptySurfaceError,
    NonManifoldError,
    OpenSurfaceError,
    OrientationError,
)
from palpate.meshes.tri_surface import TriSurface


def require_closed(surface: TriSurface) -> None:
    """Refuse a surface that is not closed, manifold, consistently oriented and outward.

    Self-intersection is not looked for here: that takes exact predicates (see the mesher).

    Args:
        surface: Any surface with finite points; unused points do no harm.

    Raises:
        EmptySurfaceError: No facets.
        DegenerateFacetError: A repeated point, or an area below rounding of the edge lengths.
        DuplicateFacetError: The same three points twice.
        OpenSurfaceError: An edge with one facet.
        NonManifoldError: An edge with more than two facets, or a point where sheets touch.
        OrientationError: Neighbours that disagree, or an enclosed volume <= 0.
    """
    facets = surface.facets
    if len(facets) == 0:
        raise EmptySurfaceError("the surface has no facets; give a closed triangulated surface")
    _refuse_degenerate(surface)
    keys = np.sort(facets, axis=1)
    _, first, counts = np.unique(keys, axis=0, return_index=True, return_counts=True)
    if np.any(counts > 1):
        raise DuplicateFacetError(np.setdiff1d(np.arange(len(facets)), first[counts == 1]).tolist())
    _check_edges(facets)
    _check_vertices(facets)
    if not surface.volume > 0.0:
        raise OrientationError(
            f"the surface encloses {surface.volume:.3g} m3: its facets point inwards; "
            "swap two points of every facet",
            list(range(len(facets))),
        )


def _refuse_degenerate(surface: TriSurface) -> None:
    """Flat means: twice the area below 4 eps times the longest edge squared."""
    corners = surface.points[surface.facets]
    edges = corners[:, [1, 2, 0]] - corners
    longest_squared = np.einsum("ijk,ijk->ij", edges, edges).max(axis=1)
    double_area = 2.0 * np.linalg.norm(surface.area_vectors, axis=1)
    flat = double_area <= 4.0 * np.finfo(float).eps * longest_squared
    if flat.any():
        raise DegenerateFacetError(np.flatnonzero(flat).tolist())


def _check_edges(facets: Indices) -> None:
    """Every edge has two facets, which run along it in opposite directions."""
    directed = facets[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    owner = np.repeat(np.arange(len(facets)), 3)
    _, inverse, counts = np.unique(
        np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    inverse = inverse.reshape(-1)
    uses = counts[inverse]
    if np.any(uses == 1):
        guilty = uses == 1
        raise OpenSurfaceError(
            [(int(a), int(b)) for a, b in directed[guilty]], np.unique(owner[guilty]).tolist()
        )
    if np.any(uses > 2):
        guilty = uses > 2
        edges = np.unique(np.sort(directed[guilty], axis=1), axis=0)
        raise NonManifoldError(
            np.unique(owner[guilty]).tolist(), edges=[(int(a), int(b)) for a, b in edges]
        )
    forward = directed[:, 0] < directed[:, 1]
    balance = np.bincount(inverse, weights=np.where(forward, 1.0, -1.0))
    guilty = balance[inverse] != 0.0
    if np.any(guilty):
        bad = np.unique(owner[guilty])
        raise OrientationError(
            f"{len(bad)} facet(s) are turned against a neighbour, first {bad[:5].tolist()}; "
            "orient all facets counter-clockwise seen from outside",
            bad.tolist(),
        )


def _check_vertices(facets: Indices) -> None:
    """The facets around a point form one fan: corners are joined across shared edges."""
    corners = facets.reshape(-1)
    parent = np.arange(len(corners))

    def root(i: int) -> int:
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = int(parent[i])
        return i

    directed = facets[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    place: dict[tuple[int, int], int] = {(int(a), int(b)): k for k, (a, b) in enumerate(directed)}
    for (a, b), k in place.items():
        twin = place[(b, a)]
        # Edge k runs from corner k of its facet to the next corner; its twin runs back.
        facet, side = divmod(k, 3)
        other, other_side = divmod(twin, 3)
        parent[root(3 * facet + side)] = root(3 * other + (other_side + 1) % 3)
        parent[root(3 * facet + (side + 1) % 3)] = root(3 * other + other_side)
    roots: NDArray[np.int64] = np.array([root(i) for i in range(len(corners))])
    fans = np.unique(np.column_stack([corners, roots]), axis=0)
    vertices, counts = np.unique(fans[:, 0], return_counts=True)
    touching = vertices[counts > 1]
    if touching.size:
        guilty = np.flatnonzero(np.isin(facets, touching).any(axis=1))
        raise NonManifoldError(guilty.tolist(), vertices=touching.tolist())


def merge_equal_points(surface: TriSurface) -> TriSurface:
    """Merge points that are equal bit for bit (STL repeats them), and drop unused ones.

    Points keep the order of their first appearance.
    """
    used, compact = np.unique(surface.facets, return_inverse=True)
    points = surface.points[used] + 0.0  # -0.0 and 0.0 are the same place
    _, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    facets = rank[inverse.reshape(-1)[compact.reshape(-1)]].reshape(-1, 3)
    return TriSurface(points[first[order]], facets)
