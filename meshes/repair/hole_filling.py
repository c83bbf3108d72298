"""Holes in a surface: their loops, the triangulation of least area of one, and smooth caps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.repair.patches import Fits, edges_of, fair_points
from palpate.meshes.triangles import edge_uses, facet_areas, facet_normals


def find_hole_loops(facets: Indices) -> list[list[int]]:
    """Loops of edges that have one facet only, in the direction of the facets that would fill them.

    Facets are consistently oriented. Loops that touch at a point are separated: a loop ends where
    it comes back to one of its own points.
    """
    uses = edge_uses(facets)
    open_edges = uses.directed[uses.crowd == 1]
    # The facet that is missing runs along the edge the other way.
    follows: dict[int, list[int]] = {}
    for a, b in sorted(open_edges.tolist(), reverse=True):
        follows.setdefault(b, []).append(a)
    loops = []
    for start in sorted(follows):
        path = [start]
        while path:
            ways = follows.get(path[-1])
            if not ways:
                path.pop()
                continue
            at = ways.pop()
            if at in path:
                first = path.index(at)
                if len(path) - first > 2:
                    loops.append(path[first:])
                del path[first + 1 :]
            else:
                path.append(at)
    return loops


def fill_loop(points: Points, loop: list[int], taken: set[tuple[int, int]]) -> Indices | None:
    """Triangulate a closed loop of points with the least area, shape (len(loop) - 2, 3).

    Dynamic programming over the loop's chords (Barequet, Sharir 1995): O(n^3) time. Facets run
    along the loop. A chord must not be one of the `taken` edges (smaller, larger point) of the
    surface, since an edge has two facets: None where every triangulation needs such a chord, or a
    facet without area.
    """
    n = len(loop)
    position = points[loop]
    cost: Floats = np.full((n, n), np.inf)
    split = np.full((n, n), -1)
    np.fill_diagonal(cost[:, 1:], 0.0)
    is_taken = np.zeros((n, n), dtype=bool)
    # The loop's pairs, not the surface's edges: an organ has far more of these.
    for i, a in enumerate(loop):
        for k, b in enumerate(loop[:i]):
            if (min(a, b), max(a, b)) in taken:
                is_taken[i, k] = is_taken[k, i] = True
    for span in range(2, n):
        # All chords of a span at once: row i from i to i + span, over each point between.
        low = np.arange(n - span)
        high = low + span
        middle = low[:, None] + np.arange(1, span)
        to_middle = position[middle] - position[low][:, None]
        to_end = np.broadcast_to((position[high] - position[low])[:, None], to_middle.shape)
        double_area = np.linalg.norm(np.cross(to_middle, to_end), axis=2)
        total = cost[low[:, None], middle] + cost[middle, high[:, None]] + double_area
        total[double_area == 0.0] = np.inf
        if span < n - 1:
            total[is_taken[low, high]] = np.inf
        best = np.argmin(total, axis=1)
        cost[low, high], split[low, high] = total[low, best], middle[low, best]
    if not np.isfinite(cost[0, n - 1]):
        return None
    facets, todo = [], [(0, n - 1)]
    while todo:
        i, k = todo.pop()
        if k - i < 2:
            continue
        m = int(split[i, k])
        facets.append((loop[i], loop[m], loop[k]))
        todo += [(i, m), (m, k)]
    return np.array(facets, dtype=np.int32)


# Caps after Liepa 2003, "Filling holes in meshes": facets larger than the edges around them are cut
# at their centres, edges flipped to Delaunay, and the new points moved to where the cap is smooth.

# A centre is a new point where it is further than its wanted length / sqrt(2) from each corner.
_CENTRE = math.sqrt(2.0)
# Wanted lengths grow inwards by this factor from each point to the next: fewer facets within.
_GROWTH = 1.15
_MOST_PASSES = 12
Facets = list[tuple[int, int, int]]


def cap_loop(
    points: Points, loop: list[int], taken: set[tuple[int, int]]
) -> Iterator[tuple[Points, Indices]]:
    """Caps on a loop, the finest first: refined and smooth, refined, and of least area alone.

    Each is new points [m], numbered from len(points) on, and facets; for `loop` and `taken` see
    `fill_loop`. The caller checks which of them crosses nothing of the rest of the surface.
    """
    coarse = fill_loop(points, loop, taken)
    if coarse is None:
        return
    fine, facets = _refine(points, coarse, loop, taken)
    free = np.arange(len(points), len(fine))
    if len(free):
        faired = fair_points(fine, facets, free, order=1)
        before, after = (facet_normals(x[facets]) for x in (fine, faired))
        # Unless smoothing has turned a facet over, or made one flat.
        if np.all(np.einsum("ij,ij->i", before, after) > 0.0):
            yield faired[len(points) :], facets
        yield fine[len(points) :], facets
    yield np.zeros((0, 3)), coarse


def _refine(
    points: Points, coarse: Indices, loop: list[int], taken: set[tuple[int, int]]
) -> tuple[Points, Indices]:
    """Cut facets at their centres where they are larger than the loop's edges near them."""
    position = [tuple(p) for p in points[loop].tolist()]
    local = {v: k for k, v in enumerate(loop)}
    # A bridged loop goes through a point twice: the last number counts, the position is the same.
    ring = points[loop]
    sides = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    wanted = (0.5 * (sides + np.roll(sides, 1))).tolist()
    facets: Facets = [tuple(local[v] for v in row) for row in coarse.tolist()]  # type: ignore[misc]
    number = list(loop)
    for _ in range(_MOST_PASSES):
        kept: Facets = []
        before = len(position)
        for f in facets:
            a, b, c = (position[v] for v in f)
            centre = tuple((x + y + z) / 3.0 for x, y, z in zip(a, b, c, strict=True))
            size = _GROWTH * sum(wanted[v] for v in f) / 3.0
            if all(_CENTRE * math.dist(centre, position[v]) > max(size, wanted[v]) for v in f):
                new = len(position)
                position.append(centre)
                wanted.append(size)
                kept += [(f[k], f[(k + 1) % 3], new) for k in range(3)]
            else:
                kept.append(f)
        facets = kept
        if len(position) == before:
            break
        number += range(len(points) + before - len(loop), len(points) + len(position) - len(loop))
        facets = _flip(position, facets, number, taken)
    new_points = np.array(position[len(loop) :]).reshape(-1, 3)
    named = np.array(number)[np.array(facets)]
    return np.vstack([points, new_points]), named.astype(np.int32)


