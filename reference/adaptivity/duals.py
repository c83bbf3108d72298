"""Duals of the goals: what a goal would change by if a force were left over anywhere.

R. Becker, R. Rannacher, Acta Numerica 10 (2001) 1-102: the error of a goal J is the residual of the
displacement weighted by z, K^T z = J'(u). The L2 norm of the displacement stands for every goal
that has no derivative of its own, and for forces, whose error goes as the energy's; half the square
of a norm for the norm itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.field_norms import size_of_change
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference import fenicsx
from palpate.reference.adaptivity.goals import Goal, Quantity
from palpate.reference.adaptivity.parts import Part
from palpate.reference.discrete_problem import DiscreteProblem
from palpate.reference.fenicsx import ufl
from palpate.reference.kinematics import cofactor, deformation_gradient
from palpate.reference.linear_solver import LinearSolveError
from palpate.reference.result import ReferenceResult
from palpate.reference.statics import Equilibrium

# Weights tell where to refine: three digits are plenty.
_TOLERANCE = 1e-3
# A goal's quantity and part.
Key = tuple[Quantity, Part | None]


@dataclass(frozen=True, eq=False)
class Solved:
    """A state that was found, and the case's mesh that it is a refinement of.

    Attributes:
        found: The equilibrium.
        state: The same, measured, at the points and in the cells of the case's mesh.
        case_mesh: That mesh.
        case_cell: Its cell that each cell solved on lies in, shape (num_cells,).
    """

    found: Equilibrium
    state: ReferenceResult
    case_mesh: TetMesh
    case_cell: Indices

    @property
    def discrete(self) -> DiscreteProblem:
        """The discrete problem."""
        return self.found.discrete

    def here(self, values: Floats) -> Floats:
        """Values of the case's cells in the cells of this rank, in dolfinx's numbering."""
        own: Floats = values[self.case_cell][self.discrete.space.transferred.cell_of_cell]
        return own

    def dx(self, degree: int) -> Any:
        """The measure of the body's volume with a quadrature of some degree."""
        mesh = self.discrete.space.transferred.mesh
        return ufl.dx(domain=mesh, metadata={"quadrature_degree": degree})


def _l2(solved: Solved, _: Part | None) -> tuple[Any, float]:
    u = solved.discrete.u
    squared = ufl.inner(u, u) * solved.dx(2 * solved.discrete.space.degree)
    return 0.5 * squared, fenicsx.assemble_scalar(fenicsx.form(squared))


def _volume(solved: Solved, _: Part | None) -> tuple[Any, float]:
    discrete, state = solved.discrete, solved.state
    dx = solved.dx(3 * (discrete.space.degree - 1))
    volume = ufl.det(deformation_gradient(discrete.u)) * dx
    return volume, size_of_change(state.volume, state.rest_volume)


def _area(solved: Solved, _: Part | None) -> tuple[Any, float]:
    discrete, state = solved.discrete, solved.state
    mesh = discrete.space.transferred.mesh
    # A weight needs fewer digits than the area itself.
    ds = ufl.ds(domain=mesh, metadata={"quadrature_degree": 2 * discrete.space.degree})
    vector = cofactor(deformation_gradient(discrete.u)) * ufl.FacetNormal(mesh)
    area = ufl.sqrt(ufl.inner(vector, vector)) * ds
    return area, size_of_change(state.surface_area, state.rest_surface_area)


def _stress(solved: Solved, part: Part | None) -> tuple[Any, float]:
    assert part is not None
    discrete = solved.discrete
    mesh = discrete.space.transferred.mesh
    inside = fenicsx.cell_function(mesh, solved.here(part.is_inside(solved.case_mesh)))
    # A weight needs fewer digits than the norm: S is of degree 2 (p - 1).
    dx = solved.dx(2 * discrete.space.degree)
    squared = inside * ufl.inner(discrete.stress, discrete.stress) * dx
    return 0.5 * squared, fenicsx.assemble_scalar(fenicsx.form(squared))


_FUNCTIONALS: dict[Quantity, Callable[[Solved, Part | None], tuple[Any, float]]] = {
    Quantity.DISPLACEMENT_L2: _l2,
    Quantity.VOLUME: _volume,
    Quantity.SURFACE_AREA: _area,
    Quantity.STRESS_L2: _stress,
}


def dual_of(goal: Goal) -> Key:
    """Whose dual stands for a goal."""
    if goal.quantity in _FUNCTIONALS:
        return goal.quantity, goal.part
    return Quantity.DISPLACEMENT_L2, None


def solve_duals(solved: Solved, keys: Sequence[Key]) -> dict[Key, Floats]:
    """Dual displacements of relative goals, flat, in the order of the displacement's space [1/N].

    With the tangent that the equilibrium's stability was told by. Under follower loads it is the
    last one of Newton's iteration and should be transposed: a weight does not need to be exact.

    Args:
        solved: The equilibrium.
        keys: Each with a functional of its own: see `dual_of`.

    Returns:
        By key; the displacement itself where the tangent cannot be solved with.
    """
    found, discrete = solved.found, solved.discrete
    duals = {}
    for quantity, part in keys:
        discrete.set_displacement(found.displacement)
        functional, scale = _FUNCTIONALS[quantity](solved, part)
        form = fenicsx.form(ufl.derivative(functional, discrete.unknown))
        gradient = discrete.to_local(fenicsx.assemble_vector(form) / (scale or 1.0))
        gradient[discrete.held.dofs] = 0.0
        try:
            dual = found.newton.solve_again(found.displacement, gradient, tolerance=_TOLERANCE)
        except LinearSolveError:
            dual = found.displacement
        duals[quantity, part] = discrete.of_displacement(dual)
    return duals
