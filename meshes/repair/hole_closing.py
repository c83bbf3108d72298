"""Holes of a surface closed by caps that fit, two facing loops by a band where that is smaller."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.repair.caps import cap_loop
from palpate.meshes.repair.hole_filling import fill_loop, find_hole_loops
from palpate.meshes.repair.patches import edges_of
from palpate.meshes.repair.sheets import Fits

# Loops are paired where there are at most so many: bands are rare, loops of a torn file many.
_MOST_PAIRED = 200
# Two loops whose band is larger than their caps by its least width and half its length are left:
# this part of that, since a band may be narrower in places.
_SURELY = 0.5
# Pairs of nearest points that a band may be cut open at.
_MOST_BRIDGES = 3


@dataclass
class ClosedHoles:
    """A surface with caps.

    Attributes:
        points: [m]; new ones follow the given.
        facets: The given ones first.
        caps: Facets of each cap, by their number here; the cap on the longest loop first.
        filled: Points of each cap's loop; of a band, those of both loops.
        left_open: Points of loops that were left open.
    """

    points: Points
    facets: Indices
    caps: list[list[int]] = field(default_factory=list)
    filled: list[list[int]] = field(default_factory=list)
    left_open: list[list[int]] = field(default_factory=list)


def close_holes(
    points: Points, facets: Indices, *, largest_hole: int, fits: Fits | None = None
) -> ClosedHoles:
    """Close holes: a band between two loops where it has less area than two caps, else caps.

    Args:
        points: [m].
        facets: Consistently oriented.
        largest_hole: Most edges of a loop that is closed.
        fits: Says whether points and facets cross nothing at the facets marked; where no cap fits
            the one of least area is taken. None asks nobody.
    """
    loops = sorted(find_hole_loops(facets), key=len, reverse=True)
    made = ClosedHoles(points, facets)
    made.left_open = [loop for loop in loops if len(loop) > largest_hole]
    taken = set(map(tuple, edges_of(facets).tolist()))
    for outline in _outlines(points, [x for x in loops if len(x) <= largest_hole], taken):
        cap = _cap_that_fits(made, outline, taken, fits)
        if cap is None:
            made.left_open.append(outline)
            continue
        new_points, rows = cap
        start = len(made.facets)
        made.points = np.vstack([made.points, new_points])
        made.facets = np.vstack([made.facets, rows]).astype(np.int32)
        made.caps.append(list(range(start, start + len(rows))))
        made.filled.append(list(dict.fromkeys(outline)))
        taken.update(map(tuple, edges_of(rows).tolist()))
    return made


def _cap_that_fits(
    made: ClosedHoles, outline: list[int], taken: set[tuple[int, int]], fits: Fits | None
) -> tuple[Points, Indices] | None:
    last = None
    for new_points, rows in cap_loop(made.points, outline, taken):
        last = new_points, rows
        if not _is_manifold(rows, outline):
            last = None
            continue
        if fits is None:
            break
        facets = np.vstack([made.facets, rows]).astype(np.int32)
        is_new = np.arange(len(facets)) >= len(made.facets)
        if fits(np.vstack([made.points, new_points]), facets, is_new):
            break
    return last


def _is_manifold(rows: Indices, outline: list[int]) -> bool:
    """Whether each side of the outline has one facet, and each other edge two."""
    directed = [(a, b) for f in rows.tolist() for a, b in zip(f, f[1:] + f[:1], strict=True)]
    once = set(directed)
    if len(once) < len(directed):
        return False
    sides = set(zip(outline, outline[1:] + outline[:1], strict=True))
    # Along a bridge the outline runs both ways.
    sides = {(a, b) for a, b in sides if (b, a) not in sides}
    return {(a, b) for a, b in once if (b, a) not in once} == sides


def _outlines(
    points: Points, loops: list[list[int]], taken: set[tuple[int, int]]
) -> list[list[int]]:
    """Loops, those that face each other joined by a bridge where a band between them is smaller."""
    if not 2 <= len(loops) <= _MOST_PAIRED:
        return loops
    areas = [_area(points, fill_loop(points, loop, taken)) for loop in loops]
    bands = []
    for i, k in _near_pairs(points, loops, areas):
        outline, area = _band(points, loops[i], loops[k], taken)
        if outline is not None and area < areas[i] + areas[k]:
            bands.append((area - areas[i] - areas[k], i, k, outline))
    out: list[list[int]] = []
    joined: set[int] = set()
    for _, i, k, outline in sorted(bands):
        if not joined & {i, k}:
            joined |= {i, k}
            out.append(outline)
    out += [loop for i, loop in enumerate(loops) if i not in joined]
    return sorted(out, key=len, reverse=True)


def _near_pairs(
    points: Points, loops: list[list[int]], areas: list[float]
) -> Iterator[tuple[int, int]]:
    """Loops so near to each other, beside their lengths, that a band may be smaller than caps."""
    rings = [points[loop] for loop in loops]
    length = [float(np.linalg.norm(np.roll(r, 1, axis=0) - r, axis=1).sum()) for r in rings]
    low = np.array([r.min(axis=0) for r in rings])
    high = np.array([r.max(axis=0) for r in rings])
    for i, first in enumerate(rings):
        gaps = np.maximum(np.maximum(low - high[i], low[i] - high), 0.0)
        apart = np.linalg.norm(gaps, axis=1)
        for k in range(i + 1, len(rings)):
            most = areas[i] + areas[k]
            across = 0.5 * _SURELY * (length[i] + length[k])
            if across * apart[k] >= most:
                continue
            nearest = np.linalg.norm(first[:, None] - rings[k][None], axis=2).min()
            if across * float(nearest) < most:
                yield i, k


def _band(
    points: Points, first: list[int], second: list[int], taken: set[tuple[int, int]]
) -> tuple[list[int] | None, float]:
    """Both loops as one outline, cut open at a short bridge, and the least area within [m2]."""
    if set(first) & set(second):
        return None, np.inf
    gap = np.linalg.norm(points[first][:, None] - points[second][None], axis=2)
    best: tuple[list[int] | None, float] = None, np.inf
    for at in np.argsort(gap, axis=None, kind="stable")[:_MOST_BRIDGES]:
        i, k = np.unravel_index(at, gap.shape)
        outline = [*first[i:], *first[: i + 1], *second[k:], *second[: k + 1]]
        rows = fill_loop(points, outline, taken)
        area = _area(points, rows)
        if rows is not None and area < best[1] and _is_manifold(rows, outline):
            best = outline, area
    return best


def _area(points: Points, rows: Indices | None) -> float:
    if rows is None:
        return np.inf
    corners = points[rows]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return 0.5 * float(np.linalg.norm(normals, axis=1).sum())
