"""Forces on nodes that are those of a traction or of a weight: which one, found by least squares.

A program that knows nodal loads alone is given the consistent nodal forces of a traction,
F_i = sum over facets of the integral of N_i t (Zienkiewicz, Taylor, Zhu, The Finite Element
Method, 6th ed. 2005, section 2.3). Forces that are those of a uniform or affine t, to 1e-6 of the
largest, are taken for it. Anything else is a set of forces on points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.validation.exchange.nodal_arrays import area_vectors, facet_areas

# Fraction of the largest force: what a file of seven digits leaves, as CalculiX's users write.
_FITS = 1e-6
# Facets whose normals differ by no more are one plane (0.01 degrees).
_FLAT = 1.0 - 0.5 * np.deg2rad(0.01) ** 2
# Planes that may have a traction each: the least squares of so many, dense, take a second. A finely
# cut curved surface has one a facet, and its forces stay forces on points.
_MOST_PLANES = 100
# Quadrature of degree 4 on a triangle (D. A. Dunavant, IJNME 21, 1985, table II): corners, weight.
_A, _B = 0.445948490915965, 0.091576213509771
_POINTS = np.array(
    [[1 - 2 * x if k == j else x for k in range(3)] for x in (_A, _B) for j in range(3)]
)
_WEIGHTS = np.repeat([0.223381589678011, 0.109951743655322], 3)


@dataclass(frozen=True, eq=False)
class FittedTraction:
    """A traction whose consistent nodal forces were found: facets by corner nodes, (n, 3).

    It is affine with these values at these positions; one position where it is uniform.
    """

    facets: NDArray[np.int64]
    positions: Points
    values: Points


def fit_tractions(
    nodes: Points, corners: NDArray[np.int64], middles: NDArray[np.int64], forces: Points
) -> tuple[list[FittedTraction], Points]:
    """Tractions that forces on nodes stand for, and the forces that none explains.

    Args:
        nodes: (num_nodes, 3).
        corners: Corners of boundary facets, (num_facets, 3).
        middles: Nodes half-way along their edges 12, 23, 31, (num_facets, 3); -1 without.
        forces: Forces on nodes, (num_nodes, 3).
    """
    is_loaded = np.any(np.abs(forces) > 1e-12 * np.abs(forces).max(initial=0.0), axis=1)
    # The corners of a quadratic facet carry nothing of a uniform traction; its middles all.
    is_quadratic = (middles >= 0).all(axis=1)
    all_corners, all_middles = is_loaded[corners].all(axis=1), is_loaded[middles].all(axis=1)
    chosen = np.flatnonzero(np.where(is_quadratic, all_middles, all_corners))
    found: list[FittedTraction] = []
    left = forces.copy()
    for part in _connected(corners, chosen) if len(chosen) else ():
        for pieces, is_affine in _ways(nodes, corners, part):
            fitted = _fit(nodes, corners, middles, forces, pieces, is_affine)
            if fitted is not None:
                found += fitted
                left[_nodes_of(corners[part], middles[part])] = 0.0
                break
    return found, left


def fit_body_force(
    weights: NDArray[np.float64], is_inside: NDArray[np.bool_], forces: Points
) -> Points | None:
    """The uniform force by volume that forces on inner nodes stand for, (3,); None if none does.

    Args:
        weights: Integral of each node's shape function, (num_nodes,).
        is_inside: Nodes that are not on the boundary, (num_nodes,).
        forces: Forces on nodes, (num_nodes, 3).
    """
    inside = forces[is_inside]
    if len(inside) < 2 or not inside.any():
        return None
    own = weights[is_inside]
    density: Points = own @ inside / (own @ own)
    missed = np.abs(inside - own[:, None] * density).max()
    return density if missed <= _FITS * np.abs(inside).max() else None


def _connected(corners: NDArray[np.int64], chosen: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Facets that hang together by edges, as rows of `corners`."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    edges = np.sort(corners[chosen][:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    _, edge = np.unique(edges, axis=0, return_inverse=True)
    facet = np.repeat(np.arange(len(chosen)), 3)
    has_edge = coo_matrix((np.ones(len(facet)), (facet, edge.ravel())))
    count, part = connected_components(has_edge @ has_edge.T, directed=False)
    return [chosen[part == k] for k in range(count)]


def _ways(
    nodes: Points, corners: NDArray[np.int64], part: NDArray[np.int64]
) -> list[tuple[list[NDArray[np.int64]], bool]]:
    """The fits to try: one traction on all, then one on each plane; uniform, then affine."""
    normals = area_vectors(nodes, corners[part])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    ways = [([part], False), ([part], True)]
    pieces: list[NDArray[np.int64]] = []
    free = np.ones(len(part), dtype=bool)
    while free.any():
        if len(pieces) == _MOST_PLANES:
            return ways
        first = np.argmax(free)
        alike = free & (normals @ normals[first] >= _FLAT)
        alike[first] = True  # of no area too
        pieces.append(part[alike])
        free &= ~alike
    return ways if len(pieces) in (1, len(part)) else [*ways, (pieces, False), (pieces, True)]


def _fit(
    nodes: Points,
    corners: NDArray[np.int64],
    middles: NDArray[np.int64],
    forces: Points,
    pieces: list[NDArray[np.int64]],
    is_affine: bool,
) -> list[FittedTraction] | None:
    """One traction on each piece, all of them at once; None where they leave too much."""
    loaded = _nodes_of(corners[np.concatenate(pieces)], middles[np.concatenate(pieces)])
    columns, frames = [], []
    for piece in pieces:
        positions = nodes[np.unique(corners[piece])]
        centre, size = positions.mean(axis=0), float(np.ptp(positions, axis=0).max())
        consistent = _consistent(nodes, corners[piece], middles[piece], centre, size)
        columns.append(consistent[loaded][:, : 4 if is_affine else 1])
        frames.append((centre, size))
    matrix = np.hstack(columns)
    solution, _, rank, _ = np.linalg.lstsq(matrix, forces[loaded], rcond=1e-10)
    # As many unknowns as nodes explain anything.
    if rank >= len(loaded):
        return None
    missed = np.abs(matrix @ solution - forces[loaded]).max()
    if not missed <= _FITS * np.abs(forces[loaded]).max():
        return None
    fitted = []
    for piece, (centre, size), values in zip(
        pieces, frames, np.split(solution, len(pieces)), strict=True
    ):
        positions = centre + size * np.vstack([np.zeros(3), np.eye(3)])[: len(values)]
        values[1:] += values[0]
        fitted.append(FittedTraction(corners[piece], positions, values))
    return fitted


def _nodes_of(corners: NDArray[np.int64], middles: NDArray[np.int64]) -> NDArray[np.int64]:
    nodes = np.unique(np.hstack([corners, middles]))
    return nodes[nodes >= 0]


def _consistent(
    nodes: Points,
    corners: NDArray[np.int64],
    middles: NDArray[np.int64],
    centre: Points,
    size: float,
) -> NDArray[np.float64]:
    """Integrals of N_i and of N_i (X - centre) / size over the facets, (num_nodes, 4)."""
    consistent = np.zeros((len(nodes), 4))
    areas = facet_areas(nodes, corners)
    is_quadratic = (middles >= 0).all(axis=1)
    for weights, weight in zip(_POINTS, _WEIGHTS, strict=True):
        positions = np.einsum("k,nkj->nj", weights, nodes[corners])
        basis = np.column_stack([np.ones(len(positions)), (positions - centre) / size])
        basis *= (weight * areas)[:, None]
        straight = np.where(is_quadratic[:, None], weights * (2.0 * weights - 1.0), weights)
        for k in range(3):
            np.add.at(consistent, corners[:, k], straight[:, [k]] * basis)
            bent = 4.0 * weights[k] * weights[(k + 1) % 3] * basis[is_quadratic]
            np.add.at(consistent, middles[is_quadratic, k], bent)
    return consistent
