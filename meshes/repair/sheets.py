"""Sheets that meet where a surface must not: fins, double walls, bodies that touch."""

from __future__ import annotations

import itertools
from collections import defaultdict

import numpy as np

from palpate.meshes.arrays import Indices, Integers, Mask, Points
from palpate.meshes.repair.hole_filling import fill_loop, find_hole_loops
from palpate.meshes.repair.patches import Fits, orient_parts
from palpate.meshes.triangles import (
    connected_parts,
    edge_uses,
    facet_normals,
    facet_parts,
    parts_by_plain_edges,
    side_lengths,
    unit_normals_at_points,
)

# How far the copies of points where sheets touch may move, over the shortest edge there: the first
# that leaves no crossing is taken.
_GAPS = (0.002, 0.006, 0.02, 0.06, 0.2)
# A fin is thin where its two sides are within this of one another, over its mean edge.
THIN = 0.5
# Longest loop around a fin [edges]: what closes a longer one takes too long to find.
_LONGEST_RIM = 200
# A closed shell has four facets at least.
_FEWEST_FACETS = 4
# A copy lies within this of what it copies, over its mean edge; so many parts are looked at.
_COPY, _MOST_COPIES = 0.05, 100


def fins_of(points: Points, facets: Indices, is_wall: Mask) -> Mask:
    """Facets of sheets that bound no solid: thin fins, inner walls, and scraps.

    A fin hangs on edges of more than two facets, and its two sides lie within `THIN` of its mean
    edge of one another (`is_thin`): a thicker one is part of the body, whose hole is closed. So is
    the smaller one of two sheets across one rim, and a wall across the neck of a process. Facets
    of `is_wall` were given twice, facing both ways: with a solid on either side. Loose parts too
    small to close are scraps.
    """
    areas = np.linalg.norm(facet_normals(points[facets]), axis=1)
    is_fin = np.zeros(len(facets), dtype=bool)
    thick: set[bytes] = set()
    while True:
        rows = np.flatnonzero(~is_fin)
        uses = edge_uses(facets[rows])
        crowd = uses.crowd
        patch = parts_by_plain_edges(uses)
        touches = np.bincount(patch[uses.owner], crowd > 2) > 0
        weight = np.bincount(patch, areas[rows])
        within = np.bincount(patch, ~is_wall[rows]) == 0
        candidates = np.flatnonzero(touches)
        for number in candidates[np.argsort(weight[candidates], kind="stable")].tolist():
            chosen = rows[patch == number]
            is_known = chosen.tobytes() in thick
            if within[number] or (not is_known and is_thin(points, facets[chosen])):
                is_fin[chosen] = True
                break
            thick.add(chosen.tobytes())
        else:
            break
    rows = np.flatnonzero(~is_fin)
    part = facet_parts(facets[rows])
    sizes = np.bincount(part)
    if (sizes >= _FEWEST_FACETS).any():
        is_fin[rows[sizes[part] < _FEWEST_FACETS]] = True
    return is_fin


def copied_sheets(points: Points, facets: Indices) -> Mask:
    """Facets of open parts that copy facets of another part, corner by corner, a little beside.

    Corners lie within `_COPY` of the part's mean edge of those that they copy.
    """
    from scipy.spatial import cKDTree

    is_copy = np.zeros(len(facets), dtype=bool)
    uses = edge_uses(facets)
    part = facet_parts(facets, uses)
    sizes = np.bincount(part)
    is_open = np.bincount(part[uses.owner], uses.crowd == 1) > 0
    open_parts = np.flatnonzero(is_open & (sizes < sizes.max(initial=0)))
    for one in open_parts[np.argsort(sizes[open_parts])][:_MOST_COPIES]:
        rows = part == one
        others = facets[~rows & ~is_copy]
        own, near = np.unique(facets[rows]), np.unique(others)
        reach = _COPY * float(side_lengths(points[facets[rows]]).mean())
        apart, found = cKDTree(points[near]).query(points[own], distance_upper_bound=reach)
        if not np.isfinite(apart).all():
            continue
        copied = np.sort(near[found][np.searchsorted(own, facets[rows])], axis=1)
        known = set(map(tuple, np.sort(others, axis=1).tolist()))
        is_copy[rows] = all(tuple(row) in known for row in copied.tolist())
    return is_copy


