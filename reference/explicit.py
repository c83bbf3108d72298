"""Explicit dynamics on FEniCSx, by which a fast explicit step is judged.

Central differences of M a'' + D a' + R(a) = F(t) with lumped M and D = lambda M. Expanding the
paper's eq. 11 gives, for each free degree of freedom,

    (m/dt^2 + d/(2 dt)) a(t+dt) = F - R(a(t)) + (2/dt^2) m a(t) - (m/dt^2 - d/(2 dt)) a(t-dt)

(its eq. 12 prints R inside a bracket multiplied by a), started by
a(-dt) = a(0) - dt a'(0) + dt^2/2 a''(0) (its eq. 13). Stiffness damping adds to R(a(t)) the forces
of the viscous stress beta C : (E(a(t)) - E(a(t-dt))) / dt (see `viscosity`). Everything is
assembled from UFL, the row sums of the mass matrix included; time is given by the caller, never
chosen.
"""

from __future__ import annotations

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference import fenicsx
from palpate.reference.contact.explicit_tools import SteppedTools
from palpate.reference.discrete_problem import ElasticBody
from palpate.reference.errors import ReferenceBlowUpError
from palpate.reference.fenicsx import is_anywhere, ufl
from palpate.reference.loads_over_time import Amplitudes, LoadsOverTime
from palpate.reference.materials import by_cell
from palpate.reference.mesh_transfer import create_space, transfer
from palpate.reference.result import ExplicitResult
from palpate.reference.stated_steps import stated_steps
from palpate.reference.viscosity import Viscosity


def simulate_explicit(
    problem: Problem,
    *,
    strain: Strain = Strain.GREEN,
    displacement: Points | None = None,
    velocity: Points | None = None,
    amplitude: Amplitudes = None,
    support_amplitude: Amplitudes = None,
    element: Element = Element.LINEAR,
) -> ExplicitResult:
    """Step a problem through its time span.

    Args:
        problem: With `time` set, its `time_step` too: the outputs lie whole steps apart.
        strain: Strain measure.
        displacement: Initial, at the mesh's points [m], shape (num_points, 3); None is rest.
        velocity: Initial [m/s], shape (num_points, 3); None is the problem's. Of held components
            it is not read.
        amplitude: Factor over time [-] on all loads, or one for each load (None is 1). None
            takes each load's own.
        support_amplitude: The same for the supports' displacements.
        element: SMOOTHED averages strains over edges and nodes; not under mpirun.

    Returns:
        The trajectory; every number in it is finite.

    Raises:
        InputError: No time span or step, outputs that are not whole steps apart, or a load,
            support or tool that cannot be used.
        ReferenceBlowUpError: A value stopped being finite; carries the last good state.

    Note:
        Degree 1 only: the row sums of a quadratic mass matrix are negative at the vertices.
        Conditionally stable: dt < 2 / omega_max, with stiffness damping beta
        dt < sqrt((2 / omega_max)^2 + beta^2) - beta.
    """
    span, dt, per_output = stated_steps(problem, "an explicit run")
    run = _Assembly(problem, Strain(strain), Element(element), amplitude, support_amplitude)
    body, half = run.body, 0.5 * span.mass_damping * dt
    zero = np.zeros_like(problem.mesh.points)
    given = body.space.from_points(zero if displacement is None else displacement)
    now = run.at_supports(body.to_local(given), 0.0)
    if velocity is None and problem.initial_velocity is not None:
        velocity = problem.initial_velocity.at(problem.mesh.points)
    speed = body.to_local(body.space.from_points(zero if velocity is None else velocity))
    speed[run.held] = 0.0
    acceleration = run.force(now, now - dt * speed, 0.0) / run.mass - span.mass_damping * speed
    before = now - dt * speed + 0.5 * dt**2 * acceleration
    before[run.held] = now[run.held]
    mobility = dt**2 / (run.mass * (1.0 + half))
    tools = SteppedTools(problem, body.space, run.held, mobility)
    tools.require_outside(now)
    states, energies = [body.at_points(now)], [body.strain_energy(now)]
    felt = [tools.mean_forces()]
    for step in range(per_output * span.num_outputs):
        force = run.force(now, before, step * dt)
        ahead = (dt**2 * force / run.mass + 2.0 * now - (1.0 - half) * before) / (1.0 + half)
        ahead = tools.keep_out(now, run.at_supports(ahead, (step + 1) * dt), (step + 1) * dt, dt)
        if is_anywhere(not np.isfinite(ahead).all()):
            raise ReferenceBlowUpError(step, step * dt, body.at_points(now))
        now, before = ahead, now
        if (step + 1) % per_output == 0:
            states.append(body.at_points(now))
            energies.append(body.strain_energy(now))
            felt.append(tools.mean_forces())
    return ExplicitResult(
        times=span.end_time / span.num_outputs * np.arange(span.num_outputs + 1),
        displacements=np.array(states),
        strain_energies=np.array(energies),
        time_step=dt,
        num_steps=per_output * span.num_outputs,
        tool_forces=np.array(felt).swapaxes(0, 1),
    )


class _Assembly:
    """Forces, lumped mass and supports of one problem, over the degrees of freedom."""

    def __init__(
        self,
        problem: Problem,
        strain: Strain,
        element: Element,
        loads_by: Amplitudes,
        supports_by: Amplitudes,
    ) -> None:
        space = create_space(transfer(problem.mesh), 1)
        self.body = ElasticBody(
            space, problem.material, strain, problem.inclusions, element=element
        )
        self.mass = row_sums_of_mass(self.body, problem)
        self._loads = LoadsOverTime(self.body, problem, loads_by, supports_by)
        self.at_supports, self.held = self._loads.at_supports, self._loads.held
        span = problem.time
        self._viscosity = None
        if span is not None and span.time_step and span.stiffness_damping:
            factor = span.stiffness_damping / span.time_step
            self._viscosity = Viscosity(self.body, factor, is_by_change=True)

    def force(self, displacement: Floats, before: Floats, time: float) -> Floats:
        """F(t) - R(a) [N], from that of a step before."""
        force = self._loads.force(displacement, time) - self.body.internal_force(displacement)
        if self._viscosity is not None:
            force -= self._viscosity.force(displacement, before)
        return force


def row_sums_of_mass(body: ElasticBody, problem: Problem) -> Floats:
    """Integral of rho N_a: a quarter of each cell's mass to its corners [kg], flat."""
    transferred = body.space.transferred
    mesh = transferred.mesh
    rho = by_cell(transferred, problem.material, problem.inclusions, lambda m: m.density)
    one = ufl.as_vector([1.0, 1.0, 1.0])
    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": 1})
    return fenicsx.assemble_vector(fenicsx.form(rho * ufl.inner(one, body.v) * dx))
