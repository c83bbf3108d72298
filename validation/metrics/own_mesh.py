"""The reference read on a candidate's own mesh, and the forces of the supports there.

Linear tetrahedra are read as they are. A quadratic reference is known at its corners only: there
its second derivatives are recovered from neighbours, by a least-squares quadratic around each
point (polynomial-preserving recovery; Zhang and Naga, SIAM J. Sci. Comput. 26, 2005), and bend
the linear reading along the edges of each cell,

    u(x) = sum_a l_a u_a + 1/2 sum_{a<b} l_a l_b (G_a - G_b) (x_b - x_a),

l_a the barycentric coordinates and G_a the recovered gradients. The doubt is twice

    sum_{a<b} l_a l_b max(|G_a (x_b - x_a) - (u_b - u_a)|, the same with G_b):

where the field is smooth that is twice what is added, and the reading's error is of higher order;
at the edge of a support, where the field has a kink, the slope along the edge is none of the two.

Which of its points a candidate fixed is not known exactly: those between fixed and free points of
the case may be either. In equilibrium a free point is in balance and adds nothing, so that all of
them are summed; in motion they are not, and their forces are the doubt. With inclusions a cell of
the own mesh has the material of the case's cell that holds its middle.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Pressure
from palpate.meshes.problem import Inclusion, Problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.exchange.nodal_arrays import fixed_components, nodal_force
from palpate.validation.exchange.point_location import locate, locate_points
from palpate.validation.metrics.body import body_of, factor_at_end, forces_at_end
from palpate.validation.states import State

Array = NDArray[np.float64]
_EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
# Points whose neighbours' neighbours are gathered together: bounds the memory.
_CHUNK = 1000
# Factor of the doubt: at the edge of the kidney's support one is too little, two is not.
_SAFETY = 2.0
# Flat patches, one cell thick, do not fix all second derivatives: the smallest ones are taken.
_RIDGE = 1e-8
# Fractions of fixed points below this are rounding.
_ROUNDING = 1e-6
# What to do where the uncertainty leaves a verdict open.
OWN_MESH_REMEDY = (
    "too near the limit for a result on a mesh of its own, where the reference is read between "
    "its points: send the result at the case's points, or mesh the case finer and build its "
    "reference (palpate reference build)"
)


@dataclass(frozen=True, eq=False)
class Reading:
    """A displacement read at given positions.

    `value`, and what of it a linear reading would not have, `added`, are (num_positions, 3) [m];
    `doubt` is the largest error [m], (num_positions,).
    """

    value: Points
    added: Points
    doubt: Points


def read_between(mesh: TetMesh, displacement: Points, degree: int, own: TetMesh) -> Reading:
    """A displacement [m], solved with elements of a degree, read at the points of another mesh.

    Outside of the mesh it is continued by the gradient at the nearest point, all of it doubt.
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
        at_nearest = np.einsum("pa,paij->pij", weights, gradients)
        continued = np.einsum("pij,pj->pi", at_nearest, beyond)[outside]
        added[outside] += continued
        doubt[outside] += np.linalg.norm(continued, axis=1)
    return Reading(linear + added, added, doubt)


def recovered_gradients(mesh: TetMesh, displacement: Points) -> Array:
    """Gradient at each point of the quadratic nearest to its neighbourhood, (num_points, 3, 3).

    Row i holds the derivatives of component i. Exact for quadratic fields where neighbours'
    neighbours determine them.
    """
    who, others, weights = _gradient_weights(mesh)
    change = displacement[others] - displacement[who]
    starts = np.searchsorted(who, np.arange(mesh.num_points))
    gradients: Array = np.add.reduceat(np.einsum("ni,nj->nij", change, weights), starts, axis=0)
    return gradients


@lru_cache(maxsize=2)
def _gradient_weights(mesh: TetMesh) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """G_a = sum over n with who_n = a of (u_other - u_a) weight_n^T; `who` increases."""
    from scipy.sparse import csr_array

    ends = np.concatenate([mesh.cells[:, edge] for edge in _EDGES]).T
    rows, columns = np.concatenate([ends, ends[::-1]], axis=1)
    shape = (mesh.num_points, mesh.num_points)
    near = csr_array((np.ones(len(rows), dtype=np.int32), (rows, columns)), shape=shape)
    parts = []
    for start in range(0, mesh.num_points, _CHUNK):
        chosen = np.arange(start, min(start + _CHUNK, mesh.num_points))
        # Neighbours, and theirs.
        who, others = (near[chosen] + near[chosen] @ near).nonzero()
        order = np.lexsort((others, who))
        who, others = chosen[who[order]], others[order].astype(np.int64)
        who, others = who[who != others], others[who != others]
        parts.append((who, others, _fit(mesh, chosen, who, others)))
    who, others, weights = (np.concatenate(part) for part in zip(*parts, strict=True))
    return who, others, weights


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
    # On second derivatives above all: linear fields are found exactly, however few the neighbours.
    ridge = np.diag([_RIDGE**2] * 3 + [_RIDGE] * 6)
    normal += np.trace(normal, axis1=1, axis2=2)[:, None, None] * ridge
    inverse = np.linalg.inv(normal)[:, :3][who - rows[0]]
    weights: Array = np.einsum("nij,nj,n->ni", inverse, basis, importance / size)
    return weights


