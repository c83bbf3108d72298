"""Newton-Raphson at one load factor (eq. 9-10): consistent tangent, inexact solves, line search."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.fastsim.forces import external_force
from palpate.fastsim.springs import PatchSprings
from palpate.fastsim.supports import FixedPoints
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain, require_linear_in_strain
from palpate.meshes.tet_mesh import TetMesh

# Below this number of points diagonal blocks alone are as quick as multigrid.
MULTIGRID_FROM_POINTS = 1500
# A full step may raise the residual for a while: in bending, stretching is so much stiffer that a
# search for a smaller residual costs twice the iterations; freed altogether, hard loads need more.
LARGEST_GROWTH = 1e3


# Out-of-balance force over that of a term, below which its active points hardly change.
_CLOSE = 1e-2
# Error of turning a vector to other axes and back, over the largest displacement.
_ROUNDING = 1e-14
# As if the last residual were so small: responses are solved to 3e-9 at a tolerance of 1e-16.
_FINE = 1e-8
# Slope of the potential at a step's end over that at its start, and how often it is cut.
_STEEP = 0.8
_MOST_CUTS = 8


class ResidualTerm(Protocol):
    """Forces on a body besides its loads, as a term of the residual with its tangent.

    It may have kinks, where points become active or inactive.
    """

    def force(self, displacement: Points) -> Points:
        """Force on the body [N], shape (num_points, 3)."""

    def add_tangent(self, body: Body, displacement: Points) -> bool:
        """Add minus the force's derivative to the matrix; return whether active points changed."""

    def settle(self, displacement: Points) -> None:
        """Store the active state of a displacement near an equilibrium."""

    def rounding_error(self, body: Body) -> float:
        """Norm of the rounding error of the force [N]."""


class Iteration(StrEnum):
    """Matrix of each step: the consistent tangent dR/da, or K + P(a) as eq. 10 prints it.

    P(a) is not unique; the symmetric one is used, so that conjugate gradients apply.
    """

    NEWTON = "newton"
    SECANT = "secant"


def rounding_error(row_sums: Points, displacement: Points) -> float:
    """Norm of the nodal forces that rounding alone can leave [N].

    Differences of neighbouring displacements are exact to eps times these, and go into each force
    with the stiffnesses of its row, whose magnitudes sum up to `row_sums` [N/m], (num_points, 3);
    slender bodies have large ones and small forces.
    """
    eps = float(np.finfo(float).eps)
    return 4.0 * eps * float(np.linalg.norm(row_sums * np.abs(displacement).max(axis=1)[:, None]))


@dataclass
class NewtonOutcome:
    """Displacement at equilibrium, or the reason why there is none."""

    displacement: Points | None
    reason: str = ""
    history: list[float] = field(default_factory=list)


