"""Motion by the scheme of whoever is judged, on its mesh and with its step, every step solved.

What an implicit simulator differs by from this is its solver's: iterations that it did not do, and
equations that are not those it states. What this differs by from the motion itself is the scheme's.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain, require_no_tools
from palpate.reference import fenicsx
from palpate.reference.availability import versions
from palpate.reference.errors import ReferenceBlowUpError, ReferenceStepError
from palpate.reference.integrators.balance import Balance, NotSolvedError
from palpate.reference.loads_over_time import Amplitudes
from palpate.reference.result import SteppedResult
from palpate.reference.schemes import Integrator, State, read_integrator, stencil_of
from palpate.reference.stated_steps import stated_steps


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
    progress: Callable[[str], None] | None = None,
) -> SteppedResult:
    """Step a problem through its time span by a scheme.

    Args:
        problem: With `time` set, its `time_step` too: the outputs lie whole steps apart. Of any
            law that the element knows.
        integrator: The scheme; its equations stand in `schemes`. For central differences see
            `palpate.reference.explicit.simulate_explicit`.
        strain: Strain measure.
        element: SMOOTHED averages strains over edges and nodes; not under mpirun.
        displacement: Initial, at the mesh's points [m], shape (num_points, 3); None is rest.
        velocity: Initial [m/s], shape (num_points, 3); None is the problem's. Of held components
            it is not read.
        amplitude: Factor over time [-] on all loads, or one for each load (None is 1). None
            takes each load's own.
        support_amplitude: The same for the supports' displacements.
        relative_tolerance: Of each step's equations: norm of the free out-of-balance nodal forces
            over the largest of those of internal, external and inertial ones [-].
        progress: Called with one line of text now and then.

    Returns:
        The trajectory at the outputs; every number in it is finite.

    Raises:
        InputError: No time span or step, outputs that are not whole steps apart, a tool, central
            differences, or a load, support or element that cannot be used.
        ReferenceStepError: A step's equations have no solution; carries the last good state.
        ReferenceBlowUpError: Semi-implicit Euler left the finite numbers; likewise.

    Note:
        Degree 1 with lumped mass, as simulators have it. A step is never cut: of what it does not
        resolve, the scheme's answer is the answer. Where the equations of a long step have several
        solutions, this is the one that Newton's method finds from u + dt v.
    """
    integrator = read_integrator(integrator)
    if integrator is Integrator.CENTRAL_DIFFERENCES:
        raise InputError("central differences are stepped by the explicit reference: leave these")
    require_no_tools(problem, f"the reference by {integrator}")
    span, dt, per_output = stated_steps(problem, f"a motion by {integrator}")
    run = Balance(
        problem,
        Strain(strain),
        Element(element),
        amplitude,
        support_amplitude,
        tolerance=relative_tolerance,
    )
    tell = progress or (lambda _line: None)
    body = run.body
    state = run.start(displacement, velocity)
    states = [state]
    for step in range(per_output * span.num_outputs):
        time = step * dt
        if integrator.is_implicit:
            try:
                state = run.solve(stencil_of(integrator, state, dt), time)
            except NotSolvedError as error:
                at_points = body.at_points(state.u)
                raise ReferenceStepError(time, dt, str(error), at_points) from None
        else:
            new = _semi_implicit(run, state, time, dt)
            if not math.isfinite(fenicsx.norm(new.u)):
                raise ReferenceBlowUpError(step, time, body.at_points(state.u))
            state = new
        if (step + 1) % per_output == 0:
            states.append(state)
            tell(f"t = {time + dt:.4g} s of {span.end_time:g} s")
    return SteppedResult(
        times=span.end_time / span.num_outputs * np.arange(span.num_outputs + 1),
        displacements=np.array([body.at_points(s.u) for s in states]),
        velocities=np.array([body.at_points(s.v) for s in states]),
        kinetic_energies=np.array([run.kinetic_energy(s.v) for s in states]),
        strain_energies=np.array([body.strain_energy(s.u) for s in states]),
        integrator=integrator,
        time_step=dt,
        num_steps=per_output * span.num_outputs,
        newton_iterations=run.iterations,
        largest_residual=run.largest_residual,
        strain=body.strain,
        element=body.element,
        versions=versions(),
    )


def _semi_implicit(run: Balance, state: State, time: float, dt: float) -> State:
    """Velocity by the forces at the start, place by the velocity at the end."""
    damping = run.damping
    velocity: Floats = (state.v + dt * run.force(state.u, state.v, time) / run.mass) / (
        1.0 + damping * dt
    )
    u = run.loads.at_supports(state.u + dt * velocity, time + dt)
    held = run.loads.held
    velocity[held] = (u[held] - state.u[held]) / dt
    return State(u, velocity, (velocity - state.v) / dt)
