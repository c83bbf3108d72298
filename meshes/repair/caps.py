"""A cap on a loop of points: the triangulation of least area, refined and smoothed.

After Liepa 2003, "Filling holes in meshes": facets larger than the edges around them are cut at
their centres, edges flipped to Delaunay, and the new points moved to where the cap is smooth.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.repair.fairing import fair_points
from palpate.meshes.repair.hole_filling import fill_loop

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

    Which of them the rest of the surface leaves room for is for the caller to find out.

    Args:
        points: [m], shape (num_points, 3).
        loop: Points in the order in which the facets run along it.
        taken: Edges (smaller, larger point) of the surface, which a cap must not use within.

    Yields:
        New points [m], shape (num_new, 3), numbered from num_points on, and facets, shape
        (num_facets, 3). Nothing where no triangulation is without a taken edge or a flat facet.
    """
    coarse = fill_loop(points, loop, taken)
    if coarse is None:
        return
    fine, facets = _refine(points, coarse, loop, taken)
    free = np.arange(len(points), len(fine))
    if len(free):
        faired = fair_points(fine, facets, free, order=1)
        if not _has_turned(fine, faired, facets):
            yield faired[len(points) :], facets
        yield fine[len(points) :], facets
    yield np.zeros((0, 3)), coarse


def _refine(
    points: Points, coarse: Indices, loop: list[int], taken: set[tuple[int, int]]
) -> tuple[Points, Indices]:
    """Cut facets at their centres where they are larger than the loop's edges near them."""
    place = [tuple(p) for p in points[loop].tolist()]
    local = {v: k for k, v in enumerate(loop)}
    # A bridged loop goes through a point twice: its last number is kept, the place is the same.
    ring = points[loop]
    sides = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    wanted = (0.5 * (sides + np.roll(sides, 1))).tolist()
    facets: Facets = [tuple(local[v] for v in row) for row in coarse.tolist()]  # type: ignore[misc]
    number = list(loop)
    for _ in range(_MOST_PASSES):
        kept: Facets = []
        before = len(place)
        for f in facets:
            a, b, c = (place[v] for v in f)
            centre = tuple((x + y + z) / 3.0 for x, y, z in zip(a, b, c, strict=True))
            size = _GROWTH * sum(wanted[v] for v in f) / 3.0
            if all(_CENTRE * math.dist(centre, place[v]) > max(size, wanted[v]) for v in f):
                new = len(place)
                place.append(centre)
                wanted.append(size)
                kept += [(f[k], f[(k + 1) % 3], new) for k in range(3)]
            else:
                kept.append(f)
        facets = kept
        if len(place) == before:
            break
        number += range(len(points) + before - len(loop), len(points) + len(place) - len(loop))
        facets = _flip(place, facets, number, taken)
    new_points = np.array(place[len(loop) :]).reshape(-1, 3)
    named = np.array(number)[np.array(facets)]
    return np.vstack([points, new_points]), named.astype(np.int32)


def _flip(
    place: list[tuple[float, ...]], facets: Facets, number: list[int], taken: set[tuple[int, int]]
) -> Facets:
    """Flip inner edges to Delaunay where the two facets stay turned as they are."""
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
        if not _is_better(*(np.array(place[v]) for v in (a, b, c, d))):
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


def _has_turned(before: Points, after: Points, facets: Indices) -> bool:
    """Whether smoothing has turned a facet over, or made one flat."""

    def normals(points: Points) -> Points:
        corners = points[facets]
        found: Points = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return found

    return bool(np.any(np.einsum("ij,ij->i", normals(before), normals(after)) <= 0.0))
