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

# Eigenpairs sought: the softest bending modes of a slender body come in pairs.
_PAIRS = 2
# A truth on the case's mesh of more unknowns is not asked: its eigenpairs would take minutes.
LARGEST = 60_000
_TOLERANCE = 1e-6
# Of the eigenvalues themselves, of which two digits are said.
_OF_EIGENVALUES = 1e-3
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
        share = self._largest(-self._of_stress(linear), solve) if is_small else math.nan
        solver.destroy()
        solve, solver = self._factors(displacement)
        # 1 / kappa of K0 phi = (1 / kappa) K(u) phi, whose largest is that of the softest mode.
        softest = self._largest(self._at_rest, solve, self._matrix(displacement))
        solver.destroy()
        return 1.0 / softest, max(share, 0.0) if math.isfinite(share) else share

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

    def _largest(self, matrix: Any, solve: Any, metric: Any = None) -> float:
        """The largest mu of matrix phi = mu metric phi; `solve` is with the metric, K0 if None."""
        from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

        metric = self._at_rest if metric is None else metric
        inverse = LinearOperator(metric.shape, matvec=solve, dtype=float)
        begin = np.random.default_rng(0).standard_normal(metric.shape[0])
        try:
            found = eigsh(
                matrix, _PAIRS, metric, which="LA", Minv=inverse, v0=begin, tol=_OF_EIGENVALUES,
                return_eigenvectors=False,
            )  # fmt: skip
        except ArpackError as error:
            raise LinearSolveError(str(error)) from None
        return float(np.max(found))
