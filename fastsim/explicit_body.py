"""A body in explicit motion: the compiled run with its loads, supports and diagnosis."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.fastsim.amplitudes import Histories
from palpate.fastsim.body import Body
from palpate.fastsim.contact.body_contact import BodyContact
from palpate.fastsim.contact.explicit_tools import ExplicitTools
from palpate.fastsim.errors import BlowUpError
from palpate.fastsim.forces import constraints, external_force
from palpate.fastsim.instruction_sets import chosen_instruction_set
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Pressure, Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain

# A displacement of more than this many sizes of the body is a blow-up, whatever its energy.
_BOUND_IN_SIZES = 1e3
_REASONS = {
    _core.StopReason.inverted_cell: "a cell inverted",
    _core.StopReason.out_of_bounds: "a displacement left all bounds",
    _core.StopReason.energy_growth: "energy grew from nothing",
    _core.StopReason.deep_in_tool: "a vertex moved so fast or deep that it may pass through a tool",
}


class Precision(StrEnum):
    """Arithmetic of the explicit step."""

    SINGLE = "float32"
    DOUBLE = "float64"


class ExplicitBody:
    """One run: the core's state, and what is needed to start and to judge it.

    Args:
        problem: Mesh, material, supports and loads.
        strain: Strain measure.
        time_step: [s].
        mass_damping: lambda in D = lambda M [1/s].
        histories: Amplitudes of the loads and supports.
        mass: Lumped [kg], shape (num_points,); None is the material's.
        precision: Of the step.
        num_threads: At least 1.
        tracks_energy: Whether `advance` returns energies.
        tools: Rigid tools; None is none.
        body_contact: Of bodies with each other and themselves; None is none.

    Attributes:
        displacement: At the last good step [m], shape (num_points, 3).
        steps: Good steps done.
    """

    def __init__(
        self,
        problem: Problem,
        *,
        strain: Strain,
        time_step: float,
        mass_damping: float,
        histories: Histories,
        mass: Points | None = None,
        precision: Precision = Precision.DOUBLE,
        num_threads: int = 1,
        tracks_energy: bool = False,
        tools: ExplicitTools | None = None,
        body_contact: BodyContact | None = None,
    ) -> None:
        mesh = problem.mesh
        self.problem = problem
        self.dt = time_step
        self.steps = 0
        self.tracks_energy = tracks_energy
        self.displacement = np.zeros_like(mesh.points)
        self._increment = np.zeros_like(mesh.points)
        self.elastic = Body.of(problem, strain)
        self._damping = mass_damping
        self._mass = (self.elastic.lumped_mass if mass is None else mass)[:, None]
        self._histories = histories
        self._is_free, self._held, self._held_histories = _moving_constraints(problem, histories)
        kind = _core.ExplicitRun32 if precision is Precision.SINGLE else _core.ExplicitRun64
        self._run = kind.make(
            mesh.points,
            mesh.cells,
            np.ascontiguousarray(self._mass[:, 0]),
            self._is_free,
            self.elastic.lmbda,
            self.elastic.mu,
            self.elastic.measure,
            time_step,
            mass_damping,
            _BOUND_IN_SIZES * float(np.ptp(mesh.points, axis=0).max()),
            num_threads,
            chosen_instruction_set(),
            tracks_energy,
        )
        self._give_loads()
        self._run.set_moving_supports(self._held, self._held_histories)
        self._tools = tools
        self._contact_force = np.zeros_like(mesh.points)
        if tools is not None:
            tools.attach(self._run, time_step, is_timed=mass is None)
        self._touches_bodies = body_contact is not None
        if body_contact is not None:
            body_contact.attach(self._run)

    @property
    def instruction_set(self) -> str:
        """What the step runs on."""
        return self._run.instruction_set

    def start(self, displacement: Points, velocity: Points) -> None:
        """Set the initial state; a(-dt) = a - dt v + dt^2 / 2 a'' (eq. 13).

        Held components are where their supports are at once.
        """
        free = self._is_free.astype(bool)
        self.displacement = np.where(free, displacement, self._held_at(0.0))
        self._contact_force[:] = 0.0
        if self._tools is not None:
            self._tools.start(self.displacement)
        speed = np.where(free, velocity, 0.0)
        acceleration = self.force() / self._mass - self._damping * speed
        self._increment = self.dt * speed - 0.5 * self.dt**2 * acceleration
        self._increment[~free] = 0.0
        energy = self.elastic.strain_energy(self.displacement)
        energy += 0.5 * float(np.sum(self._mass * speed**2))
        self._run.set_state(self.displacement, self._increment, energy)
        self.steps = 0

    def advance(
        self, num_steps: int, every: int, *, is_output: bool = True
    ) -> tuple[Points, Points]:
        """Do steps without stopping; return the states at every n-th of them.

        Args:
            num_steps: A multiple of `every`.
            every: Steps between two records, >= 1.
            is_output: Whether the tools' tracks are wanted at the records.

        Returns:
            Displacements [m], shape (num_records, num_points, 3); and kinetic energy, external
            work and damping loss [J] there, shape (num_records + 1, 3), the first row for the
            state at the start (all zero if not tracked).

        Raises:
            BlowUpError: With the last good state.
        """
        count = num_steps // every
        states = np.empty((count, *self.displacement.shape))
        energies = np.zeros((count + 1, 3))
        times = self.dt * (self.steps + np.arange(num_steps + 2))
        factors, tools = self._histories.at(times), self._tools
        poses = np.zeros((len(times), 0)) if tools is None else tools.rows(times)
        reactions = np.zeros((0, 0)) if tools is None else tools.begin_reactions(count)
        done, reason, point = self._run.advance(factors, every, states, energies, poses, reactions)
        self.steps += done
        self._run.get_state(self.displacement, self._increment)
        if tools is not None or self._touches_bodies:
            self._run.get_contact_force(self._contact_force)
        if tools is not None:
            tools.collect(reactions, is_output=is_output)
        # The step looks at the state it starts from: the last one has not been looked at.
        looks = reason is _core.StopReason.none and self.elastic.strain is Strain.GREEN
        if looks and self.elastic.smallest_det_f(self.displacement)[0] <= 0.0:
            self.displacement -= self._increment
            self.steps -= 1
            reason = _core.StopReason.inverted_cell
        if reason is not _core.StopReason.none:
            raise self._diagnose(reason, point)
        return states, energies

    def body_touches(self) -> tuple[int, float]:
        """Vertices inside cells at the last step, and the deepest [m]."""
        return self._run.body_touches()

    def velocity(self) -> Points:
        """Central velocity at the present time [m/s]: the mean of the two increments."""
        half = 0.5 * self._damping * self.dt
        ahead = ((1.0 - half) * self._increment + self.dt**2 * self.force() / self._mass) / (
            1.0 + half
        )
        time = self.steps * self.dt
        ahead = np.where(
            self._is_free != 0, ahead, self._held_at(time + self.dt) - self._held_at(time)
        )
        speed: Points = (self._increment + ahead) / (2.0 * self.dt)
        return speed

    def load(self) -> Points:
        """All loads F(t) at the present state, pressure and tools included [N], (num_points, 3)."""
        factors = self._histories.at([self.steps * self.dt])[0]
        load: Points = np.tensordot(factors, self._dead, axes=1) + self._contact_force
        for pressure, history in self._pressures:
            pushed = Problem(self.problem.mesh, self.problem.material, (), (pressure,))
            load += factors[history] * external_force(pushed, self.displacement)
        return load

    def force(self) -> Points:
        """Loads minus internal force, F(t) - R(a), at the present state [N]."""
        force: Points = self.load() - self.elastic.internal_force(self.displacement)
        return force

    def set_mass_damping(self, mass_damping: float) -> None:
        """Change D = mass_damping M from here on [1/s]."""
        self._damping = mass_damping
        self._run.set_mass_damping(mass_damping)

    def _held_at(self, time: float) -> Points:
        factors = self._histories.at([time])[0]
        held: Points = factors[np.maximum(self._held_histories, 0)] * self._held
        return held

    def _give_loads(self) -> None:
        # Pressure follows the body only where the strain measure knows finite rotations.
        follows = self.elastic.strain is Strain.GREEN
        problem, histories = self.problem, self._histories
        external_force(problem)  # names a load that is not finite by its number
        self._dead = np.zeros((len(histories), *problem.mesh.points.shape))
        self._pressures: list[tuple[Pressure, int]] = []
        for load, history in zip(problem.loads, histories.of_load, strict=True):
            if follows and isinstance(load, Pressure):
                self._pressures.append((load, history))
            else:
                alone = Problem(problem.mesh, problem.material, (), (load,))
                self._dead[history] += external_force(alone)
        self._run.set_dead_loads(self._dead)
        if self._pressures:
            counts = [len(p.facets) for p, _ in self._pressures]
            self._run.set_pressure(
                np.concatenate([p.facets for p, _ in self._pressures]).astype(np.int32),
                np.repeat([float(p.pressure) for p, _ in self._pressures], counts),
                np.repeat([h for _, h in self._pressures], counts).astype(np.int32),
            )

    def _diagnose(self, reason: _core.StopReason, point: int) -> BlowUpError:
        mesh = self.problem.mesh
        smallest, cell = self.elastic.smallest_det_f(self.displacement)
        if reason is _core.StopReason.inverted_cell:
            # The bad state is one increment ahead of the last good one.
            cell = self.elastic.smallest_det_f(self.displacement + self._increment)[1]
        elif point >= 0:
            cell = int(np.flatnonzero((mesh.cells == point).any(axis=1))[0])
        critical = self.elastic.critical_time_step(
            displacement=self.displacement, mass=self._mass[:, 0]
        )
        return BlowUpError(
            _REASONS[reason],
            step=self.steps,
            time=self.steps * self.dt,
            cell=cell,
            place=tuple(float(x) for x in mesh.points[mesh.cells[cell]].mean(axis=0)),
            smallest_det_f=smallest,
            displacement=self.displacement,
            time_step=self.dt,
            critical_time_step=critical,
        )


def _moving_constraints(
    problem: Problem, histories: Histories
) -> tuple[NDArray[np.uint8], Points, NDArray[np.int32]]:
    """Free components, held values, and the history of each held component (-1 if free).

    A component held by two supports needs the same value and the same amplitude.
    """
    is_free, held = constraints(problem)
    of = np.full(held.shape, -1, dtype=np.int32)
    for support, history in zip(problem.supports, histories.of_support, strict=True):
        _mark(support, history, held, of)
    return is_free, held, of


def _mark(support: Support, history: int, held: Points, of: NDArray[np.int32]) -> None:
    points = np.union1d(support.points, support.facets)
    for axis in range(3):
        if not support.components[axis]:
            continue
        clash = points[(of[points, axis] >= 0) & (of[points, axis] != history)]
        clash = clash[held[clash, axis] != 0.0]
        if clash.size:
            raise InputError(
                f"point {int(clash[0])} is held along {'xyz'[axis]} by two supports with "
                "different amplitudes; separate the supports"
            )
        of[points, axis] = history
