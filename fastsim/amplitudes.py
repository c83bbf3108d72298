"""Amplitudes: factors over time on loads and on the displacements of supports."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem

Amplitude: TypeAlias = Callable[[float], float]
Amplitudes: TypeAlias = Amplitude | Sequence[Amplitude | None] | None


def smooth_ramp(duration: float) -> Amplitude:
    """A factor that rises from 0 to 1 over `duration` [s] without a jump of its first two rates.

    10 s^3 - 15 s^4 + 6 s^5 with s = t / duration: such a load hardly excites vibrations.

    Raises:
        InputError: A duration that is not above 0.
    """
    if not duration > 0.0:
        raise InputError(f"duration = {duration:g} s: a ramp needs a value above 0")

    return TabularAmplitude((0.0, duration), (0.0, 1.0), is_smooth=True)


class Histories:
    """The different amplitudes of a problem, each once; history 0 is 1 at all times.

    `loads` and `supports` are one amplitude for all, or one for each (None is 1); None uses each
    one's own.

    Attributes:
        of_load: History of each load.
        of_support: History of each support.
        of_turn: For each support that turns, the histories of sin(angle s) and 1 - cos(angle s), s
            its factor; None of the others.

    Raises:
        InputError: A sequence of another length.
    """

    def __init__(self, problem: Problem, loads: Amplitudes, supports: Amplitudes) -> None:
        self._functions: list[Amplitude] = []
        if loads is None:
            loads = [load.amplitude for load in problem.loads]
        if supports is None:
            supports = [support.amplitude for support in problem.supports]
        self.of_load = self._number(loads, len(problem.loads), "loads")
        self.of_support = self._number(supports, len(problem.supports), "supports")
        self.of_turn = tuple(
            None if support.rotation is None else self._turn(support.rotation.angle, history)
            for support, history in zip(problem.supports, self.of_support, strict=True)
        )

    def __len__(self) -> int:
        return 1 + len(self._functions)

    def at(self, times: Sequence[float] | Points) -> Floats:
        """Factors [-], shape (num_times, num_histories).

        Raises:
            InputError: An amplitude that is not finite at one of the times.
        """
        factors = np.ones((len(times), len(self)))
        if not self._functions:
            return factors
        for column, function in enumerate(self._functions, start=1):
            factors[:, column] = [function(float(t)) for t in times]
        if not np.isfinite(factors).all():
            row, column = np.argwhere(~np.isfinite(factors))[0]
            raise InputError(
                f"the amplitude at t = {times[row]:g} s is {factors[row, column]}; "
                "it must be finite"
            )
        return factors

    def _number(self, given: Amplitudes, count: int, what: str) -> tuple[int, ...]:
        if given is None or callable(given):
            given = [given] * count
        if len(given) != count:
            raise InputError(
                f"{len(given)} amplitudes for {count} {what}; give one for each, or one for all"
            )
        for function in given:
            if function is not None and function not in self._functions:
                self._functions.append(function)
        return tuple(0 if f is None else 1 + self._functions.index(f) for f in given)

    def _turn(self, angle: float, history: int) -> tuple[int, int]:
        factor: Amplitude = self._functions[history - 1] if history else lambda _time: 1.0
        self._functions += [
            lambda time: math.sin(angle * factor(time)),
            lambda time: 2.0 * math.sin(0.5 * angle * factor(time)) ** 2,
        ]
        return len(self._functions) - 1, len(self._functions)
