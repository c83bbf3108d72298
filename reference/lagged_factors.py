"""Many systems that are nearly the same: conjugate gradients by the factors of one of the last.

From step to step of a motion the tangent changes little, and by contact in a few nodes only; that
of a linear body not at all. Then old factors leave few iterations, each of them far cheaper than to
factor anew.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.reference import fenicsx
from palpate.reference.fenicsx import PETSc
from palpate.reference.linear_solver import LinearSolveError, errors_of, hold

# What a solve may take before the next one gets factors of its own.
_FEW_ITERATIONS = 12
# Newton's method goes on from what is left: no solve need be better than this.
_ROUGH = 1e-4
_MOST_ITERATIONS = 60
_PREFIX = "palpate_reference_lagged_"


class LaggedFactors:
    """Solves A du = b with some entries of du prescribed, for one A after another.

    Args:
        is_symmetric: Whether the matrices are.
    """

    def __init__(self, *, is_symmetric: bool) -> None:
        self._is_symmetric = is_symmetric
        self._ksp = PETSc.KSP().create(fenicsx.COMM)
        self._ksp.setOptionsPrefix(_PREFIX)
        self._ksp.setType("cg" if is_symmetric else "fgmres")
        pc = self._ksp.getPC()
        pc.setType("cholesky" if is_symmetric else "lu")
        pc.setFactorSolverType("mumps")
        if is_symmetric:
            self._ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        self._ksp.setFromOptions()
        self._ksp.setTolerances(rtol=_ROUGH, atol=0.0, max_it=_MOST_ITERATIONS)
        # New factors solve by themselves, also where the matrix is indefinite.
        self._exact = PETSc.KSP().create(fenicsx.COMM)
        self._exact.setType("preonly")
        self._exact.setPC(pc)
        self._is_old = True

    @property
    def name(self) -> str:
        """What solves, for the log."""
        method, factors = ("CG", "LDL") if self._is_symmetric else ("FGMRES", "LU")
        return f"{method} with an earlier {factors} (MUMPS)"

    def forget(self) -> None:
        """Take new factors for the next matrix, which is another one."""
        self._is_old = True

    def solve(
        self, matrix: Any, rhs: Floats, held: Indices, values: Floats, *, tolerance: float
    ) -> Floats:
        """Return du with matrix du = rhs on the free entries and du = values on the held ones.

        Overwrites the held rows and columns of the matrix.

        Args:
            matrix: PETSc matrix, of the same size and pattern each time.
            rhs: Right-hand side, the entries this rank owns, shape (num_dofs,).
            held: Prescribed entries, shape (n,).
            values: Their values, shape (n,).
            tolerance: Relative residual at which to stop; 1e-4 where that is less.

        Raises:
            LinearSolveError: No finite solution was found.
        """
        fenicsx.give_back_dropped()
        x, b = matrix.createVecs()
        b.array[:] = rhs
        x.array[held] = values
        hold(matrix, held, x, b, is_symmetric=self._is_symmetric)
        self._ksp.setTolerances(rtol=max(tolerance, _ROUGH))
        try:
            self._run(matrix, b, x)
            solution: Floats = np.array(x.array)
        finally:
            x.destroy()
            b.destroy()
        if not np.isfinite(fenicsx.norm(solution)):
            raise LinearSolveError("the tangent stiffness is singular")
        solution[held] = values
        return solution

    def _run(self, matrix: Any, b: Any, x: Any) -> None:
        pc = self._ksp.getPC()
        for ksp in (self._exact,) if self._is_old else (self._ksp, self._exact):
            is_new = ksp is self._exact
            ksp.setOperators(matrix)
            pc.setReusePreconditioner(not is_new)
            with errors_of(self.name):
                ksp.solve(b, x)
            if ksp.getConvergedReason() > 0:
                self._is_old = not is_new and ksp.getIterationNumber() > _FEW_ITERATIONS
                return
            x.set(0.0)
        raise LinearSolveError("the tangent stiffness is singular")
