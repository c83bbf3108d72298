"""Whether an equilibrium is the only one near: the softest mode, and the first critical load.

The tangent K(u) is compared with the tangent at rest, K0, so that both numbers have no unit:

    K(u) phi = kappa K0 phi          the least kappa: 1 at rest, 0 where a branch begins
    (K0 + lambda G) phi = 0          linear buckling, G of the linear solution's stress S:
                                     phi . G phi = integral of S : (grad phi)^T grad phi

(K. J. Bathe, Finite Element Procedures, 1996, section 6.8.2). The load over the first critical one
is the largest 1 / lambda: above 1 a body that is not quite straight has turned to one side, and to
another it could have as well. Where a body has turned far, K0 is a stiff measure of what bends it:
kappa is small there, and only its sign counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.problem import Strain
from palpate.reference import fenicsx
from palpate.reference.discrete_problem import DiscreteProblem
from palpate.reference.fenicsx import ufl
from palpate.reference.laws import engineering_strain, second_piola_kirchhoff_stress
from palpate.reference.linear_solver import LinearSolveError, LinearSolver
from palpate.reference.statics import Equilibrium

# A truth on the case's mesh of more unknowns is not asked: its eigenpairs would take minutes.
LARGEST = 60_000
_TOLERANCE = 1e-6
# Error of an eigenvalue over itself, of which two digits are said, or over its distance from 1: far
# from a critical load, and where the tangent is nearly that at rest, its modes are many and alike.
_OF_EIGENVALUES, _OF_DISTANCE = 1e-3, 0.02
_LEAST_STEPS, _MOST_STEPS, _SMOOTHINGS = 8, 200, 2
# Over the body's size: what moves farther under linear strain has other stresses at finite strain,
# and its linear buckling says nothing.
LARGEST_BEND = 0.2


def find_stability(found: Equilibrium) -> tuple[float, float]:
    """The least eigenvalue of the tangent over that at rest, and the load over the critical one.

    Returns:
        kappa [-], and the largest 1 / lambda [-], 0 where no load of this direction is critical.
        Both are nan where they are not asked: under linear strain, of the mixed form, with tools
        or following pressure, on several ranks, the second where the linear solution is large,
        of more than LARGEST unknowns or less than twenty,
        or where no eigenpair was found.
    """
    discrete = found.discrete
    free = discrete.free
    is_asked = (
        discrete.strain is Strain.GREEN
        and not (discrete.num_pressures or discrete.contacts or discrete.has_followers)
        and fenicsx.COMM.size == 1
        and 20 <= free.size <= LARGEST
    )
    if not is_asked:
        return math.nan, math.nan
    try:
        return _Modes(discrete).of(found.displacement)
    except LinearSolveError:
        return math.nan, math.nan


class _Modes:
    """Generalised eigenpairs of tangents on the free entries, by solves with one of them."""

    def __init__(self, discrete: DiscreteProblem) -> None:
        self._discrete = discrete
        self._free = discrete.free
        self._rest = np.zeros(discrete.num_dofs)
        self._size = len(self._free)
        self._at_rest = self._matrix(self._rest)

    def of(self, displacement: Floats) -> tuple[float, float]:
        eq, fixed = self._discrete, self._discrete.fixed
        solve, solver = self._factors(self._rest)
        force = eq.external_force(self._rest)
        pushed = force.copy()
        moved = np.zeros(eq.num_dofs)
        moved[fixed.dofs] = fixed.values
        if moved.any():
            pushed -= self._whole @ moved
        linear = moved
        linear[self._free] = solve(pushed[self._free])
        size = float(np.ptp(eq.space.coordinates, axis=0).max())
        is_small = 0.0 < float(np.abs(linear).max()) <= LARGEST_BEND * size
        share = math.nan
        if is_small:
            of_stress = self._of_stress(linear)
            share = max(largest_eigenvalue(lambda v: -(of_stress @ v), solve, self._size), 0.0)
        solver.destroy()
        solve, solver = self._factors(displacement)
        # 1 / kappa of K0 phi = (1 / kappa) K(u) phi, whose largest is that of the softest mode.
        softest = largest_eigenvalue(lambda v: self._at_rest @ v, solve, self._size)
        solver.destroy()
        return 1.0 / softest, share

    def _matrix(self, displacement: Floats) -> Any:
        """The tangent's free rows and columns, as a scipy matrix."""
        return self._rows(self._discrete.tangent(displacement, 1.0))

    def _rows(self, matrix: Any) -> Any:
        from scipy.sparse import csr_matrix

        rows, columns, values = fenicsx.in_rows(matrix).getValuesCSR()
        self._whole = csr_matrix((values.copy(), columns.copy(), rows.copy()))
        return self._whole[self._free][:, self._free]

    def _of_stress(self, linear: Floats) -> Any:
        """G of the linear solution's stress."""
        eq = self._discrete
        eq.set_displacement(linear)
        S = second_piola_kirchhoff_stress(engineering_strain(eq.u), *eq.lame)
        trial = ufl.TrialFunction(eq.u.function_space)
        form = fenicsx.form(ufl.inner(ufl.grad(trial) * S, ufl.grad(eq.v)) * ufl.dx)
        matrix = fenicsx.create_matrix(form, [])
        fenicsx.assemble_into_matrix(matrix, form)
        turned = matrix if eq.frames is None else eq.frames.turned(matrix)
        rows = self._rows(turned)
        matrix.destroy()
        return rows

    def _factors(self, displacement: Floats) -> tuple[Any, LinearSolver]:
        """A function that solves with the tangent at a displacement, and the solver behind it."""
        eq, free = self._discrete, self._free
        solver = LinearSolver(eq.space, is_symmetric=True, is_always_direct=True, frames=eq.frames)
        matrix = eq.tangent(displacement, 1.0).copy()
        fixed, nothing = eq.fixed.dofs, np.zeros(len(eq.fixed.dofs))
        solver.solve(matrix, np.zeros(eq.num_dofs), fixed, nothing, tolerance=_TOLERANCE)

        def solve(right: Floats) -> Floats:
            whole = np.zeros(eq.num_dofs)
            whole[free] = np.ravel(right)
            return solver.solve_once_more(matrix, whole, fixed, tolerance=_TOLERANCE)[free]

        return solve, solver


