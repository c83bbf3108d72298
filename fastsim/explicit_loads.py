"""Loads, springs, moving supports and a caller's forces of a body in explicit motion."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.fastsim.amplitudes import Amplitudes, Histories
from palpate.fastsim.explicit_run import ExplicitRun
from palpate.fastsim.forces import external_force
from palpate.fastsim.springs import PatchSprings
from palpate.fastsim.supports import FixedPoints, SlantedPoints, turning
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.boundary_conditions import Load, Pressure
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.spring import Spring


class ExplicitLoads:
    """Loads, springs and supports of a run, sorted by their histories in time.

    For the amplitudes of loads and supports see `Histories`. Pressure follows the body only under
    finite strain.

    Attributes:
        is_free: 1 where free, 0 where fixed along x, y or z, shape (num_points, 3). Points that
            slide along slanted walls are free here: the core holds them along the normals.
        springs: Springs that act now.

    Raises:
        InputError: A load that is not finite, or a component fixed in two ways.
    """

    def __init__(
        self, problem: Problem, strain: Strain, loads: Amplitudes, supports: Amplitudes
    ) -> None:
        self._problem = problem
        self._histories = histories = Histories(problem, loads, supports)
        self._supports = FixedPoints(problem)
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

    @property
    def slides(self) -> bool:
        """Whether points slide along slanted walls."""
        return self._moving.slides is not None

    def attach(self, run: ExplicitRun) -> None:
        """Set all loads, springs and supports of a run."""
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
        """Replace the forces of the caller, which act besides the loads."""
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
        """Factors of the histories [-], (num_times, num_histories), then columns of the springs."""
        factors = self._histories.at(times)
        if not len(self.springs):
            return factors
        return np.hstack([factors, self.springs.rows(times)])

    def change_springs(self, run: ExplicitRun, springs: ExplicitSprings) -> None:
        """Replace the springs from now on."""
        self.springs = springs
        springs.attach(run, len(self._histories))

    def at(self, time: float, displacement: Points) -> Points:
        """All loads but contact, at a time and displacement [N], shape (num_points, 3)."""
        factors = self._histories.at([time])[0]
        load: Points = np.tensordot(factors, self._dead, axes=1) + self._applied
        for pressure, history in self._pressures:
            load += factors[history] * external_force(self._alone(pressure), displacement)
        if len(self.springs):
            load += self.springs.force(displacement, time)
        return load

    def placed(self, displacement: Points, time: float) -> Points:
        """A displacement with its fixed components where they are at that time [m]."""
        prescribed = self._prescribed_at(time)
        local = self._supports.to_local(displacement)
        return self._supports.to_global(np.where(self._supports.is_free != 0, local, prescribed))

    def moved(self, increment: Points, time: float, next_time: float) -> Points:
        """An increment from one time to the next, its fixed components those of the supports."""
        prescribed = self._prescribed_at(next_time) - self._prescribed_at(time)
        local = self._supports.to_local(increment)
        return self._supports.to_global(np.where(self._supports.is_free != 0, local, prescribed))

    def keep_free(self, vectors: Points) -> Points:
        """Vectors without their fixed components."""
        return self._supports.keep_free(vectors)

    def _prescribed_at(self, time: float) -> Points:
        factors = self._histories.at([time])[0]
        return self._supports.at(factors[list(self._histories.of_support)])

    def _alone(self, load: Load) -> Problem:
        return Problem(self._problem.mesh, self._problem.material, (), (load,))


class MovingSupports:
    """Prescribed displacements over time, as the core needs them: sums of factors times values.

    Attributes:
        is_free: 1 where free along x, y or z, shape (num_points, 3); points that slide are free.
        slides: Points that slide along one or two slanted walls, with their directions (n, 6),
            where they are fixed along these (n, 2) and the histories (n, 2), -1 for none; None
            where nothing slides.

    Raises:
        InputError: A component that two supports move in different ways.
    """

    def __init__(self, problem: Problem, supports: FixedPoints, histories: Histories) -> None:
        self._problem, self._supports, self._histories = problem, supports, histories
        full = supports.at(1.0)
        self._require_one_way(full)
        self.is_free = supports.is_free.copy()
        self._values = [np.zeros_like(full) for _ in range(3)]
        self._numbers = [np.full(full.shape, -1, dtype=np.int32) for _ in range(3)]
        for number, support in enumerate(problem.supports):
            mine = supports.fixed_by(number)
            points = np.flatnonzero(mine.any(axis=1))
            fields = [(np.broadcast_to(support.displacement, (len(points), 3)), 0)]
            if support.rotation is not None:
                across, inward = turning(support.rotation, problem.mesh.points[points])
                fields += [(across, 1), (inward, 2)]
            for field, term in fields:
                self._add(term, points, mine[points], field, self._history(number, term))
        self.slides: tuple[NDArray[np.int32], Floats, Floats, NDArray[np.int32]] | None = None
        if supports.slanted is not None:
            self._add_slanted(supports.slanted, full)

    def terms(self) -> tuple[Points, NDArray[np.int32]]:
        """Values and histories of each term, stacked; a single term if the others are empty."""
        count = 1 + max((k for k in (1, 2) if (self._numbers[k] >= 0).any()), default=0)
        return np.vstack(self._values[:count]), np.vstack(self._numbers[:count])

    def _history(self, support: int, term: int) -> int:
        if term == 0:
            return self._histories.of_support[support]
        turns = self._histories.of_turn[support]
        assert turns is not None
        return turns[term - 1]

    def _add(
        self, term: int, points: Indices, mine: NDArray[np.bool_], values: Points, history: int
    ) -> None:
        # What is fixed at zero never moves, whatever its factor: nothing to step.
        moves = mine & (values != 0.0)
        self._values[term][points] = np.where(moves, values, self._values[term][points])
        self._numbers[term][points] = np.where(moves, history, self._numbers[term][points])

    def _add_slanted(self, slanted: SlantedPoints, full: Points) -> None:
        """Points fixed along all directions move as others do; the rest slide."""
        history = np.array([self._history_of(slanted, k) for k in range(len(slanted.points))])
        whole = slanted.rank == 3
        points = slanted.points[whole]
        self.is_free[slanted.points] = ~whole[:, None]
        values = self._supports.to_global(full)[points]
        everywhere = np.ones(3, dtype=bool)
        for point, value, number in zip(points, values, history[whole], strict=True):
            self._add(0, np.array([point]), everywhere[None], value[None], int(number))
        rows = ~whole
        fixed = np.arange(2) < slanted.rank[rows, None]
        self.slides = (
            np.ascontiguousarray(slanted.points[rows]),
            np.ascontiguousarray(slanted.axes[rows, :2].reshape(-1, 6)),
            np.ascontiguousarray(np.where(fixed, full[slanted.points[rows], :2], 0.0)),
            np.where(fixed, history[rows, None], -1).astype(np.int32),
        )

    def _history_of(self, slanted: SlantedPoints, k: int) -> int:
        """The one history by which a slanted point's supports move it; 0 where none does."""
        supports = [int(s) for s in slanted.supports[k] if s >= 0]
        moving = {s for s in supports if self._problem.supports[s].is_moved}
        found = {self._histories.of_support[s] for s in moving}
        is_turned = any(self._problem.supports[s].rotation is not None for s in moving)
        if len(found) > 1 or is_turned:
            raise InputError(
                f"point {int(slanted.points[k])} is held along a slanted normal and by a support "
                "that turns or has another amplitude; separate the supports"
            )
        return found.pop() if found else 0

    def _require_one_way(self, full: Points) -> None:
        """Refuse a component that two supports move by different amplitudes or rotations."""
        by = np.full(full.shape, -1)
        supports = self._problem.supports
        keys = [
            (history, support.rotation)
            for history, support in zip(self._histories.of_support, supports, strict=True)
        ]
        kinds = [keys.index(key) for key in keys]
        for support, kind in zip(supports, kinds, strict=True):
            points = support.points
            for axis in np.flatnonzero(support.components) if support.normal is None else ():
                clash = points[(by[points, axis] >= 0) & (by[points, axis] != kind)]
                clash = clash[full[clash, axis] != 0.0]
                if clash.size:
                    raise InputError(
                        f"point {int(clash[0])} is held along {'xyz'[axis]} by two supports with "
                        "different amplitudes; separate the supports"
                    )
                by[points, axis] = kind


