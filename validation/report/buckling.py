"""The load of a case over its first critical one, before anything is solved at finite strain.

Linear buckling on the case's mesh by smoothed tetrahedra, which are little too stiff in bending:

    (K0 + lambda G) phi = 0,   phi . G phi = integral of S : (grad phi)^T grad phi

with the tangent at rest K0 and the stress S of the linear solution under the full load (K. J.
Bathe, Finite Element Procedures, 1996, section 6.8.2). Loads do not turn. What bends much before it
buckles has other stresses than these, and is not asked.

Modes are sought among the body's softest shapes alone, those of its slowest free vibrations (the
Rayleigh-Ritz method, Bathe, section 10.3.2). Stress has no bound at the edge of what is fixed, and
among all displacements of the mesh the first to buckle is then a single point there: 0.73, 0.17 and
0.84 of the phantom's load on three meshes, where these shapes give 0.03 on each. Less than all
displacements allow is found: the ratio is a lower bound of that of the mesh.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from palpate.fastsim.body import Body, cell_stress
from palpate.fastsim.forces import external_force
from palpate.fastsim.supports import FixedPoints
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.tet_mesh import signed_volumes

# Points of the largest mesh that is asked: a few seconds for the factors of smoothed tetrahedra.
MOST_POINTS = 1500
# The softest shapes, and those of them that must give the ratio within this part of it too: so do a
# column's. Otherwise both are said, as a range that has not settled.
_SHAPES, _FEW, _SETTLED = 60, 15, 0.05
_TOLERANCE = 1e-6
# Over the body's size: what moves farther under linear strain has other stresses at finite strain.
LARGEST_BEND = 0.2


class Buckling(NamedTuple):
    """The load over the first critical one [-], in a few of the softest shapes and in all of them.

    0 where no load of this direction is critical. Where they differ the mode is that of a part of
    the body, an edge or a single bad cell, and the mesh decides about the number.
    """

    least: float
    ratio: float

    @property
    def is_settled(self) -> bool:
        """Whether more shapes than a few leave the number as it is."""
        return self.ratio - self.least <= _SETTLED * self.ratio


def load_over_critical(problem: Problem) -> Buckling | None:
    """The load of a case over its first critical one.

    None in motion, with tools, springs, following pressure or slanted supports, of more than
    MOST_POINTS points or fewer than 120 free components, where linear strain moves the body by
    more than LARGEST_BEND of its size, and where no eigenpair was found.
    """
    supports = FixedPoints(problem)
    free = np.flatnonzero(np.ravel(supports.is_free))
    is_asked = (
        problem.time is None
        and not (problem.tools or problem.springs or supports.slanted is not None)
        and not any(isinstance(load, Pressure) for load in problem.loads)
        and problem.mesh.num_points <= MOST_POINTS
        and free.size >= 2 * _SHAPES
    )
    return _ratio_of(problem, supports, free) if is_asked else None


def _ratio_of(problem: Problem, supports: FixedPoints, free: Any) -> Buckling | None:
    from scipy.linalg import eigh
    from scipy.sparse import bsr_matrix, coo_matrix, diags, identity, kron
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
    weights = np.bincount(mesh.cells.ravel(), np.repeat(volumes, 4), mesh.num_points)
    inverse = LinearOperator(at_rest.shape, matvec=solve, dtype=float)
    begin = np.random.default_rng(0).standard_normal(free.size)
    try:
        slowness, shapes = eigsh(
            diags(np.repeat(weights, 3)[free]), _SHAPES, at_rest, which="LA", Minv=inverse,
            v0=begin, tol=_TOLERANCE,
        )  # fmt: skip
    except ArpackError:
        return None
    shapes = shapes[:, np.argsort(-slowness)]
    of_load, of_rest = shapes.T @ (slope @ shapes), shapes.T @ (at_rest @ shapes)
    least, ratio = (
        max(float(eigh(of_load[:n, :n], of_rest[:n, :n], eigvals_only=True)[-1]), 0.0)
        for n in (_FEW, _SHAPES)
    )
    return Buckling(least, ratio)
