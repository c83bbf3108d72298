"""Implicit dynamics on FEniCSx: the reference for motion, second order in time.

The generalised-alpha method for

    M a'' + lambda M a' + R(a) = F(t),

whose formulas are in `schemes`; with stiffness damping R has the forces of a viscous stress too,
R(a, a'): see `motion`. Its one parameter is the spectral radius at infinite frequency, the factor
on oscillations that the time step does not resolve: 1 leaves them all, 0 removes them in one step.
"""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.reference import fenicsx
from palpate.reference.contact.implicit_tools import ImplicitTools, step_length
from palpate.reference.errors import ReferenceStepError
from palpate.reference.fenicsx import PETSc, fem, ufl
from palpate.reference.linear_solver import (
    LARGEST_FALLBACK,
    LaggedFactors,
    LinearSolveError,
    LinearSolver,
)
from palpate.reference.motion import Amplitudes, Field, MovingBody, StepLostError
from palpate.reference.result import ImplicitResult
from palpate.reference.schemes import AlphaMethod, State, Stencil, stated_steps, stencil_of
from palpate.reference.tasks import Progress, say_nothing

# Maximum number of times that a step that does not converge is halved.
_MAX_HALVINGS = 6
_MAX_ITERATIONS = 25
# An iteration with an earlier tangent must reduce the residual to this fraction, else the tangent
# is updated. To assemble and factor it costs as much as ten solves or more with existing factors.
_SLOW = 0.3
# Contact changes the active nodes, and the multipliers with them: more iterations are needed.
_MOST_WITH_TOOLS = 40


def simulate_implicit(
    problem: Problem,
    *,
    strain: Strain = Strain.GREEN,
    degree: int = 2,
    displacement: Field = None,
    velocity: Field = None,
    amplitude: Amplitudes = None,
    support_amplitude: Amplitudes = None,
    spectral_radius: float = 0.8,
    is_mass_lumped: bool = False,
    relative_tolerance: float = 1e-9,
    progress: Progress | None = None,
) -> ImplicitResult:
    """Step a problem through its time span.

    Args:
        problem: With `time` set, its `time_step` too: the outputs lie whole steps apart.
        strain: Strain measure.
        degree: Polynomial degree of the displacement, 1 to 3.
        displacement: Initial displacement at the mesh's points [m], shape (num_points, 3), linear
            between them; or a function of rest points, shape (n, 3); None is rest.
        velocity: Initial velocity [m/s], given like the displacement; None is the problem's.
        amplitude: Factor over time [-] on all loads, or one for each load (None is 1). None
            takes each load's own.
        support_amplitude: The same for the supports' displacements.
        spectral_radius: See `AlphaMethod`.
        is_mass_lumped: Row sums instead of the consistent mass; degree 1 only.
        relative_tolerance: Tolerance of each step: out-of-balance nodal forces over the largest
            of internal, external and inertial ones [-].
        progress: Called with one line of text now and then.

    Returns:
        The trajectory at the outputs; every number in it is finite.

    Raises:
        InputError: No time span or step, outputs that are not whole steps apart, a tool inside the
            body at the start, or a load or support that cannot be used.
        ReferenceStepError: A step has no solution, however short; has the last accepted state.

    Note:
        Tools touch the body at nodes, for degree 1 over facets where they say so (see
        `contact_points`); a tool driven by a force has a mass and moves along its line, from rest
        (see `DrivenTool`). Where contact forces jump (a node comes into contact, or friction acts
        from the start) steps are of first order.
        The method is unconditionally stable for linear problems only. Oscillations that the time
        step does not resolve are wrong: halve the step to estimate the error.
    """
    span, dt, per_output = stated_steps(problem, "implicit dynamics")
    if degree not in (1, 2, 3):
        raise InputError(f"degree = {degree}: needs 1, 2 or 3")
    if is_mass_lumped and degree > 1:
        raise InputError("row sums of a quadratic mass matrix are negative; lump degree 1 only")
    method = AlphaMethod(spectral_radius)
    motion = Motion(
        problem,
        strain,
        degree=degree,
        loads_by=amplitude,
        supports_by=support_amplitude,
        is_mass_lumped=is_mass_lumped,
    )
    motion.prepare(method, relative_tolerance)
    body = motion.body
    tell = progress or say_nothing
    tell(f"{3 * body.space.num_global_blocks} degrees of freedom, {motion.solver.name}")
    state = motion.begin(displacement, velocity)
    motion.tools.require_outside(state.u)
    states, smallest_det_f = [state], motion.sampler.smallest(state.u)
    felt = [motion.tools.mean_forces(0.0)]
    for output in range(1, span.num_outputs + 1):
        for step in range(per_output):
            time = ((output - 1) * per_output + step) * dt
            state = _advance(motion, state, time, dt, _MAX_HALVINGS)
        states.append(state)
        felt.append(motion.tools.mean_forces(per_output * dt))
        smallest_det_f = min(smallest_det_f, motion.sampler.smallest(state.u))
        tell(f"t = {output * per_output * dt:.4g} s of {span.end_time:g} s")
    return ImplicitResult(
        **motion.at_outputs(states, span),
        external_works=np.array([s.external_work for s in states]),
        damping_works=np.array([s.damping_work for s in states]),
        smallest_det_f=smallest_det_f,
        degree=degree,
        time_step=dt,
        newton_iterations=motion.iterations,
        tool_forces=np.array(felt).swapaxes(0, 1),
    )