class Newton:
    """Newton-Raphson on one problem, with its body and its counts of iterations.

    It stops at a relative residual, or after so many iterations of a call of `solve`. Unless it
    `is_guarded`, steps that invert a cell or blow up the residual are not shortened: eq. 9-10 as
    printed, where `iteration` takes the secant matrix. `term` is further forces on the body.
    """

    def __init__(
        self,
        problem: Problem,
        strain: Strain,
        relative_tolerance: float,
        max_iterations: int,
        iteration: Iteration = Iteration.NEWTON,
        *,
        element: Element = Element.LINEAR,
        is_guarded: bool = True,
        term: ResidualTerm | None = None,
    ) -> None:
        self.problem = problem
        self._term = term
        self._term_norm = self._spring_norm = 0.0
        self._is_close = False
        self.is_guarded = is_guarded
        self.iteration = iteration
        self.body = Body.of(problem, strain, element=element)
        if iteration is Iteration.SECANT:
            # The residual of other laws is not cubic.
            require_linear_in_strain(problem.material, strain, "the secant iteration of eq. 10")
            if self.body.folds:
                raise InputError(
                    "the secant iteration of eq. 10 needs forces that are cubic in the "
                    "displacement, and smoothed tetrahedra of saint-venant-kirchhoff go over to "
                    "plain ones where they are compressed; take linear tetrahedra, or the "
                    f"iteration {Iteration.NEWTON}"
                )
        self.tolerance = relative_tolerance
        self.max_iterations = max_iterations
        self.iterations = 0
        self.linear_iterations = 0
        # Steps and right sides are in the points' own components, where a support slants those.
        self._supports = FixedPoints(problem)
        self._is_free = self._supports.is_free
        self._moves_supports = bool(np.any(self._supports.at(1.0)))
        slanted = self._supports.slanted
        if slanted is not None:
            self.body.core.set_frames(slanted.points, slanted.axes.reshape(-1, 9))
        self._uses_multigrid = problem.mesh.num_points >= MULTIGRID_FROM_POINTS
        self._is_stale = True
        self._fresh_cost: float | None = None
        self._load = external_force(problem)
        # Springs act from the first step on: the load factor raises the anchor's displacement.
        self._springs = PatchSprings(problem.mesh.points, problem.springs)
        ends = [spring.path.end for spring in problem.springs]
        self._anchors = np.array(ends).reshape(-1, 3)
        # Pressure follows the body only under finite strain.
        self._follows = strain is Strain.GREEN and any(
            isinstance(load, Pressure) for load in problem.loads
        )

    def solve(self, start: Points, factor: float) -> NewtonOutcome:
        """Equilibrium at a load factor, from the equilibrium at a smaller one."""
        free = self._is_free.astype(bool)
        displacement = start.copy()
        # The fixed components' change goes through the tangent first: no cell is crushed by it.
        jump = self._jump(displacement, factor)
        history: list[float] = []
        residual, internal = self._residual(displacement, factor)
        outcome = NewtonOutcome(None, history=history)
        for _ in range(self.max_iterations):
            self._assemble_tangent(displacement, factor)
            right_side = self._supports.to_local(residual)
            if np.any(jump):
                right_side = right_side - self.body.core.multiply(jump)
            step, reason = self._linear_solve(np.where(free, right_side, 0.0), history)
            if step is None:
                outcome.reason = reason
                return outcome
            step = self._supports.to_global(step + jump)
            self.iterations += 1
            moves_held = bool(np.any(jump))
            accepted = self._line_search(displacement, step, factor, residual, moves_held)
            if accepted is None:
                outcome.reason = "the line search found no smaller residual with det F > 0"
                return outcome
            if self._term is not None and not moves_held:
                accepted = self._cut_before_kinks(displacement, step, factor, residual, accepted)
            displacement, residual, internal = accepted
            jump = self._jump(displacement, factor)
            norm = self._free_norm(residual)
            history.append(norm / self._scale(internal, factor))
            if not np.isfinite(history[-1]):
                outcome.reason = "the residual is not finite"
                return outcome
            if not np.any(jump) and (
                history[-1] <= self.tolerance or self._is_at_rounding(displacement, norm, history)
            ):
                if self._is_stable():
                    outcome.displacement = displacement
                else:
                    outcome.reason = "the equilibrium found is not stable"
                return outcome
        outcome.reason = f"relative residual {history[-1]:.2g} after {len(history)} iterations"
        return outcome

    def solver_at(self, displacement: Points, factor: float) -> Callable[[Points], Points | None]:
        """Return a solver of the tangent at an equilibrium; it returns None where not definite."""
        self._assemble_tangent(displacement, factor)
        self._is_stale = True

        def solve(right_side: Points) -> Points | None:
            local = self._supports.to_local(right_side)
            given = np.where(self._is_free != 0, local, 0.0)
            found = self._linear_solve(given, [1e-3])[0]
            return None if found is None else self._supports.to_global(found)

        return solve

    @property
    def free_components(self) -> NDArray[np.bool_]:
        """Which of the points' own components no support fixes, shape (num_points, 3)."""
        return np.asarray(self._is_free != 0)

    def stiffness_times(self, displacement: Points, vector: Points) -> Points:
        """The tangent at full load times a vector [m]: [N], shape (num_points, 3)."""
        self._assemble_tangent(displacement, 1.0)
        self._is_stale = True
        return self._supports.to_global(self.body.core.multiply(self._supports.to_local(vector)))

    def residual_at(self, displacement: Points) -> Points:
        """Force out of balance at full load [N], shape (num_points, 3), reactions included."""
        return self._residual(displacement, 1.0)[0]

    def responses_at(
        self, displacement: Points, changes: Sequence[tuple[Points, Points]]
    ) -> list[Points | None]:
        """How an equilibrium at full load moves by small changes, one solve of its tangent each.

        Args:
            displacement: The equilibrium [m].
            changes: Of the force out of balance [N], and of the supports' displacement along the
                points' own components [m], which is 0 where a component is free.

        Returns:
            Changes of displacement [m]; None where the tangent is not positive definite.
        """
        free = self._is_free != 0
        self._assemble_tangent(displacement, 1.0)
        self._is_stale = True
        found: list[Points | None] = []
        for force, moved in changes:
            right_side = self._supports.to_local(force)
            if np.any(moved):
                right_side = right_side - self.body.core.multiply(moved)
            step, _ = self._linear_solve(np.where(free, right_side, 0.0), [_FINE])
            found.append(None if step is None else self._supports.to_global(step + moved))
        return found

    def _jump(self, displacement: Points, factor: float) -> Points:
        """Distance of fixed components from their prescribed values, 0 for the free ones [m]."""
        here = self._supports.to_local(displacement)
        jump = np.where(self._is_free != 0, 0.0, self._supports.at(factor) - here)
        slanted = self._supports.slanted
        if slanted is not None:
            # The rounding error of turning there and back is no distance.
            size = _ROUNDING * float(np.abs(displacement).max(initial=0.0))
            rows = jump[slanted.points]
            jump[slanted.points] = np.where(np.abs(rows) <= size, 0.0, rows)
        return jump

    def _free_norm(self, forces: Points) -> float:
        """Norm of the free components."""
        return float(np.linalg.norm(self._supports.to_local(forces)[self._is_free != 0]))

    def _free_dot(self, forces: Points, step: Points) -> float:
        """Work of the free components."""
        to_local = self._supports.to_local
        return float(np.sum((to_local(forces) * to_local(step))[self._is_free != 0]))

    def _is_stable(self) -> bool:
        """Whether the last tangent is positive definite; the last step was too small to change it.

        Symmetric loads leave symmetric residuals, which never meet the direction in which a
        column buckles: conjugate gradients are given a direction without symmetry.
        """
        if self.body.strain is Strain.LINEAR or self._follows or self.iteration is Iteration.SECANT:
            return True
        direction = self._supports.to_local(smooth_direction(self.problem.mesh))
        direction = np.where(self._is_free != 0, direction, 0.0)
        return self._linear_solve(direction, [1.0])[0] is not None

    def _is_at_rounding(self, displacement: Points, norm: float, history: list[float]) -> bool:
        """Whether the residual [N] has stopped falling, at the rounding error of the forces."""
        if len(history) < 2 or history[-1] <= 0.5 * history[-2]:
            return False
        if norm <= rounding_error(self.body.core.absolute_row_sums(), displacement):
            return True
        return self._term is not None and norm <= self._term.rounding_error(self.body)

    def _scale(self, internal: Points, factor: float) -> float:
        """Norm of what drives the problem: the load, and the reactions to moved supports."""
        scale = factor * float(np.linalg.norm(self._load))
        if self._moves_supports or scale == 0.0:
            reactions = self._supports.to_local(internal)[self._is_free == 0]
            scale = max(scale, float(np.linalg.norm(reactions)))
        return max(scale, self._term_norm, self._spring_norm, float(np.finfo(float).tiny))

    def _residual(self, displacement: Points, factor: float) -> tuple[Points, Points]:
        internal = self.body.core.internal_force(displacement)
        load = external_force(self.problem, displacement) if self._follows else self._load
        residual = factor * load - internal
        if len(self._springs):
            full = np.ones(len(self._springs))
            pull = self._springs.force(displacement, factor * self._anchors, full)
            residual = residual + pull
            self._spring_norm = float(np.linalg.norm(pull))
        if self._term is not None:
            force = self._term.force(displacement)
            residual = residual + force
            self._term_norm = float(np.linalg.norm(force))
            left = self._free_norm(residual)
            self._is_close = left < _CLOSE * self._term_norm
        return residual, internal

    def _assemble_tangent(self, displacement: Points, factor: float) -> None:
        if self.iteration is Iteration.SECANT:
            self.body.core.assemble_secant(displacement)
        else:
            self.body.core.assemble_tangent(displacement)
        displaced = self.problem.mesh.points + displacement
        for load in self.problem.loads if self._follows else ():
            if isinstance(load, Pressure):
                facets = np.ascontiguousarray(load.facets, dtype=np.int32)
                self.body.core.add_pressure_tangent(displaced, facets, factor * load.pressure)
        self._springs.add_to(self.body.core, 1.0)
        if self._term is not None:
            if self._is_close:
                self._term.settle(displacement)
            # The multigrid of a tangent with other active points is of little use.
            if self._term.add_tangent(self.body, displacement):
                self._is_stale = True
        if self._supports.slanted is not None:
            self.body.core.turn_matrix()

    def _linear_solve(self, right_side: Points, history: list[float]) -> tuple[Points | None, str]:
        """Solve K x = b; early Newton steps need few digits, the last ones many."""
        norm = float(np.linalg.norm(right_side))
        relative = 0.3 * self.tolerance
        if self.body.strain is Strain.GREEN:
            # Inexact Newton (Eisenstat and Walker 1996): as many digits as the last step gained,
            # but none beyond the tolerance.
            last = history[-1] if history else 1.0
            enough = 0.3 * self.tolerance / max(last, self.tolerance)
            relative = max(min(1e-2, 0.1 * last), enough)
        if self._uses_multigrid and self._is_stale:
            self.body.core.build_multigrid(self._is_free)
            self._fresh_cost = None
        limit = 20 * self.problem.mesh.num_points + 1000
        x, status, iterations = self.body.core.solve(
            right_side, self._is_free, relative * norm, limit, self._uses_multigrid
        )
        self.linear_iterations += iterations
        # The iterations per digit show when the multigrid of an earlier tangent is outdated.
        cost = iterations / -np.log10(relative)
        if self._fresh_cost is None:
            self._fresh_cost = cost
        self._is_stale = cost > 1.5 * self._fresh_cost + 2.0
        if status == _core.SolveStatus.negative_curvature:
            if self.iteration is Iteration.SECANT:
                return None, "the secant matrix is not positive definite"
            return None, "the tangent stiffness is not positive definite: a limit point"
        if status == _core.SolveStatus.iteration_limit:
            return None, f"conjugate gradients stopped at {limit} iterations"
        return x, ""

    def _line_search(
        self, displacement: Points, step: Points, factor: float, residual: Points, moves_held: bool
    ) -> tuple[Points, Points, Points] | None:
        """Full step first; halve it while a cell is inverted or the residual explodes."""
        before = self._free_norm(residual)
        length = 1.0
        for _ in range(12):
            trial = displacement + length * step
            trial_residual, internal = self._residual(trial, factor)
            norm = self._free_norm(trial_residual)
            if self.body.strain is Strain.LINEAR or not self.is_guarded:
                return trial, trial_residual, internal
            is_whole = bool(self.body.core.det_f(trial).min() > 0.0)
            if is_whole and np.isfinite(norm) and (moves_held or norm <= LARGEST_GROWTH * before):
                return trial, trial_residual, internal
            length *= 0.5
        return None

    def _cut_before_kinks(
        self,
        displacement: Points,
        step: Points,
        factor: float,
        residual: Points,
        accepted: tuple[Points, Points, Points],
    ) -> tuple[Points, Points, Points]:
        """Shorten the step while the potential rises steeply again along it.

        Otherwise points could become active and inactive in turn without end.
        """
        fall = self._free_dot(residual, step)
        low, high = 0.0, 1.0
        for _ in range(_MOST_CUTS):
            trial, trial_residual, _ = accepted
            rise = -self._free_dot(trial_residual, step)
            if not (fall > 0.0 and abs(rise) > _STEEP * fall):
                return accepted
            reached = float(np.sum((trial - displacement) * step) / np.sum(step * step))
            if rise > 0.0:
                high = reached
            elif reached >= high:
                return accepted
            else:
                low = reached
            middle = displacement + 0.5 * (low + high) * step
            accepted = (middle, *self._residual(middle, factor))
        return accepted


