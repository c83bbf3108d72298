"""Sheets that meet where a surface must not: fins, double walls, bodies that touch."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable

import numpy as np

from palpate.meshes.arrays import Indices, Integers, Mask, Points
from palpate.meshes.surface_checks import LARGEST_FIN
from palpate.meshes.triangles import (
    connected_parts,
    edge_uses,
    facet_normals,
    facet_parts,
    parts_by_plain_edges,
    side_lengths,
    unit_normals_at_points,
)

# How far the copies of a point where sheets touched are moved, over the shortest edge there.
_GAP = 0.05
# A closed shell has four facets at least.
_FEWEST_FACETS = 4
Fits = Callable[[Points, Indices, Mask], bool]


def fins_of(points: Points, facets: Indices, is_wall: Mask) -> Mask:
    """Facets of sheets that bound no solid: free at one edge, joined at another, or inner walls.

    Facets of `is_wall` were given twice, facing both ways: with a solid on either side. Loose parts
    too small to close count as well.
    """
    areas = np.linalg.norm(facet_normals(points[facets]), axis=1)
    is_fin = np.zeros(len(facets), dtype=bool)
    while True:
        rows = np.flatnonzero(~is_fin)
        uses = edge_uses(facets[rows])
        crowd = uses.crowd
        patch = parts_by_plain_edges(uses)
        touches = np.bincount(patch[uses.owner], crowd > 2) > 0
        is_free = np.bincount(patch[uses.owner], crowd == 1) > 0
        weight = np.bincount(patch, areas[rows])
        small = weight <= LARGEST_FIN * areas.sum()
        within = np.bincount(patch, ~is_wall[rows]) == 0
        candidates = np.flatnonzero(touches & (within | (is_free & small)))
        if not len(candidates):
            break
        is_fin[rows[patch == candidates[np.argmin(weight[candidates])]]] = True
    rows = np.flatnonzero(~is_fin)
    part = facet_parts(facets[rows])
    sizes = np.bincount(part)
    if (sizes >= _FEWEST_FACETS).any():
        is_fin[rows[sizes[part] < _FEWEST_FACETS]] = True
    return is_fin


def split_touching(
    points: Points, facets: Indices, fits: Fits | None = None
) -> tuple[Points, Indices, int, float]:
    """Give each of the bodies that touch along an edge or at a point its own points, and a gap.

    Around an edge facets belong together that bound the same wedge of the solid; around a point,
    those that are joined by such edges. Facets are consistently oriented within each part connected
    by edges with two facets; of the two directions the one that `fits` is taken. Returns points,
    with the copies appended; facets; how many points were split; and the largest movement [m].
    Nothing changes where the wedges cannot be determined.
    """
    joined = _joined_corners(points, facets)
    if joined is None:
        return points, facets, 0, 0.0
    fan = connected_parts(3 * len(facets), joined)
    corner = facets.reshape(-1).astype(np.int64)
    pair = np.unique(np.column_stack([corner, fan]), axis=0)
    # A fan that ends at a rim stays: the hole is closed later.
    uses = edge_uses(facets)
    rim = uses.directed[uses.crowd == 1]
    several = np.flatnonzero(np.bincount(pair[:, 0], minlength=len(points)) > 1)
    several = np.setdiff1d(several, rim)
    if not len(several):
        return points, facets, 0, 0.0
    named = corner.copy()
    position = list(points)
    for v in several:
        for number in pair[pair[:, 0] == v, 1][1:]:
            named[fan == number] = len(position)
            position.append(points[v])
    new = named.reshape(-1, 3).astype(np.int32)
    copies = np.concatenate([several, np.arange(len(points), len(position))])
    apart = np.array(position)
    normals = unit_normals_at_points(apart, new)[copies]
    shortest = np.full(len(apart), np.inf)
    lengths = side_lengths(apart[new])
    np.minimum.at(shortest, new, lengths)
    np.minimum.at(shortest, new[:, [1, 2, 0]], lengths)
    edge = shortest[copies]
    touched = np.isin(new, copies).any(axis=1)
    best = None
    for sign in (-1.0, 1.0):
        moved = apart.copy()
        moved[copies] += sign * _GAP * edge[:, None] * normals
        best = moved if best is None else best
        if fits is None or fits(moved, new, touched):
            best = moved
            break
    assert best is not None
    return best, new, len(several), float(_GAP * edge.max())


def _joined_corners(points: Points, facets: Indices) -> Integers | None:
    """Pairs of corners (3 facet + k) of one point whose facets belong together across an edge."""
    uses = edge_uses(facets)
    sides = [uses.plain_pairs]
    patch = parts_by_plain_edges(uses)
    by_edge = defaultdict(list)
    for side in uses.by_edge[uses.crowd[uses.by_edge] > 2].tolist():
        by_edge[int(uses.edge[side])].append(side)
    for around in by_edge.values():
        pairs = _wedges(points, facets, uses.directed, np.array(around), patch[uses.owner[around]])
        if pairs is None:
            return None
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
) -> Integers | None:
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
    is_forward = (directed[sides, 0] == a)[order]
    if len(sides) % 2 or np.any(is_forward == np.roll(is_forward, 1)):
        return None
    ring = sides[order]
    return (ring if not is_forward[0] else np.roll(ring, -1)).reshape(-1, 2)


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