# Columns of a spring: the factor on its stiffness, and its anchor's displacement.
_COLUMNS = 4


class ExplicitSprings:
    """The springs of a run, which may be added, removed and moved between its steps.

    `springs` are all that act now, with the paths of those that are not moved from outside,
    `patches` their forces.
    """

    def __init__(self, points: Points, springs: tuple[Spring, ...]) -> None:
        self._points = points
        self.springs = springs
        self.patches = PatchSprings(points, springs)
        self._ways = [_ways_of(spring) for spring in springs]

    def __len__(self) -> int:
        return len(self.springs)

    def attach(self, run: ExplicitRun, first_history: int) -> None:
        """Set them in a run whose number of other histories is `first_history`."""
        of_facet = self.patches.of_facet
        run.set_springs(
            self.patches.facets,
            self.patches.stiffnesses,
            (first_history + _COLUMNS * of_facet).astype(np.int32),
        )

    def rows(self, times: ArrayLike) -> Floats:
        """Factors and displacements [m] at some times [s], shape (num_times, 4 num_springs)."""
        given = np.asarray(times, dtype=np.float64).tolist()
        columns = [[way(t) for t in given] for ways in self._ways for way in ways]
        rows = np.array(columns, dtype=np.float64).reshape(_COLUMNS * len(self), len(given)).T
        return np.ascontiguousarray(rows)

    def at(self, time: float) -> tuple[Points, Floats]:
        """Displacements of the anchors [m], (num_springs, 3), and factors, (num_springs,)."""
        row = self.rows([time]).reshape(len(self), _COLUMNS)
        return row[:, 1:], row[:, 0]

    def force(self, displacement: Points, time: float) -> Points:
        """Force on the body [N], shape (num_points, 3)."""
        return self.patches.force(displacement, *self.at(time))

    def resultants(self, displacement: Points, time: float) -> Points:
        """Whole force of each on the body [N], shape (num_springs, 3)."""
        return self.patches.resultants(displacement, *self.at(time))

    def send(self, number: int, goal: Floats, start: float, end: float) -> None:
        """Move an anchor along a straight line to a position in a span of time; it stays there."""
        factor, *ways = self._ways[number]
        lines = (
            TabularAmplitude((start, end), (way(start), to))
            for way, to in zip(ways, goal.tolist(), strict=True)
        )
        self._ways[number] = (factor, *lines)

    def anew(self) -> ExplicitSprings:
        """The same springs with their original paths."""
        return ExplicitSprings(self._points, self.springs)

    def with_spring(self, spring: Spring) -> ExplicitSprings:
        """The same springs and one more, the last."""
        more = ExplicitSprings(self._points, (*self.springs, spring))
        more._ways[: len(self)] = self._ways
        return more

    def without_spring(self, number: int) -> ExplicitSprings:
        """The same without one; those after it count one less."""
        kept = [k for k in range(len(self)) if k != number]
        fewer = ExplicitSprings(self._points, tuple(self.springs[k] for k in kept))
        fewer._ways = [self._ways[k] for k in kept]
        return fewer


def pulling_at_once(springs: Sequence[Spring]) -> list[tuple[Spring, ...]]:
    """Sets of springs that pull together at some time, as stiff as then; only maximal ones.

    Between the knots of linear amplitudes the largest frequency is at most that at one of them.
    """
    amplitudes = [s.amplitude or TabularAmplitude((0.0,), (1.0,)) for s in springs]
    knots = sorted({time for amplitude in amplitudes for time in amplitude.times})
    factors = np.unique([[amplitude(t) for amplitude in amplitudes] for t in knots], axis=0)
    is_least = [
        any((row <= other).all() and (row < other).any() for other in factors) for row in factors
    ]
    return [
        tuple(
            dataclasses.replace(spring, stiffness=factor * spring.stiffness, amplitude=None)
            for spring, factor in zip(springs, row.tolist(), strict=True)
            if factor > 0.0
        )
        for row, is_less in zip(factors, is_least, strict=True)
        if not is_less
    ]


_Way = Callable[[float], float]


def _ways_of(spring: Spring) -> tuple[_Way, ...]:
    factor = spring.amplitude or TabularAmplitude((0.0,), (1.0,))
    return (factor, *spring.path.components())
