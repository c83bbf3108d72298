"""Four ways to remove crossings from a patch of a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.meshes.arrays import Indices, Points
from palpate.meshes.repair.hole_filling import cap_loop
from palpate.meshes.repair.patches import (
    MeanOfNeighbours,
    edges_of,
    fair_points,
    grow,
    inner_points,
    with_enclosed,
)
from palpate.meshes.triangles import edge_uses, facet_normals, side_lengths, unit_normals_at_points

Mask = NDArray[np.bool_]
# Rings around the facets that cross: a fold is a few facets wide.
_MOST_RINGS = 6
# Pulling apart: steps of this part of the mean edge, and as many at most.
_STEP, _MOST_STEPS = 0.1, 40
# Pushing back: steps of this part of the mean edge, as many at most, and as many without fewer
# crossings; passes over what follows; fraction that each further ring follows.
_PUSH, _MOST_PUSHES, _PUSHES = 0.04, 80, 15
_FOLLOWS, _PUSH_SPREAD, _PUSH_RINGS = 20, 0.5, 2
_TINY = np.finfo(float).tiny
# Steps without fewer crossings before it gives up.
_PATIENCE = 6
# Fraction of a point's displacement that each further ring around it follows.
_SPREAD, _SPREAD_RINGS = 0.6, 3


@dataclass(frozen=True, eq=False)
class Surroundings:
    """A surface, or the part of one in which a patch of at most `most_facets` facets lies.

    Points `is_fixed` where the surface continues, shape (num_points,).
    """

    points: Points
    facets: Indices
    is_fixed: Mask
    most_facets: float


@dataclass(frozen=True, eq=False)
class Attempt:
    """A surface whose patch crosses nothing.

    `kept` are the rows of the preserved facets, which come first, in order; new facets follow.
    """

    points: Points
    facets: Indices
    kept: NDArray[np.int64]


def smoothed(part: Surroundings, rows: NDArray[np.int64]) -> Attempt | None:
    """Replace the patch by a thin plate on the surface around it; None if crossings remain."""
    points, facets = part.points, part.facets
    for rings in range(1, _MOST_RINGS + 1):
        patch = _patch(part, rows, rings)
        if patch is None:
            return None
        free = inner_points(facets, patch, len(points))
        free = free[~part.is_fixed[free]]
        moved = fair_points(points, facets[grow(facets, patch, 2)], free)
        if is_clean(moved, facets, patch):
            return Attempt(moved, facets, np.arange(len(facets)))
    return None


def pulled_apart(
    part: Surroundings,
    rows: NDArray[np.int64],
    *,
    outwards: bool,
    most: float,
    with_islands: bool = True,
) -> Attempt | None:
    """Facets that cross moved along their normals step by step: walls outwards, lobes inwards.

    `rows` are the facets that cross; what they cut off from the rest may follow them. No point
    moves further than `most` [m].
    """
    points, facets = part.points, part.facets
    step = _STEP * float(side_lengths(points[facets[rows]]).mean())
    normals = unit_normals_at_points(points, facets)
    edges = edges_of(facets)
    moved, bad, counts = points.copy(), rows, list[int]()
    for _ in range(_MOST_STEPS):
        is_bad = np.zeros(len(facets), dtype=bool)
        is_bad[bad] = True
        pull = np.zeros(len(points))
        pull[facets[with_enclosed(facets, is_bad) if with_islands else is_bad]] = 1.0
        for _ring in range(_SPREAD_RINGS):
            spread = pull.copy()
            for a, b in ((0, 1), (1, 0)):
                np.maximum.at(spread, edges[:, a], _SPREAD * pull[edges[:, b]])
            pull = spread
        moved = moved + (step if outwards else -step) * pull[:, None] * normals
        changed = _changed(part, moved, rows, most)
        if changed is None:
            return None
        pairs = crossings_of(moved, facets, changed)
        if not len(pairs):
            is_good = is_clean(moved, facets, changed)
            return Attempt(moved, facets, np.arange(len(facets))) if is_good else None
        bad = np.unique(pairs)
        counts.append(len(pairs))
        if len(counts) > _PATIENCE and min(counts[-_PATIENCE:]) >= min(counts[:-_PATIENCE]):
            return None
    return None


def _changed(
    part: Surroundings, moved: Points, rows: NDArray[np.int64], most: float
) -> Mask | None:
    """`rows` and facets that moved; None if a point moved too far, or too many facets did."""
    shift = np.linalg.norm(moved - part.points, axis=1)
    if shift.max() > most or shift[part.is_fixed].any():
        return None
    changed: Mask = (shift > 0.0)[part.facets].any(axis=1)
    changed[rows] = True
    return changed if np.count_nonzero(changed) <= part.most_facets else None


def pushed_back(part: Surroundings, rows: NDArray[np.int64], *, most: float) -> Attempt | None:
    """What pierces a facet pushed back through it, step by step, and the facet the other way.

    Of each edge that pierces a facet the end nearer to the facet's plane moves along the facet's
    normal; points of crossing facets also move to the mean of their neighbours, which unfolds
    them, by at most as much. What these facets cut off from the rest follows, and so, by less and
    less, does what is around. No point moves further than `most` [m].
    """
    points, facets = part.points, part.facets
    edge = float(side_lengths(points[facets[rows]]).mean())
    mean = MeanOfNeighbours(facets, len(points))
    moved, counts = points.copy(), list[int]()
    pairs = crossings_of(moved, facets, rows)
    for _ in range(_MOST_PUSHES):
        is_bad = np.zeros(len(facets), dtype=bool)
        is_bad[pairs] = True
        is_pushed = np.zeros(len(points), dtype=bool)
        is_pushed[facets[is_bad]] = True
        follows = np.zeros(len(points), dtype=bool)
        follows[facets[with_enclosed(facets, is_bad)]] = True
        push = _at_most_one(_pushes(moved, facets, pairs))
        push[is_pushed] += _at_most_one((mean(moved) - moved) / edge)[is_pushed]
        for _ring in range(_FOLLOWS):
            push = np.where((follows & ~is_pushed)[:, None], mean(push), push)
        spread = push
        for _ring in range(_PUSH_RINGS):
            spread = np.where(follows[:, None], push, _PUSH_SPREAD * mean(spread))
        moved = moved + _PUSH * edge * spread
        changed = _changed(part, moved, rows, most)
        if changed is None:
            return None
        pairs = crossings_of(moved, facets, changed)
        if not len(pairs) and is_clean(moved, facets, changed):
            return Attempt(moved, facets, np.arange(len(facets)))
        counts.append(len(pairs))
        if len(counts) > _PUSHES and min(counts[-_PUSHES:]) >= min(counts[:-_PUSHES]):
            return None
    return None


def _at_most_one(vectors: Points) -> Points:
    """Vectors shortened to a length of one where they are longer."""
    shorter: Points = vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1.0)[:, None]
    return shorter


def _pushes(points: Points, facets: Indices, pairs: NDArray[np.int64]) -> Points:
    """Sum of unit pushes at each point, of pairs of facets of which edges pierce the other."""
    push = np.zeros_like(points)
    for one, other in (pairs.T, pairs.T[::-1]):
        corners = points[facets[other]]
        normals = facet_normals(corners)
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1), _TINY)[:, None]
        for k in range(3):
            first, second = facets[one, k], facets[one, (k + 1) % 3]
            height, top = (
                np.einsum("ij,ij->i", points[p] - corners[:, 0], normals) for p in (first, second)
            )
            along = points[second] - points[first]
            part = height / np.where(height == top, 1.0, height - top)
            at = points[first] + part[:, None] * along
            sides = np.roll(corners, -1, axis=1) - corners
            turns = np.einsum("fij,fj->fi", np.cross(sides, at[:, None] - corners), normals)
            pierces = (height * top < 0.0) & (turns.min(axis=1) >= 0.0)
            is_first = np.abs(height) <= np.abs(top)
            end = np.where(is_first, first, second)
            sign = -np.sign(np.where(is_first, height, top)) * pierces
            np.add.at(push, end, sign[:, None] * normals)
            for corner in range(3):
                np.add.at(push, facets[other, corner], -sign[:, None] * normals)
    return push


def filled_anew(part: Surroundings, rows: NDArray[np.int64]) -> Attempt | None:
    """Remove the patch and fill the holes with smooth caps; None if crossings remain."""
    points, facets = part.points, part.facets
    for rings in range(_MOST_RINGS + 1):
        patch = _patch(part, rows, rings)
        if patch is None:
            return None
        loops = _rim_loops(facets[patch])
        if loops is None:
            continue
        kept = np.flatnonzero(~patch)
        near = facets[grow(facets, patch, 2) & ~patch]
        taken = set(map(tuple, edges_of(near).tolist()))
        caps, positions, is_whole = [], points, True
        for loop in loops:
            cap = next(cap_loop(positions, loop, taken), None)
            is_whole = is_whole and cap is not None
            if cap is not None:
                positions = np.vstack([positions, cap[0]])
                caps.append(cap[1])
                taken.update(map(tuple, edges_of(cap[1]).tolist()))
        if not is_whole:
            continue
        made = np.vstack([facets[kept], *caps]).astype(np.int32)
        is_new = np.arange(len(made)) >= len(kept)
        free = np.arange(len(points), len(positions))
        around = np.vstack([near, *caps]).astype(np.int32)
        for candidate in (fair_points(positions, around, free), positions):
            if is_clean(candidate, made, is_new):
                return Attempt(candidate, made, kept)
    return None


def is_clean(points: Points, facets: Indices, changed: Mask) -> bool:
    """Whether changed facets have an area and cross nothing."""
    corners = points[facets[changed]]
    longest = side_lengths(corners).max(axis=1, initial=0.0)
    # Far above rounding errors, since a mesher has to make cells on the facets.
    if np.any(np.linalg.norm(facet_normals(corners), axis=1) <= 1e-6 * longest**2):
        return False
    return len(crossings_of(points, facets, changed)) == 0


def _patch(part: Surroundings, rows: NDArray[np.int64], rings: int) -> Mask | None:
    chosen = np.zeros(len(part.facets), dtype=bool)
    chosen[rows] = True
    patch = with_enclosed(part.facets, grow(part.facets, chosen, rings))
    return patch if np.count_nonzero(patch) <= part.most_facets else None


def _rim_loops(patch: Indices) -> list[list[int]] | None:
    """Loops around a patch, as its facets run along them; None where loops touch."""
    uses = edge_uses(patch)
    rim = uses.directed[uses.counts[uses.edge] == 1].tolist()
    follows = dict(rim)
    if len(follows) < len(rim):
        return None
    loops = []
    while follows:
        start, at = next(iter(follows.items()))
        loop = [start]
        del follows[start]
        while at != start:
            loop.append(at)
            at = follows.pop(at)
        loops.append(loop)
    return loops


# Largest number of pairs to consider; the first ones are enough.
MOST_PAIRS = 20_000


def all_crossings(points: Points, facets: Indices) -> NDArray[np.int32]:
    """Pairs of facets that meet beyond shared corners and edges, shape (num_pairs, 2)."""
    return _core.find_self_intersections(
        np.ascontiguousarray(points), np.ascontiguousarray(facets), MOST_PAIRS
    )


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
    points: Points, facets: Indices, positions: Points, reach: float = 0.0
) -> NDArray[np.int64]:
    """Facets whose box comes within `reach` of the box of positions."""
    if not len(positions):
        return np.zeros(0, dtype=np.int64)
    low, high = positions.min(axis=0) - reach, positions.max(axis=0) + reach
    corners = points[facets]
    meets = (corners.min(axis=1) <= high) & (corners.max(axis=1) >= low)
    return np.flatnonzero(meets.all(axis=1))
