"""Implicit dynamics on FEniCSx: the truth of motion, second order in time.

The generalised-alpha method (J. Chung, G. M. Hulbert, J. Appl. Mech. 60 (1993) 371-375) for

    M a'' + lambda M a' + R(a) = F(t),

balanced at t + (1 - alpha_f) dt, accelerations at t + (1 - alpha_m) dt, with Newmark's formulas

    u' = u + dt v + dt^2 ((1/2 - beta) a + beta a'),   v' = v + dt ((1 - gamma) a + gamma a').

With stiffness damping R has the forces of a viscous stress too, R(a, a'): see `viscosity`.

Its one parameter, the spectral radius at infinite frequency, says how much of a wave too short
for the mesh is left after a step: 1 leaves all, 0 nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.reference.availability import versions
from palpate.reference.discrete_problem import ElasticBody
from palpate.reference.errors import ReferenceStepError
from palpate.reference.fenicsx import PETSc
from palpate.reference.generalised_alpha import AlphaMethod, Motion, State, StepLostError
from palpate.reference.loads_over_time import Amplitudes, LoadsOverTime
from palpate.reference.mesh_transfer import TransferredSpace, create_space, transfer
from palpate.reference.result import ImplicitResult
from palpate.reference.stated_steps import stated_steps

Field: TypeAlias = Points | Callable[[Points], Points] | None

# A step that does not converge is cut in two, so often at most.
_MAX_HALVINGS = 6


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
    progress: Callable[[str], None] | None = None,
) -> ImplicitResult:
    """Step a problem through its time span.

    Args:
        problem: With `time` set, its `time_step` too: the outputs lie whole steps apart.
        strain: Strain measure.
        degree: Polynomial degree of the displacement, 1 to 3.
        displacement: Initial, at the mesh's points [m], shape (num_points, 3), linear between
            them; or a function of rest points, shape (n, 3); None is rest.
        velocity: Initial [m/s], likewise; None is the problem's.
        amplitude: Factor over time [-] on all loads, or one for each load (None is 1). None
            takes each load's own.
        support_amplitude: The same for the supports' displacements.
        spectral_radius: See `AlphaMethod`.
        is_mass_lumped: Row sums instead of the consistent mass; degree 1 only.
        relative_tolerance: Of each step: out-of-balance nodal forces over the largest of
            internal, external and inertial ones [-].
        progress: Called with one line of text now and then.

    Returns:
        The trajectory at the outputs; every number in it is finite.

    Raises:
        InputError: No time span or step, outputs that are not whole steps apart, a tool inside the
            body at the start, or a load or support that cannot be used.
        ReferenceStepError: A step had no answer, however short; carries the last good state.

    Note:
        Tools touch the body at nodes (see `ContactPoints`); one that a force drives has its mass
        and moves along its line, from rest (see `DrivenTool`). Where their forces set in at
        once (a node is caught, or dragged from the start) steps are of first order.
        Unconditionally stable for linear problems only; of what the time step does not resolve
        nothing is true. Halve the step to see how far it is resolved.
    """
    span, dt, per_output = stated_steps(problem, "implicit dynamics")
    if degree not in (1, 2, 3):
        raise InputError(f"degree = {degree}: needs 1, 2 or 3")
    if is_mass_lumped and degree > 1:
        raise InputError("row sums of a quadratic mass matrix are negative; lump degree 1 only")
    body = ElasticBody(
        create_space(transfer(problem.mesh), degree),
        problem.material,
        Strain(strain),
        problem.inclusions,
    )
    loads = LoadsOverTime(body, problem, amplitude, support_amplitude)
    motion = Motion(
        problem,
        body,
        loads,
        AlphaMethod(spectral_radius),
        is_mass_lumped=is_mass_lumped,
        tolerance=relative_tolerance,
    )
    tell = progress or (lambda _line: None)
    tell(f"{3 * motion.body.space.num_global_blocks} degrees of freedom, {motion.solver.name}")
    space = body.space
    speed = body.to_local(_flat(space, velocity))
    if velocity is None and problem.initial_velocity is not None:
        speed = body.to_local(_flat(space, problem.initial_velocity.at))
        speed[loads.held] = 0.0
    state = motion.start(body.to_local(_flat(space, displacement)), speed)
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
        times=span.end_time / span.num_outputs * np.arange(span.num_outputs + 1),
        displacements=np.array([body.at_points(s.u) for s in states]),
        velocities=np.array([body.at_points(s.v) for s in states]),
        kinetic_energies=np.array([motion.kinetic_energy(s.v) for s in states]),
        strain_energies=np.array([motion.body.strain_energy(s.u) for s in states]),
        external_works=np.array([s.external_work for s in states]),
        damping_works=np.array([s.damping_work for s in states]),
        smallest_det_f=smallest_det_f,
        strain=motion.body.strain,
        degree=degree,
        time_step=dt,
        newton_iterations=motion.iterations,
        tool_forces=np.array(felt).swapaxes(0, 1),
        versions={**versions(), "petsc": ".".join(map(str, PETSc.Sys.getVersion()))},
    )


def _flat(space: TransferredSpace, given: Field) -> Floats:
    if given is None:
        return np.zeros(3 * space.num_blocks)
    if not callable(given):
        return space.from_points(given)
    values: Points = np.asarray(given(space.coordinates), dtype=np.float64).ravel()
    return values


def _advance(motion: Motion, state: State, time: float, dt: float, halvings: int) -> State:
    """One step, or two half ones where it has no answer."""
    try:
        return motion.step(state, time, dt)
    except StepLostError as error:
        if halvings == 0:
            at_points = motion.body.at_points(state.u)
            raise ReferenceStepError(time, dt, str(error), at_points) from None
    half = _advance(motion, state, time, 0.5 * dt, halvings - 1)
    return _advance(motion, half, time + 0.5 * dt, 0.5 * dt, halvings - 1)
