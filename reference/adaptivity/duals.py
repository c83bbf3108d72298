"""Dual solutions of the goals and errors of gradients: where the goals' errors come from.

A dual is the change of a goal by a unit residual force at each point. R. Becker, R. Rannacher,
Acta Numerica 10 (2001) 1-102: the error of a goal J is the residual of the displacement weighted by
z, K^T z = J'(u). The dual of the L2 norm of the displacement is used for every goal without a
derivative of its own, and for forces, whose error converges like the energy's; the dual of half the
square of a norm is used for the norm itself.

The L2 norm of the error of a displacement is not the error of its norm, which an error orthogonal
to the displacement does not change. It is the component along the error, which is approximated by
the change c since the mesh before: J(u) = (c, u) / (|c| |u|), in L2 between the case's points.
Where other solutions are judged, c is the change from the first iterate on the first mesh.

The largest displacement is that of one point, along itself; the largest difference is that of a
point which is not known in advance and is sought on every mesh: where the displacement is largest,
where it has changed most since the mesh before, and where the error of its gradient is largest. The
dual of such a goal has a force on a single point; the discrete dual is smooth over its cells.

The error of a gradient is its distance from the nearest continuous one. O. C. Zienkiewicz, J. Z.
Zhu, Int. J. Numer. Methods Eng. 24 (1987) 337-357, with the L2 projection to continuous gradients
of degree p - 1, as accurate as the gradient where the displacement is smooth. It is done for each
material, since gradients jump between materials, and for each part, since the dual of a part has a
gradient that jumps at its border. It does not depend on loads, supports or tools.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.field_norms import l2_gradient, l2_norm
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.reference import fenicsx
from palpate.reference.adaptivity.goals import Goal, Part, Quantity, scale_of
from palpate.reference.discrete_problem import DiscreteProblem
from palpate.reference.fenicsx import PETSc, different_rows, fem, ufl
from palpate.reference.laws import cofactor, deformation_gradient
from palpate.reference.linear_solver import LinearSolveError
from palpate.reference.result import ReferenceResult
from palpate.reference.statics import Equilibrium

# Tolerance of the projection, which is to show errors of some per cent.
_PROJECTION_TOLERANCE = 1e-6


class GradientRecovery:
    """Projects displacement gradients of a discrete problem of degree 2 or 3, part by part.

    Each part is 1 in its cells and 0 in the others, dolfinx numbering, (num_cells,).
    """

    def __init__(self, discrete: DiscreteProblem, parts: Sequence[Floats] = ()) -> None:
        transferred = discrete.space.transferred
        mesh, degree = transferred.mesh, discrete.space.degree
        self._field = fem.Function(discrete.space.space)
        tensors = fenicsx.function_space(mesh, "Lagrange", degree - 1, (3, 3))
        scalars = fenicsx.function_space(mesh, "Lagrange", degree - 1)
        self._smooth = fem.Function(tensors)
        # Blocks of the tensors in the order of the scalars, whose matrix is a ninth as large.
        self._num_owned = int(scalars.dofmap.index_map.size_local)
        block_of = np.zeros(self._num_owned, dtype=np.int64)
        rows, blocks = fenicsx.cell_dofs(scalars).ravel(), fenicsx.cell_dofs(tensors).ravel()
        owned = rows < self._num_owned
        block_of[rows[owned]] = blocks[owned]
        self._block_of = block_of
        self._num_cells = transferred.source.num_cells
        self._cell_of_cell = transferred.cell_of_cell

        mu = discrete.lame[1]
        values = [fenicsx.cell_values(x) for x in discrete.lame]
        kinds = np.column_stack([*values, *parts])
        everywhere = different_rows(kinds)
        self._parts = [(kinds == kind).all(axis=1).astype(float) for kind in everywhere]
        self._inside = fenicsx.cell_function(mesh, np.ones(len(kinds)))
        dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": 2 * (degree - 1)})
        a, b = ufl.TrialFunction(scalars), ufl.TestFunction(scalars)
        self._mass = fenicsx.form(self._inside * a * b * dx)
        gradient = ufl.grad(self._field)
        t = ufl.TestFunction(tensors)
        self._moments = fenicsx.form(self._inside * ufl.inner(gradient, t) * dx)
        self._cells = fenicsx.function_space(mesh, "DG", 0)
        rough = self._smooth - gradient
        q = ufl.TestFunction(self._cells)
        self._squared = fenicsx.form(self._inside * mu * ufl.inner(rough, rough) * q * dx)

    def cell_errors(self, fields: list[Floats]) -> list[Floats]:
        """Root of the integral of mu |G - grad u|^2 over each cell, G the recovered gradient.

        For each of some displacements, flat vectors of the space: [J^(1/2)], in the TetMesh's
        order, the same on all ranks, (num_cells,).
        """
        squared = np.zeros((len(fields), self._num_cells))
        for part in self._parts:
            fenicsx.set_cell_values(self._inside, part)
            matrix = self._mass_matrix()
            ksp = PETSc.KSP().create(fenicsx.COMM)
            ksp.setType("cg")
            ksp.getPC().setType("jacobi")
            ksp.setTolerances(rtol=_PROJECTION_TOLERANCE)
            ksp.setOperators(matrix)
            for k, field in enumerate(fields):
                self._set(self._field, field)
                self._project(matrix, ksp)
                found = fenicsx.assemble_vector(self._squared)
                own = found[fenicsx.cell_dofs(self._cells)[:, 0]]
                squared[k, self._cell_of_cell] += np.maximum(own, 0.0)
            ksp.destroy()
            matrix.destroy()
        return [np.sqrt(row) for row in fenicsx.total(squared)]

    def _mass_matrix(self) -> Any:
        matrix = fenicsx.create_matrix(self._mass)
        fenicsx.assemble_into_matrix(matrix, self._mass)
        diagonal = matrix.getDiagonal()
        # Nodes that belong to no cell of this material.
        diagonal.array[:] = np.where(diagonal.array > 0.0, diagonal.array, 1.0)
        matrix.setDiagonal(diagonal)
        diagonal.destroy()
        return matrix

    def _project(self, matrix: Any, ksp: Any) -> None:
        moments = fenicsx.assemble_vector(self._moments).reshape(-1, 9)[self._block_of]
        x, b = matrix.createVecs()
        smooth = np.zeros_like(moments)
        for k in range(9):
            b.array[:] = moments[:, k]
            ksp.solve(b, x)
            smooth[:, k] = x.array
        x.destroy()
        b.destroy()
        ordered = np.zeros_like(smooth)
        ordered[self._block_of] = smooth
        self._set(self._smooth, ordered.ravel())

    @staticmethod
    def _set(function: Any, values: Floats) -> None:
        function.x.array[: len(values)] = values
        function.x.scatter_forward()


# The duals only weight the refinement: three digits are enough.
_DUAL_TOLERANCE = 1e-3
# Maximum number of points with large gradient errors, and the least error over the largest: at the
# end of a rectangular bar four corners have similar errors, and all are refined at once.
_MOST_ROUGHEST, _ALIKE = 4, 0.5


@dataclass(frozen=True)
class PointValue:
    """The displacement of a point of the case's mesh, along a unit vector."""

    point: int
    along: tuple[float, float, float]


