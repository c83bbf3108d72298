"""One step of the generalised-alpha method on a body, by Newton's method.

J. Chung, G. M. Hulbert, J. Appl. Mech. 60 (1993) 371-375; the equations stand in `dynamics`.
"""

from __future__ import annotations

import functools
import math
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.reference import fenicsx
from palpate.reference.contact.implicit_tools import ImplicitTools, step_length
from palpate.reference.deformed_state import DetFSampler
from palpate.reference.discrete_problem import ElasticBody
from palpate.reference.explicit import row_sums_of_mass
from palpate.reference.fenicsx import PETSc, fem, ufl
from palpate.reference.linear_solver import (
    LARGEST_FALLBACK,
    LaggedFactors,
    LinearSolveError,
    LinearSolver,
)
from palpate.reference.loads_over_time import LoadsOverTime
from palpate.reference.materials import by_cell
from palpate.reference.viscosity import Viscosity

_MAX_ITERATIONS = 25
# Of the residual, what may be left by an iteration with the tangent of an earlier one. To assemble
# and factor it costs as much as ten solves or more by factors that are there.
_SLOW = 0.3
# Nodes come and go, and multipliers follow them.
_MOST_WITH_TOOLS = 40
_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class AlphaMethod:
    """The parameters of the generalised-alpha method.

    Args:
        spectral_radius: At infinite frequency [-], 0 to 1 (eq. 25 of Chung and Hulbert).
    """

    spectral_radius: float = 0.8

    def __post_init__(self) -> None:
        if not 0.0 <= self.spectral_radius <= 1.0:
            raise InputError(f"spectral_radius = {self.spectral_radius:g}: needs 0 to 1")

    @property
    def alpha_m(self) -> float:
        """Where accelerations are taken."""
        return (2.0 * self.spectral_radius - 1.0) / (self.spectral_radius + 1.0)

    @property
    def alpha_f(self) -> float:
        """Where forces are balanced."""
        return self.spectral_radius / (self.spectral_radius + 1.0)

    @property
    def gamma(self) -> float:
        """Newmark's gamma: second order (eq. 17)."""
        return 0.5 - self.alpha_m + self.alpha_f

    @property
    def beta(self) -> float:
        """Newmark's beta: most damping at high frequencies (eq. 20)."""
        return 0.25 * (1.0 - self.alpha_m + self.alpha_f) ** 2


@dataclass(frozen=True, eq=False)
class State:
    """Displacement [m], velocity, acceleration, all flat, and works since the start [J]."""

    u: Floats
    v: Floats
    a: Floats
    external_work: float = 0.0
    damping_work: float = 0.0


@dataclass(frozen=True, eq=False)
class _Trial:
    """A displacement at the end of a step: all flat, forces in N.

    Attributes:
        v: Velocity at the end [m/s].
        a: Acceleration at the end [m/s2].
        middle: Displacement where forces are balanced [m].
        damped: lambda times the velocity there [m/s2].
        viscous: What stiffness damping makes of the internal forces there; None without it.
        external: Of the loads there.
        balance: Without the tools' forces.
        residual: With them.
        scale: Norm of the largest of internal, external and inertial forces.
    """

    v: Floats
    a: Floats
    middle: Floats
    damped: Floats
    viscous: Floats | None
    external: Floats
    balance: Floats
    residual: Floats
    scale: float


class StepLostError(Exception):
    """A step has no answer; the message says why."""


