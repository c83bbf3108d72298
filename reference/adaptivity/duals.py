"""Duals of the goals: what a goal would change by if a force were left over anywhere.

R. Becker, R. Rannacher, Acta Numerica 10 (2001) 1-102: the error of a goal J is the residual of the
displacement weighted by z, K^T z = J'(u). The L2 norm of the displacement stands for every goal
that has no derivative of its own, and for forces, whose error goes as the energy's; half the square
of a norm for the norm itself.

How far a displacement is off in L2 is not what its norm is off: an error that is orthogonal to it
leaves that as it is. It is its part along the error, for which the change since the mesh before
stands: J(u) = (c, u) / (|c| |u|), in L2 between the case's points, as it is measured.

The largest displacement is that of one point, along itself; the largest difference is that of
a point which nobody knows before, and is looked for on every mesh: where the displacement is
largest, where it has moved most since the mesh before, and where its gradient is roughest. The
force of such a dual is on a single point, over which the discrete one is as smooth as its cells.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.field_norms import l2_gradient, l2_norm, size_of_change
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
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
# Rough points looked at, and how rough over the roughest: at the end of a body that is cut at right
# angles four corners have like errors, and all are refined for at once.
_MOST_ROUGHEST, _ALIKE = 4, 0.5


@dataclass(frozen=True)
class PointValue:
    """The displacement of a point of the case's mesh, along a unit vector."""

    point: int
    along: tuple[float, float, float]


@dataclass(frozen=True)
class AlongChange:
    """The displacement's part along how it has changed since the mesh before."""


# A goal's quantity and part, or what is read of the displacement at the case's points.
Key = tuple[Quantity, Part | None] | PointValue | AlongChange


@dataclass(frozen=True, eq=False)
class Solved:
    """A state that was found, and the case's mesh that it is a refinement of.

    Attributes:
        found: The equilibrium.
        state: The same, measured, at the points and in the cells of the case's mesh.
        before: The state on the mesh before; None on the first one.
        case_mesh: That mesh.
        case_cell: Its cell that each cell solved on lies in, shape (num_cells,).
    """

    found: Equilibrium
    state: ReferenceResult
    before: ReferenceResult | None
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

    def everywhere(self, values: Floats) -> Floats:
        """Values of the cells of this rank in those of all, in the TetMesh's order."""
        transferred = self.discrete.space.transferred
        whole = np.zeros(transferred.source.num_cells)
        whole[transferred.cell_of_cell] = values
        total: Floats = fenicsx.total(whole)
        return total

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
    dx = solved.dx(discrete.stress_degree or 2 * discrete.space.degree)
    squared = inside * ufl.inner(discrete.stress, discrete.stress) * dx
    return 0.5 * squared, fenicsx.assemble_scalar(fenicsx.form(squared))


def _of_tools(solved: Solved) -> Floats:
    """Derivative of the forces on the tools, each along itself, over the largest [1/m].

    Its dual is what the body does where the tools go on by one metre against those forces, with the
    points that they hold: the force is the energy's derivative by their poses.
    """
    discrete, u = solved.discrete, solved.found.displacement
    forces = [np.array(tool.forces[-1]) for tool in solved.state.tools]
    largest = max((float(np.linalg.norm(force)) for force in forces), default=0.0)
    gradient = np.zeros(discrete.num_dofs)
    for contact, force in zip(discrete.contacts, forces, strict=True):
        size = float(np.linalg.norm(force))
        if size > 0.0:
            gradient += contact.derivative_of_force(u, force / size) / largest
    return gradient


_FUNCTIONALS: dict[Quantity, Callable[[Solved, Part | None], tuple[Any, float]]] = {
    Quantity.DISPLACEMENT_L2: _l2,
    Quantity.VOLUME: _volume,
    Quantity.SURFACE_AREA: _area,
    Quantity.STRESS_L2: _stress,
}


def duals_of(goal: Goal, solved: Solved, rough: Floats) -> list[Key]:
    """Whose duals stand for a goal; of several, see `worst_of`.

    Args:
        goal: The goal.
        solved: The equilibrium.
        rough: How rough its gradient is in each cell, see `GradientRecovery`, (num_cells,).
    """
    moved = solved.state.displacement
    largest = int(np.argmax(np.linalg.norm(moved, axis=1)))
    if goal.quantity is Quantity.MAX_DISPLACEMENT:
        return [_along(moved, largest)]
    if goal.quantity is Quantity.DISPLACEMENT_MAX:
        found = [_along(moved, point) for point in (largest, *_roughest(solved, rough))]
        if solved.before is not None:
            since = moved - solved.before.displacement
            found.append(_along(since, int(np.argmax(np.linalg.norm(since, axis=1)))))
        return list(dict.fromkeys(found))
    if goal.quantity is Quantity.DISPLACEMENT_L2 and solved.before is not None:
        return [AlongChange()]
    if goal.quantity in _FUNCTIONALS or goal.quantity is Quantity.TOOL_FORCE:
        return [(goal.quantity, goal.part)]
    return [(Quantity.DISPLACEMENT_L2, None)]


