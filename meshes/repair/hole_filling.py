"""Holes in a surface: their loops, and the triangulation of least area that closes one."""

from __future__ import annotations

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.facet_topology import edge_uses


def find_hole_loops(facets: Indices) -> list[list[int]]:
    """Loops of edges that have one facet only, run through as a filling's facets must.

    Where loops touch at a point they are told apart: a loop ends where it comes back to one of its
    own points.

    Args:
        facets: Consistently oriented, shape (num_facets, 3).
    """
    uses = edge_uses(facets)
    open_edges = uses.directed[uses.counts[uses.edge] == 1]
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
        to_middle = place[middle] - place[low][:, None]
        to_end = np.broadcast_to((place[high] - place[low])[:, None], to_middle.shape)
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