# Where a body has softened when it loses its equilibrium.
#
# At a limit point the tangent stiffness K loses its smallest eigenvalue. Beside it stands the same
# matrix without the stress that destabilises, K_m = sum of V B^T D B with the law's D = dS/dE at
# the present F: the smallest x . K x / x . K_m x is 1 in a body without stress and 0 at the limit,
# at any rotation and scale.


# Inverse iterations for the softest direction, whose ratio separates from the next near a limit.
_ITERATIONS = 8
# Change of the displacement gradient by which stresses are derived: what it leaves out is of its
# square, what rounding adds of eps over it.
_SMALL = 1e-5
# A body this soft is at its limit, to the step by which the load was raised.
SOFT = 0.25


@dataclass(frozen=True)
class Softening:
    """The softening of a body: how near an equilibrium is to its limit, and where.

    Attributes:
        stiffness: Smallest x . K x / x . K_m x [-]; 1 without stress, 0 at the limit, below 0
            where the equilibrium found is not stable.
        cell: The cell that the softest direction strains most.
        position: Centre of that cell at rest [m].
        smallest_stretch: Smallest principal stretch of all cells [-].
        stretched_cell: The cell that has it.
    """

    stiffness: float
    cell: int
    position: tuple[float, float, float]
    smallest_stretch: float
    stretched_cell: int


