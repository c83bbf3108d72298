"""Springs over patches in explicit motion: where their anchors are, by their paths or as driven."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from palpate.fastsim.explicit_run import ExplicitRun
from palpate.fastsim.springs import PatchSprings
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.spring import Spring

# Of each spring: the factor on its stiffness, and its anchor's displacement.
_COLUMNS = 4


class ExplicitSprings:
    """The springs of a run, which may come, go and be driven between its steps.

    Args:
        points: Of the mesh at rest [m], shape (num_points, 3).
        springs: Those of the problem.

    Attributes:
        springs: All that pull now, with the paths of those that are not driven.
        patches: Their forces.
    """

    def __init__(self, points: Points, springs: tuple[Spring, ...]) -> None:
        self._points = points
        self.springs = springs
        self.patches = PatchSprings(points, springs)
        self._ways = [_ways_of(spring) for spring in springs]

    def __len__(self) -> int:
        return len(self.springs)

    def attach(self, run: ExplicitRun, first_history: int) -> None:
        """Give them to a run that has so many other histories."""
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
        """On the body [N], shape (num_points, 3)."""
        return self.patches.force(displacement, *self.at(time))

    def resultants(self, displacement: Points, time: float) -> Points:
        """Whole force of each on the body [N], shape (num_springs, 3)."""
        return self.patches.resultants(displacement, *self.at(time))

    def goal(self, number: int, displacement: ArrayLike) -> Floats:
        """Where an anchor is to be sent [m], checked, shape (3,).

        Raises:
            InputError: There is no such spring, or this is no place.
        """
        if not 0 <= number < len(self):
            raise InputError(f"spring number {number}: there are {len(self)}, from 0")
        goal = np.array(displacement, dtype=np.float64)
        if goal.shape != (3,) or not np.isfinite(goal).all():
            raise InputError(
                f"displacement = {goal.tolist()} of spring number {number}: needs 3 finite numbers"
            )
        return goal

    def send(self, number: int, goal: Floats, start: float, end: float) -> None:
        """Have an anchor go straight from where it is to a place in a span of time, and stay."""
        factor, *ways = self._ways[number]
        self._ways[number] = (factor, *map(_way_to, ways, goal.tolist(), [start] * 3, [end] * 3))

    def anew(self) -> ExplicitSprings:
        """The same, with their paths as they were at first."""
        return ExplicitSprings(self._points, self.springs)

    def with_spring(self, spring: Spring) -> ExplicitSprings:
        """The same with one more, the last."""
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
    """Which springs pull together at some time, as stiff as they are then; none of it less.

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


def _way_to(way: _Way, goal: float, start: float, end: float) -> _Way:
    return TabularAmplitude((start, end), (way(start), goal))
