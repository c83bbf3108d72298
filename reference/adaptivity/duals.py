"""Duals of the goals: what a goal would change by if a force were left over anywhere.

R. Becker, R. Rannacher, Acta Numerica 10 (2001) 1-102: the error of a goal J is the residual of the
displacement weighted by z, K^T z = J'(u). The L2 norm of the displacement stands for every goal
that has no derivative of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from palpate.meshes.arrays import Floats
from palpate.meshes.field_norms import size_of_change
from palpate.reference import fenicsx
from palpate.reference.adaptivity.goals import Quantity
from palpate.reference.discrete_problem import DiscreteProblem
from palpate.reference.fenicsx import ufl
from palpate.reference.kinematics import cofactor, deformation_gradient
from palpate.reference.linear_solver import LinearSolveError
from palpate.reference.result import ReferenceResult
from palpate.reference.statics import Equilibrium

# Weights tell where to refine: three digits are plenty.
_TOLERANCE = 1e-3


def _l2(discrete: DiscreteProblem, _: ReferenceResult) -> tuple[Any, float]:
    degree = 2 * discrete.space.degree
    mesh = discrete.space.transferred.mesh
    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": degree})
    squared = ufl.inner(discrete.u, discrete.u) * dx
    return 0.5 * squared, fenicsx.assemble_scalar(fenicsx.form(squared))


def _volume(discrete: DiscreteProblem, state: ReferenceResult) -> tuple[Any, float]:
    degree = 3 * (discrete.space.degree - 1)
    mesh = discrete.space.transferred.mesh
    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": degree})
    volume = ufl.det(deformation_gradient(discrete.u)) * dx
    return volume, size_of_change(state.volume, state.rest_volume)


def _area(discrete: DiscreteProblem, state: ReferenceResult) -> tuple[Any, float]:
    mesh = discrete.space.transferred.mesh
    # A weight needs fewer digits than the area itself.
    ds = ufl.ds(domain=mesh, metadata={"quadrature_degree": 2 * discrete.space.degree})
    vector = cofactor(deformation_gradient(discrete.u)) * ufl.FacetNormal(mesh)
    area = ufl.sqrt(ufl.inner(vector, vector)) * ds
    return area, size_of_change(state.surface_area, state.rest_surface_area)


_FUNCTIONALS: dict[Quantity, Callable[[DiscreteProblem, ReferenceResult], tuple[Any, float]]] = {
    Quantity.DISPLACEMENT_L2: _l2,
    Quantity.VOLUME: _volume,
    Quantity.SURFACE_AREA: _area,
}


def dual_of(quantity: Quantity) -> Quantity:
    """Whose dual stands for a quantity."""
    return quantity if quantity in _FUNCTIONALS else Quantity.DISPLACEMENT_L2


def solve_duals(
    found: Equilibrium, state: ReferenceResult, quantities: Sequence[Quantity]
) -> dict[Quantity, Floats]:
    """Dual displacements of relative goals, flat, in the order of the displacement's space [1/N].

    With the tangent that the equilibrium's stability was told by. Under follower loads it is the
    last one of Newton's iteration and should be transposed: a weight does not need to be exact.

    Args:
        found: The equilibrium.
        state: The same, measured.
        quantities: Each with a functional of its own: see `dual_of`.

    Returns:
        By quantity; the displacement itself where the tangent cannot be solved with.
    """
    discrete = found.discrete
    duals = {}
    for quantity in quantities:
        discrete.set_displacement(found.displacement)
        functional, scale = _FUNCTIONALS[quantity](discrete, state)
        form = fenicsx.form(ufl.derivative(functional, discrete.unknown))
        gradient = discrete.to_local(fenicsx.assemble_vector(form) / (scale or 1.0))
        gradient[discrete.held.dofs] = 0.0
        try:
            dual = found.newton.solve_again(found.displacement, gradient, tolerance=_TOLERANCE)
        except LinearSolveError:
            dual = found.displacement
        duals[quantity] = discrete.of_displacement(dual)
    return duals
