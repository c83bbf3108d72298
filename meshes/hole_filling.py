"""Holes in a surface: their loops, and the triangulation of least area that closes one."""

from __future__ import annotations

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.facet_topology import edge_uses


def find_hole_loops(facets: Indices) -> tuple[list[list[int]], list[int]]:
    """Loops of edges that have one facet only, run through as a filling's facets must.

    Args:
        facets: Consistently oriented, shape (num_facets, 3).

    Returns:
        Loops of points; and points where loops touch, whose loops are left out.
    """
    uses = edge_uses(facets)
    open_edges = uses.directed[uses.counts[uses.edge] == 1]
    starts, counts = np.unique(open_edges[:, 1], return_counts=True)
    tangled = set(starts[counts > 1].tolist())
    # The facet that is missing runs along the edge the other way.
    follows = {b: a for a, b in open_edges.tolist()}
    loops, seen = [], set()
    for start in sorted(follows):
        loop, at = [], start
        while at not in seen and at in follows:
            seen.add(at)
            loop.append(at)
            at = follows[at]
        if at == start and len(loop) > 2 and not tangled.intersection(loop):
            loops.append(loop)
    return loops, sorted(tangled)


def fill_loop(points: Points, loop: list[int], taken: set[tuple[int, int]]) -> Indices | None:
    """Triangulate a closed loop of points with the least area.

    Dynamic programming over the loop's chords (Barequet, Sharir 1995): O(n^3) time.

    Args:
        points: [m], shape (num_points, 3).
        loop: Points in the order in which the facets run along it.
        taken: Edges (smaller, larger point) of the surface: a chord must not be one of them,
            for an edge has two facets.

    Returns:
        Facets, shape (len(loop) - 2, 3), or None where every triangulation needs such a chord or
        a facet without area.
    """
    n = len(loop)
    place = points[loop]
    cost: Floats = np.full((n, n), np.inf)
    split = np.full((n, n), -1)
    np.fill_diagonal(cost[:, 1:], 0.0)
    for span in range(2, n):
        for i in range(n - span):
            k = i + span
            is_side = span == n - 1
            if not is_side and (min(loop[i], loop[k]), max(loop[i], loop[k])) in taken:
                continue
            middle = np.arange(i + 1, k)
            double_area = np.linalg.norm(
                np.cross(place[middle] - place[i], place[k] - place[i]), axis=1
            )
            total = cost[i, middle] + cost[middle, k] + double_area
            total[double_area == 0.0] = np.inf
            best = int(np.argmin(total))
            cost[i, k], split[i, k] = total[best], middle[best]
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