class Motion:
    """Forces, mass and supports of one problem, and a step of it.

    Args:
        problem: With its time span.
        body: Its body.
        loads: What pushes and holds it.
        method: Of the steps.
        is_mass_lumped: Row sums instead of the consistent mass.
        tolerance: Relative residual of a step [-].
    """

    def __init__(
        self,
        problem: Problem,
        body: ElasticBody,
        loads: LoadsOverTime,
        method: AlphaMethod,
        *,
        is_mass_lumped: bool,
        tolerance: float,
    ) -> None:
        assert problem.time is not None
        self.damping, beta = problem.time.mass_damping, problem.time.stiffness_damping
        self.viscosity = Viscosity(body, beta) if beta else None
        self.method = method
        self.tolerance = tolerance
        self.body, self.loads = body, loads
        space = body.space
        self.sampler = DetFSampler(body)
        mesh = space.transferred.mesh
        density = by_cell(
            space.transferred, problem.material, problem.inclusions, lambda m: m.density
        )
        dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": 2 * space.degree})
        self._w = fem.Function(space.space)
        self._inertia = fenicsx.form(density * ufl.inner(self._w, body.v) * dx)
        self._row_sums = row_sums_of_mass(body, problem) if is_mass_lumped else None
        du = ufl.TrialFunction(space.space)
        self._mass_factor = fem.Constant(mesh, PETSc.ScalarType(0.0))
        self._stiffness_factor = fem.Constant(mesh, PETSc.ScalarType(0.0))
        tangent = self._stiffness_factor * body.work_change(du)
        if not is_mass_lumped:
            tangent += self._mass_factor * density * ufl.inner(du, body.v) * dx
        self._tangent = fenicsx.form(tangent)
        self._matrix = fenicsx.create_matrix(self._tangent)
        self._matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        self.tools = ImplicitTools(problem, space, loads.held, tolerance)
        is_viscous = self.viscosity is not None and body.strain is Strain.GREEN
        is_symmetric = not (self.loads.has_followers or is_viscous)
        # Multigrid does badly by contact, and factors serve many steps.
        is_direct = bool(self.tools) or 3 * space.num_global_blocks < LARGEST_FALLBACK
        self.solver: LinearSolver | LaggedFactors = (
            LaggedFactors(is_symmetric=is_symmetric)
            if is_direct
            else LinearSolver(space.coordinates, is_symmetric=is_symmetric, to_local=body.to_local)
        )
        self.iterations = 0
        is_linear = body.strain is Strain.LINEAR
        # Part of the residual that an iteration with an earlier tangent may leave. Multigrid is set
        # up anew for every matrix: then a new one costs little more.
        self._slow = math.inf if is_linear else _SLOW if is_direct else 0.0
        # Factors of mass, stiffness and viscosity, and the matrix that they gave last.
        self._kept: tuple[tuple[float, float, float], Any] | None = None

    def inertia(self, acceleration: Floats) -> Floats:
        """M a [N], flat."""
        if self._row_sums is not None:
            force: Floats = self._row_sums * acceleration
            return force
        self._w.x.array[: len(acceleration)] = self.body.to_global(acceleration)
        self._w.x.scatter_forward()
        return self.body.to_local(fenicsx.assemble_vector(self._inertia))

    def kinetic_energy(self, velocity: Floats) -> float:
        """Half of v . M v [J]."""
        return 0.5 * float(fenicsx.total(float(velocity @ self.inertia(velocity))))

    def _solve(
        self,
        u: Floats,
        rhs: Floats,
        gap: Floats,
        mass: float,
        stiffness: float,
        time: float,
        touching: Floats | None = None,
        *,
        rate: float = 0.0,
        is_fresh: bool = True,
    ) -> Floats:
        """Solve (mass M + stiffness K(u) + rate D(u)) du = rhs, du = gap where held.

        D that of the last viscous force, K with what it has of the displacement.
        With the stiffness of contact where the tools touch the body of another displacement.
        Where it need not be fresh, K and D of an earlier displacement, if they were kept.
        """
        factors = mass, stiffness, rate
        if self._kept is None or self._kept[0] != factors or is_fresh:
            self._assemble(u, factors)
        else:
            same = PETSc.Mat.Structure.SAME_NONZERO_PATTERN
            self._kept[1].copy(self._matrix, structure=same)
        if stiffness:
            self.loads.add_tangent(self._matrix, stiffness, time)
        if self._row_sums is not None:
            diagonal = self._matrix.getDiagonal()
            diagonal.array[:] += mass * self._row_sums
            self._matrix.setDiagonal(diagonal)
            diagonal.destroy()
        if touching is not None:
            self.tools.add_tangent(self._matrix, touching)
        self.iterations += 1
        frames = self.body.frames
        matrix = self._matrix if frames is None else frames.turned(self._matrix)
        return self.solver.solve(matrix, rhs, self.loads.held, gap, tolerance=0.1 * self.tolerance)

    def _assemble(self, u: Floats, factors: tuple[float, float, float]) -> None:
        """Without followers, lumped mass and tools; and keep it."""
        mass, stiffness, rate = factors
        self.body.set_displacement(u)
        self._mass_factor.value, self._stiffness_factor.value = mass, stiffness
        self._matrix.zeroEntries()
        fenicsx.assemble_into_matrix(self._matrix, self._tangent)
        if self.viscosity is not None and rate:
            self.viscosity.add_tangent(self._matrix, stiffness, rate)
        if self._kept is not None:
            self._kept[1].destroy()
            # Contact changes a few nodes at a time: then old factors serve many iterations.
            is_new = self._kept[0] != factors or not self.tools
            if is_new and isinstance(self.solver, LaggedFactors):
                self.solver.forget()
        if self._slow > 0.0:  # else nothing comes back to it
            self._kept = factors, self._matrix.copy()

    def start(self, u: Floats, v: Floats) -> State:
        """The state at time 0, with the acceleration that balances it."""
        u = self.loads.at_supports(u, 0.0)
        force = self.loads.force(u, 0.0) - self._internal(u, v)[0]
        force -= self.damping * self.inertia(v)
        still = np.zeros(len(self.loads.held))
        return State(u, v, self._solve(u, force, still, 1.0, 0.0, 0.0))

    def _internal(self, u: Floats, v: Floats) -> tuple[Floats, Floats | None]:
        """Of displacement and velocity, and its viscous part [N], flat."""
        force = self.body.internal_force(u)
        if self.viscosity is None:
            return force, None
        viscous = self.viscosity.force(u, v)
        return force + viscous, viscous

    def step(self, state: State, time: float, dt: float) -> State:
        """The state a time step later.

        Raises:
            StepLostError: Newton's method found no answer.
        """
        m, held = self.method, self.loads.held
        mass = ((1.0 - m.alpha_m) / dt + (1.0 - m.alpha_f) * m.gamma * self.damping) / (m.beta * dt)
        new = self.loads.at_supports(state.u + dt * state.v + 0.5 * dt**2 * state.a, time + dt)
        if not self._is_sound(new):
            new = self.loads.at_supports(state.u, time + dt)
        self.tools.begin_step(time, dt, m, mass)
        most = _MOST_WITH_TOOLS if self.tools else _MAX_ITERATIONS
        rounding, last, is_lost = 0.0, sys.float_info.max, False
        for iteration in range(most + 1):
            trial = self._trial(state, new, time, dt)
            norm, scale = fenicsx.norm(trial.residual[self.loads.free]), trial.scale
            if not math.isfinite(norm):
                raise StepLostError("the residual is not finite")
            is_settled = self.tools.settle(new, norm / scale if scale else 0.0)
            is_balanced = norm <= self.tolerance * scale or (norm > 0.5 * last and norm <= rounding)
            if (
                is_settled
                and is_balanced
                and self.tools.are_balanced(new, self.tolerance, rounding)
            ):
                break
            if iteration == most:
                raise StepLostError(f"no convergence in {most} iterations")
            is_fresh = is_lost or norm > self._slow * last
            last = norm
            # Multipliers taken over have changed the forces.
            residual = trial.balance + self.tools.force(new)
            still, stiffness = np.zeros(len(held)), 1.0 - m.alpha_f
            solve = functools.partial(
                self._solve, trial.middle, gap=still, mass=mass, stiffness=stiffness,
                time=time + stiffness * dt, touching=new,
                rate=stiffness * m.gamma / (m.beta * dt),
            )  # fmt: skip
            try:
                du, ways = self.tools.solve_with_driven(solve, new, residual, is_fresh=is_fresh)
            except LinearSolveError as error:
                raise StepLostError(str(error)) from None
            rounding = 4.0 * _EPS * float(self._matrix.norm()) * self._size(new)
            if self.tools:
                length = self._length(state, new, (du, ways), time, dt, residual)
                du, ways = length * du, length * ways
            is_lost = not self._is_sound(new + du)
            if is_lost and is_fresh:
                raise StepLostError("a cell would invert")
            if not is_lost:
                new = new + du
                self.tools.go_to(self.tools.ways + ways)
        moved = new - state.u
        # What holds the supports does work too: all that is out of balance there.
        work = float((trial.external + self.tools.force(new)) @ moved)
        work -= float(trial.residual[held] @ moved[held])
        lost = float(self.inertia(trial.damped) @ moved) if self.damping else 0.0
        if trial.viscous is not None:
            lost += float(trial.viscous @ moved)

        def momentum(dv: Floats, da: Floats) -> Floats:
            # Over steps, M v = impulses + (alpha_f - 1/2) dt M a.
            return self.inertia(dv + (0.5 - m.alpha_f) * dt * da)

        late = 0.5 - m.alpha_f
        v, a = self.tools.end_step(new, trial.v, trial.a, dt, late, momentum)
        return State(
            new,
            v,
            a,
            state.external_work + float(fenicsx.total(work)),
            state.damping_work + float(fenicsx.total(lost)),
        )

    def _trial(self, state: State, new: Floats, time: float, dt: float) -> _Trial:
        """What a displacement at the end of a step would leave out of balance in it."""
        m = self.method
        u, v, a = state.u, state.v, state.a
        new_a = (new - u - dt * v) / (m.beta * dt**2) - (0.5 / m.beta - 1.0) * a
        new_v = v + dt * ((1.0 - m.gamma) * a + m.gamma * new_a)
        mid_u = (1.0 - m.alpha_f) * new + m.alpha_f * u
        mid_v = (1.0 - m.alpha_f) * new_v + m.alpha_f * v
        mid_a = (1.0 - m.alpha_m) * new_a + m.alpha_m * a
        external = self.loads.force(mid_u, time + (1.0 - m.alpha_f) * dt)
        internal, viscous = self._internal(mid_u, mid_v)
        damped = self.damping * mid_v
        inertia = self.inertia(mid_a + damped)
        balance = external - internal - inertia
        scale = max(fenicsx.norm(x) for x in (internal, external, inertia))
        residual = balance + self.tools.force(new)
        return _Trial(new_v, new_a, mid_u, damped, viscous, external, balance, residual, scale)

    def _length(
        self,
        state: State,
        new: Floats,
        step: tuple[Floats, Floats],
        time: float,
        dt: float,
        residual: Floats,
    ) -> float:
        """How much of a Newton step of body and driven tools to take; these stay where they are."""
        du, ways = step
        start = self.tools.ways

        def along(length: float) -> float | None:
            further = new + length * du
            if not self._is_sound(further):
                return None
            self.tools.go_to(start + length * ways)
            here = self._trial(state, further, time, dt).residual
            of_tools = float(self.tools.lacking(further)[0] @ ways)
            return float(fenicsx.total(float(here @ du))) + of_tools

        first = float(fenicsx.total(float(residual @ du)))
        length = step_length(along, first + float(self.tools.lacking(new)[0] @ ways))
        self.tools.go_to(start)
        return length

    def _is_sound(self, u: Floats) -> bool:
        return self.body.strain is Strain.LINEAR or self.sampler.smallest(u) > 0.0

    def _size(self, u: Floats) -> float:
        source = self.body.space.transferred.source
        cell = (source.volume / source.num_cells) ** (1.0 / 3.0)
        return float(max(fenicsx.largest(float(np.max(np.abs(u), initial=0.0))), cell))