def is_thin(points: Points, patch: Indices) -> bool:
    """Whether the two sides of an open patch lie within `THIN` of its mean edge of one another.

    The other side is the triangulation of least area of the patch's rim: of a flap the flap, of a
    bone's process the opening at its base. Judged at points, middles of sides, and centres.
    """
    turned, _ = orient_parts(patch)
    uses = edge_uses(turned)
    if np.any(uses.counts > 2):
        return False
    caps = []
    for loop in find_hole_loops(turned):
        cap = fill_loop(points, loop, set()) if len(loop) <= _LONGEST_RIM else None
        if cap is None:
            return False
        caps.append(cap)
    if not caps:
        return False
    reach = THIN * float(side_lengths(points[patch]).mean())
    corners = points[np.vstack(caps)]
    inner = points[np.setdiff1d(patch, uses.edges[uses.counts == 1])]
    middles = points[uses.edges[uses.counts == 2]].mean(axis=1)
    positions = np.vstack([inner, middles, points[patch].mean(axis=1)])
    return all(_distance_to(x, corners) <= reach for x in positions)


def _distance_to(position: Points, corners: Points) -> float:
    """Distance of a position from the nearest of triangles [m], corners (num_facets, 3, 3)."""
    sides = np.roll(corners, -1, axis=1) - corners
    offset = position - corners
    along = np.einsum("fij,fij->fi", offset, sides)
    along = along / np.maximum(np.einsum("fij,fij->fi", sides, sides), np.finfo(float).tiny)
    to_sides = offset - np.clip(along, 0.0, 1.0)[:, :, None] * sides
    normals = facet_normals(corners)
    size = np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)
    is_over = np.einsum("fij,fj->fi", np.cross(sides, offset), normals).min(axis=1) >= 0.0
    to_planes = np.abs(np.einsum("fj,fj->f", offset[:, 0], normals)) / size
    nearest = np.linalg.norm(to_sides, axis=2).min(axis=1)
    return float(np.where(is_over, to_planes, nearest).min())


