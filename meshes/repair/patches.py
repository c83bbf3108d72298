"""Patches of a surface that are worked on: rings around facets, and what they enclose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices
from palpate.meshes.facet_topology import connected_parts, edge_uses

Mask = NDArray[np.bool_]
# What rings enclose is taken in where it has at most this many times the facets of the rings:
# the tip of a fold, not the rest of an organ.
_MOST_ENCLOSED = 4


def grow(facets: Indices, chosen: Mask, rings: int = 1) -> Mask:
    """Take in the facets that share a point with the chosen ones, ring by ring."""
    for _ in range(rings):
        is_touched = np.zeros(int(facets.max(initial=-1)) + 1, dtype=bool)
        is_touched[facets[chosen]] = True
        chosen = is_touched[facets].any(axis=1)
    return chosen


def with_enclosed(facets: Indices, chosen: Mask) -> Mask:
    """Take in the small islands that chosen facets cut off from the rest of their shell.

    What reaches an open rim is no island: the surface may go on there.
    """
    uses = edge_uses(facets)
    order = np.argsort(uses.edge, kind="stable")
    edge, owner = uses.edge[order], uses.owner[order]
    pairs = np.column_stack([owner[:-1], owner[1:]])[edge[1:] == edge[:-1]]
    shell = connected_parts(len(facets), pairs)
    apart = chosen[pairs[:, 0]] == chosen[pairs[:, 1]]
    part = connected_parts(len(facets), pairs[apart])
    sizes = np.bincount(part)
    is_rim = np.zeros(len(sizes), dtype=bool)
    is_rim[part[uses.owner[uses.counts[uses.edge] == 1]]] = True
    taken = chosen.copy()
    for number in np.unique(shell[chosen]):
        of_shell = shell == number
        rest = np.unique(part[of_shell & ~chosen])
        if not len(rest):
            continue
        most = _MOST_ENCLOSED * np.count_nonzero(of_shell & chosen)
        largest = rest[np.argmax(sizes[rest])]
        small = [k for k in rest if k != largest and sizes[k] <= most and not is_rim[k]]
        taken |= np.isin(part, small)
    return taken


def inner_points(facets: Indices, chosen: Mask, num_points: int) -> NDArray[np.int64]:
    """Points of chosen facets alone: those that may move when the patch is replaced."""
    is_inner = np.zeros(num_points, dtype=bool)
    is_inner[facets[chosen]] = True
    is_inner[facets[~chosen]] = False
    return np.flatnonzero(is_inner)


def edges_of(facets: Indices) -> NDArray[np.int64]:
    """Undirected edges of facets, shape (num_edges, 2), each once."""
    return edge_uses(facets).edges
