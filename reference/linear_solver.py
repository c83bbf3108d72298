"""Linear systems: direct when small, multigrid with rigid modes when large, lagged in motion.

From step to step of a motion the tangent changes little, and by contact at a few nodes only; that
of a linear body is constant. Conjugate gradients preconditioned by the factors of an earlier
tangent then need few iterations, each of them far cheaper than a new factorisation.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.reference import fenicsx
from palpate.reference.fenicsx import PETSc, is_met_by_all
from palpate.reference.mesh_transfer import TransferredSpace
from palpate.reference.multigrid import (
    LinearLevel,
    aggregation_options,
    attach_rigid_modes,
    set_options,
    smoother_options,
)
from palpate.reference.supports import NodeFrames

# Beyond this the factors of a 3-D solid cost more time and memory than multigrid.
LARGEST_DIRECT = 15_000
# Up to this size a matrix for which multigrid fails is factored instead: about 3 GB.
LARGEST_FALLBACK = 150_000
_MAX_KRYLOV_ITERATIONS = 2_000
_OPTIONS = "palpate_reference_"
_NOT_SET_UP = PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED


class LinearSolveError(RuntimeError):
    """The linear solver failed: the tangent is singular, or not positive definite."""


@contextlib.contextmanager
def errors_of(name: str) -> Iterator[None]:
    """Turn an error of PETSc in a solver that occurs on every rank into a LinearSolveError.

    An error on some ranks only is raised unchanged: the other ranks wait inside the solve.
    """
    try:
        yield
    except PETSc.Error as error:
        if not is_met_by_all():
            raise
        raise LinearSolveError(f"PETSc error {error.ierr} in {name}") from None


class PreconditionerError(LinearSolveError):
    """The preconditioner is not positive definite; the matrix may well be."""


def prescribe(matrix: Any, fixed: Indices, x: Any, b: Any, *, is_symmetric: bool) -> None:
    """Replace the fixed rows and columns of matrix x = b by equations for the values in x."""
    # The mean size of the diagonal preserves the condition number; 1.0 would not for E = 1e9.
    diagonal = matrix.getDiagonal()
    typical = float(diagonal.norm(PETSc.NormType.NORM_1)) / diagonal.size or 1.0
    diagonal.destroy()
    first, _ = matrix.getOwnershipRange()
    rows = np.asarray(fixed, dtype=PETSc.IntType) + first
    matrix.zeroRowsColumns(rows, diag=typical, x=x, b=b)
    if is_symmetric:
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)


def _prescribed(
    matrix: Any, rhs: Floats, fixed: Indices, values: Floats, *, is_symmetric: bool
) -> tuple[Any, Any]:
    """The vectors x and b of a system with some entries of x prescribed."""
    fenicsx.give_back_dropped()
    x, b = matrix.createVecs()
    b.array[:] = rhs
    x.array[fixed] = values
    prescribe(matrix, fixed, x, b, is_symmetric=is_symmetric)
    return x, b


def _solution(x: Any, fixed: Indices, values: Floats) -> Floats:
    solution: Floats = np.array(x.array)
    if not math.isfinite(fenicsx.norm(solution)):
        raise LinearSolveError("the tangent stiffness is singular")
    solution[fixed] = values
    return solution


def symmetric_part(matrix: Any) -> Any:
    """(A + A^T) / 2 as a new PETSc matrix, to be destroyed by the caller."""
    part = PETSc.Mat()
    matrix.transpose(part)
    part.axpy(1.0, matrix)
    part.scale(0.5)
    return part


class LinearSolver:
    """Solves A du = b with some entries of du prescribed.

    Args:
        space: Displacements, whose nodes that this rank owns are the unknowns, three each.
        is_symmetric: Whether the tangents are (they are unless a load follows the surface).
        frames: Nodes whose unknowns are along axes of their own; None where there are none.
        is_always_direct: Factor also where multigrid would be cheaper: for tangents that need not
            be positive definite.
        num_multipliers: Number of unknowns besides displacements (pressures), each a negative pivot
            of a stable body; the solver is direct where there are any.
    """

    def __init__(
        self,
        space: TransferredSpace,
        *,
        is_symmetric: bool,
        frames: NodeFrames | None = None,
        is_always_direct: bool = False,
        num_multipliers: int = 0,
    ) -> None:
        self._space, self._frames = space, frames
        # The level below the multigrid of a higher degree, for the unknowns that are fixed now.
        self._below: LinearLevel | None = None
        self._fixed_below = np.zeros(0, dtype=np.int32)
        num_nodes = space.num_global_blocks
        self._is_symmetric = is_symmetric
        self._num_multipliers = num_multipliers
        is_small = is_always_direct or 3 * num_nodes < LARGEST_DIRECT
        self._is_direct = is_small or num_multipliers > 0
        self._may_fall_back = 3 * num_nodes < LARGEST_FALLBACK
        self._smooths_by_blocks = True
        self._is_prepared = False
        self._ksp = self._direct() if self._is_direct else self._multigrid()

    @property
    def name(self) -> str:
        """What solves, for the log."""
        if self._is_direct:
            return f"{'LDL' if self._is_symmetric else 'LU'} (MUMPS)"
        method = "CG" if self._is_symmetric else "FGMRES"
        if self._space.degree == 1:
            return f"{method} with GAMG"
        return f"{method} with multigrid from degree {self._space.degree} to 1"

    def solve(
        self,
        matrix: Any,
        rhs: Floats,
        fixed: Indices,
        values: Floats,
        *,
        tolerance: float,
        is_same_matrix: bool = False,
        is_near: bool = False,
    ) -> Floats:
        """Return du with matrix du = rhs on the free entries and du = values on the fixed ones.

        Overwrites the fixed rows and columns of the matrix.

        Args:
            matrix: PETSc matrix.
            rhs: Right-hand side, the entries that this rank owns, shape (num_dofs,).
            fixed: Prescribed entries, shape (n,).
            values: Their values, shape (n,).
            tolerance: Relative residual at which an iterative solve stops.
            is_same_matrix: The matrix is that of the last solve: use its factors or multigrid.
            is_near: The matrix is nearly that of the last solve: use its multigrid, but no factors.

        Raises:
            LinearSolveError: No finite solution was found.
        """
        x, b = _prescribed(matrix, rhs, fixed, values, is_symmetric=self._is_symmetric)
        if is_same_matrix:
            tried = [True]
        else:
            tried = [True, False] if is_near and not self._is_direct else [False]
        return self._solve_prescribed(matrix, b, x, fixed, values, tried, tolerance)

    def solve_once_more(
        self, matrix: Any, rhs: Floats, fixed: Indices, *, tolerance: float
    ) -> Floats:
        """Return du for another right-hand side, with du = 0 at the fixed entries.

        Matrix and fixed entries are as the last `solve` left them.

        Raises:
            LinearSolveError: No finite solution was found.
        """
        x, b = matrix.createVecs()
        b.array[:] = rhs
        b.array[fixed] = 0.0
        return self._solve_prescribed(matrix, b, x, fixed, np.zeros(len(fixed)), [True], tolerance)

    def _solve_prescribed(
        self,
        matrix: Any,
        b: Any,
        x: Any,
        fixed: Indices,
        values: Floats,
        tried: Sequence[bool],
        tolerance: float,
    ) -> Floats:
        """Solve, and destroy x and b. `tried`: whether to use the last preparation, in turn."""
        try:
            for is_prepared in tried:
                self._ksp.getPC().setReusePreconditioner(is_prepared)
                if is_prepared:
                    self._ksp.setOperators(matrix)
                else:
                    self._prepare(matrix, fixed)
                self._ksp.setTolerances(rtol=tolerance, atol=0.0, max_it=_MAX_KRYLOV_ITERATIONS)
                try:
                    self._run(b, x)
                    break
                except PreconditionerError:
                    continue
            else:
                self._factor_instead(matrix, b, x)
            return _solution(x, fixed, values)
        finally:
            self._ksp.getPC().setReusePreconditioner(False)
            x.destroy()
            b.destroy()

    def destroy(self) -> None:
        """Free factors or multigrid levels at once."""
        self._ksp.destroy()

    def is_positive_definite(self, matrix: Any, fixed: Indices) -> bool:
        """Whether a symmetric matrix is positive definite on its free entries.

        A small matrix is tested by the signs of its pivots, a large one by whether conjugate
        gradients for a random right-hand side meet a direction of negative curvature.
        """
        x, b = matrix.createVecs()
        b.array[:] = np.random.default_rng(fenicsx.COMM.rank).standard_normal(b.local_size)
        b.array[fixed] = 0.0
        prescribe(matrix, fixed, x, b, is_symmetric=self._is_symmetric)
        try:
            # The multigrid of the last Newton step is good enough: the tangent is nearly the same.
            is_prepared = self._is_prepared and not self._is_direct
            self._ksp.getPC().setReusePreconditioner(is_prepared)
            if is_prepared:
                self._ksp.setOperators(matrix)
            else:
                self._prepare(matrix, fixed)
            self._ksp.setTolerances(rtol=1e-6, atol=0.0, max_it=_MAX_KRYLOV_ITERATIONS)
            try:
                self._run(b, x)
            except PreconditionerError:
                return self._factor_instead(matrix, b, x)
            return self._has_good_pivots(self._ksp) if self._is_direct else True
        except LinearSolveError:
            return False
        finally:
            self._ksp.getPC().setReusePreconditioner(False)
            x.destroy()
            b.destroy()

    def _has_good_pivots(self, ksp: Any) -> bool:
        """Whether the factors L D L^T have as many negative pivots as there are multipliers."""
        negative, zero, _ = ksp.getPC().getFactorMatrix().getInertia()
        return int(negative) == self._num_multipliers and int(zero) == 0

    def _factor_instead(self, matrix: Any, b: Any, x: Any) -> bool:
        """Solve by factors where multigrid fails; return whether all pivots are positive."""
        if not self._may_fall_back:
            raise LinearSolveError(
                f"the preconditioner of {self.name} is not positive definite, nor perhaps the "
                "tangent stiffness"
            )
        ksp = self._direct()
        try:
            ksp.setOperators(fenicsx.in_rows(matrix))
            with errors_of("MUMPS"):
                ksp.solve(b, x)
            return self._has_good_pivots(ksp) if self._is_symmetric else True
        finally:
            ksp.destroy()

    def _run(self, b: Any, x: Any) -> None:
        with errors_of(self.name):
            self._ksp.solve(b, x)
        reason = self._ksp.getConvergedReason()
        if reason < 0:
            # A failure of multigrid does not show that the matrix is indefinite.
            if reason == PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_PC:
                raise PreconditionerError
            raise LinearSolveError(
                "the tangent stiffness is not positive definite"
                if reason == PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT
                else f"{self.name} stopped with reason {reason}"
            )

    def _direct(self) -> Any:
        ksp = PETSc.KSP().create(fenicsx.COMM)
        ksp.setType("preonly")
        ksp.setOptionsPrefix("palpate_reference_direct_")
        # MUMPS reports the signs of the pivots only where it also looks for null pivots.
        PETSc.Options("palpate_reference_direct_")["mat_mumps_icntl_24"] = 1
        # A symmetric matrix is factored as L D L^T, whose pivots show if it is positive definite.
        ksp.getPC().setType("cholesky" if self._is_symmetric else "lu")
        ksp.getPC().setFactorSolverType("mumps")
        ksp.setFromOptions()
        return ksp

    def _multigrid(self) -> Any:
        ksp = PETSc.KSP().create(fenicsx.COMM)
        ksp.setOptionsPrefix(_OPTIONS)
        ksp.setType("cg" if self._is_symmetric else "fgmres")
        # The stopping norm must be that of the true residual, which the outer loop relies on.
        if self._is_symmetric:
            ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        if self._space.degree == 1:
            ksp.getPC().setType("gamg")
            set_options(aggregation_options(_OPTIONS, 3, by_blocks=self._smooths_by_blocks))
        else:
            set_options(smoother_options(_OPTIONS, 2, by_blocks=self._smooths_by_blocks))
        ksp.setFromOptions()
        return ksp

    def _prepare(self, matrix: Any, fixed: Indices) -> None:
        """Pass a new matrix on, and set multigrid up for it unless its last one is used again."""
        self._is_prepared = True
        if self._is_direct:
            # Factors are of entries, multigrid is of blocks.
            self._ksp.setOperators(fenicsx.in_rows(matrix))
            return
        self._attach(matrix, fixed)
        with errors_of(self.name):
            self._ksp.setUp()
        if self._smooths_by_blocks and self._ksp.getConvergedReason() == _NOT_SET_UP:
            self._smooths_by_blocks = False
            self._ksp.destroy()
            self._ksp, self._below = self._multigrid(), None
            self._attach(matrix, fixed)

    def _attach(self, matrix: Any, fixed: Indices) -> None:
        """Pass multigrid a new matrix and what it needs to know of it."""
        self._ksp.setOperators(matrix)
        if self._space.degree == 1:
            turn = None if self._frames is None else self._frames.to_local
            attach_rigid_modes(matrix, self._space.coordinates, fixed, turn)
            return
        if self._below is None or not np.array_equal(fixed, self._fixed_below):
            self._below = LinearLevel(
                self._space,
                fixed,
                self._frames,
                is_symmetric=self._is_symmetric,
                by_blocks=self._smooths_by_blocks,
            )
            self._below.attach(self._ksp)
            self._fixed_below = fixed
        self._below.prepare(matrix, self._ksp.getPC())


# Iterations of a solve above which the next matrix is factored anew.
_FEW_ITERATIONS = 12
# Newton's method corrects the remaining error: no solve needs a smaller tolerance than this.
_ROUGH = 1e-4
_MOST_ITERATIONS = 60
_PREFIX = "palpate_reference_lagged_"


class LaggedFactors:
    """Solves A du = b with some entries of du prescribed, for one A after another."""

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
        # New factors give the solution directly, also where the matrix is indefinite.
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
        """Drop the factors: the next matrix is a different one and is factored anew."""
        self._is_old = True

    def solve(
        self, matrix: Any, rhs: Floats, fixed: Indices, values: Floats, *, tolerance: float
    ) -> Floats:
        """See `LinearSolver.solve`, for matrices of the same size and pattern each time.

        No tolerance is less than 1e-4.
        """
        x, b = _prescribed(matrix, rhs, fixed, values, is_symmetric=self._is_symmetric)
        self._ksp.setTolerances(rtol=max(tolerance, _ROUGH))
        try:
            self._run(matrix, b, x)
            return _solution(x, fixed, values)
        finally:
            x.destroy()
            b.destroy()

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
