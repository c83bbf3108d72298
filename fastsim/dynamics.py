"""Dynamics by central differences with a lumped mass: eq. 11-13 of the paper."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.errors import BlowUpError, UnstableStepError
from palpate.fastsim.forces import (
    STRAIN_MEASURE,
    checked_displacement,
    constraints,
    external_force,
    lame_parameters,
    lumped_mass,
)
from palpate.fastsim.time_steps import critical_time_step, sharp_critical_time_step
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain, TimeSpan

__all__ = [
    "DynamicResult",
    "Energies",
    "Precision",
    "critical_time_step",
    "simulate",
]

# Share of the critical step used when none is chosen: Green strain stiffens under stretch.
SAFETY = 0.8


class Precision(StrEnum):
    """Arithmetic of the explicit step."""

    SINGLE = "float32"
    DOUBLE = "float64"


@dataclass(frozen=True, eq=False)
class Energies:
    """Energies at the output times [J], each of shape (num_outputs + 1,).

    Their balance strain + kinetic + damping_loss - external_work stays at its first value up to
    the error of the time steps. Strain energy is integrated from psi(F), not from work.
    """

    strain: Points
    kinetic: Points
    external_work: Points
    damping_loss: Points

    @property
    def balance(self) -> Points:
        """What should not change [J], shape (num_outputs + 1,)."""
        return self.strain + self.kinetic + self.damping_loss - self.external_work


@dataclass(frozen=True, eq=False)
class DynamicResult:
    """A trajectory.

    Attributes:
        times: [s], shape (num_outputs + 1,), from 0.
        displacements: [m], shape (num_outputs + 1, num_points, 3).
        velocity: At the last time [m/s], shape (num_points, 3).
        time_step: [s].
        critical_time_step: [s].
        num_steps: Steps done.
        energies: If asked for.
        instruction_set: What the step ran on.
    """

    times: Points
    displacements: Points
    velocity: Points
    time_step: float
    critical_time_step: float
    num_steps: int
    energies: Energies | None = None
    instruction_set: str = ""


def simulate(
    problem: Problem,
    *,
    strain: Strain = Strain.GREEN,
    displacement: Points | None = None,
    velocity: Points | None = None,
    amplitude: Callable[[float], float] | None = None,
    precision: Precision = Precision.DOUBLE,
    num_threads: int = 1,
    tracks_energy: bool = False,
    progress: Callable[[str], None] | None = None,
) -> DynamicResult:
    """Run the explicit scheme over the problem's time span.

    M a'' + D a' + R(a) = s(t) F with lumped M and D = mass_damping M, by eq. 12 (corrected: see
    core/mechanics/central_difference.hpp) from the start-up value of eq. 13.

    Args:
        problem: With `time` set; its `time_step` None takes 0.8 of the critical one.
        strain: Engineering or Green strain.
        displacement: Initial [m], shape (num_points, 3); None is rest. Held components jump to
            their prescribed value at once.
        velocity: Initial [m/s], shape (num_points, 3); None is zero.
        amplitude: Factor s(t) [-] on all loads; None is 1 from the start.
        precision: Of the step; loads, states and energies are float64 all the same.
        num_threads: At least 1. A run repeats bit for bit for a given number.
        tracks_energy: Sum up work and losses at every step (slower).
        progress: Called with one line per stored state.

    Returns:
        The trajectory; every number in it is finite.

    Raises:
        InputError: No time span, or arrays of the wrong shape.
        UnstableStepError: The chosen step is above the critical one.
        BlowUpError: A cell inverted (Green strain), a number left its bounds, or energy grew
            from nothing; carries the last good state.
    """
    span, mesh = problem.time, problem.mesh
    if span is None:
        raise InputError("a dynamic run needs a time span; add [time] to the case")
    if num_threads < 1:
        raise InputError(f"num_threads = {num_threads}: needs at least 1")
    critical = _critical(problem, span, strain)
    wanted = span.time_step if span.time_step is not None else SAFETY * critical
    per_output = max(1, int(np.ceil(span.end_time / span.num_outputs / wanted * (1 - 1e-12))))
    body = _Body(
        problem,
        strain,
        span.end_time / (span.num_outputs * per_output),
        precision,
        num_threads,
        tracks_energy,
        amplitude,
    )
    zero = np.zeros_like(mesh.points)
    body.start(
        checked_displacement(mesh, zero if displacement is None else displacement),
        checked_displacement(mesh, zero if velocity is None else velocity),
    )
    states, times = [body.displacement.copy()], [0.0]
    energies = [body.energies()] if tracks_energy else []
    for output in range(1, span.num_outputs + 1):
        body.advance(per_output)
        states.append(body.displacement.copy())
        times.append(output * span.end_time / span.num_outputs)
        if tracks_energy:
            energies.append(body.energies())
        if progress:
            progress(f"t = {times[-1]:.4g} s of {span.end_time:.4g} s")
    return DynamicResult(
        times=np.array(times),
        displacements=np.array(states),
        velocity=body.velocity(),
        time_step=body.dt,
        critical_time_step=critical,
        num_steps=body.steps,
        energies=Energies(*np.array(energies).T) if energies else None,
        instruction_set=body.instruction_set,
    )


def _critical(problem: Problem, span: TimeSpan, strain: Strain) -> float:
    """Critical step about rest, sharp: the cells' bound is often only half of it."""
    critical = sharp_critical_time_step(problem.mesh, problem.material, strain=strain)
    if span.time_step is not None and span.time_step > critical:
        raise UnstableStepError(span.time_step, critical)
    return critical