def _advance(motion: Motion, state: State, time: float, dt: float, halvings: int) -> State:
    """Do one step, or two of half the length where it has no solution."""
    try:
        return motion.step(state, time, dt)
    except StepLostError as error:
        if halvings == 0:
            at_points = motion.body.at_points(state.u)
            raise ReferenceStepError(time, dt, str(error), at_points) from None
    half = _advance(motion, state, time, 0.5 * dt, halvings - 1)
    return _advance(motion, half, time + 0.5 * dt, 0.5 * dt, halvings - 1)


class Motion(MovingBody):
    """A body with its tools, and a step of the generalised-alpha method by Newton's method.

    Attributes:
        method: Parameters of the generalised-alpha method.
        tolerance: Relative residual of a step [-].
        tools: The tools of the problem.
        solver: Solver of the linear systems.
        iterations: Number of linear solves so far.
    """

    iterations = 0
    # Factors of mass, stiffness and viscosity, with the last matrix that was assembled from them.
    _cached: tuple[tuple[float, float, float], Any] | None = None
    # The consistent mass of masses on the surface, each a form.
    _surface_tangents: Sequence[Any] = ()

    def prepare(self, method: AlphaMethod, tolerance: float) -> None:
        """Compile the tangent, and choose what solves with it."""
        self.method, self.tolerance = method, tolerance
        body, space = self.body, self.body.space
        du = ufl.TrialFunction(space.space)
        mesh = space.transferred.mesh
        self._mass_factor, self._stiffness_factor = (
            fem.Constant(mesh, PETSc.ScalarType(0.0)) for _ in range(2)
        )
        tangent = self._stiffness_factor * body.work_change(du)
        if self.row_sums is None:
            mass = self.density * ufl.inner(du, body.v) * self.mass_measure
            tangent += self._mass_factor * mass
            on_surface = self.works_of_masses(du)
            self._surface_tangents = [fenicsx.form(self._mass_factor * of) for of in on_surface]
        self._tangent = fenicsx.form(tangent)
        self.tools = ImplicitTools(self.problem, space, self.fixed, tolerance)
        self._matrix = fenicsx.create_matrix(self._tangent, self.tools.reached)
        self._matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        # Multigrid converges slowly with contact, and factors can be used for many steps.
        is_direct = bool(self.tools) or 3 * space.num_global_blocks < LARGEST_FALLBACK
        self.solver: LinearSolver | LaggedFactors = (
            LaggedFactors(is_symmetric=self.is_symmetric)
            if is_direct
            else LinearSolver(space, is_symmetric=self.is_symmetric, frames=body.frames)
        )
        is_linear = body.strain is Strain.LINEAR
        # Largest ratio of residuals by an iteration with an earlier tangent. Multigrid is set up
        # anew for every matrix, so that a new tangent costs little more.
        self._slow = math.inf if is_linear else _SLOW if is_direct else 0.0

    def _solve(
        self,
        u: Floats,
        rhs: Floats,
        factors: tuple[float, float, float],
        time: float,
        touching: Floats | None = None,
        *,
        is_fresh: bool = True,
    ) -> Floats:
        """Solve (mass M + stiffness K(u) + rate D(u)) du = rhs, du = 0 at fixed entries.

        D is the derivative of the last viscous force by the velocity, K has that by displacement.
        The stiffness of contact is added at the displacement `touching`, if it is given.
        Unless `is_fresh`, K and D of an earlier displacement are taken where they are cached.
        """
        mass, stiffness, _ = factors
        if self._cached is None or self._cached[0] != factors or is_fresh:
            self._assemble(u, factors)
        else:
            same = PETSc.Mat.Structure.SAME_NONZERO_PATTERN
            self._cached[1].copy(self._matrix, structure=same)
        if stiffness:
            self.add_load_tangent(self._matrix, stiffness, time)
        if self.row_sums is not None:
            diagonal = self._matrix.getDiagonal()
            diagonal.array[:] += mass * self.row_sums
            self._matrix.setDiagonal(diagonal)
            diagonal.destroy()
        if touching is not None:
            self.tools.add_tangent(self._matrix, touching)
        self.iterations += 1
        frames = self.body.frames
        matrix = self._matrix if frames is None else frames.turned(self._matrix)
        still = np.zeros(len(self.fixed))
        return self.solver.solve(matrix, rhs, self.fixed, still, tolerance=0.1 * self.tolerance)

    def _assemble(self, u: Floats, factors: tuple[float, float, float]) -> None:
        """Assemble and cache the tangent, without followers, lumped mass and tools."""
        mass, stiffness, rate = factors
        self.body.set_displacement(u)
        self._mass_factor.value, self._stiffness_factor.value = mass, stiffness
        self._matrix.zeroEntries()
        fenicsx.assemble_into_matrix(self._matrix, self._tangent)
        for form in self._surface_tangents:
            fenicsx.assemble_into_matrix(self._matrix, form)
        if self.viscosity is not None and rate:
            self.viscosity.add_tangent(self._matrix, stiffness, rate)
        if self._cached is not None:
            self._cached[1].destroy()
            # Contact changes few nodes at a time: old factors then remain good preconditioners.
            is_new = self._cached[0] != factors or not self.tools
            if is_new and isinstance(self.solver, LaggedFactors):
                self.solver.forget()
        if self._slow > 0.0:  # else it is never used again
            self._cached = factors, self._matrix.copy()

    def begin(self, displacement: Field, velocity: Field) -> State:
        """The state at time 0, with the acceleration that balances it."""
        u, v = self.start(displacement, velocity)
        force = self.force(u, v, 0.0) - self.damping * self.inertia(v)
        return State(u, v, self._solve(u, force, (1.0, 0.0, 0.0), 0.0))

    def step(self, state: State, time: float, dt: float) -> State:
        """The state a time step later.

        Raises:
            StepLostError: Newton's method found no solution.
        """
        m, fixed, tools = self.method, self.fixed, self.tools
        stencil = stencil_of(m, state, dt)
        factors = stencil.A + self.damping * stencil.B, stencil.theta, stencil.B
        new = self.at_supports(state.u + dt * state.v + 0.5 * dt**2 * state.a, time + dt)
        if not self.is_sound(new):
            new = self.at_supports(state.u, time + dt)
        tools.begin_step(time, dt, m, factors[0])
        most = _MOST_WITH_TOOLS if tools else _MAX_ITERATIONS
        rounding, last, is_lost = 0.0, sys.float_info.max, False
        for iteration in range(most + 1):
            forces = self.balance(stencil, new, time)
            left = forces.lacking + tools.force(new)
            norm, scale = fenicsx.norm(left[self.free]), forces.scale()
            if not math.isfinite(norm):
                raise StepLostError("the residual is not finite")
            # In free flight all forces are rounding, and none is small beside the others.
            is_rounding = norm <= rounding or not scale
            is_settled = tools.settle(new, 0.0 if is_rounding else norm / scale)
            is_balanced = norm <= self.tolerance * scale or (norm > 0.5 * last and norm <= rounding)
            if is_settled and is_balanced and tools.are_balanced(new, self.tolerance, rounding):
                break
            if iteration == most:
                raise StepLostError(f"no convergence in {most} iterations")
            is_fresh = is_lost or norm > self._slow * last
            last = norm
            # The update of the multipliers has changed the forces.
            residual = forces.lacking + tools.force(new)
            solve = functools.partial(
                self._solve,
                stencil.middle(new),
                factors=factors,
                time=time + stencil.theta * dt,
                touching=new,
            )
            try:
                du, ways = tools.solve_with_driven(solve, new, residual, is_fresh=is_fresh)
            except LinearSolveError as error:
                raise StepLostError(str(error)) from None
            rounding = self.rounding_error(float(self._matrix.norm()), new)
            if tools:
                length = self._length(stencil, new, (du, ways), time, residual)
                du, ways = length * du, length * ways
            is_lost = not self.is_sound(new + du)
            if is_lost and is_fresh:
                raise StepLostError("a cell would invert")
            if not is_lost:
                new = new + du
                tools.go_to(tools.ways + ways)
        moved = new - state.u
        # Reactions of moving supports do work too: they are the residual at the fixed entries.
        work = float((forces.external + tools.force(new)) @ moved)
        work -= float(left[fixed] @ moved[fixed])
        lost = float(self.inertia(forces.damped) @ moved) if self.damping else 0.0
        if forces.viscous is not None:
            lost += float(forces.viscous @ moved)

        def momentum(dv: Floats, da: Floats) -> Floats:
            # Summed over steps, M v = impulses + (alpha_f - 1/2) dt M a.
            return self.inertia(dv + (0.5 - m.alpha_f) * dt * da)

        end = stencil.after(new)
        v, a = tools.end_step(new, end.v, end.a, dt, 0.5 - m.alpha_f, momentum)
        return State(
            new,
            v,
            a,
            external_work=state.external_work + float(fenicsx.total(work)),
            damping_work=state.damping_work + float(fenicsx.total(lost)),
        )

    def _length(
        self,
        stencil: Stencil,
        new: Floats,
        step: tuple[Floats, Floats],
        time: float,
        residual: Floats,
    ) -> float:
        """Fraction of a Newton step of body and driven tools to take; the tools are not moved."""
        (du, ways), tools = step, self.tools
        start = tools.ways

        def along(length: float) -> float | None:
            further = new + length * du
            if not self.is_sound(further):
                return None
            tools.go_to(start + length * ways)
            here = self.balance(stencil, further, time).lacking + tools.force(further)
            of_tools = float(tools.lacking(further)[0] @ ways)
            return float(fenicsx.total(float(here @ du))) + of_tools

        first = float(fenicsx.total(float(residual @ du)))
        length = step_length(along, first + float(tools.lacking(new)[0] @ ways))
        tools.go_to(start)
        return length