@dataclass(frozen=True)
class AlongChange:
    """The component of the displacement along its change since the mesh before."""


# A goal's quantity and part, or a functional of the displacement at the case's points.
Key = tuple[Quantity, Part | None] | PointValue | AlongChange


@dataclass(frozen=True, eq=False)
class Solved:
    """An equilibrium on a refinement of the case's mesh.

    Attributes:
        found: The equilibrium.
        state: Its result at the points and in the cells of the case's mesh.
        before: The displacement on the mesh before, or another near it, at the case's points [m];
            None where there is none.
        case_mesh: The case's mesh.
        case_cell: For each cell the cell of the case's mesh that it lies in, shape (num_cells,).
    """

    found: Equilibrium
    state: ReferenceResult
    before: Points | None
    case_mesh: TetMesh
    case_cell: Indices

    @property
    def discrete(self) -> DiscreteProblem:
        """The discrete problem."""
        return self.found.discrete

    def here(self, values: Floats) -> Floats:
        """Values of the case's cells in the cells of this rank, in dolfinx's numbering."""
        return values[self.case_cell][self.discrete.space.transferred.cell_of_cell]

    def everywhere(self, values: Floats) -> Floats:
        """Values of the cells of this rank in those of all, in the TetMesh's order."""
        transferred = self.discrete.space.transferred
        whole = np.zeros(transferred.source.num_cells)
        whole[transferred.cell_of_cell] = values
        total: Floats = fenicsx.total(whole)
        return total

    def dx(self, degree: int) -> Any:
        """The measure of the body's volume with a quadrature of a degree."""
        mesh = self.discrete.space.transferred.mesh
        return ufl.dx(domain=mesh, metadata={"quadrature_degree": degree})


