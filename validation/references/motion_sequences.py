"""How the numbers of a motion settle with the time step, or with the mesh."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.validation.metrics import CATALOGUE, MOVING_TRUTH_METRICS, measure
from palpate.validation.metrics.finite import largest
from palpate.validation.metrics.grid_convergence import (
    Convergence,
    GridConvergence,
    assess_grid_convergence,
)
from palpate.validation.metrics.motion import OSCILLATION, oscillation_offsets
from palpate.validation.states import State

# Of generalised-alpha in the time step; in the mesh less at clamped edges, more inside.
_ORDER = 2.0
# Relative: seven digits kept, and solves to 1e-9 of the forces, step upon step.
_NOISE = 1e-6


def truth_metrics(problem: Problem) -> tuple[str, ...]:
    """What the truth of a motion has error bars for."""
    return tuple(
        name for name in MOVING_TRUTH_METRICS if problem.tools or not CATALOGUE[name].needs_tools
    )


def assess_sequence(problem: Problem, runs: Sequence[State]) -> dict[str, GridConvergence]:
    """How each metric settles with the time step, or with the mesh: second order inside both.

    What an oscillation's fit cannot tell, because other modes leak into it, counts as noise.

    Args:
        problem: Whose points the runs are read at.
        runs: Three, the shortest step or the finest mesh first, each half the next.
    """
    try:
        offsets, uncertainty = oscillation_offsets(runs)
    except InputError:  # nothing swings: nothing to be said of it
        offsets, uncertainty = (), None
    found = {}
    for metric in truth_metrics(problem):
        noise = _NOISE
        if metric in OSCILLATION:
            if uncertainty is None:
                found[metric] = GridConvergence(0.0, Convergence.DIVERGING)
                continue
            word = metric.removeprefix("oscillation_")
            values = [float(getattr(offset, word)) for offset in offsets]
            noise = largest((noise, float(getattr(uncertainty, word))))
        else:
            last = difference(metric, problem, runs[1], runs[0])
            values = [0.0, last, last + difference(metric, problem, runs[2], runs[1])]
        found[metric] = (
            assess_grid_convergence(values, (1.0, 2.0, 4.0), expected_order=_ORDER, noise=noise)
            if np.isfinite(values).all()
            else GridConvergence(0.0, Convergence.DIVERGING)
        )
    return found


def difference(metric: str, problem: Problem, one: State, other: State) -> float:
    """Infinite where the metric has nothing to measure: no swing, no displacement."""
    try:
        return measure(metric, problem, one, other).value
    except InputError:
        return math.inf