def smallest_stretches(body: Body, displacement: Points) -> Floats:
    """Smallest principal stretch of each cell [-], shape (num_cells,): sqrt of C's eigenvalue."""
    F = body.displacement_gradients(displacement) + np.eye(3)
    C = F.transpose(0, 2, 1) @ F
    stretches: Floats = np.sqrt(np.maximum(np.linalg.eigvalsh(C)[:, 0], 0.0))
    return stretches


def find_softening(
    body: Body, displacement: Points, solve: Callable[[Points], Points | None]
) -> Softening:
    """Measure how far a body has softened at an equilibrium [m].

    `solve` finds K x = b with fixed components of x zero; None where K is not positive definite.
    """
    mesh = body.mesh
    stretches = smallest_stretches(body, displacement)
    stretched = int(np.argmin(stretches))
    form = _MaterialStiffness(body, displacement)
    right_side = form.times(smooth_direction(mesh))
    stiffness, mode = -1.0, None
    for _ in range(_ITERATIONS):
        x = solve(right_side)
        if x is None:
            break
        next_side = form.times(x)
        # K x = b, so that x . K x = x . b.
        with np.errstate(invalid="ignore", divide="ignore"):
            # NaN, from numbers out of range, does not indicate a limit.
            stiffness = float(np.sum(x * right_side) / np.sum(x * next_side))
        mode = x
        right_side = next_side / np.linalg.norm(next_side)
    cell = stretched if mode is None else int(np.argmax(form.densities(mode)))
    centre = mesh.points[mesh.cells[cell]].mean(axis=0)
    position = float(centre[0]), float(centre[1]), float(centre[2])
    return Softening(stiffness, cell, position, float(stretches[stretched]), stretched)


