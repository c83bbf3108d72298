"""What drives a body in explicit motion: loads, supports that move, forces of the caller's own."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.fastsim import _core
from palpate.fastsim.amplitudes import Amplitudes, Histories
from palpate.fastsim.forces import constraints, external_force
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.boundary_conditions import Load, Pressure, Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain


class ExplicitLoads:
    """Loads and supports of a run, sorted by their histories in time.

    Args:
        problem: Loads and supports.
        strain: Pressure follows the body only where this knows finite rotations.
        loads: Amplitudes of the loads; see `Histories`.
        supports: Amplitudes of the supports.

    Attributes:
        is_free: 1 where free, 0 where held, shape (num_points, 3).

    Raises:
        InputError: A load that is not finite, or a component held in two ways.
    """

    def __init__(
        self, problem: Problem, strain: Strain, loads: Amplitudes, supports: Amplitudes
    ) -> None:
        self._problem = problem
        self._histories = histories = Histories(problem, loads, supports)
        self.is_free, self._held, self._held_histories = _moving_constraints(problem, histories)
        external_force(problem)  # names a load that is not finite by its number
        self._dead = np.zeros((len(histories), *problem.mesh.points.shape))
        self._applied = np.zeros_like(problem.mesh.points)
        self._pressures: list[tuple[Pressure, int]] = []
        for load, history in zip(problem.loads, histories.of_load, strict=True):
            if strain is Strain.GREEN and isinstance(load, Pressure):
                self._pressures.append((load, history))
            else:
                self._dead[history] += external_force(self._alone(load))

    def attach(self, run: _core.ExplicitRun) -> None:
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
        # What is held at zero never moves, whatever its factor: nothing to step.
        moves = np.where(self._held != 0.0, self._held_histories, -1).astype(np.int32)
        run.set_moving_supports(self._held, moves)

    def apply(self, run: _core.ExplicitRun, force: ArrayLike, points: ArrayLike | None) -> None:
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
        """Of the histories [-], shape (num_times, num_histories)."""
        return self._histories.at(times)

    def at(self, time: float, displacement: Points) -> Points:
        """All of them but contact, at a time and place [N], shape (num_points, 3)."""
        factors = self._histories.at([time])[0]
        load: Points = np.tensordot(factors, self._dead, axes=1) + self._applied
        for pressure, history in self._pressures:
            load += factors[history] * external_force(self._alone(pressure), displacement)
        return load

    def held_at(self, time: float) -> Points:
        """Where the held components are [m], 0 for the free ones, shape (num_points, 3)."""
        factors = self._histories.at([time])[0]
        held: Points = factors[np.maximum(self._held_histories, 0)] * self._held
        return held

    def _alone(self, load: Load) -> Problem:
        return Problem(self._problem.mesh, self._problem.material, (), (load,))


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
    points = support.points
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