def _along(field: Points, point: int) -> PointValue:
    """The displacement of a point along a field there."""
    size = float(np.linalg.norm(field[point]))
    x, y, z = (field[point] / size).tolist() if size > 0.0 else (1.0, 0.0, 0.0)
    return PointValue(point, (x, y, z))


def _roughest(solved: Solved, rough: Floats) -> list[int]:
    """The moving points of the case with the largest errors in cells of their own, and like ones.

    Gradients that are wrong by g over a cell of size h, rough = (mu g^2 h^3)^(1/2), make a
    displacement wrong by g h.
    """
    mesh = solved.found.problem.mesh
    size = np.cbrt(signed_volumes(mesh.points, mesh.cells))
    mu = solved.everywhere(fenicsx.cell_values(solved.discrete.lame[1]))
    at_points = np.zeros(mesh.num_points)
    np.maximum.at(at_points, mesh.cells, (rough / np.sqrt(mu * size))[:, None])
    own = at_points[: solved.case_mesh.num_points]
    own = np.where(np.linalg.norm(solved.state.displacement, axis=1) > 0.0, own, 0.0)
    best = np.argsort(-own, kind="stable")[:_MOST_ROUGHEST]
    found: list[int] = best[own[best] >= _ALIKE * own[best[0]]].tolist()
    return found


def worst_of(errors: Sequence[Floats]) -> Floats:
    """One error's parts by cell from those of several duals: the largest of their errors.

    Each cell's part is the largest that one of them has, and all together are that error, so that
    what is refined is refined for all.
    """
    if len(errors) == 1:
        return errors[0]
    parts: Floats = np.max(errors, axis=0)
    whole = float(parts.sum())
    return parts * (max(float(e.sum()) for e in errors) / whole) if whole > 0.0 else parts


def _gradient(solved: Solved, key: Key) -> Floats:
    """Derivative of what a key stands for, relative, by the unknowns of this rank, flat."""
    discrete = solved.discrete
    if isinstance(key, PointValue | AlongChange):
        space = discrete.space
        forces = _forces_at_points(solved, key)
        dofs = space.dof_of_point[: len(forces)]
        here = (dofs >= 0) & (dofs < space.num_blocks)
        nodal = np.zeros((space.num_blocks, 3))
        nodal[dofs[here]] = forces[here]
        return discrete.from_nodal(nodal.ravel())
    quantity, part = key
    if quantity is Quantity.TOOL_FORCE:
        return _of_tools(solved)
    functional, scale = _FUNCTIONALS[quantity](solved, part)
    along = ufl.TestFunction(discrete.unknown.function_space)
    form = fenicsx.form(discrete.derivative(functional, along))
    return discrete.to_local(fenicsx.assemble_vector(form) / (scale or 1.0))


def _forces_at_points(solved: Solved, key: PointValue | AlongChange) -> Points:
    """By what a relative number changes with the displacement of each of the case's points."""
    mesh, moved = solved.case_mesh, solved.state.displacement
    if isinstance(key, PointValue):
        forces = np.zeros_like(moved)
        forces[key.point] = key.along
        return forces / (float(np.linalg.norm(moved, axis=1).max()) or 1.0)
    change = moved if solved.before is None else moved - solved.before.displacement
    return l2_gradient(mesh, change) / (l2_norm(mesh, moved) or 1.0)


def solve_duals(solved: Solved, keys: Sequence[Key]) -> dict[Key, Floats]:
    """Dual displacements of relative goals, flat, in the order of the displacement's space [1/N].

    With the tangent that the equilibrium's stability was told by. Under follower loads it is the
    last one of Newton's iteration and should be transposed: a weight does not need to be exact.

    Args:
        solved: The equilibrium.
        keys: See `duals_of`.

    Returns:
        By key; the displacement itself where the tangent cannot be solved with.
    """
    found, discrete = solved.found, solved.discrete
    duals = {}
    for key in keys:
        discrete.set_displacement(found.displacement)
        gradient = _gradient(solved, key)
        gradient[discrete.held.dofs] = 0.0
        try:
            dual = found.newton.solve_again(found.displacement, gradient, tolerance=_TOLERANCE)
        except LinearSolveError:
            dual = found.displacement
        duals[key] = discrete.of_displacement(dual)
    return duals