def split_touching(
    points: Points, facets: Indices, fits: Fits | None = None
) -> tuple[Points, Indices, int, float]:
    """Give each of the bodies that touch along an edge or at a point its own points, and a gap.

    Around an edge facets belong together that bound the same wedge of the solid; around a point,
    those that are joined by such edges. Facets are consistently oriented within each part connected
    by edges with two facets. Points that hang together are moved together, along their normals or
    against them, by the least of some distances that `fits`. Returns points, with the copies
    appended; facets; how many points were split; and the largest movement [m]. A facet that finds
    no partner at an edge ends there, at a rim of its own.
    """
    joined = _joined_corners(points, facets)
    fan = connected_parts(3 * len(facets), joined)
    corner = facets.reshape(-1).astype(np.int64)
    pair = np.unique(np.column_stack([corner, fan]), axis=0)
    # A fan that ends at a rim stays: the hole is closed later.
    uses = edge_uses(facets)
    rim = uses.directed[uses.crowd == 1]
    several = np.flatnonzero(np.bincount(pair[:, 0], minlength=len(points)) > 1)
    # Unless it ends at an edge where other sheets go on.
    crowded = uses.directed[uses.crowd > 2]
    several = np.setdiff1d(several, np.setdiff1d(rim, crowded))
    if not len(several):
        return points, facets, 0, 0.0
    named = corner.copy()
    position = list(points)
    origin = []
    for v in several:
        for number in pair[pair[:, 0] == v, 1][1:]:
            named[fan == number] = len(position)
            position.append(points[v])
            origin.append(v)
    new = named.reshape(-1, 3).astype(np.int32)
    copies = np.concatenate([several, np.arange(len(points), len(position))])
    moved = np.array(position)
    directions = unit_normals_at_points(moved, new)
    shortest = np.full(len(moved), np.inf)
    lengths = side_lengths(moved[new])
    np.minimum.at(shortest, new, lengths)
    np.minimum.at(shortest, new[:, [1, 2, 0]], lengths)
    # Points hang together where they have an edge in common, or were one.
    edges = edge_uses(new).edges
    is_copy = np.isin(np.arange(len(moved)), copies)
    twins = np.column_stack([origin, np.arange(len(points), len(moved))])
    cluster = connected_parts(len(moved), np.vstack([edges[is_copy[edges].all(axis=1)], twins]))
    shortest[~np.isfinite(shortest)] = 0.0
    start, step = moved.copy(), shortest[:, None] * directions
    everywhere = np.isin(new, copies).any(axis=1)
    moved[copies] -= _GAPS[0] * step[copies]
    largest = _GAPS[0] * float(shortest[copies].max())
    # Edges that are still crowded are refused by the caller, whatever the gaps.
    is_refused = bool(np.any(edge_uses(new).counts > 2))
    if fits is None or is_refused or fits(moved, new, everywhere):
        return moved, new, len(several), largest
    for number in np.unique(cluster[copies]):
        some = copies[cluster[copies] == number]
        touched = np.isin(new, some).any(axis=1)
        for gap, sign in itertools.product((*_GAPS, _GAPS[0]), (-1.0, 1.0)):
            moved[some] = start[some] + sign * gap * step[some]
            if fits(moved, new, touched):
                break
        largest = max(largest, gap * float(shortest[some].max()))
    return moved, new, len(several), largest


