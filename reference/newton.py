"""Newton's method at one load factor.

Full steps, because the residual must be free to grow at first: on bending steps stretching is
so much stiffer than bending that a search for a smaller residual stalls where full steps converge
in five. Two safeguards are used instead: no step may invert a cell, and the iteration ends when
the residual has not decreased for several iterations.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.problem import Strain
from palpate.reference import fenicsx
from palpate.reference.deformed_state import DetFSampler
from palpate.reference.discrete_problem import DiscreteProblem
from palpate.reference.linear_solver import LinearSolveError, LinearSolver, symmetric_part
from palpate.reference.result import ToolHistory

_SMALLEST_STEP_LENGTH = 1.0 / 64.0
_LARGEST_GROWTH = 1e6
# The iteration fails after so many steps without a new smallest residual, the first two excepted.
_PATIENCE = 6
# With tools, a step ends where the force along it is below this fraction of that at its start.
_NEARLY = 0.2
_MOST_TRIALS = 12
# A Newton step may take det F down to this fraction of what it was, not further.
_SHRINK_PER_STEP = 0.1
# Below this relative residual the multigrid of one tangent is used for the next ones too, and the
# tangent of contact is consistent.
_NEAR = 0.1

Report = Callable[[int, float, float], None]


@dataclass(frozen=True, eq=False)
class Outcome:
    """Where a search for equilibrium ended, by Newton's method or along a path.

    Attributes:
        displacement: The last iterate, or a path's last equilibrium, flat [m].
        relative_residual: Its relative residual [-].
        iterations: Number of linear solves, those of rejected steps included.
        reason: Why no equilibrium was found; empty if it was.
        load_factors: Load factors of a path at which equilibrium was found, ascending.
        tools: Forces and moments on each tool along the path.
    """

    displacement: Floats
    relative_residual: float
    iterations: int
    reason: str = ""
    load_factors: tuple[float, ...] = ()
    tools: tuple[ToolHistory, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether the equilibrium was found."""
        return not self.reason


