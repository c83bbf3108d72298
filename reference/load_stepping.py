"""From rest to the full load in steps that adapt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Points
from palpate.reference.deformed_state import DetFSampler
from palpate.reference.newton import Newton

# The load at which equilibrium ends is found to this fraction of the full load.
_SMALLEST_STEP = 1.0 / 1024.0
# A first step whose linear answer has a larger gradient might jump to another branch.
_LARGEST_FIRST_GRADIENT = 0.5
_FEW_ITERATIONS = 6
_LAST_STRETCH = 1.25

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class LoadPath:
    """The equilibria found on the way.

    Attributes:
        displacement: The last one, flat [m].
        load_factors: Those with an equilibrium, growing.
        relative_residual: Of the last one [-].
        iterations: Linear solves in all, lost ones included.
        reason: Why the path ended before 1; empty when it did not.
    """

    displacement: Points
    load_factors: tuple[float, ...]
    relative_residual: float
    iterations: int
    reason: str


def follow_load(
    newton: Newton,
    sampler: DetFSampler,
    num_dofs: int,
    *,
    progress: Progress,
) -> LoadPath:
    """Raise the load from zero to full; halve the step where Newton fails, double it where easy.

    Each step starts from the last equilibrium, or from the extrapolation of the last two where
    that inverts no cell.
    """
    rest = np.zeros(num_dofs)
    path: list[tuple[float, Points]] = [(0.0, rest)]
    reached: list[float] = []
    step, start, iterations = _first_step(newton, sampler, rest)
    residual = 0.0
    while path[-1][0] < 1.0:
        last = path[-1][0]
        # A little further rather than a small last step that costs a whole Newton iteration.
        target = 1.0 if last + _LAST_STRETCH * step >= 1.0 else last + step
        outcome = newton.solve(
            _extrapolate(path, target, sampler) if start is None else start,
            target,
            report=_reporter(progress, target),
        )
        start = None
        iterations += outcome.iterations
        reason = outcome.reason
        if outcome.converged and not newton.is_stable(outcome.displacement, target):
            reason = "the equilibrium found is not stable"
        if not reason:
            path = [path[-1], (target, outcome.displacement)]
            reached.append(target)
            residual = outcome.relative_residual
            if outcome.iterations <= _FEW_ITERATIONS:
                step *= 2.0
            continue
        step = (target - last) / 2.0
        progress(f"load {target:.4f}: {reason}; back to {last:.4f}, step {step:.4f}")
        if step < _SMALLEST_STEP:
            return LoadPath(path[-1][1], tuple(reached), residual, iterations, reason)
    return LoadPath(path[-1][1], tuple(reached), residual, iterations, "")


def _first_step(
    newton: Newton, sampler: DetFSampler, rest: Points
) -> tuple[float, Points | None, int]:
    """Choose the first step by the size of the linear answer; that answer is its start."""
    linear = newton.linearise(rest)
    if linear is None:
        return 1.0, None, 0
    if newton.is_linear:
        return 1.0, linear, 1
    gradient = sampler.largest_gradient(linear)
    step = 1.0 if gradient <= _LARGEST_FIRST_GRADIENT else _LARGEST_FIRST_GRADIENT / gradient
    step = max(step, 2.0 * _SMALLEST_STEP)
    start = step * linear
    return step, (start if sampler.smallest(start) > 0.0 else None), 1


def _extrapolate(path: list[tuple[float, Points]], target: float, sampler: DetFSampler) -> Points:
    last, u_last = path[-1]
    if len(path) < 2:
        return u_last
    before, u_before = path[-2]
    ahead: Points = u_last + (target - last) / (last - before) * (u_last - u_before)
    return ahead if sampler.smallest(ahead) > 0.5 * sampler.smallest(u_last) else u_last


def _reporter(progress: Progress, target: float) -> Callable[[int, float, float], None]:
    def report(iteration: int, relative: float, det_f: float) -> None:
        progress(
            f"load {target:.4f}, iteration {iteration}: relative residual {relative:.2e}, "
            f"smallest det F {det_f:.4f}"
        )

    return report
