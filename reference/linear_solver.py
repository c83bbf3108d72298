"""Linear systems: direct when small, multigrid with rigid modes when large, lagged in motion.

From step to step of a motion the tangent changes little, and by contact in a few nodes only; that
of a linear body not at all. Then factors of an earlier one leave conjugate gradients few
iterations, each of them far cheaper than to factor anew.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.reference import fenicsx
from palpate.reference.fenicsx import PETSc, is_met_by_all

# Beyond this the factors of a 3-D solid cost more time and memory than multigrid.
LARGEST_DIRECT = 15_000
# Up to here a matrix that multigrid cannot work with is factored after all: about 3 GB.
LARGEST_FALLBACK = 150_000
_MAX_KRYLOV_ITERATIONS = 2_000


class LinearSolveError(RuntimeError):
    """The linear solver gave up: the tangent is singular, or not positive definite."""


@contextlib.contextmanager
def errors_of(name: str) -> Iterator[None]:
    """Turn an error of PETSc that every rank meets into a solver's.

    One that a single rank meets stays what it is: the others wait for it inside the solve.

    Args:
        name: Of the solver.

    Raises:
        LinearSolveError: In the place of PETSc's.
    """
    try:
        yield
    except PETSc.Error as error:
        if not is_met_by_all():
            raise
        raise LinearSolveError(f"PETSc error {error.ierr} in {name}") from None


class PreconditionerError(LinearSolveError):
    """The preconditioner is not positive definite; the matrix may well be."""


def hold(matrix: Any, held: Indices, x: Any, b: Any, *, is_symmetric: bool) -> None:
    """Replace the held rows and columns of matrix x = b by those of the values in x."""
    # The diagonal's own size keeps the condition number; 1.0 would not for E = 1e9.
    diagonal = matrix.getDiagonal()
    typical = float(diagonal.norm(PETSc.NormType.NORM_1)) / diagonal.size or 1.0
    diagonal.destroy()
    first, _ = matrix.getOwnershipRange()
    rows = np.asarray(held, dtype=PETSc.IntType) + first
    matrix.zeroRowsColumns(rows, diag=typical, x=x, b=b)
    if is_symmetric:
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)


def _prescribed(
    matrix: Any, rhs: Floats, held: Indices, values: Floats, *, is_symmetric: bool
) -> tuple[Any, Any]:
    """The vectors x and b of a system with some entries of x prescribed."""
    fenicsx.give_back_dropped()
    x, b = matrix.createVecs()
    b.array[:] = rhs
    x.array[held] = values
    hold(matrix, held, x, b, is_symmetric=is_symmetric)
    return x, b


def _solution(x: Any, held: Indices, values: Floats) -> Floats:
    solution: Floats = np.array(x.array)
    if not math.isfinite(fenicsx.norm(solution)):
        raise LinearSolveError("the tangent stiffness is singular")
    solution[held] = values
    return solution


def symmetric_part(matrix: Any) -> Any:
    """(A + A^T) / 2 as a PETSc matrix of its own, to be destroyed by the caller."""
    part = PETSc.Mat()
    matrix.transpose(part)
    part.axpy(1.0, matrix)
    part.scale(0.5)
    return part


class LinearSolver:
    """Solves A du = b with some entries of du prescribed.

    Args:
        coordinates: Rest position of each node that this rank owns [m], shape (num_blocks, 3).
        is_symmetric: Whether the tangents are (they are unless a load follows the surface).
        has_contact: Whether contact stiffens some nodes along one direction: a smoother that
            looks at one degree of freedom at a time then needs a wider bound.
        is_always_direct: Also where multigrid would be cheaper: for tangents that need not be
            positive definite.
        num_multipliers: Unknowns besides displacements (pressures), each a negative pivot of a
            stable body; with any, always direct.
        largest_direct: Unknowns up to which it is direct; LARGEST_DIRECT where None.
        to_local: Turns a flat vector along x, y, z to the axes that the unknowns are along.
    """

    def __init__(
        self,
        coordinates: Points,
        *,
        is_symmetric: bool,
        has_contact: bool = False,
        is_always_direct: bool = False,
        num_multipliers: int = 0,
        largest_direct: int | None = None,
        to_local: Callable[[Floats], Floats] | None = None,
    ) -> None:
        self._to_local = to_local or (lambda flat: flat)
        num_nodes = fenicsx.total(len(coordinates))
        centre = fenicsx.total(coordinates.sum(axis=0)) / num_nodes
        self._centred = coordinates - centre
        self._is_symmetric = is_symmetric
        self._has_contact = has_contact
        self._num_multipliers = num_multipliers
        most = LARGEST_DIRECT if largest_direct is None else largest_direct
        is_small = is_always_direct or 3 * num_nodes < most
        self._is_direct = is_small or num_multipliers > 0
        self._may_fall_back = 3 * num_nodes < LARGEST_FALLBACK
        self._ksp = self._direct() if self._is_direct else self._multigrid()

    @property
    def name(self) -> str:
        """What solves, for the log."""
        if self._is_direct:
            return f"{'LDL' if self._is_symmetric else 'LU'} (MUMPS)"
        return f"{'CG' if self._is_symmetric else 'FGMRES'} with GAMG"

    def solve(
        self,
        matrix: Any,
        rhs: Floats,
        held: Indices,
        values: Floats,
        *,
        tolerance: float,
        is_same_matrix: bool = False,
        is_near: bool = False,
    ) -> Floats:
        """Return du with matrix du = rhs on the free entries and du = values on the held ones.

        Overwrites the held rows and columns of the matrix.

        Args:
            matrix: PETSc matrix.
            rhs: Right-hand side, the entries this rank owns, shape (num_dofs,).
            held: Prescribed entries, shape (n,).
            values: Their values, shape (n,).
            tolerance: Relative residual at which an iterative solve stops.
            is_same_matrix: As in the last solve: what it prepared serves again.
            is_near: Nearly so: multigrid may serve again, factors do not.

        Raises:
            LinearSolveError: No finite solution was found.
        """
        x, b = _prescribed(matrix, rhs, held, values, is_symmetric=self._is_symmetric)
        if is_same_matrix:
            tried = [True]
        else:
            tried = [True, False] if is_near and not self._is_direct else [False]
        return self._solve_held(matrix, b, x, held, values, tried, tolerance)

    def solve_once_more(
        self, matrix: Any, rhs: Floats, held: Indices, *, tolerance: float
    ) -> Floats:
        """Return du of another right-hand side, and du = 0 where held.

        Args:
            matrix: As the last `solve` left it.
            rhs: See there.
            held: As then.
            tolerance: See there.

        Raises:
            LinearSolveError: No finite solution was found.
        """
        x, b = matrix.createVecs()
        b.array[:] = rhs
        b.array[held] = 0.0
        return self._solve_held(matrix, b, x, held, np.zeros(len(held)), [True], tolerance)

    def _solve_held(
        self,
        matrix: Any,
        b: Any,
        x: Any,
        held: Indices,
        values: Floats,
        tried: Sequence[bool],
        tolerance: float,
    ) -> Floats:
        """Solve, and destroy x and b. `tried`: in turn, whether what was prepared last serves."""
        try:
            for is_prepared in tried:
                if not (is_prepared or self._is_direct):
                    self._attach_rigid_modes(matrix, held)
                self._ksp.setOperators(matrix)
                self._ksp.getPC().setReusePreconditioner(is_prepared)
                self._ksp.setTolerances(rtol=tolerance, atol=0.0, max_it=_MAX_KRYLOV_ITERATIONS)
                try:
                    self._run(b, x)
                    break
                except PreconditionerError:
                    continue
            else:
                self._factor_instead(matrix, b, x)
            return _solution(x, held, values)
        finally:
            self._ksp.getPC().setReusePreconditioner(False)
            x.destroy()
            b.destroy()

    def destroy(self) -> None:
        """Give factors or multigrid levels back at once."""
        self._ksp.destroy()

    def is_positive_definite(self, matrix: Any, held: Indices) -> bool:
        """Whether a symmetric matrix is positive definite on its free entries.

        Small: by the signs of the pivots. Large: whether conjugate gradients meet a direction of
        negative curvature on the way to a random right-hand side.
        """
        x, b = matrix.createVecs()
        b.array[:] = np.random.default_rng(fenicsx.COMM.rank).standard_normal(b.local_size)
        b.array[held] = 0.0
        hold(matrix, held, x, b, is_symmetric=self._is_symmetric)
        try:
            if not self._is_direct:
                self._attach_rigid_modes(matrix, held)
            self._ksp.setOperators(matrix)
            self._ksp.setTolerances(rtol=1e-6, atol=0.0, max_it=_MAX_KRYLOV_ITERATIONS)
            # The multigrid of the last Newton step, one small step away, serves as well.
            self._ksp.getPC().setReusePreconditioner(not self._is_direct)
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
        """Solve by factors where multigrid is none; return whether all pivots are positive."""
        if not self._may_fall_back:
            raise LinearSolveError(
                f"the preconditioner of {self.name} is not positive definite, nor perhaps the "
                "tangent stiffness"
            )
        ksp = self._direct()
        try:
            ksp.setOperators(matrix)
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
            # What multigrid cannot do says nothing about the matrix.
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
        # MUMPS tells the signs of the pivots only where it also looks for null ones.
        PETSc.Options("palpate_reference_direct_")["mat_mumps_icntl_24"] = 1
        # Of a symmetric matrix L D L^T, whose pivots also tell whether it is positive definite.
        ksp.getPC().setType("cholesky" if self._is_symmetric else "lu")
        ksp.getPC().setFactorSolverType("mumps")
        ksp.setFromOptions()
        return ksp

    def _multigrid(self) -> Any:
        ksp = PETSc.KSP().create(fenicsx.COMM)
        ksp.setOptionsPrefix("palpate_reference_")
        options = PETSc.Options("palpate_reference_")
        for key, value in {
            "pc_gamg_type": "agg",
            "pc_gamg_agg_nsmooths": 1,
            "pc_gamg_threshold": 0.01,
            "mg_levels_ksp_type": "chebyshev",
            "mg_levels_pc_type": "jacobi",
            "mg_levels_ksp_max_it": 3,
            # Smoothing up to so many times the estimated largest eigenvalue. Contact adds k n n^T
            # at single nodes: up to 3 against its diagonal, which the estimate's few steps miss.
            "mg_levels_ksp_chebyshev_esteig": "0,0.2,0,3.0" if self._has_contact else "0,0.1,0,1.1",
        }.items():
            options[key] = value
        ksp.setType("cg" if self._is_symmetric else "fgmres")
        ksp.getPC().setType("gamg")
        # The stopping norm must be the true residual's: the outer loop reasons with it.
        if self._is_symmetric:
            ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        ksp.setFromOptions()
        return ksp

    def _attach_rigid_modes(self, matrix: Any, held: Indices) -> None:
        extent = fenicsx.largest(float(np.max(np.abs(self._centred), initial=0.0)))
        modes = np.zeros((6, len(self._centred), 3))
        for axis in range(3):
            modes[axis, :, axis] = 1.0
            modes[3 + axis] = np.cross(np.eye(3)[axis], self._centred / extent)
        flat = np.array([self._to_local(mode) for mode in modes.reshape(6, -1)])
        flat[:, held] = 0.0
        # By their Gram matrix, summed over the ranks; what the supports leave nothing of goes.
        sizes, directions = np.linalg.eigh(fenicsx.total(flat @ flat.T))
        kept = sizes > 1e-10 * max(float(sizes[-1]), 1e-300)
        vectors = []
        for mode in (directions[:, kept] / np.sqrt(sizes[kept])).T @ flat:
            vector = matrix.createVecRight()
            vector.array[:] = mode
            vectors.append(vector)
        matrix.setBlockSizes(3, 3)
        matrix.setNearNullSpace(PETSc.NullSpace().create(vectors=vectors, comm=fenicsx.COMM))


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
        x, b = _prescribed(matrix, rhs, held, values, is_symmetric=self._is_symmetric)
        self._ksp.setTolerances(rtol=max(tolerance, _ROUGH))
        try:
            self._run(matrix, b, x)
            return _solution(x, held, values)
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