def _l2(solved: Solved, _: Part | None) -> Any:
    u = solved.discrete.u
    return ufl.inner(u, u) * solved.dx(2 * solved.discrete.space.degree)


def _volume(solved: Solved, _: Part | None) -> Any:
    F = deformation_gradient(solved.discrete.u)
    return ufl.det(F) * solved.dx(3 * (solved.discrete.space.degree - 1))


def _area(solved: Solved, _: Part | None) -> Any:
    discrete = solved.discrete
    mesh = discrete.space.transferred.mesh
    # A weight needs fewer digits than the area itself.
    ds = ufl.ds(domain=mesh, metadata={"quadrature_degree": 2 * discrete.space.degree})
    vector = cofactor(deformation_gradient(discrete.u)) * ufl.FacetNormal(mesh)
    return ufl.sqrt(ufl.inner(vector, vector)) * ds


def _stress(solved: Solved, part: Part | None) -> Any:
    assert part is not None
    discrete = solved.discrete
    mesh = discrete.space.transferred.mesh
    inside = fenicsx.cell_function(mesh, solved.here(part.is_inside(solved.case_mesh)))
    # A weight needs fewer digits than the norm: S is of degree 2 (p - 1).
    dx = solved.dx(discrete.stress_degree or 2 * discrete.space.degree)
    return inside * ufl.inner(discrete.stress, discrete.stress) * dx


def _of_tools(solved: Solved) -> tuple[Floats, Floats]:
    """Derivative of the forces on the tools, each along itself, over the largest [1/m].

    Its dual is the displacement by a motion of the tools by one metre against those forces together
    with the points in contact: the force is the derivative of the energy by the tools' poses. That
    displacement of the points in contact alone, over the largest force, comes second [1/N]: the
    penalties that resist it are a hundred times stiffer than the body.
    """
    discrete, u = solved.discrete, solved.found.displacement
    forces = [np.array(tool.forces[-1]) for tool in solved.state.tools]
    largest = max((float(np.linalg.norm(force)) for force in forces), default=0.0)
    gradient, moved = np.zeros(discrete.num_dofs), np.zeros(discrete.num_dofs)
    for contact, force in zip(discrete.contacts, forces, strict=True):
        size = float(np.linalg.norm(force))
        if size > 0.0:
            gradient += contact.derivative_of_force(u, force / size) / largest
            moved[contact.pressed_dofs(u)] = force / size / largest
    return gradient, moved


# Derivatives of the goals; for a norm that of its square.
_FUNCTIONALS: dict[Quantity, Callable[[Solved, Part | None], Any]] = {
    Quantity.DISPLACEMENT_L2: _l2,
    Quantity.VOLUME: _volume,
    Quantity.SURFACE_AREA: _area,
    Quantity.STRESS_L2: _stress,
}


def duals_of(goal: Goal, solved: Solved, rough: Floats) -> list[Key]:
    """Keys of the duals that are used for a goal; for several duals see `worst_of`.

    `rough` is the error of the equilibrium's gradient in each cell, see `GradientRecovery`.
    """
    moved = solved.state.displacement
    largest = int(np.argmax(np.linalg.norm(moved, axis=1)))
    if goal.quantity is Quantity.MAX_DISPLACEMENT:
        return [_along(moved, largest)]
    if goal.quantity is Quantity.DISPLACEMENT_MAX:
        found = [_along(moved, point) for point in (largest, *_roughest(solved, rough))]
        if solved.before is not None:
            since = moved - solved.before
            found.append(_along(since, int(np.argmax(np.linalg.norm(since, axis=1)))))
        return list(dict.fromkeys(found))
    if goal.quantity is Quantity.DISPLACEMENT_L2 and solved.before is not None:
        return [AlongChange()]
    if goal.quantity in _FUNCTIONALS or goal.quantity is Quantity.TOOL_FORCE:
        return [(goal.quantity, goal.part)]
    return [(Quantity.DISPLACEMENT_L2, None)]