def largest_eigenvalue(
    multiply: Callable[[Floats], Floats], solve: Callable[[Floats], Floats], size: int
) -> float:
    """The largest mu of A phi = mu B phi, as exactly as its distance from 1 asks for.

    By Lanczos's method in the inner product of B, with all vectors made orthogonal again (B. N.
    Parlett, The Symmetric Eigenvalue Problem, 1998, section 15.11): with the last residual's norm
    b and the last component s of an eigenvector of the tridiagonal matrix, an eigenvalue is within
    b |s| of its value. The start is smooth, as the softest modes are.

    Args:
        multiply: Returns A times a vector; A is symmetric.
        solve: Returns the inverse of B times one; B is symmetric and positive definite.
        size: Number of unknowns, > 0.

    Raises:
        LinearSolveError: No eigenvalue was found, which a B that is not positive definite explains.
    """
    after = np.random.default_rng(0).standard_normal(size)
    for _ in range(_SMOOTHINGS):
        after, with_metric = solve(after), after
    vectors: list[Floats] = []  # v
    covectors: list[Floats] = []  # B v
    diagonal: list[float] = []
    beside: list[float] = []
    norm = math.sqrt(max(float(after @ with_metric), 0.0))
    for step in range(min(_MOST_STEPS, size)):
        if not (norm > 0.0 and math.isfinite(norm)):
            break
        vectors.append(after / norm)
        covectors.append(with_metric / norm)
        with_metric = multiply(vectors[-1])
        diagonal.append(float(vectors[-1] @ with_metric))
        after = solve(with_metric)
        for _ in range(2):
            parts = np.array(covectors) @ after
            after = after - parts @ np.array(vectors)
            with_metric = with_metric - parts @ np.array(covectors)
        norm = math.sqrt(max(float(after @ with_metric), 0.0))
        values, modes = np.linalg.eigh(np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1))
        beside.append(norm)
        value, bound = float(values[-1]), norm * abs(float(modes[-1, -1]))
        if step + 1 >= min(_LEAST_STEPS, size) and bound <= max(
            _OF_EIGENVALUES * abs(value), _OF_DISTANCE * abs(1.0 - value)
        ):
            return value
    raise LinearSolveError("the eigenvalues do not settle")
