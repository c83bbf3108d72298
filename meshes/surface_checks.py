"""Checks that a surface bounds a solid, with typed errors that list the facets; near points."""

from __future__ import annotations

import itertools
from weakref import WeakKeyDictionary

import numpy as np

from palpate.meshes.arrays import Indices, Integers, Mask, Points, equal_points, row_keys
from palpate.meshes.errors import InputError
from palpate.meshes.shells import Shell, require_nested
from palpate.meshes.tri_surface import (
    DegenerateFacetError,
    DuplicateFacetError,
    EmptySurfaceError,
    FinError,
    NonManifoldError,
    OpenSurfaceError,
    OrientationError,
    SurfaceError,
    TriSurface,
)
from palpate.meshes.triangles import (
    EdgeUses,
    edge_uses,
    facet_parts,
    parts_by_plain_edges,
    points_with_several_fans,
)

# A fin has at most this fraction of the area: a larger sheet may be intended.
LARGEST_FIN = 0.1

# Shells of surfaces that were looked at: who reads one asks, and who meshes it asks again.
_CLOSED: WeakKeyDictionary[TriSurface, tuple[Shell, ...]] = WeakKeyDictionary()


def require_closed(surface: TriSurface) -> list[Shell]:
    """Refuse a surface that is not closed, manifold, consistently oriented and outward.

    Several shells are allowed: outer walls beside each other, cavities within (facing the
    hollow), bodies within cavities.

    Self-intersection is not checked here: that needs exact predicates (see the mesher).

    Args:
        surface: Any surface with finite points; unused points do no harm.

    Returns:
        Its shells, classified by nesting.

    Raises:
        EmptySurfaceError: No facets.
        DegenerateFacetError: A repeated point, or an area below rounding of the edge lengths.
        DuplicateFacetError: The same three points twice.
        OpenSurfaceError: An edge with one facet.
        FinError: A sheet that hangs on the surface by one edge, where nothing else is open.
        NonManifoldError: An edge with more than two facets, or a point where sheets touch.
        OrientationError: Neighbours that disagree, or a shell that faces the wrong way for its
            nesting.
    """
    if surface.num_facets == 0:
        raise EmptySurfaceError("the surface has no facets; give a closed triangulated surface")
    if surface not in _CLOSED:
        try:
            _CLOSED[surface] = tuple(_shells_of(surface))
        except SurfaceError as error:
            error.surface = surface
            raise
    return list(_CLOSED[surface])


def _shells_of(surface: TriSurface) -> list[Shell]:
    facets = surface.facets
    # Flat: twice the area at most 4 eps times the longest edge squared.
    corners = surface.points[facets]
    edges = corners[:, [1, 2, 0]] - corners
    longest_squared = np.einsum("ijk,ijk->ij", edges, edges).max(axis=1)
    double_area = 2.0 * np.linalg.norm(surface.area_vectors, axis=1)
    flat = double_area <= 4.0 * np.finfo(float).eps * longest_squared
    if flat.any():
        raise DegenerateFacetError(np.flatnonzero(flat).tolist())
    _refuse_duplicates(facets)
    table = edge_uses(facets)
    _check_edges(surface, table)
    touching = points_with_several_fans(facets, table)
    if touching.size:
        guilty = np.flatnonzero(np.isin(facets, touching).any(axis=1))
        raise NonManifoldError(guilty.tolist(), vertices=touching.tolist())
    return require_nested(surface, table)


def _refuse_duplicates(facets: Indices) -> None:
    keys = np.sort(facets, axis=1)
    base = int(keys.max()) + 1
    if base < 2**21:
        # One number for three points sorts much faster than the three.
        a, b, c = keys.astype(np.int64).T
        numbers = np.sort((a * base + b) * base + c)
        if not np.any(numbers[1:] == numbers[:-1]):
            return
    _, first, counts = np.unique(keys, axis=0, return_index=True, return_counts=True)
    if np.any(counts > 1):
        raise DuplicateFacetError(np.setdiff1d(np.arange(len(facets)), first[counts == 1]).tolist())


def _fins(surface: TriSurface, table: EdgeUses) -> tuple[Mask, int]:
    """Facets of small sheets, free at one edge and joined to two others at another; how many."""
    crowd = table.crowd
    patch = parts_by_plain_edges(table)
    touches = np.bincount(patch[table.owner], crowd > 2) > 0
    is_free = np.bincount(patch[table.owner], crowd == 1) > 0
    area = np.bincount(patch, np.linalg.norm(surface.area_vectors, axis=1))
    hangs = touches & is_free & (area <= LARGEST_FIN * area.sum())
    # Sheets that hang on each other are one fin.
    rows = np.flatnonzero(hangs[patch])
    is_fin = hangs[patch]
    return is_fin, int(facet_parts(surface.facets[rows]).max(initial=-1)) + 1


