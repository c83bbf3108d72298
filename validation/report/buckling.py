"""The load of a case over its first critical one, before anything is solved at finite strain.

Linear buckling on the case's mesh by smoothed tetrahedra, which are little too stiff in bending:

    (K0 + lambda G) phi = 0,   phi . G phi = integral of S : (grad phi)^T grad phi

with the tangent at rest K0 and the stress S of the linear solution under the full load (K. J.
Bathe, Finite Element Procedures, 1996, section 6.8.2). Loads do not turn. What bends much before it
buckles has other stresses than these, and is not asked.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.fastsim.body import Body, cell_stress
from palpate.fastsim.forces import external_force
from palpate.fastsim.supports import FixedPoints
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.tet_mesh import signed_volumes

# Points of the largest mesh that is asked: a few seconds for the factors of smoothed tetrahedra.
MOST_POINTS = 1500
# Eigenpairs sought: the softest bending modes of a slender body come in pairs.
_PAIRS = 4
_TOLERANCE = 1e-4
# Over the body's size: what moves farther under linear strain has other stresses at finite strain.
LARGEST_BEND = 0.2


def load_over_critical(problem: Problem) -> float | None:
    """The load over the first critical one [-]; 0 where none of this direction is critical.

    None in motion, with tools, springs, following pressure or slanted supports, of more than
    MOST_POINTS points or fewer than twenty free components, where linear strain moves the body by
    more than LARGEST_BEND of its size, and where no eigenpair was found.
    """
    supports = FixedPoints(problem)
    free = np.flatnonzero(np.ravel(supports.is_free))
    is_asked = (
        problem.time is None
        and not (problem.tools or problem.springs or supports.slanted is not None)
        and not any(isinstance(load, Pressure) for load in problem.loads)
        and problem.mesh.num_points <= MOST_POINTS
        and free.size >= 20
    )
    return _ratio_of(problem, supports, free) if is_asked else None


def _ratio_of(problem: Problem, supports: FixedPoints, free: Any) -> float | None:
    from scipy.sparse import bsr_matrix, coo_matrix, identity, kron
    from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh, splu

    mesh = problem.mesh
    body = Body.of(problem, Strain.LINEAR, element=Element.SMOOTHED)
    body.core.assemble_tangent(np.zeros_like(mesh.points))
    starts, columns, numbers = body.core.matrix()
    whole = bsr_matrix((np.reshape(numbers, (-1, 3, 3)), columns, starts)).tocsr()
    linear = np.array(supports.at(1.0), dtype=float).reshape(-1)
    at_rest = whole[free][:, free]
    try:
        solve = splu(at_rest.tocsc()).solve
    except RuntimeError:  # singular: too few supports, which others report
        return None
    linear[free] = solve((external_force(problem).reshape(-1) - whole @ linear)[free])
    largest = float(np.abs(linear).max())
    if not 0.0 < largest <= LARGEST_BEND * float(np.ptp(mesh.points, axis=0).max()):
        return None
    S, gradients = cell_stress(body, linear.reshape(-1, 3)), body.shape_gradients
    volumes = signed_volumes(mesh.points, mesh.cells)
    softening = -np.einsum("c,cai,cij,cbj->cab", volumes, gradients, S, gradients)
    rows, columns = (np.repeat(mesh.cells, 4, axis=1), np.tile(mesh.cells, (1, 4)))
    scalar = coo_matrix((softening.ravel(), (rows.ravel(), columns.ravel())))
    slope = kron(scalar.tocsr(), identity(3)).tocsr()[free][:, free]
    inverse = LinearOperator(at_rest.shape, matvec=solve, dtype=float)
    begin = np.random.default_rng(0).standard_normal(free.size)
    try:
        found = eigsh(
            slope, _PAIRS, at_rest, which="LA", Minv=inverse, v0=begin, tol=_TOLERANCE,
            return_eigenvectors=False,
        )  # fmt: skip
    except ArpackError:
        return None
    return max(float(np.max(found)), 0.0)
