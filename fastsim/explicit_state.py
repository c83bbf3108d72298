"""State and equation of motion (eq. 11-13) of a body in explicit motion, around its steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.fastsim.contact.explicit_tools import TOOL_STEP
from palpate.fastsim.errors import BlowUpError
from palpate.fastsim.explicit_loads import ExplicitLoads
from palpate.fastsim.explicit_run import ExplicitRun
from palpate.fastsim.explicit_time_step import viscous_force
from palpate.meshes.arrays import Floats, Points


class ExplicitState:
    """The present state of a run, read from it when it is needed.

    Args:
        elastic: The body at rest.
        mass: Lumped [kg], shape (num_points,).
        run: What makes the steps.
        time_step: [s].

    Attributes:
        steps: Number of accepted time steps since the start.
        tool_steps: Where the tools' paths were at the last look, shape (num_tools,) of `TOOL_STEP`.
        read_only: The displacement as last read [m], a view that cannot be written to.
    """

    def __init__(self, elastic: Body, mass: Floats, run: ExplicitRun, time_step: float) -> None:
        self._elastic = elastic
        self._mass = mass
        self._run = run
        self._time_step = time_step
        self._displacement = np.zeros_like(elastic.mesh.points)
        self._increment = np.zeros_like(elastic.mesh.points)
        self.read_only = self._displacement.view()
        self.read_only.flags.writeable = False
        self.tool_steps: NDArray[np.void] = np.zeros(0, dtype=TOOL_STEP)
        self.steps = 0
        self._is_read, self._is_looked_at = True, False

    @property
    def is_looked_at(self) -> bool:
        """Whether the run has found all forces at this state."""
        return self._is_looked_at

    def start(self, displacement: Points, increment: Points, energy: float) -> None:
        """Start the run from a displacement [m], the increment before it [m] and its energy [J]."""
        self.steps = 0
        self._displacement[:], self._increment[:] = displacement, increment
        self._run.set_state(self._displacement, self._increment, energy)
        self._is_read, self._is_looked_at = True, False

    def read(self) -> tuple[Points, Points]:
        """Displacement and the increment that led to it [m], always the same two arrays."""
        if not self._is_read:
            self._run.get_state(self._displacement, self._increment)
            self._is_read = True
        return self._displacement, self._increment

    def disturb(self) -> None:
        """Note that the forces have changed, so that they are found anew."""
        self._is_looked_at = False

    def look(self, factors: Points, tools: Points) -> None:
        """Find all forces, for these factors of the histories and steps of the tools.

        Raises:
            BlowUpError: The last step inverted a cell.
        """
        outcome = self._run.look(factors, tools)
        self._is_looked_at = True
        self._settle(*outcome)
        self.tool_steps = tools[0].view(TOOL_STEP)

    def moved(self, steps_done: int, reason: _core.StopReason, point: int) -> None:
        """Record steps that the run has made.

        Raises:
            BlowUpError: They ended early, for `reason`; carries the last good state.
        """
        self._is_read = self._is_looked_at = False
        self._settle(steps_done, reason, point)

    def _settle(self, steps_done: int, reason: _core.StopReason, point: int) -> None:
        """Count the steps of a call of the core; raise if something ended them early."""
        self.steps += steps_done
        if reason is not _core.StopReason.none:
            self._is_read = False
            displacement, increment = self.read()
            raise diagnose(
                self._elastic,
                reason,
                point,
                displacement=displacement.copy(),
                increment=increment,
                mass=self._mass,
                steps=self.steps,
                time_step=self._time_step,
            )


_REASONS = {
    _core.StopReason.inverted_cell: "a cell inverted",
    _core.StopReason.out_of_bounds: "a displacement left all bounds",
    _core.StopReason.energy_growth: "energy grew from nothing",
    _core.StopReason.deep_in_tool: "a vertex moved so fast or deep that it may pass through a tool",
}


def diagnose(
    body: Body,
    reason: _core.StopReason,
    point: int,
    *,
    displacement: Points,
    increment: Points,
    mass: Floats,
    steps: int,
    time_step: float,
) -> BlowUpError:
    """The error that states what happened, in which cell, and what to change.

    Args:
        body: The body at rest.
        reason: What the core found.
        point: The point that moved fastest, or -1.
        displacement: The last good state [m], shape (num_points, 3).
        increment: The increment to that state or, if a cell inverted, from it [m].
        mass: Lumped [kg], shape (num_points,).
        steps: Number of accepted time steps.
        time_step: [s].
    """
    mesh = body.mesh
    smallest, cell = body.smallest_det_f(displacement)
    if reason is _core.StopReason.inverted_cell:
        # The bad state is one increment ahead of the last good one.
        cell = body.smallest_det_f(displacement + increment)[1]
    elif point >= 0:
        cell = int(np.flatnonzero((mesh.cells == point).any(axis=1))[0])
    return BlowUpError(
        _REASONS[reason],
        step=steps,
        time=steps * time_step,
        cell=cell,
        place=tuple(float(x) for x in mesh.points[mesh.cells[cell]].mean(axis=0)),
        smallest_det_f=smallest,
        displacement=displacement,
        time_step=time_step,
        critical_time_step=body.critical_time_step(displacement=displacement, mass=mass),
    )


# Eq. 11-13 on whole arrays. The core makes the steps themselves (eq. 12); here are the start of a
# run, and forces and velocities between two of its steps.


class EquationOfMotion:
    """The equation of motion of a run: its start, and its forces and velocities.

    Args:
        elastic: The body at rest.
        mass: Lumped [kg], shape (num_points,).
        loads: What drives it.
        scheme: Time step and mass damping.
        stiffness_damping: beta [s], >= 0; see `viscosity`.

    Attributes:
        scheme: Time step and mass damping; may be replaced by one of the same time step.
    """

    def __init__(
        self,
        elastic: Body,
        mass: Floats,
        loads: ExplicitLoads,
        scheme: _core.CentralDifference,
        stiffness_damping: float,
    ) -> None:
        self._elastic = elastic
        self._mass = mass
        self._loads = loads
        self.scheme = scheme
        self._stiffness_damping = stiffness_damping

    def start(self, displacement: Points, velocity: Points) -> tuple[Points, float]:
        """The increment before time 0: a(-dt) = a - dt v + dt^2 / 2 a'' (eq. 13).

        Args:
            displacement: [m], shape (num_points, 3), its fixed components in place.
            velocity: [m/s], shape (num_points, 3); zero where fixed.

        Returns:
            a(0) - a(-dt) [m], zero where fixed, and the energy of the state [J].
        """
        dt, mass = self.scheme.time_step, self._mass[:, None]
        force = self.force(self._loads.at(0.0, displacement), displacement, dt * velocity)
        acceleration = force / mass - self.scheme.mass_damping * velocity
        increment = self._loads.keep_free(dt * velocity - 0.5 * dt**2 * acceleration)
        energy = self._elastic.strain_energy(displacement)
        energy += 0.5 * float(np.sum(mass * velocity**2))
        return increment, energy

    def force(self, load: Points, displacement: Points, increment: Points) -> Points:
        """Loads minus internal force, F - R(a) [N], shape (num_points, 3).

        Args:
            load: F [N], shape (num_points, 3).
            displacement: a [m], shape (num_points, 3).
            increment: That led to it [m]: the force of stiffness damping is in R(a).
        """
        force: Points = load - self._elastic.internal_force(displacement)
        if self._stiffness_damping:
            factor = self._stiffness_damping / self.scheme.time_step
            force -= viscous_force(self._elastic, displacement, increment, factor)
        return force

    def velocity(self, increment: Points, force: Points, time: float) -> Points:
        """Central velocity [m/s]: the mean of the increment behind and the one ahead.

        Args:
            increment: Behind [m], shape (num_points, 3).
            force: Now [N], shape (num_points, 3).
            time: Now [s].
        """
        dt = self.scheme.time_step
        ahead = self.scheme.next_increments(increment, self._mass, force)
        ahead = self._loads.moved(ahead, time, time + dt)
        speed: Points = (increment + ahead) / (2.0 * dt)
        return speed
