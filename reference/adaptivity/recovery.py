"""Where a displacement's gradient is rough: its distance from the nearest continuous one.

O. C. Zienkiewicz, J. Z. Zhu, Int. J. Numer. Methods Eng. 24 (1987) 337-357, with the L2 projection
to continuous gradients of degree p - 1, which are as good as the gradient itself where the
displacement is smooth. Material by material, since gradients do jump where materials meet, and part
by part, since those of a part's dual jump at its border. It asks nothing of loads, supports or
tools.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.reference import fenicsx
from palpate.reference.across_ranks import different_rows
from palpate.reference.discrete_problem import DiscreteProblem
from palpate.reference.fenicsx import PETSc, fem, ufl

# Of the projection: the errors that it is to show are some per cent.
_TOLERANCE = 1e-6


class GradientRecovery:
    """Projects displacement gradients of a discrete problem of degree 2 or 3.

    Args:
        discrete: Whose space and materials.
        parts: Each 1 in a part's cells and 0 in the others, dolfinx numbering, (num_cells,).
    """

    def __init__(self, discrete: DiscreteProblem, parts: Sequence[Floats] = ()) -> None:
        self._space = discrete.space
        transferred = discrete.space.transferred
        mesh, degree = transferred.mesh, discrete.space.degree
        self._field = fem.Function(discrete.space.space)
        tensors = fenicsx.tensor_space(mesh, degree - 1)
        scalars = fenicsx.scalar_space(mesh, degree - 1)
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
        self._cells = fenicsx.cell_space(mesh)
        rough = self._smooth - gradient
        q = ufl.TestFunction(self._cells)
        self._squared = fenicsx.form(self._inside * mu * ufl.inner(rough, rough) * q * dx)

    def cell_errors(self, fields: list[Floats]) -> list[Floats]:
        """Root of the integral of mu |G - grad u|^2 over each cell, G the recovered gradient.

        Args:
            fields: Displacements, flat vectors of the space.

        Returns:
            For each, in the TetMesh's order, the same on all ranks [J^(1/2)], (num_cells,).
        """
        squared = np.zeros((len(fields), self._num_cells))
        for part in self._parts:
            fenicsx.set_cell_values(self._inside, part)
            matrix = self._mass_matrix()
            ksp = PETSc.KSP().create(fenicsx.COMM)
            ksp.setType("cg")
            ksp.getPC().setType("jacobi")
            ksp.setTolerances(rtol=_TOLERANCE)
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
        # Nodes that no cell of this material has.
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
