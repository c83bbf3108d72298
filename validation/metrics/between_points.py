"""The reference read between the points of the case, where a candidate's own mesh has points.

Linear tetrahedra are read as they are. A quadratic reference is known at its corners only: there
its second derivatives are recovered from neighbours, by a least-squares quadratic around each
point (polynomial-preserving recovery; Zhang and Naga, SIAM J. Sci. Comput. 26, 2005), and bend
the linear reading along the edges of each cell,

    u(x) = sum_a l_a u_a + 1/2 sum_{a<b} l_a l_b (G_a - G_b) (x_b - x_a),

l_a the barycentric coordinates and G_a the recovered gradients. The doubt is twice

    sum_{a<b} l_a l_b max(|G_a (x_b - x_a) - (u_b - u_a)|, the same with G_b):

where the field is smooth that is twice what is added, and the reading's error is of higher order;
at the edge of a support, where the field has a kink, the slope along the edge is none of the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.exchange.point_location import locate_points

Array = NDArray[np.float64]
_EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
# Points whose neighbours' neighbours are gathered together: bounds the memory.
_CHUNK = 1000
# Of the doubt: at the edge of the kidney's support one is too little, two is not.
_SAFETY = 2.0
# Flat patches, one cell thick, do not tell all second derivatives: the smallest ones are taken.
_RIDGE = 1e-8


@dataclass(frozen=True, eq=False)
class Reading:
    """A displacement read at places.

    Attributes:
        value: [m], (num_places, 3).
        added: What of it a linear reading would not have [m], (num_places, 3).
        doubt: What the reading may be off by [m], (num_places,).
    """

    value: Points
    added: Points
    doubt: Points


def read_between(mesh: TetMesh, displacement: Points, degree: int, own: TetMesh) -> Reading:
    """A displacement at the points of a mesh read at the points of another.

    Outside of the mesh it is continued by the gradient at the nearest place, all of it doubt.

    Args:
        mesh: The case's.
        displacement: At its points [m], (mesh.num_points, 3).
        degree: Of the elements that it was solved with.
        own: The other mesh.
    """
    location = locate_points(mesh, own)
    corners = mesh.cells[location.cells]
    weights = location.weights
    gradients = recovered_gradients(mesh, displacement)[corners]
    linear = location.read(mesh.cells, displacement)
    added, doubt = np.zeros_like(linear), np.zeros(len(linear))
    if degree > 1:
        values = displacement[corners]
        for a, b in _EDGES:
            along = mesh.points[corners[:, b]] - mesh.points[corners[:, a]]
            slopes = [np.einsum("pij,pj->pi", gradients[:, k], along) for k in (a, b)]
            product = weights[:, a] * weights[:, b]
            added += (0.5 * product)[:, None] * (slopes[0] - slopes[1])
            missed = [np.linalg.norm(s - (values[:, b] - values[:, a]), axis=1) for s in slopes]
            doubt += _SAFETY * product * np.maximum(*missed)
    outside = location.distances > 0.0
    if outside.any():
        beyond = own.points - location.read(mesh.cells, mesh.points)
        at_place = np.einsum("pa,paij->pij", weights, gradients)
        continued = np.einsum("pij,pj->pi", at_place, beyond)[outside]
        added[outside] += continued
        doubt[outside] += np.linalg.norm(continued, axis=1)
    return Reading(linear + added, added, doubt)


def recovered_gradients(mesh: TetMesh, displacement: Points) -> Array:
    """Gradient at each point of the quadratic nearest to its neighbourhood, (num_points, 3, 3).

    Row i holds the derivatives of component i. Exact for quadratic fields where neighbours'
    neighbours tell them apart.
    """
    who, others, weights = _gradient_weights(mesh)
    change = displacement[others] - displacement[who]
    starts = np.searchsorted(who, np.arange(mesh.num_points))
    gradients: Array = np.add.reduceat(np.einsum("ni,nj->nij", change, weights), starts, axis=0)
    return gradients


@lru_cache(maxsize=2)
def _gradient_weights(mesh: TetMesh) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """G_a = sum over n with who_n = a of (u_other - u_a) weight_n^T; `who` increases."""
    first, count, neighbours = _neighbours(mesh)
    parts = []
    for start in range(0, mesh.num_points, _CHUNK):
        rows = np.arange(start, min(start + _CHUNK, mesh.num_points))
        # Neighbours, and theirs.
        who, near = _gather(rows, rows, first, count, neighbours)
        whose, far = _gather(who, near, first, count, neighbours)
        both = np.concatenate([who * mesh.num_points + near, whose * mesh.num_points + far])
        pairs = np.unique(both)
        who, others = pairs // mesh.num_points, pairs % mesh.num_points
        who, others = who[who != others], others[who != others]
        parts.append((who, others, _fit(mesh, rows, who, others)))
    return (
        np.concatenate([part[0] for part in parts]),
        np.concatenate([part[1] for part in parts]),
        np.concatenate([part[2] for part in parts]),
    )


def _fit(
    mesh: TetMesh, rows: NDArray[np.int64], who: NDArray[np.int64], others: NDArray[np.int64]
) -> Array:
    """How much each neighbour's difference adds to the gradient at its point, (n, 3)."""
    starts = np.searchsorted(who, rows)
    apart = mesh.points[others] - mesh.points[who]
    length = np.linalg.norm(apart, axis=1)
    size = np.maximum.reduceat(length, starts)[who - rows[0]]
    x, y, z = (apart / size[:, None]).T
    basis = np.column_stack([x, y, z, x * x, y * y, z * z, y * z, z * x, x * y])
    # Nearer neighbours count for more.
    importance = (size / length) ** 2
    normal = np.add.reduceat(np.einsum("n,ni,nj->nij", importance, basis, basis), starts, axis=0)
    # On second derivatives above all: what is linear is found so, however few the neighbours.
    ridge = np.diag([_RIDGE**2] * 3 + [_RIDGE] * 6)
    normal += np.trace(normal, axis1=1, axis2=2)[:, None, None] * ridge
    inverse = np.linalg.inv(normal)[:, :3][who - rows[0]]
    weights: Array = np.einsum("nij,nj,n->ni", inverse, basis, importance / size)
    return weights


def _neighbours(mesh: TetMesh) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Neighbours of point a: the `count[a]` numbers from `first[a]` on."""
    ends = mesh.cells.astype(np.int64)[:, np.array(_EDGES)].reshape(-1, 2)
    keys = np.unique(
        np.concatenate([ends @ [mesh.num_points, 1], ends[:, ::-1] @ [mesh.num_points, 1]])
    )
    count = np.bincount(keys // mesh.num_points, minlength=mesh.num_points)
    return np.cumsum(count) - count, count, keys % mesh.num_points


def _gather(
    who: NDArray[np.int64],
    points: NDArray[np.int64],
    first: NDArray[np.int64],
    count: NDArray[np.int64],
    neighbours: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Each of `who` once for every neighbour of its point."""
    many = count[points]
    within = np.arange(many.sum()) - np.repeat(np.cumsum(many) - many, many)
    return np.repeat(who, many), neighbours[np.repeat(first[points], many) + within]
