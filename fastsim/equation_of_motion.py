"""The equation of motion of a run, eq. 11-13, on whole arrays: where a run begins and is read.

The core makes the steps themselves (eq. 12). Here is what a run is started from, and what is read
between two of its steps: forces and velocities.
"""

from __future__ import annotations

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.fastsim.explicit_loads import ExplicitLoads
from palpate.fastsim.viscosity import viscous_force
from palpate.meshes.arrays import Floats, Points


class EquationOfMotion:
    """Of one run.

    Args:
        elastic: The body at rest.
        mass: Lumped [kg], shape (num_points,).
        loads: What drives it.
        scheme: Time step and mass damping.
        stiffness_damping: beta [s], >= 0; see `viscosity`.

    Attributes:
        scheme: As given; may be replaced by one of the same time step.
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
            displacement: [m], shape (num_points, 3), its held components in place.
            velocity: [m/s], likewise; zero where held.

        Returns:
            a(0) - a(-dt) [m], zero where held, and the energy that the state holds [J].
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
            displacement: a [m], likewise.
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
            force: Now [N], likewise.
            time: Now [s].
        """
        dt = self.scheme.time_step
        ahead = self.scheme.next_increments(increment, self._mass, force)
        ahead = self._loads.moved(ahead, time, time + dt)
        speed: Points = (increment + ahead) / (2.0 * dt)
        return speed