def _flip(
    position: list[tuple[float, ...]],
    facets: Facets,
    number: list[int],
    taken: set[tuple[int, int]],
) -> Facets:
    """Flip inner edges to Delaunay where the two facets keep their orientation."""
    facets = list(facets)
    at = {(f[k], f[(k + 1) % 3]): i for i, f in enumerate(facets) for k in range(3)}
    todo = list(at)
    for _ in range(20 * len(todo) + 20):
        if not todo:
            break
        a, b = todo.pop()
        i, j = at.get((a, b)), at.get((b, a))
        if i is None or j is None:
            continue
        c = next(v for v in facets[i] if v not in (a, b))
        d = next(v for v in facets[j] if v not in (a, b))
        if (c, d) in at or (d, c) in at or c == d:
            continue
        named = (min(number[c], number[d]), max(number[c], number[d]))
        if named in taken or number[c] == number[d]:
            continue
        if not _is_better(*(np.array(position[v]) for v in (a, b, c, d))):
            continue
        for u, v in ((a, b), (b, c), (c, a), (b, a), (a, d), (d, b)):
            del at[u, v]
        facets[i], facets[j] = (c, a, d), (d, b, c)
        for f, n in ((facets[i], i), (facets[j], j)):
            for k in range(3):
                at[f[k], f[(k + 1) % 3]] = n
        todo += [(a, d), (d, b), (b, c), (c, a)]
    return facets


def _is_better(a: Points, b: Points, c: Points, d: Points) -> bool:
    """Whether edge (c, d) beats (a, b): the angles at c and d sum to more than pi."""

    def cosine(apex: Points) -> float:
        u, v = a - apex, b - apex
        return float(u @ v / (np.linalg.norm(u) * np.linalg.norm(v) + np.finfo(float).tiny))

    if cosine(c) + cosine(d) >= -1e-12:
        return False
    old = np.cross(b - a, c - a) + np.cross(d - a, b - a)
    return bool(np.cross(a - c, d - c) @ old > 0.0 and np.cross(b - d, c - d) @ old > 0.0)


# Loops are paired only up to this number: bands are rare, and torn files have many loops.
_MOST_PAIRED = 200
# Loops are not paired where this fraction of the least width times half the length of their band
# exceeds their caps' area; below 1, since a band may be narrower in some positions.
_SURELY = 0.5
# Pairs of nearest points at which a band may be cut open.
_MOST_BRIDGES = 3


@dataclass
class ClosedHoles:
    """A surface with caps.

    Attributes:
        points: [m]; the given points first, then the new ones.
        facets: The given facets first, then those of the caps.
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

    Loops of more than `largest_hole` edges stay. `fits` is whether points and facets have no
    crossing at the marked facets; where no cap fits, the one of least area is taken. Without it
    the first cap is.
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
    """Loops; two that face each other are one, joined by a bridge, where a band has less area."""
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
    """Pairs of loops so near for their lengths that a band may have less area than two caps."""
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
    return float(facet_areas(points[rows]).sum())