def _along(field: Points, point: int) -> PointValue:
    """The displacement of a point along the value of a field there."""
    size = float(np.linalg.norm(field[point]))
    x, y, z = (field[point] / size).tolist() if size > 0.0 else (1.0, 0.0, 0.0)
    return PointValue(point, (x, y, z))


def _roughest(solved: Solved, rough: Floats) -> list[int]:
    """The moving points of the case with the largest errors in their cells, or nearly the largest.

    An error g of the gradient over a cell of size h, rough = (mu g^2 h^3)^(1/2), gives an error
    g h of the displacement.
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
    """Contributions of the cells to the largest of the errors that several duals give.

    Each cell's contribution is the largest of all duals, scaled so that the sum is the largest
    error: cells are refined for all duals.
    """
    if len(errors) == 1:
        return errors[0]
    parts: Floats = np.max(errors, axis=0)
    whole = float(parts.sum())
    return parts * (max(float(e.sum()) for e in errors) / whole) if whole > 0.0 else parts


def _gradient(solved: Solved, key: Key) -> tuple[Floats, Floats | None]:
    """Relative derivative of the functional of a key by the unknowns of this rank, flat.

    With it a displacement near the dual, where one is known.
    """
    discrete = solved.discrete
    if isinstance(key, PointValue | AlongChange):
        space = discrete.space
        forces = _forces_at_points(solved, key)
        dofs = space.dof_of_point[: len(forces)]
        here = (dofs >= 0) & (dofs < space.num_blocks)
        nodal = np.zeros((space.num_blocks, 3))
        nodal[dofs[here]] = forces[here]
        return discrete.from_nodal(nodal.ravel()), None
    quantity, part = key
    if quantity is Quantity.TOOL_FORCE:
        return _of_tools(solved)
    functional = _FUNCTIONALS[quantity](solved, part)
    if quantity.is_norm:
        # Half the square of a norm is used instead of the norm.
        scale = fenicsx.assemble_scalar(fenicsx.form(functional))
        functional = 0.5 * functional
    else:
        scale = scale_of(quantity, solved.case_mesh, part, solved.state)
    along = ufl.TestFunction(discrete.unknown.function_space)
    form = fenicsx.form(discrete.derivative(functional, along))
    return discrete.to_local(fenicsx.assemble_vector(form) / (scale or 1.0)), None


def _forces_at_points(solved: Solved, key: PointValue | AlongChange) -> Points:
    """Derivative of a relative functional by the displacements of the case's points [1/m]."""
    mesh, moved = solved.case_mesh, solved.state.displacement
    if isinstance(key, PointValue):
        forces = np.zeros_like(moved)
        forces[key.point] = key.along
        return forces / (float(np.linalg.norm(moved, axis=1).max()) or 1.0)
    change = moved if solved.before is None else moved - solved.before
    return l2_gradient(mesh, change) / (l2_norm(mesh, moved) or 1.0)


def solve_duals(solved: Solved, keys: Sequence[Key]) -> dict[Key, Floats]:
    """Dual displacements of relative goals, flat, in the order of the displacement's space [1/N].

    They are solved with the tangent by which stability was tested. Under follower loads it is the
    last one of Newton's iteration and should be transposed, but a weight need not be exact. Where
    the linear solve fails, it is the displacement itself.
    """
    found, discrete = solved.found, solved.discrete
    duals = {}
    for key in keys:
        discrete.set_displacement(found.displacement)
        gradient, near = _gradient(solved, key)
        gradient[discrete.fixed.dofs] = 0.0
        if near is not None:
            near[discrete.fixed.dofs] = 0.0
        try:
            dual = found.newton.solve_again(
                found.displacement, gradient, tolerance=_DUAL_TOLERANCE, near=near
            )
        except LinearSolveError:
            dual = found.displacement
        duals[key] = discrete.of_displacement(dual)
    return duals
