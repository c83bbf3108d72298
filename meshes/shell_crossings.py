"""Do different shells of a surface cross? By rounding arithmetic, for the independent mesher.

Shells that merely touch, and a shell that crosses itself, take exact predicates: see
`palpate.fastsim.mesher`.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.errors import SelfIntersectionError
from palpate.meshes.facet_topology import Integers, edge_uses
from palpate.meshes.shells import Shell
from palpate.meshes.tri_surface import TriSurface

# Edges times facets per block: bounds the memory to some 100 MB.
_BLOCK = 500_000


def require_apart(surface: TriSurface, shells: Sequence[Shell]) -> None:
    """Refuse shells of which an edge of one pierces a facet of another.

    Args:
        surface: Closed.
        shells: Its shells.

    Raises:
        SelfIntersectionError: They cross; one pair of facets for each edge that pierces.
    """
    pairs: list[tuple[int, int]] = []
    for one, other in itertools.permutations(range(len(shells)), 2):
        pairs += _piercings(surface, shells[one].facets, shells[other].facets)
    if pairs:
        raise SelfIntersectionError(sorted(set(pairs)))


def _piercings(surface: TriSurface, rows: Integers, walls: Integers) -> list[tuple[int, int]]:
    """Pairs (facet of `rows` at the edge, pierced facet of `walls`)."""
    points = surface.points
    uses = edge_uses(surface.facets[rows])
    owner = np.empty(len(uses.edges), dtype=np.int64)
    owner[uses.edge] = rows[uses.owner]
    edges, facets = uses.edges, surface.facets[walls]
    # What lies outside the other's bounding box cannot pierce it.
    near_edges = _boxes_meet(points, edges, facets)
    near_facets = _boxes_meet(points, facets, edges)
    edges, owner = edges[near_edges], owner[near_edges]
    facets, walls = facets[near_facets], walls[near_facets]
    found: list[tuple[int, int]] = []
    step = max(1, _BLOCK // max(1, len(facets)))
    for start in range(0, len(edges) if len(facets) else 0, step):
        block = slice(start, start + step)
        e, f = np.nonzero(_pierces(points, edges[block], facets))
        found += zip(owner[block][e].tolist(), walls[f].tolist(), strict=True)
    return found


def _boxes_meet(
    points: Points, items: Indices | Integers, others: Indices | Integers
) -> NDArray[np.bool_]:
    low, high = points[others].min(axis=(0, 1)), points[others].max(axis=(0, 1))
    corners = points[items]
    meets = (corners.min(axis=1) <= high) & (corners.max(axis=1) >= low)
    found: NDArray[np.bool_] = meets.all(axis=1)
    return found


def _pierces(points: Points, edges: Integers, facets: Indices) -> NDArray[np.bool_]:
    """Whether each edge passes through each facet, shape (num_edges, num_facets)."""
    p, q = (points[edges[:, None, k]] for k in range(2))
    a, b, c = (points[facets[None, :, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    ends = np.einsum("efk,efk->ef", p - a, normal) * np.einsum("efk,efk->ef", q - a, normal)
    along = q - p
    turns = [
        np.einsum("efk,efk->ef", along, np.cross(u - p, v - p)) for u, v in ((a, b), (b, c), (c, a))
    ]
    is_through = (np.minimum.reduce(turns) > 0.0) | (np.maximum.reduce(turns) < 0.0)
    found: NDArray[np.bool_] = (ends < 0.0) & is_through
    return found
