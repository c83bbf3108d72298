"""Motion of linear tetrahedra with lumped mass, by the scheme and step of the simulator judged.

Every step is solved to a tolerance. The difference of an implicit simulator from this is the error
of its solver: too few iterations, or equations other than those it states. The difference of this
from the exact motion is the error of the scheme.

Central differences of M a'' + D a' + R(a) = F(t) with lumped M and D = lambda M are the explicit
steps by which fast simulators are judged. Expanding the paper's eq. 11 gives, for each free degree
of freedom,

    (m/dt^2 + d/(2 dt)) a(t+dt) = F - R(a(t)) + (2/dt^2) m a(t) - (m/dt^2 - d/(2 dt)) a(t-dt)

(its eq. 12 prints R inside a bracket multiplied by a), started by
a(-dt) = a(0) - dt a'(0) + dt^2/2 a''(0) (its eq. 13). Stiffness damping adds to R(a(t)) the forces
of the viscous stress beta C : (E(a(t)) - E(a(t-dt))) / dt (see `Viscosity`). Everything is
assembled from UFL, the row sums of the mass matrix included; the caller chooses the time step.
The other schemes are in `schemes`.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Element, Problem, Strain, require_no_tools
from palpate.reference import fenicsx
from palpate.reference.contact.explicit_tools import SteppedTools
from palpate.reference.errors import ReferenceBlowUpError, ReferenceStepError
from palpate.reference.fenicsx import PETSc, ufl
from palpate.reference.linear_solver import LinearSolveError, LinearSolver
from palpate.reference.motion import Amplitudes, MovingBody, StepLostError
from palpate.reference.result import SteppedResult
from palpate.reference.schemes import (
    Integrator,
    State,
    Stencil,
    read_integrator,
    stated_steps,
    stencil_of,
)
from palpate.reference.tasks import Progress, say_nothing

_MAX_ITERATIONS = 60
# Maximum number of times that a Newton step is halved, while a cell would invert or the residual
# force along the step is opposite and larger than at its start.
_MAX_CUTS = 12


def simulate_explicit(problem: Problem, **options: Any) -> SteppedResult:
    """`simulate_by` with central differences, whose arguments it takes."""
    return simulate_by(problem, Integrator.CENTRAL_DIFFERENCES, **options)


def simulate_by(
    problem: Problem,
    integrator: Integrator,
    *,
    strain: Strain = Strain.GREEN,
    element: Element = Element.LINEAR,
    displacement: Points | None = None,
    velocity: Points | None = None,
    amplitude: Amplitudes = None,
    support_amplitude: Amplitudes = None,
    relative_tolerance: float = 1e-10,
    progress: Progress | None = None,
) -> SteppedResult:
    """Step a problem through its time span by a scheme.

    Args:
        problem: A problem with `time` and its `time_step`: the outputs are whole steps apart. Any
            law that the element supports.
        integrator: The scheme; its equations are in `schemes`.
        strain: Strain measure.
        element: SMOOTHED averages strains over edges and nodes; not under mpirun.
        displacement: See `simulate_implicit`.
        velocity: See `simulate_implicit`; values of fixed components are ignored.
        amplitude: See `simulate_implicit`.
        support_amplitude: See `simulate_implicit`.
        relative_tolerance: Tolerance of each step: norm of the free out-of-balance nodal forces
            over the largest of those of internal, external and inertial ones [-].
        progress: Called with one line of text now and then.

    Returns:
        The trajectory at the outputs; every number in it is finite.

    Raises:
        InputError: No time span or step, outputs that are not whole steps apart, a tool with
            another scheme than central differences, or a load, support, tool or element that
            cannot be used.
        ReferenceStepError: A step's equations have no solution; has the last accepted state.
        ReferenceBlowUpError: An explicit scheme diverged; has the last accepted state.

    Note:
        Degree 1 with lumped mass, like simulators: the row sums of a quadratic mass matrix are
        negative at the vertices. A time step is never cut: errors of time steps that are too long
        are part of the result. Where the equations of a long step have several solutions, this is
        the one that Newton's method finds from u + dt v.
        Central differences are stable for dt < 2 / omega_max, with stiffness damping beta for
        dt < sqrt((2 / omega_max)^2 + beta^2) - beta.
    """
    integrator = read_integrator(integrator)
    is_central = integrator is Integrator.CENTRAL_DIFFERENCES
    if not is_central:
        require_no_tools(problem, f"the reference by {integrator}")
    span, dt, per_output = stated_steps(problem, f"a motion by {integrator}")
    run = SteppedBody(
        problem,
        strain,
        element=element,
        loads_by=amplitude,
        supports_by=support_amplitude,
        is_viscous_by_change=is_central,
    )
    run.tolerance = relative_tolerance
    tell = progress or say_nothing
    body = run.body
    state = run.begin(displacement, velocity, integrator, dt)
    tools: SteppedTools | None = None
    if is_central:
        tools = SteppedTools(problem, body.space, run.fixed, run.mobility(dt))
        tools.require_outside(state.u)
    states, felt = [state], [] if tools is None else [tools.mean_forces()]
    for step in range(per_output * span.num_outputs):
        time = step * dt
        if integrator.is_implicit:
            try:
                state = run.solve(stencil_of(integrator, state, dt), time)
            except StepLostError as error:
                at_points = body.at_points(state.u)
                raise ReferenceStepError(time, dt, str(error), at_points) from None
        else:
            new = (
                run.step_semi_implicitly(state, time, dt)
                if tools is None
                else run.step_by_central_differences(state, tools, step, dt)
            )
            if fenicsx.is_anywhere(not np.isfinite(new.u).all()):
                raise ReferenceBlowUpError(step, time, body.at_points(state.u))
            state = new
        if (step + 1) % per_output == 0:
            states.append(state)
            if tools is not None:
                felt.append(tools.mean_forces())
            tell(f"t = {time + dt:.4g} s of {span.end_time:g} s")
    return SteppedResult(
        **run.at_outputs(states, span),
        integrator=integrator,
        time_step=dt,
        num_steps=per_output * span.num_outputs,
        newton_iterations=run.iterations,
        largest_residual=run.largest_residual,
        element=body.element,
        tool_forces=np.array(felt).swapaxes(0, 1) if felt else np.zeros((0, len(states), 3)),
    )


class SteppedBody(MovingBody):
    """A body with lumped mass, and Newton's method for the equations of an implicit step.

    It counts linear solves, and the largest relative residual of its steps [-], to a `tolerance`.
    """

    tolerance = 1e-10
    iterations = 0
    largest_residual = 0.0
    # The last matrix and its factors; the matrix of a linear body changes with the stencil only.
    _last: tuple[tuple[float, float, float], Any] | None = None
    _matrix_norm = 0.0

    @property
    def mass(self) -> Floats:
        """Row sums of the mass matrix [kg], flat."""
        assert self.row_sums is not None
        return self.row_sums

    @functools.cached_property
    def _system(self) -> tuple[Any, Any, LinearSolver]:
        """Form of the stiffness, its matrix and its solver; semi-implicit steps need none."""
        form = fenicsx.form(self.body.work_change(ufl.TrialFunction(self.body.space.space)))
        matrix = fenicsx.create_matrix(form)
        matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        solver = LinearSolver(
            self.body.space,
            is_symmetric=self.is_symmetric,
            frames=self.body.frames,
        )
        return form, matrix, solver

    def mobility(self, dt: float) -> Floats:
        """Displacement per force of each degree of freedom in a central-difference step [m/N]."""
        return dt**2 / (self.mass * (1.0 + 0.5 * self.damping * dt))

    def step_by_central_differences(
        self, state: State, tools: SteppedTools, step: int, dt: float
    ) -> State:
        """A step by the recurrence above (eq. 12); its velocity is the mean over the last step."""
        assert state.before is not None
        now, before, end = state.u, state.before.u, (step + 1) * dt
        half, force = 0.5 * self.damping * dt, self.force(now, before, step * dt)
        ahead = (dt**2 * force / self.mass + 2.0 * now - (1.0 - half) * before) / (1.0 + half)
        ahead = tools.keep_out(now, self.at_supports(ahead, end), end, dt)
        return State(ahead, (ahead - now) / dt, state.a, State(now, state.v, state.a))

    def begin(
        self,
        displacement: Points | None,
        velocity: Points | None,
        integrator: Integrator,
        dt: float,
    ) -> State:
        """The state at time 0; for central differences with the state a step before (eq. 13)."""
        u, v = self.start(displacement, velocity)
        v[self.fixed] = 0.0
        is_central = integrator is Integrator.CENTRAL_DIFFERENCES
        a = self.force(u, u - dt * v if is_central else v, 0.0) / self.mass - self.damping * v
        a[self.fixed] = 0.0
        # Eq. 13; no other scheme starts from two states.
        before = State(u - dt * v + 0.5 * dt**2 * a, v, a)
        return State(u, v, a, before if is_central else None)

    def step_semi_implicitly(self, state: State, time: float, dt: float) -> State:
        """Velocity from the forces at the start, displacement from the velocity at the end."""
        v: Floats = (state.v + dt * self.force(state.u, state.v, time) / self.mass) / (
            1.0 + self.damping * dt
        )
        u = self.at_supports(state.u + dt * v, time + dt)
        v[self.fixed] = (u[self.fixed] - state.u[self.fixed]) / dt
        return State(u, v, (v - state.v) / dt)

    def solve(self, stencil: Stencil, time: float) -> State:
        """The state at the end of a step.

        Args:
            stencil: Equations of the step.
            time: Time at its start [s].

        Raises:
            StepLostError: Newton's method found no solution.
        """
        dt, free, fixed = stencil.time_step, self.free, self.fixed
        u = self.at_supports(stencil.state.u + dt * stencil.state.v, time + dt)
        if not self.is_sound(stencil.middle(u)):
            u = self.at_supports(stencil.state.u, time + dt)
        residual, scale = self._residual(stencil, u, time)
        rounding, last, still = 0.0, math.inf, np.zeros(len(fixed))
        for _ in range(_MAX_ITERATIONS):
            norm = fenicsx.norm(residual[free])
            if not math.isfinite(norm):
                raise StepLostError("the residual is not finite")
            if norm <= self.tolerance * scale or (norm > 0.5 * last and norm <= rounding):
                self.largest_residual = max(self.largest_residual, norm / scale if scale else 0.0)
                return stencil.after(u)
            last = norm
            try:
                du = self._newton_step(stencil, u, time, residual, still)
            except LinearSolveError as error:
                raise StepLostError(str(error)) from None
            rounding = self.rounding_error(self._matrix_norm, u)
            u, residual, scale = self._along(stencil, u, du, time, residual)
        raise StepLostError(f"no convergence in {_MAX_ITERATIONS} iterations")

    def _residual(self, stencil: Stencil, u: Floats, time: float) -> tuple[Floats, float]:
        """Out-of-balance forces [N], flat, and the largest norm of their parts [N]."""
        forces = self.balance(stencil, u, time)
        return forces.lacking, forces.scale(self.free)

    def _newton_step(
        self, stencil: Stencil, u: Floats, time: float, residual: Floats, still: Floats
    ) -> Floats:
        self.iterations += 1
        body, fixed = self.body, self.fixed
        form, matrix, solver = self._system
        factors = stencil.A + self.damping * stencil.B, stencil.theta, stencil.B
        if self._last is not None and self.is_linear and self._last[0] == factors:
            matrix = self._last[1]
            return solver.solve(matrix, residual, fixed, still, tolerance=1e-4, is_same_matrix=True)
        body.set_displacement(stencil.middle(u))
        matrix.zeroEntries()
        fenicsx.assemble_into_matrix(matrix, form)
        self.add_load_tangent(matrix, 1.0, time + stencil.theta * stencil.time_step)
        matrix = body.with_smoothing(matrix)
        matrix.scale(stencil.theta)
        if self.viscosity is not None:
            self.viscosity.add_tangent(matrix, stencil.theta, stencil.B)
        if body.frames is not None:
            matrix = body.frames.turned(matrix)
        diagonal = matrix.getDiagonal()
        diagonal.array[:] += factors[0] * self.mass
        matrix.setDiagonal(diagonal)
        diagonal.destroy()
        self._last = factors, matrix
        self._matrix_norm = float(matrix.norm())
        return solver.solve(matrix, residual, fixed, still, tolerance=1e-4)

    def _along(
        self, stencil: Stencil, u: Floats, du: Floats, time: float, residual: Floats
    ) -> tuple[Floats, Floats, float]:
        """Take the largest of 1, 1/2, 1/4, ... of a Newton step that is accepted.

        No cell may be inverted, and the force along the step must not be larger than at its start;
        for dead loads this force is the slope of the incremental potential.
        """
        first = abs(float(fenicsx.total(float(residual @ du))))
        length = 1.0
        for _ in range(_MAX_CUTS):
            further = u + length * du
            if self.is_sound(stencil.middle(further)):
                left, scale = self._residual(stencil, further, time)
                # A NaN, from a law outside its range, halves the step as well.
                if abs(float(fenicsx.total(float(left @ du)))) <= first:
                    return further, left, scale
            length *= 0.5
        raise StepLostError("a cell would invert, or no part of a Newton step balances better")