class _Body:
    """One run: the core's state and what is needed to judge it."""

    def __init__(
        self,
        problem: Problem,
        strain: Strain,
        dt: float,
        precision: Precision,
        num_threads: int,
        tracks_energy: bool,
        amplitude: Callable[[float], float] | None,
    ) -> None:
        assert problem.time is not None
        mesh = problem.mesh
        self.dt = dt
        self.steps = 0
        self._first_halves = 0.0, 0.0
        self._amplitude = amplitude
        self._measure = STRAIN_MEASURE[strain]
        self._lame = lame_parameters(problem.material)
        self._damping = problem.time.mass_damping
        self._mass = lumped_mass(mesh, problem.material.density)[:, None]
        self._solid = _core.Solid.make(mesh.points, mesh.cells)
        self._num_cells = mesh.num_cells
        self._is_free, self._held = constraints(problem)
        kind = _core.ExplicitRun32 if precision is Precision.SINGLE else _core.ExplicitRun64
        self._run = kind.make(
            mesh.points,
            mesh.cells,
            np.ascontiguousarray(self._mass[:, 0]),
            self._is_free,
            *self._lame,
            self._measure,
            dt,
            self._damping,
            1e3 * float(np.ptp(mesh.points, axis=0).max()),
            num_threads,
            _core.widest_instruction_set(),
            tracks_energy,
        )
        # Pressure follows the body only where the strain measure knows finite rotations.
        follows = strain is Strain.GREEN
        pressures = [load for load in problem.loads if follows and isinstance(load, Pressure)]
        if pressures and tracks_energy:
            raise InputError("the work of a follower pressure is not tracked; use a traction")
        dead = tuple(load for load in problem.loads if load not in pressures)
        self._load = external_force(Problem(mesh, problem.material, problem.supports, dead))
        self._run.set_external_force(self._load)
        self._pressed: Problem | None = None
        if pressures:
            self._run.set_pressure(
                np.ascontiguousarray(np.concatenate([p.facets for p in pressures]), dtype=np.int32),
                np.concatenate([np.full(len(p.facets), float(p.pressure)) for p in pressures]),
            )
            self._pressed = Problem(mesh, problem.material, problem.supports, tuple(pressures))
        self.instruction_set: str = self._run.instruction_set

    def start(self, displacement: Points, velocity: Points) -> None:
        """Set the initial state; a(-dt) = a - dt v + dt^2 / 2 a'' (eq. 13)."""
        free = self._is_free.astype(bool)
        self.displacement = np.where(free, displacement, self._held)
        speed = np.where(free, velocity, 0.0)
        acceleration = self._force() / self._mass - self._damping * speed
        self._increment = self.dt * speed - 0.5 * self.dt**2 * acceleration
        self._increment[~free] = 0.0
        self._run.set_state(self.displacement, self._increment)
        self._energy_given = abs(float(np.sum(self._load * self.displacement)))
        strain = self._solid.strain_energy(self.displacement, *self._lame, self._measure)
        increments = self._increment / self.dt
        self._energy_at_start = strain + 0.5 * float(np.sum(self._mass * increments**2))

    def advance(self, num_steps: int) -> None:
        """Do the steps up to the next output."""
        times = self.dt * (self.steps + np.arange(num_steps))
        factors = (
            np.array([self._factor(t) for t in times]) if self._amplitude else np.ones(num_steps)
        )
        before = self.displacement.copy()
        done, reason = self._run.advance(factors)
        self._run.get_state(self.displacement, self._increment)
        self.steps += done
        if reason is _core.StopReason.none:
            if not self._grew_from_nothing():
                return
            self.displacement = before
            message = "energy grew from nothing"
        elif reason is _core.StopReason.inverted_cell:
            message = "a cell inverted"
        else:
            message = "a displacement left all bounds"
        if not np.isfinite(self.displacement).all():
            self.displacement = before
        values = np.empty(self._num_cells)
        self._solid.det_f(self.displacement, values)
        cell = int(np.argmin(values))
        raise BlowUpError(
            message,
            step=self.steps,
            time=self.steps * self.dt,
            cell=cell,
            smallest_det_f=float(values[cell]),
            displacement=self.displacement,
        )

    def velocity(self) -> Points:
        """Central velocity at the present time [m/s]: the mean of the two increments."""
        half = 0.5 * self._damping * self.dt
        ahead = ((1.0 - half) * self._increment + self.dt**2 * self._force() / self._mass) / (
            1.0 + half
        )
        ahead[self._is_free == 0] = 0.0
        speed: Points = (self._increment + ahead) / (2.0 * self.dt)
        return speed

    def energies(self) -> tuple[float, float, float, float]:
        """Strain, kinetic, external work, damping loss [J]."""
        strain = self._solid.strain_energy(self.displacement, *self._lame, self._measure)
        squared_speed = float(np.sum(self._mass * self.velocity() ** 2))
        # The core's sums hold a full term for each step begun; the trapezoidal rule wants half
        # of the first and half of the present one.
        factor = self._factor(self.steps * self.dt)
        half_work = 0.5 * factor * float(np.sum(self._load * self._increment))
        half_loss = 0.5 * self.dt * self._damping * squared_speed
        if self.steps == 0:
            self._first_halves = half_work, half_loss
        work = self._run.external_work + half_work - self._first_halves[0]
        loss = self._run.damping_loss + half_loss - self._first_halves[1]
        return strain, 0.5 * squared_speed, work, loss

    def _grew_from_nothing(self) -> bool:
        """Is there far more energy than a constant dead load and the start can have given?

        At 0.8 of the critical step the scheme's own energy error can reach a factor of three.
        """
        if self._amplitude is not None or self._pressed is not None:
            return False
        strain = self._solid.strain_energy(self.displacement, *self._lame, self._measure)
        energy = strain + 0.5 * float(np.sum(self._mass * (self._increment / self.dt) ** 2))
        given = abs(float(np.sum(self._load * self.displacement)))
        self._energy_given = max(self._energy_given, given)
        return bool(not energy <= 10.0 * (self._energy_given + self._energy_at_start))

    def _factor(self, time: float) -> float:
        value = 1.0 if self._amplitude is None else float(self._amplitude(time))
        if not np.isfinite(value):
            raise InputError(f"the amplitude at t = {time:g} s is {value}; it must be finite")
        return value

    def _force(self) -> Points:
        """Load minus internal force, s F - R(a), at the present state [N]."""
        internal = np.zeros_like(self.displacement)
        self._solid.internal_force(self.displacement, *self._lame, self._measure, internal)
        load = self._load
        if self._pressed is not None:
            load = load + external_force(self._pressed, self.displacement)
        force: Points = self._factor(self.steps * self.dt) * load - internal
        return force