def problem_on(mesh: TetMesh, problem: Problem) -> Problem:
    """Another mesh of a case's body with its materials; without all that holds it or acts on it."""
    bare = dataclasses.replace(problem, supports=(), loads=(), springs=(), tools=(), masses=())
    if not problem.inclusions:
        return dataclasses.replace(bare, mesh=mesh)
    case = problem.mesh
    cells = locate(case.points, case.cells, mesh.points[mesh.cells].mean(axis=1)).cells
    inclusions = tuple(
        Inclusion(np.flatnonzero(np.isin(cells, part.cells)).astype(np.int32), part.material)
        for part in problem.inclusions
    )
    return dataclasses.replace(bare, mesh=mesh, inclusions=inclusions)


def own_reactions(
    problem: Problem, own: Problem, displacement: Points, candidate: State, reference: State
) -> tuple[float, float]:
    """Largest error of a support's total force, and what it may be off by [N].

    `own` is the own mesh with the case's materials, `displacement` the result there [m]; the states
    are at the case's points.
    """
    mesh, strain = own.mesh, candidate.strain
    spread = _spread(problem.mesh, mesh)
    force = body_of(own, strain, candidate.element).internal(displacement)
    is_fixed = fixed_components(problem)[0] > 0
    # Loads near a support, and pressure, may be applied to the wrong points.
    loose = np.zeros(mesh.num_points)
    # So may a weight: a result of the case's mesh, sent on a finer one, is balanced on its own.
    weight = np.zeros(mesh.num_points)
    for item, at_points in forces_at_end(problem, candidate.displacement, strain):
        if isinstance(item, BodyForce):
            body = factor_at_end(problem, item) * nodal_force(mesh, item)
            force -= body
            weight += np.linalg.norm(body - spread(at_points), axis=1)
            continue
        loose += spread(np.linalg.norm(at_points, axis=1)[:, None])[:, 0]
        if isinstance(item, Pressure):
            # As `support_reactions` has it: not subtracted where the body is fixed.
            at_points = np.where(is_fixed, 0.0, at_points)
        force -= spread(at_points)
    size = np.linalg.norm(force, axis=1)
    moving = np.zeros_like(size) if problem.time is None else size
    fractions = np.array([_fixed_fraction(problem, s.points, mesh) for s in problem.supports])
    expected = body_of(problem, reference.strain, reference.element).support_reactions(
        reference.displacement
    )
    errors, doubts = [0.0], [0.0]
    for number, support in enumerate(problem.supports):
        touched = _with_neighbours(mesh, fractions[number] > _ROUNDING)
        between = touched & (fractions[number] < 1.0 - _ROUNDING)
        onto = support.directions.T @ support.directions
        found = onto @ force[touched].sum(axis=0)
        shifted = min(weight[touched].sum(), size[between].sum())
        doubts.append(float(loose[touched].sum() + moving[between].sum() + shifted))
        # Between two supports a point's force may belong to either.
        for other, rival in enumerate(problem.supports):
            if other != number and np.any(np.abs(support.directions @ rival.directions.T) > 0.0):
                theirs = _with_neighbours(mesh, fractions[other] > _ROUNDING)
                doubts[-1] += float(size[between & theirs].sum())
        errors.append(float(np.linalg.norm(found - expected[number])))
    return float(np.max(errors)), float(np.max(doubts))


def _fixed_fraction(problem: Problem, points: NDArray[np.int32], own: TetMesh) -> Points:
    """How far each own point is a fixed one: 1 at fixed points, 0 where no corner is."""
    is_fixed = np.zeros((problem.mesh.num_points, 1))
    is_fixed[points] = 1.0
    return locate_points(problem.mesh, own).read(problem.mesh.cells, is_fixed)[:, 0]


def _with_neighbours(own: TetMesh, is_chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """A support may reach one cell farther on a coarser mesh: facets are fixed whole."""
    reached = is_chosen.copy()
    reached[own.cells[is_chosen[own.cells].any(axis=1)]] = True
    return reached


def _spread(case: TetMesh, own: TetMesh) -> Callable[[Points], Points]:
    location = locate(own.points, own.cells, case.points)
    corners = own.cells[location.cells]

    def spread(forces: Points) -> Points:
        """Forces at the case's points, moved to the corners of the own cells that hold them."""
        moved = np.zeros((own.num_points, forces.shape[1]))
        np.add.at(moved, corners, location.weights[:, :, None] * forces[:, None])
        return moved

    return spread