def _check_edges(surface: TriSurface, table: EdgeUses) -> None:
    """Require two facets at every edge, which run along it in opposite directions."""
    uses = table.crowd
    if np.any(uses == 1):
        guilty = uses == 1
        fin, count = _fins(surface, table)
        if count:
            guilty &= ~fin[table.owner]
        if not guilty.any():
            raise FinError(np.flatnonzero(fin).tolist(), count)
        raise OpenSurfaceError(
            [(int(a), int(b)) for a, b in table.directed[guilty]],
            np.unique(table.owner[guilty]).tolist(),
        )
    if np.any(uses > 2):
        edges = table.edges[table.counts > 2]
        raise NonManifoldError(
            np.unique(table.owner[uses > 2]).tolist(), edges=[(int(a), int(b)) for a, b in edges]
        )
    forward = table.directed[:, 0] < table.directed[:, 1]
    balance = np.bincount(table.edge, weights=np.where(forward, 1.0, -1.0))
    guilty = balance[table.edge] != 0.0
    if np.any(guilty):
        bad = np.unique(table.owner[guilty])
        raise OrientationError(
            f"{len(bad)} facet(s) are turned against a neighbour",
            bad.tolist(),
            detail=f", first {bad[:5].tolist()}; orient all facets counter-clockwise seen from "
            "outside",
        )


def merge_equal_points(surface: TriSurface) -> TriSurface:
    """Merge points that are equal bit for bit (STL repeats them), and drop unused ones.

    Points keep the order of their first appearance.
    """
    return merge_of(surface)[0]


def merge_of(surface: TriSurface) -> tuple[TriSurface, Integers]:
    """`merge_equal_points`, and which point of the surface each merged one is, the first."""
    used = surface.used_points
    points = surface.points[used] + 0.0  # -0.0 and 0.0 are equal
    first, same = equal_points(points)
    number = np.zeros(len(surface.points), dtype=np.int32)
    number[used] = same
    return TriSurface(points[first], number[surface.facets]), used[first]


# Near points, as a fraction of the longest side of the bounding box: some ten roundings of single
# precision, in which STL files are written (eps 1.2e-7).
NEAR = 1e-6

# More points than this within the distance of one of them: the distance is too large.
_MOST_IN_REACH = 1000


def find_near_duplicates(points: Points, distance: float | None = None) -> Integers:
    """Pairs of points [m] within a distance of each other, equal ones included, ascending, (n, 2).

    The distance [m] is 0 or more; None takes `NEAR` of the longest side of the bounding box.

    Raises:
        InputError: The distance is not a number >= 0, or so large that a thousand points lie in it.
    """
    if len(points) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    size = float(np.ptp(points, axis=0).max())
    reach = NEAR * size if distance is None else distance
    if not (np.isfinite(reach) and reach >= 0.0):
        raise InputError(f"distance = {reach:g} m: needs a finite value of at least 0")
    if _surely_apart(points, reach):
        return np.zeros((0, 2), dtype=np.int64)
    from scipy.spatial import cKDTree

    # A power of two changes no digit, and squares of lengths stay within the range of numbers.
    scale = float(np.ldexp(1.0, int(np.clip(-np.frexp(size)[1], -1000, 1000))))
    scaled, within = points * scale, reach * scale
    tree = cKDTree(scaled)
    crowd = int(tree.query_ball_point(scaled, within, return_length=True).max())
    if crowd > _MOST_IN_REACH:
        raise InputError(
            f"distance = {reach:.3g} m: {crowd} points lie within such a distance; take less"
        )
    pairs = np.sort(tree.query_pairs(within, output_type="ndarray"), axis=1).astype(np.int64)
    unique: Integers = np.unique(pairs.reshape(-1, 2), axis=0)
    return unique


# Cells along an axis up to which rounding is far below a cell.
_MOST_CELLS = 2.0**40


def _surely_apart(points: Points, reach: float) -> bool:
    """Whether points are further from each other than `reach` for sure, without a tree of them.

    Two points within reach share a cell of at least one of eight grids of cells of twice the reach,
    each shifted by none or half a cell along each axis.
    """
    local = points - points.min(axis=0)
    if not reach > 0.0 or not local.max() < _MOST_CELLS * reach:
        return False
    # A little more than half a cell, for rounding.
    halves = local / (1.001 * reach)
    for shift in itertools.product((0.0, 1.0), repeat=3):
        keys = np.sort(row_keys(np.floor(0.5 * (halves + shift)).astype(np.int64)))
        if np.any(keys[1:] == keys[:-1]):
            return False
    return True