class Newton:
    """Newton's method for an equilibrium (eq. 9) by the consistent tangent; one step solves eq. 5.

    The tolerance is of the norm of the free residual over the larger norm of external and internal
    forces [-].
    """

    def __init__(
        self,
        discrete: DiscreteProblem,
        sampler: DetFSampler,
        *,
        relative_tolerance: float,
        max_iterations: int = 20,
    ) -> None:
        self._discrete = discrete
        self._sampler = sampler
        self.relative_tolerance = relative_tolerance
        self._max_iterations = max_iterations
        self._linear = self._solver(is_symmetric=not discrete.has_followers)
        source = discrete.space.transferred.source
        self._cell_size = (source.volume / source.num_cells) ** (1.0 / 3.0)
        self._has_contact = bool(discrete.contacts)
        self.is_linear = discrete.strain is Strain.LINEAR
        # Whether the tangent is constant.
        self._is_constant = self.is_linear and not (
            discrete.contacts or discrete.has_follower_forces
        )
        self._is_prepared = False
        # The matrix of `solve_again` with its fixed rows, and its PETSc object state at that time.
        self._again: tuple[Any, int] = (None, 0)

    @property
    def linear_solver(self) -> str:
        """Name of the linear solver."""
        return self._linear.name

    def _solver(self, *, is_symmetric: bool) -> LinearSolver:
        eq = self._discrete
        return LinearSolver(
            eq.space,
            is_symmetric=is_symmetric,
            num_multipliers=eq.num_pressures,
            frames=eq.frames,
        )

    def destroy(self) -> None:
        """Free the memory of the linear solver at once."""
        self._linear.destroy()

    def solve_again(
        self, displacement: Floats, rhs: Floats, *, tolerance: float, near: Floats | None = None
    ) -> Floats:
        """Solve K x = rhs, x = 0 at fixed entries, with the factors or multigrid of the last solve.

        K is that of the equilibrium that was found last. `tolerance` is of an iterative solver,
        over the residual of `near`, which is 0 at fixed entries: an approximation that has what
        is stiff in rhs, beside which the residual of the rest would be small from the beginning.

        Raises:
            LinearSolveError: No finite solution was found.
        """
        fixed = self._discrete.fixed.dofs
        matrix, state = self._again
        is_known = matrix is not None and matrix.stateGet() == state
        if not is_known:
            matrix = self._discrete.tangent(displacement, 1.0)
        left = rhs if near is None else rhs - fenicsx.product(matrix, near)
        if is_known:
            found = self._linear.solve_once_more(matrix, left, fixed, tolerance=tolerance)
        else:
            nothing = np.zeros(len(fixed))
            found = self._linear.solve(
                matrix, left, fixed, nothing, tolerance=tolerance, is_same_matrix=True
            )
            self._again = matrix, matrix.stateGet()
        return found if near is None else near + found

    def linearise(self, displacement: Floats) -> Floats | None:
        """Approximate first Newton step to the full load; None if the tangent is singular."""
        eq = self._discrete
        external = eq.external_force(displacement) + eq.contact_force(displacement)
        residual = eq.internal_force(displacement) - external
        gap = eq.fixed.values - displacement[eq.fixed.dofs]
        matrix = eq.tangent(displacement, 1.0)
        try:
            found = self._linear.solve(matrix, -residual, eq.fixed.dofs, gap, tolerance=1e-3)
        except LinearSolveError:
            return None
        self._is_prepared = True
        return found

    def is_stable(self, displacement: Floats, load_factor: float) -> bool:
        """Whether the tangent stiffness is positive definite at an equilibrium.

        A body never reaches an unstable equilibrium. Under linear strain the result is True without
        a test. Under follower loads K is not symmetric, and its symmetric part is tested: where it
        is positive definite, the real parts of all eigenvalues of K are above 0 (T. J. I'A.
        Bromwich, Acta Math. 30 (1906) 295-304), and the equilibrium is isolated. K is symmetric
        where the pressure has a potential, as inside a closed surface.
        """
        eq = self._discrete
        if self.is_linear or fenicsx.total(eq.free.size) == 0:
            return True
        matrix = eq.tangent(displacement, load_factor)
        if not eq.has_followers:
            return self._linear.is_positive_definite(matrix, eq.fixed.dofs)
        part = symmetric_part(matrix)
        solver = self._solver(is_symmetric=True)
        try:
            return solver.is_positive_definite(part, eq.fixed.dofs)
        finally:
            solver.destroy()
            part.destroy()

    def keep(self, displacement: Floats, load_factor: float) -> None:
        """Pass an accepted equilibrium to the tools."""
        del load_factor
        for contact in self._discrete.contacts:
            contact.keep(displacement)

    def solve(
        self,
        start: Floats,
        load_factor: float,
        *,
        report: Report | None = None,
        least_tolerance: float = 0.0,
    ) -> Outcome:
        """Iterate from a displacement to the equilibrium at a load factor.

        Args:
            start: First iterate, flat [m]; need not satisfy the supports.
            load_factor: Fraction of the loads and of the prescribed displacements.
            report: Called with iteration, relative residual and smallest det F.
            least_tolerance: Smallest tolerance; replaces a smaller relative tolerance.
        """
        eq, enough = self._discrete, max(self.relative_tolerance, least_tolerance)
        fixed, free = eq.fixed.dofs, eq.free
        target = eq.fixed.at(load_factor)
        u = start.copy()
        det_f = self._sampler.smallest(u)
        rounding, first, last_norm, relative = 0.0, 0.0, 0.0, math.inf
        best, since_best = math.inf, 0
        is_near = False  # whether the tangent is nearly the last one
        for iteration in range(self._max_iterations + 1):
            internal = eq.internal_force(u)
            external = load_factor * eq.external_force(u) + eq.contact_force(u)
            residual = internal - external
            norm = fenicsx.norm(residual[free])
            scale = max(fenicsx.norm(internal), fenicsx.norm(external))
            if not math.isfinite(norm):
                return Outcome(u, math.inf, iteration, "the residual is not finite")
            relative = norm / scale if scale > 0.0 else 0.0
            if report:
                report(iteration, relative, det_f)
            is_at_supports = fenicsx.total(int(np.sum(u[fixed] != target))) == 0
            is_stalled = norm > 0.5 * last_norm and norm <= rounding
            last_norm = norm
            if is_at_supports and (norm <= enough * scale or is_stalled):
                return Outcome(u, relative, iteration)
            # Under prescribed displacements alone the first residual is zero: test the second.
            if iteration > 1 and not norm <= _LARGEST_GROWTH * first:
                return Outcome(u, relative, iteration, "the iteration diverges")
            best, since_best = (norm, 0) if norm < best else (best, since_best + 1)
            if since_best >= _PATIENCE:
                return Outcome(u, relative, iteration, "the iteration stalls")
            if iteration == self._max_iterations:
                break
            for contact in eq.contacts:
                contact.is_near = relative < _NEAR
            matrix = eq.tangent(u, load_factor)
            rounding = self._rounding_error(matrix, u)
            # A loose tolerance far from the solution; at the end tight enough for one last step.
            tolerance = max(min(1e-3, relative), 0.1 * enough / max(relative, 1e-300))
            try:
                du = self._linear.solve(
                    matrix, -residual, fixed, target - u[fixed], tolerance=min(tolerance, 1e-3),
                    is_same_matrix=self._is_constant and self._is_prepared,
                    is_near=is_near,
                )  # fmt: skip
            except LinearSolveError as error:
                return Outcome(u, relative, iteration, str(error))
            self._is_prepared = True
            is_near = is_near or relative < _NEAR
            length, det_f = self._step_length(u, du, det_f)
            if self._has_contact and length > 0.0:
                length *= self._part_in_balance(u, length * du, residual, load_factor)
            if length == 0.0:
                return Outcome(u, relative, iteration + 1, "a cell would invert")
            u = u + length * du
            if length == 1.0:
                u[fixed] = target
            if iteration <= 1:
                first = max(first, norm)
                best = math.inf
        return Outcome(
            u, relative, iteration, f"no convergence in {self._max_iterations} iterations"
        )

    def _step_length(self, u: Floats, du: Floats, det_f: float) -> tuple[float, float]:
        """Largest of 1, 1/2, 1/4, ... that keeps every sampled det F well above zero."""
        length = 1.0
        while length >= _SMALLEST_STEP_LENGTH:
            trial = self._sampler.smallest(u + length * du)
            if self.is_linear or trial > _SHRINK_PER_STEP * min(det_f, 1.0):
                return length, trial
            length /= 2.0
        return 0.0, det_f

    def _part_in_balance(
        self, u: Floats, du: Floats, residual: Floats, load_factor: float
    ) -> float:
        """Fraction of a step, at most 1, at which the forces along it are nearly in balance.

        With full steps, nodes may alternate without end between contact and none, or stick and
        slip. Contact and friction have a potential, whose minimum along the step is sought. In the
        mixed form the pressures change in proportion to the displacement, since only the potential
        of the displacement has a minimum.
        """
        eq = self._discrete
        free, low, high, part = eq.free_displacements, 0.0, 1.0, 1.0
        first = at_low = fenicsx.total(float(residual[free] @ du[free]))
        at_high = 0.0
        for trial in range(_MOST_TRIALS):
            here = u + part * du
            external = load_factor * eq.external_force(here) + eq.contact_force(here)
            left = eq.internal_force(here) - external
            along = fenicsx.total(float(left[free] @ du[free]))
            if abs(along) <= _NEARLY * abs(first) or (trial == 0 and along < 0.0):
                return part
            if along > 0.0:
                high, at_high = part, along
            else:
                low, at_low = part, along
            chord = -at_low / (at_high - at_low)
            part = low + (high - low) * min(max(chord, 0.1), 0.9)
        return part

    def _rounding_error(self, matrix: object, u: Floats) -> float:
        """Largest norm of the nodal forces that is due to rounding [N].

        The strain is computed from I + grad u, so its rounding error is eps even where u is small
        beside the cell size.
        """
        largest = fenicsx.largest(float(np.max(np.abs(u), initial=0.0)))
        length = largest if self.is_linear else max(largest, self._cell_size)
        own = 4.0 * float(np.finfo(float).eps) * float(matrix.norm()) * length  # type: ignore[attr-defined]
        return own + sum(contact.rounding_error(u) for contact in self._discrete.contacts)