def _joined_corners(points: Points, facets: Indices) -> Integers:
    """Pairs of corners (3 facet + k) of one point whose facets belong together across an edge."""
    uses = edge_uses(facets)
    sides = [uses.plain_pairs]
    patch = parts_by_plain_edges(uses)
    by_edge = defaultdict(list)
    for side in uses.by_edge[uses.crowd[uses.by_edge] > 2].tolist():
        by_edge[int(uses.edge[side])].append(side)
    for around in by_edge.values():
        pairs = _wedges(points, facets, uses.directed, np.array(around), patch[uses.owner[around]])
        sides.append(pairs)
    first, second = np.vstack(sides).T
    out = []
    for end in range(2):
        # The corner at the start or the end of one side, and at the same point of the other.
        here = 3 * (first // 3) + (first % 3 + end) % 3
        is_start = uses.directed[second, 0] == uses.directed[first, end]
        there = 3 * (second // 3) + np.where(is_start, second % 3, (second % 3 + 1) % 3)
        out.append(np.column_stack([here, there]))
    return np.vstack(out)


def _wedges(
    points: Points,
    facets: Indices,
    directed: Integers,
    sides: Integers,
    patch: Integers,
) -> Integers:
    """The facets around one edge, paired: those of one body, or of one wedge of the solid."""
    _, number = np.unique(patch, return_inverse=True)
    if np.all(np.bincount(number.reshape(-1)) == 2):
        return sides[np.argsort(patch, kind="stable")].reshape(-1, 2)
    a, b = np.sort(directed[sides[0]])
    axis = points[b] - points[a]
    axis = axis / np.linalg.norm(axis)
    across = points[facets[sides // 3, (sides % 3 + 2) % 3]] - points[a]
    across = across - np.outer(across @ axis, axis)
    x = across[0] / np.linalg.norm(across[0])
    angle = np.arctan2(across @ np.cross(axis, x), across @ x)
    order = np.argsort(angle, kind="stable")
    # By angle, a facet that runs from a to b has the solid before it, one from b to a behind it.
    is_forward = (directed[sides, 0] == a).tolist()
    ring = order.tolist()
    pairs = []
    # Neighbours with the solid between them, again and again as these leave others beside them.
    while True:
        for i, one in enumerate(ring):
            other = ring[(i + 1) % len(ring)]
            if not is_forward[one] and is_forward[other]:
                pairs.append((sides[one], sides[other]))
                ring = [k for k in ring if k not in (one, other)]
                break
        else:
            return np.array(pairs, dtype=np.int64).reshape(-1, 2)


# Two sheets on one rim coincide below this volume between them over area^(3/2), and below this
# relative difference of their areas and moments.
_FLAT = 1e-6


def double_walls(points: Points, facets: Indices) -> Mask:
    """Facets to remove of two coinciding sheets: both that face each other, one that face alike.

    Two bodies that touch along a whole face have it twice, cut into different facets.
    """
    gone = np.zeros(len(facets), dtype=bool)
    uses = edge_uses(facets)
    crowd = uses.crowd
    if not np.any(crowd > 2):
        return gone
    patch = parts_by_plain_edges(uses)
    is_rim = crowd != 2
    is_free = np.bincount(patch[uses.owner], crowd == 1) > 0
    rims: dict[int, dict[int, bool]] = {}
    closed: set[int] = set()
    for edge, owner, (a, b) in zip(
        uses.edge[is_rim].tolist(),
        patch[uses.owner[is_rim]].tolist(),
        uses.directed[is_rim].tolist(),
        strict=True,
    ):
        rim = rims.setdefault(owner, {})
        # A body that touches another along a line has its edges there twice.
        if edge in rim or is_free[owner]:
            closed.add(owner)
        rim[edge] = a < b
    by_rim: dict[frozenset[int], list[int]] = {}
    for owner, rim in rims.items():
        if owner not in closed:
            by_rim.setdefault(frozenset(rim), []).append(owner)
    order = np.argsort(patch, kind="stable")
    rows_of = np.split(order, np.cumsum(np.bincount(patch))[:-1])
    for key, owners in by_rim.items():
        left = list(owners)
        while len(left) > 1:
            one = left.pop()
            edge = next(iter(key))
            for other in left:
                faces = rims[one][edge] != rims[other][edge]
                if _is_flat(points, facets[rows_of[one]], facets[rows_of[other]], faces):
                    gone[rows_of[one]] = True
                    if faces:
                        gone[rows_of[other]] = True
                        left.remove(other)
                    break
    return gone


def _is_flat(points: Points, one: Indices, other: Indices, faces: bool) -> bool:
    """Whether two sheets on one rim enclose nothing and coincide.

    Judged by their areas and the first and second moments of these.
    """
    origin = points[one].reshape(-1, 3).mean(axis=0)
    (area, volume, first, second), (other_area, other_volume, other_first, other_second) = (
        _moments(points[rows] - origin) for rows in (one, other)
    )
    between = volume + other_volume if faces else volume - other_volume
    return (
        abs(between) <= _FLAT * area**1.5
        and abs(area - other_area) <= _FLAT * area
        and bool(np.abs(first - other_first).max() <= _FLAT * area**1.5)
        and bool(np.abs(second - other_second).max() <= _FLAT * area**2)
    )


def _moments(corners: Points) -> tuple[float, float, Points, Points]:
    """Area, volume to the origin, and the area's first and second moments of triangles."""
    normals = facet_normals(corners)
    areas = 0.5 * np.linalg.norm(normals, axis=1)
    centres = corners.mean(axis=1)
    volume = float(np.einsum("ij,ij->", centres, normals)) / 6.0
    # Exact for quadratics: the middles of the sides, each with a third.
    middles = 0.5 * (corners + corners[:, [1, 2, 0]])
    second: Points = np.einsum("f,fix,fiy->xy", areas / 3.0, middles, middles)
    return float(areas.sum()), volume, areas @ centres, second
