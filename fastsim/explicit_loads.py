"""What drives a body in explicit motion: loads, springs, moving supports, a caller's forces."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.fastsim.amplitudes import Amplitudes, Histories
from palpate.fastsim.explicit_run import ExplicitRun
from palpate.fastsim.explicit_springs import ExplicitSprings
from palpate.fastsim.forces import external_force
from palpate.fastsim.moving_supports import MovingSupports
from palpate.fastsim.supports import HeldPoints
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.boundary_conditions import Load, Pressure
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain


class ExplicitLoads:
    """Loads, springs and supports of a run, sorted by their histories in time.

    Args:
        problem: Loads, springs and supports.
        strain: Pressure follows the body only where this knows finite rotations.
        loads: Amplitudes of the loads; see `Histories`.
        supports: Amplitudes of the supports.

    Attributes:
        is_free: 1 where free, 0 where held along x, y or z, shape (num_points, 3). Points that
            slide along slanted walls are free here: the core holds them along the normals.
        springs: Those that pull now.

    Raises:
        InputError: A load that is not finite, or a component held in two ways.
    """

    def __init__(
        self, problem: Problem, strain: Strain, loads: Amplitudes, supports: Amplitudes
    ) -> None:
        self._problem = problem
        self._histories = histories = Histories(problem, loads, supports)
        self._supports = HeldPoints(problem)
        self._moving = MovingSupports(problem, self._supports, histories)
        self.is_free = self._moving.is_free
        external_force(problem)  # names a load that is not finite by its number
        self._dead = np.zeros((len(histories), *problem.mesh.points.shape))
        self._applied = np.zeros_like(problem.mesh.points)
        self.springs = ExplicitSprings(problem.mesh.points, problem.springs)
        self._pressures: list[tuple[Pressure, int]] = []
        for load, history in zip(problem.loads, histories.of_load, strict=True):
            if strain is Strain.GREEN and isinstance(load, Pressure):
                self._pressures.append((load, history))
            else:
                self._dead[history] += external_force(self._alone(load))

    def attach(self, run: ExplicitRun) -> None:
        """Give all of them to a run."""
        for history, forces in enumerate(self._dead):
            run.set_dead_load(history, forces)
        if self._pressures:
            counts = [len(p.facets) for p, _ in self._pressures]
            run.set_pressure(
                self._problem.mesh.points,
                np.concatenate([p.facets for p, _ in self._pressures]).astype(np.int32),
                np.repeat([float(p.pressure) for p, _ in self._pressures], counts),
                np.repeat([h for _, h in self._pressures], counts).astype(np.int32),
            )
        if len(self.springs):
            self.springs.attach(run, len(self._histories))
        run.set_moving_supports(*self._moving.terms())
        if self._moving.slides is not None:
            run.set_sliding_supports(*self._moving.slides)

    def apply(self, run: ExplicitRun, force: ArrayLike, points: ArrayLike | None) -> None:
        """Push with other forces besides, in the place of those applied before."""
        total = np.zeros_like(self._applied)
        rows = np.arange(len(total)) if points is None else np.asarray(points, dtype=np.int64)
        pushed = np.asarray(force, dtype=np.float64)
        if pushed.shape != (len(rows), 3) or not np.isfinite(pushed).all():
            raise InputError(
                f"a force needs finite numbers of shape ({len(rows)}, 3), got {pushed.shape}"
            )
        if rows.size and not 0 <= rows.min() <= rows.max() < len(total):
            raise InputError(f"a point of the force is not one of the {len(total)} of the mesh")
        np.add.at(total, rows, pushed)
        self._applied = total
        run.set_dead_load(0, self._dead[0] + total)

    def factors(self, times: Floats) -> Floats:
        """Of the histories [-], shape (num_times, num_histories); behind them the springs'."""
        factors = self._histories.at(times)
        if not len(self.springs):
            return factors
        return np.hstack([factors, self.springs.rows(times)])

    def change_springs(self, run: ExplicitRun, springs: ExplicitSprings) -> None:
        """Have others pull from now on."""
        self.springs = springs
        springs.attach(run, len(self._histories))

    def at(self, time: float, displacement: Points) -> Points:
        """All of them but contact, at a time and place [N], shape (num_points, 3)."""
        factors = self._histories.at([time])[0]
        load: Points = np.tensordot(factors, self._dead, axes=1) + self._applied
        for pressure, history in self._pressures:
            load += factors[history] * external_force(self._alone(pressure), displacement)
        if len(self.springs):
            load += self.springs.force(displacement, time)
        return load

    def placed(self, displacement: Points, time: float) -> Points:
        """A displacement with its held components where they are at that time [m]."""
        held = self._held_at(time)
        local = self._supports.to_local(displacement)
        return self._supports.to_global(np.where(self._supports.is_free != 0, local, held))

    def moved(self, increment: Points, time: float, next_time: float) -> Points:
        """An increment from one time to the next, its held components those of the supports."""
        held = self._held_at(next_time) - self._held_at(time)
        local = self._supports.to_local(increment)
        return self._supports.to_global(np.where(self._supports.is_free != 0, local, held))

    def keep_free(self, vectors: Points) -> Points:
        """Vectors without their held components."""
        return self._supports.keep_free(vectors)

    def _held_at(self, time: float) -> Points:
        factors = self._histories.at([time])[0]
        return self._supports.at(factors[list(self._histories.of_support)])

    def _alone(self, load: Load) -> Problem:
        return Problem(self._problem.mesh, self._problem.material, (), (load,))
