"""From one equilibrium to another in adaptive steps."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Protocol

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.reference.deformed_state import DetFSampler
from palpate.reference.newton import Newton, Outcome

# The largest load with an equilibrium is found to this fraction of the full load.
SMALLEST_STEP = 1.0 / 1024.0
# A first step whose linear solution has a larger gradient might jump to another branch.
_LARGEST_FIRST_GRADIENT = 0.5
_FEW_ITERATIONS = 6
_LAST_STRETCH = 1.25

Progress = Callable[[str], None]
Report = Callable[[int, float, float], None]


class Stage(Protocol):
    """Equilibria as a function of a parameter from 0 to 1, of a load or along a tool's path."""

    def solve(self, start: Floats, parameter: float, *, report: Report | None = None) -> Outcome:
        """Iterate from a displacement to the equilibrium at a parameter."""

    def is_stable(self, displacement: Floats, parameter: float) -> bool:
        """Whether an equilibrium is stable."""

    def keep(self, displacement: Floats, parameter: float) -> None:
        """Accept a stable equilibrium as the start of the next step; called once per step."""


def follow_load(
    newton: Newton,
    sampler: DetFSampler,
    num_dofs: int,
    *,
    progress: Progress,
) -> Outcome:
    """Raise the load from zero to full, from the body at rest."""
    rest = np.zeros(num_dofs)
    step, guess, iterations = _first_step(newton, sampler, rest)
    path = follow(newton, sampler, rest, step, guess=guess, progress=progress)
    return dataclasses.replace(path, iterations=path.iterations + iterations)


def follow(
    stage: Stage,
    sampler: DetFSampler,
    start: Floats,
    step: float,
    *,
    guess: Floats | None = None,
    name: str = "load",
    few_iterations: int = _FEW_ITERATIONS,
    largest_step: float = 1.0,
    smallest_step: float = SMALLEST_STEP,
    progress: Progress,
) -> Outcome:
    """Go from 0 to 1; halve the step where Newton fails, double it where it converges fast.

    Each step starts from the last equilibrium, or from the extrapolation of the last two where
    that inverts no cell; the first from `guess` [m], if there is one, or from the equilibrium
    `start` at 0. Steps of the parameter, called `name` in the log, are in (0, 1], and where they
    would be below the smallest the path ends; one with at most `few_iterations` linear solves
    converged fast.
    """
    path: list[tuple[float, Floats]] = [(0.0, start)]
    reached: list[float] = []
    target = 0.0

    def report(iteration: int, relative: float, det_f: float) -> None:
        progress(
            f"{name} {target:.4f}, iteration {iteration}: relative residual {relative:.2e}, "
            f"smallest det F {det_f:.4f}"
        )

    iterations, residual = 0, 0.0
    while path[-1][0] < 1.0:
        last, first = path[-1]
        # A slightly longer step avoids a small last one that costs a whole Newton iteration.
        target = 1.0 if last + _LAST_STRETCH * step >= 1.0 else last + step
        if guess is not None:
            first, guess = guess, None
        elif len(path) > 1:
            before, u_before = path[0]
            ahead = first + (target - last) / (last - before) * (first - u_before)
            if sampler.smallest(ahead) > 0.5 * sampler.smallest(first):
                first = ahead
        outcome = stage.solve(first, target, report=report)
        iterations += outcome.iterations
        reason = outcome.reason
        if outcome.converged and not stage.is_stable(outcome.displacement, target):
            reason = "the equilibrium found is not stable"
        if not reason:
            path = [path[-1], (target, outcome.displacement)]
            reached.append(target)
            stage.keep(outcome.displacement, target)
            residual = outcome.relative_residual
            if outcome.iterations <= few_iterations:
                step = min(2.0 * step, largest_step)
            continue
        step = (target - last) / 2.0
        progress(f"{name} {target:.4f}: {reason}; back to {last:.4f}, step {step:.4f}")
        if step < smallest_step:
            return Outcome(path[-1][1], residual, iterations, reason, tuple(reached))
    return Outcome(path[-1][1], residual, iterations, "", tuple(reached))


def _first_step(
    newton: Newton, sampler: DetFSampler, rest: Floats
) -> tuple[float, Floats | None, int]:
    """Choose the first step by the size of the linear solution, which is its first iterate."""
    linear = newton.linearise(rest)
    if linear is None:
        return 1.0, None, 0
    if newton.is_linear:
        return 1.0, linear, 1
    gradient = sampler.largest_gradient(linear)
    step = 1.0 if gradient <= _LARGEST_FIRST_GRADIENT else _LARGEST_FIRST_GRADIENT / gradient
    step = max(step, 2.0 * SMALLEST_STEP)
    start = step * linear
    return step, (start if sampler.smallest(start) > 0.0 else None), 1
