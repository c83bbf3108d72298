"""How the numbers of a motion settle with the time step, or with the mesh."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.field_norms import l2_norms
from palpate.meshes.problem import Problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.metrics import CATALOGUE, MOVING_TRUTH_METRICS, measure
from palpate.validation.metrics.grid_convergence import (
    Convergence,
    GridConvergence,
    assess_grid_convergence,
)
from palpate.validation.metrics.motion import OSCILLATION, oscillation_offsets
from palpate.validation.references.sequences import SAFETY_FACTOR
from palpate.validation.states import State

# Of generalised-alpha in the time step; in the mesh less at clamped edges, more inside.
_ORDER = 2.0
# Relative: seven digits kept, and solves to 1e-9 of the forces, step upon step.
_NOISE = 1e-6
# Those of `MOVING_TRUTH_METRICS` that are norms of a difference.
_NORMS = ("displacement_l2", "displacement_max", "max_displacement", "trajectory_l2")
# Of the last difference of a norm over the one before: more, and nothing settles.
LARGEST_GROWTH = 1.5
# Of a motion's outputs, the last ones, over which its end is compared: see `difference`.
LAST_PART = 0.25
LEAST_OUTPUTS = 4


def truth_metrics(problem: Problem) -> tuple[str, ...]:
    """What the truth of a motion has error bars for."""
    return tuple(
        name for name in MOVING_TRUTH_METRICS if problem.tools or not CATALOGUE[name].needs_tools
    )


def assess_sequence(problem: Problem, runs: Sequence[State]) -> dict[str, GridConvergence]:
    """How each metric settles with the time step, or with the mesh: second order inside both.

    No faster than of that order is believed: a sequence that shows more has bars as of that.

    Of an oscillation, what other modes leak into a fit is hardly another from run to run, so that
    a sequence may show an order far below what one fit can tell of the swing. Where it shows none
    there, the bar is three times its range (L. Eca, M. Hoekstra, J. Comput. Phys. 262 (2014)
    104-130, of sequences without order).

    Norms of what lies between two runs are never small by chance. Where they shrink more slowly
    than any order that is believed, or grow by less than LARGEST_GROWTH, as where a mesh was cut in
    some places only, their bar is three times their range likewise: no less than two runs alone
    would make it.

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
        untold = 0.0
        if metric in OSCILLATION:
            if uncertainty is None:
                found[metric] = GridConvergence(0.0, Convergence.DIVERGING)
                continue
            word = metric.removeprefix("oscillation_")
            values = [float(getattr(offset, word)) for offset in offsets]
            untold = float(getattr(uncertainty, word))
        else:
            last = difference(metric, problem, runs[1], runs[0])
            values = [0.0, last, last + difference(metric, problem, runs[2], runs[1])]
        if not np.isfinite(values).all():
            found[metric] = GridConvergence(0.0, Convergence.DIVERGING)
            continue
        shown = assess_grid_convergence(
            values, (1.0, 2.0, 4.0), expected_order=_ORDER, noise=_NOISE
        )
        if shown.error_bar is not None and shown.order is not None and shown.order > _ORDER:
            slower = (2.0**shown.order - 1.0) / (2.0**_ORDER - 1.0)
            shown = replace(shown, error_bar=slower * shown.error_bar)
        reach = float(np.ptp(values))
        if shown.error_bar is None and reach <= untold:
            shown = replace(
                shown, behaviour=Convergence.BELOW_NOISE, error_bar=SAFETY_FACTOR * reach + _NOISE
            )
        elif shown.error_bar is None and metric in _NORMS and _grows_little(values):
            shown = replace(shown, error_bar=SAFETY_FACTOR * reach + _NOISE)
        found[metric] = shown
    return found


def _grows_little(values: Sequence[float]) -> bool:
    return values[1] - values[0] <= LARGEST_GROWTH * (values[2] - values[1])


def difference(metric: str, problem: Problem, one: State, other: State) -> float:
    """How far two runs are apart in a metric, over its scale [-].

    At the end of a swing two runs that are at odds may meet by chance, each on its way elsewhere: a
    bar from that would be nothing, with the truth a whole swing off. So metrics of the last state
    have the largest difference over the last part of the motion, LAST_PART of its outputs and no
    fewer than LEAST_OUTPUTS, and the largest displacement, a number that agrees by chance sooner
    still, has that of the worst point.

    Infinite where the metric has nothing to measure: no swing, no displacement.
    """
    name = "displacement_max" if metric == "max_displacement" else metric
    try:
        found = measure(name, problem, one, other)
    except InputError:
        return math.inf
    norm = _AT_THE_END.get(name)
    if norm is None or one.trajectory is None or other.trajectory is None:
        return found.value
    last = max(LEAST_OUTPUTS, math.ceil(LAST_PART * len(other.trajectory.times)))
    apart = one.trajectory.displacements[-last:] - other.trajectory.displacements[-last:]
    largest = float(norm(problem.mesh, apart).max())
    return max(found.value, largest / found.scale if found.scale > 0.0 else found.value)


def _largest_norms(_mesh: TetMesh, moved: Points) -> Floats:
    norms: Floats = np.linalg.norm(moved, axis=2).max(axis=1)
    return norms


_AT_THE_END: dict[str, Callable[[TetMesh, Points], Floats]] = {
    "displacement_l2": l2_norms,
    "displacement_max": _largest_norms,
}
