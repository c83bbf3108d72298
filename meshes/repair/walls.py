"""Walls given twice with other facets: two sheets on the same rim with no volume between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.facet_topology import edge_uses, parts_by_plain_edges

# Of two sheets on one rim: volume between over area to the power 3/2, difference of their areas.
_FLAT = 1e-6


def double_walls(points: Points, facets: Indices) -> NDArray[np.bool_]:
    """Facets of two sheets in one place: both where they face each other, one where alike.

    Two bodies that touch along a whole face have it twice, cut into other facets.

    Args:
        points: [m].
        facets: Each once, shape (num_facets, 3).

    Returns:
        Whether each facet goes.
    """
    gone = np.zeros(len(facets), dtype=bool)
    uses = edge_uses(facets)
    crowd = uses.counts[uses.edge]
    if not np.any(crowd > 2):
        return gone
    patch = parts_by_plain_edges(uses.edge, uses.owner, crowd, len(facets))
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
    rows_of = _rows_by_patch(patch)
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


def _rows_by_patch(patch: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    order = np.argsort(patch, kind="stable")
    return np.split(order, np.cumsum(np.bincount(patch))[:-1])


def _is_flat(points: Points, one: Indices, other: Indices, faces: bool) -> bool:
    """Whether two sheets on one rim enclose nothing and lie in the same place.

    That is told by their areas, their centres and how they spread about these.
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
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(normals, axis=1)
    centres = corners.mean(axis=1)
    volume = float(np.einsum("ij,ij->", centres, normals)) / 6.0
    # Exact for quadratics: the middles of the sides, each with a third.
    middles = 0.5 * (corners + corners[:, [1, 2, 0]])
    second: Points = np.einsum("f,fix,fiy->xy", areas / 3.0, middles, middles)
    return float(areas.sum()), volume, areas @ centres, second