def smooth_direction(mesh: TetMesh) -> Points:
    """A displacement without symmetry: random polynomials of degree 3, so every mode is in it."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    x, y, z = (2.0 * (mesh.points - low) / np.maximum(high - low, 1e-300) - 1.0).T
    powers = [x**i * y**j * z**k for i in range(4) for j in range(4 - i) for k in range(4 - i - j)]
    coefficients = np.random.default_rng(0).standard_normal((len(powers), 3))
    direction: Points = np.array(powers).T @ coefficients
    return direction / float(np.linalg.norm(direction))


class _MaterialStiffness:
    """K_m x = sum of V F (dS/dE : sym(F^T grad x)) grad N, cell by cell.

    The change of S along x is a central difference of the law's own: exact but for rounding where S
    is a polynomial of degree 2 in the displacement, as Saint-Venant-Kirchhoff's is.
    """

    def __init__(self, body: Body, displacement: Points) -> None:
        self._body, self._displacement = body, displacement
        self._F = self._gradients(displacement)
        self._volumes = body.mesh.cell_volumes

    def times(self, x: Points) -> Points:
        cells = self._body.mesh.cells
        P = self._volumes[:, None, None] * (self._F @ self._stress_changes(x))
        product = np.zeros_like(x)
        np.add.at(product, cells, self._body.shape_gradients @ P.transpose(0, 2, 1))
        return product

    def densities(self, x: Points) -> Floats:
        strain = self._F.transpose(0, 2, 1) @ self._body.displacement_gradients(x)
        values: Points = (strain * self._stress_changes(x)).sum(axis=(1, 2))
        return values

    def _gradients(self, displacement: Points) -> Floats:
        """F, which is I under linear strain."""
        H = self._body.displacement_gradients(displacement)
        return np.eye(3) + (H if self._body.strain is Strain.GREEN else 0.0 * H)

    def _stresses(self, displacement: Points) -> Floats:
        """Second Piola-Kirchhoff's S = F^-1 P."""
        P = self._body.first_piola_kirchhoff_stresses(displacement)
        return np.linalg.solve(self._gradients(displacement), P)

    def _stress_changes(self, x: Points) -> Floats:
        largest = float(np.abs(self._body.displacement_gradients(x)).max())
        step = _SMALL / largest if largest > 0.0 else 1.0
        ahead, behind = (self._stresses(self._displacement + s * x) for s in (step, -step))
        return (ahead - behind) / (2.0 * step)
