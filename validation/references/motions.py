"""References of a case in motion: the same steps on the same mesh, and a truth in time and space.

The explicit run takes the case's own steps by central differences, so that a candidate with the
same ones must equal it to rounding. The truth is implicit (generalised-alpha) on quadratic
tetrahedra; its error bars come from sequences of time steps and of meshes, which are refined where
the body bends: where it is clamped, or where tools touch it, the strain changes from cell to cell.
It asks nothing of the candidate's step, mesh or method.

For storing there are three meshes, each refined from the last where its motion says, and three time
steps on the second (on the first, nodes that come to a tool and leave it would drown what the steps
do). The truth is the finest mesh's with the shortest step.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.errors import InputError
from palpate.meshes.field_norms import l2_norms
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.refinement import refine_cells
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.reference.errors import ReferenceTooLongError
from palpate.validation.metrics import CATALOGUE, MOVING_TRUTH_METRICS, measure
from palpate.validation.metrics.body import shape_gradients
from palpate.validation.metrics.grid_convergence import (
    Convergence,
    GridConvergence,
    assess_grid_convergence,
)
from palpate.validation.metrics.motion import OSCILLATION, oscillation_offsets
from palpate.validation.references.bars import (
    GEOMETRY,
    PARTS,
    SAFETY_FACTOR,
    BarParts,
    Bars,
    as_record,
    saturated,
    with_bar,
    without_limits,
)
from palpate.validation.references.reference_set import (
    BOTH,
    OF_ELEMENT,
    QUADRATIC,
    TRUTH,
    ReferenceSet,
    StateKey,
)
from palpate.validation.references.runs import (
    TIME_LIMIT,
    at_points_of,
    failure_recorded,
    solve_by_steps,
    solve_implicit,
)
from palpate.validation.states import REFERENCE, Progress, State

# Steps from one output to the next; the last is the truth's.
LIVE_STEPS = (1, 2)
# Steps from output to output: all of them on the second mesh.
STEPS = (2, 4, 8)
_MESHES = 3
# Fraction of the roughness of the strain over a motion in the cells that are cut for the next mesh:
# the first that makes it at most so many times as large.
BULKS = (0.7, 0.5, 0.3)
GROWTH = 4
# Order of generalised-alpha in the time step; in the mesh less at clamped edges, more inside.
_ORDER = 2.0
# Relative: seven digits stored, and solves to 1e-9 of the forces, step upon step.
_NOISE = 1e-6
# Those of `MOVING_TRUTH_METRICS` that are norms of a difference; a range is one but for constants.
_NORMS = (
    "displacement_l2", "displacement_max", "max_displacement", "trajectory_l2",
    "force_ripple", "false_lateral_force",
)  # fmt: skip
# Largest ratio of the last difference of a norm to the one before: above it, nothing settles.
LARGEST_GROWTH = 1.5
# The last fraction of a motion's outputs, over which its end is compared: see `difference`.
LAST_PART = 0.25
LEAST_OUTPUTS = 4


def solve_motion_set(
    problem: Problem,
    progress: Progress,
    *,
    wanted: Collection[str] = BOTH,
    stored: ReferenceSet | None = None,
    is_for_storing: bool = False,
    elements: Collection[Element] = (Element.LINEAR,),
    strains: Collection[Strain] = tuple(Strain),
    truth_strains: Collection[Strain] | None = None,
    seconds: float = TIME_LIMIT,
) -> ReferenceSet:
    """The explicit runs and the truth of a dynamic case, one for each strain measure.

    Args:
        problem: The problem with a time span.
        progress: Called with one line for each run.
        wanted: What checks ask for: "same_mesh", "truth".
        stored: A set whose truth is taken, if it has one, instead of solving here.
        is_for_storing: Three time steps and three meshes for the error bars; otherwise two steps,
            and one mesh refined where the body bends.
        elements: Elements of the explicit runs.
        strains: Strain measures of those runs.
        truth_strains: Strain measures of the truth, where those are fewer.
        seconds: Most time that an explicit run, and all runs of a truth that is not for storing,
            may take [s], > 0.

    Returns:
        States, bars, and why one is missing: a run that found no solution leaves the others be.

    Raises:
        InputError: A tool that the reference cannot move.
        ReferenceUnavailableError: No FEniCSx here.
        ReferenceFailedError: A run failed, and the set is for storing: nothing incomplete is.
    """
    states: dict[StateKey, State] = {}
    bars: Bars = {}
    parts: dict[StateKey, BarParts] = {}
    failures: dict[StateKey, str] = {}
    origin: list[str] = []
    convergence: dict[str, Any] = {}
    if "same_mesh" in wanted:
        for element in (kind for kind in Element if kind in elements):
            label = OF_ELEMENT[element]
            name = label.removeprefix(f"{REFERENCE} ")
            origin.append(f"{name} in motion by central differences on the case's mesh")
            for strain in strains:
                with failure_recorded(failures, (label, strain), is_for_storing, " in motion"):
                    states[label, strain] = solve_by_steps(
                        problem, strain, None, progress, element=element, time_limit=seconds
                    )
    on_mesh = OF_ELEMENT.values()
    known = (
        {} if stored is None else {k: s for k, s in stored.states.items() if k[0] not in on_mesh}
    )
    if "truth" in wanted and known and stored is not None:
        origin.append("the truth stored: P2 in motion, implicit")
        states |= known
        bars |= stored.bars
    elif "truth" in wanted:
        for strain in strains if truth_strains is None else truth_strains:
            with failure_recorded(failures, (QUADRATIC, strain), is_for_storing, " in motion"):
                if is_for_storing:
                    truth, made_of, details = solve_motion_truth(problem, strain, progress)
                else:
                    truth, made_of, details = _truth_here(problem, strain, progress, seconds)
                states[truth.label, strain] = truth
                found = {metric: one.whole for metric, one in made_of.items()}
                found = without_limits(problem, strain, found)
                bars |= {(metric, strain): bar for metric, bar in found.items()}
                parts |= {(m, strain): with_bar(made_of[m], bar) for m, bar in found.items()}
                convergence[strain.value] = details
        is_refined = any(label == TRUTH for label, _ in states)
        cut = " refined where it bends" if is_refined else ""
        origin.append(f"P2 in motion, implicit, on the case's mesh{cut} as the truth")
        if not is_for_storing:
            origin.append("its error bars: from a longer step and one finer mesh")
    versions = next((dict(s.versions) for s in states.values() if s.versions), {})
    provenance: dict[str, Any] = {"versions": versions}
    if convergence:
        provenance["convergence"] = convergence
    if parts:
        provenance[PARTS] = as_record(parts)
    elif bars and stored is not None:
        provenance |= {key: stored.provenance.get(key, {}) for key in (PARTS, GEOMETRY)}
    return ReferenceSet(states, bars, "; ".join(origin), failures, provenance)


def _truth_here(
    problem: Problem, strain: Strain, progress: Progress, seconds: float
) -> tuple[State, dict[str, BarParts], dict[str, Any]]:
    """Two time steps, and one finer mesh: Roache's rule for two grids of each.

    The coarse run shows what all three take together, cells times steps: where that is more than
    they may, the others are not begun.

    In time of second order, which generalised-alpha has: 3 d / (2^2 - 1) = d. In space of first,
    because clamped edges are singular, and from a mesh on which only the cells with a part b of the
    roughness are cut, so that d is that part of what halving all would find: 3 d / b. Where two
    runs are more than half apart neither says anything, as in statics (`bars.saturated`): no bar.
    """
    begin, (few, more) = time.monotonic(), LIVE_STEPS

    def left() -> float:
        return max(1.0, seconds - (time.monotonic() - begin))

    coarse = solve_implicit(problem, strain, few, progress, time_limit=left())
    finer, bulk = refine_where_rough(problem, coarse)
    growth = 1.0 + more / few + finer.mesh.num_cells / problem.mesh.num_cells
    if coarse.seconds * growth > seconds:
        raise ReferenceTooLongError(coarse.seconds * growth, seconds)
    fine = solve_implicit(problem, strain, more, progress, time_limit=left())
    graded = solve_implicit(finer, strain, few, progress, at=problem.mesh, time_limit=left())
    bars = {
        metric: BarParts(
            discretisation=SAFETY_FACTOR
            / bulk
            * saturated(difference(metric, problem, coarse, graded)),
            time=saturated(difference(metric, problem, coarse, fine)),
        )
        for metric in truth_metrics(problem)
    }
    try:
        _, uncertainty = oscillation_offsets((fine,))
    except InputError:
        return fine, bars, {}
    for metric in OSCILLATION:
        fitted = float(getattr(uncertainty, metric.removeprefix("oscillation_")))
        bars[metric] = dataclasses.replace(bars[metric], time=bars[metric].time + fitted)
    return fine, bars, {}


def solve_motion_truth(
    problem: Problem, strain: Strain, progress: Progress
) -> tuple[State, dict[str, BarParts], dict[str, Any]]:
    """The truth at the case's points, its error bars by part, and the sequences they come from.

    Args:
        problem: A motion.
        strain: Strain measure.
        progress: Called with one line for each run.

    Raises:
        ReferenceFailedError: A run failed.
    """
    long, middling, short = STEPS
    runs: list[State] = []
    meshes = [problem]
    for number in range(_MESHES):
        runs.append(solve_implicit(meshes[-1], strain, long, progress))
        if number + 1 < _MESHES:
            meshes.append(refine_where_rough(meshes[-1], runs[-1])[0])
    first, second, finest = (at_points_of(problem.mesh, run) for run in runs)
    half, quarter = (
        at_points_of(problem.mesh, solve_implicit(meshes[1], strain, steps, progress))
        for steps in (middling, short)
    )
    in_time = assess_sequence(problem, (quarter, half, second))
    in_space = assess_sequence(problem, (finest, second, first))
    truth = at_points_of(problem.mesh, solve_implicit(meshes[-1], strain, short, progress))
    bars = {
        metric: BarParts(discretisation=_bar_of(in_space[metric]), time=_bar_of(in_time[metric]))
        for metric in truth_metrics(problem)
    }
    details = {
        "time": _as_data(in_time),
        "mesh": _as_data(in_space),
        "cells": [p.mesh.num_cells for p in meshes],
        "steps_per_output": list(STEPS),
    }
    return dataclasses.replace(truth, label=TRUTH), bars, details


def refine_where_rough(problem: Problem, run: State) -> tuple[Problem, float]:
    """The next mesh, and the part of the roughness that is in the cells cut for it [-].

    Args:
        problem: The problem whose mesh is refined.
        run: The motion of that problem.
    """
    for bulk in BULKS:
        finer = refine_cells(problem, rough_cells(problem.mesh, run, bulk)).problem
        if finer.mesh.num_cells <= GROWTH * problem.mesh.num_cells:
            break
    return finer, bulk


def rough_cells(mesh: TetMesh, run: State, part: float) -> NDArray[np.bool_]:
    """The fewest cells that hold a part of how rough the displacement's gradient is over a motion.

    By the squared difference of each cell's gradient from the mean about its corners, by volume
    (after O. C. Zienkiewicz, J. Z. Zhu, Int. J. Numer. Meth. Engng 24, 1987).

    Args:
        mesh: Mesh of the run.
        run: The run, with its trajectory at the mesh's points.
        part: Fraction of the whole, summed over the outputs [-], 0 to 1.

    Returns:
        Which cells, shape (num_cells,).
    """
    assert run.trajectory is not None
    shapes = shape_gradients(mesh)
    volumes = signed_volumes(mesh.points, mesh.cells)
    weights = np.bincount(mesh.cells.ravel(), np.repeat(volumes, 4), mesh.num_points)
    rough = np.zeros(mesh.num_cells)
    for displacement in run.trajectory.displacements:
        gradients = (displacement[mesh.cells].transpose(0, 2, 1) @ shapes).reshape(-1, 9)
        means = np.zeros((mesh.num_points, 9))
        np.add.at(means, mesh.cells, (volumes[:, None] * gradients)[:, None, :])
        means /= weights[:, None]
        apart = gradients[:, None, :] - means[mesh.cells]
        rough += volumes * np.sum(apart**2, axis=(1, 2))
    order = np.argsort(-rough, kind="stable")
    count = np.searchsorted(np.cumsum(rough[order]), part * rough.sum()) + 1
    marked = np.zeros(mesh.num_cells, dtype=np.bool_)
    marked[order[:count]] = True
    return marked


def truth_metrics(problem: Problem) -> tuple[str, ...]:
    """Metrics that the truth of a motion has error bars for."""
    return tuple(name for name in MOVING_TRUTH_METRICS if CATALOGUE[name].fits(problem))


def assess_sequence(problem: Problem, runs: Sequence[State]) -> dict[str, GridConvergence]:
    """How each metric settles with the time step, or with the mesh: second order inside both.

    No faster than of that order is believed: a sequence that shows more has bars as of that.

    Of an oscillation, what other modes leak into a fit is hardly another from run to run, so that
    a sequence may show an order far below what one fit can show of the swing. Where it shows none
    there, the bar is three times its range (L. Eca, M. Hoekstra, J. Comput. Phys. 262 (2014)
    104-130, of sequences without order).

    Norms of what lies between two runs are never small by chance. Where they shrink more slowly
    than any order that is believed, or grow by less than LARGEST_GROWTH, as where a mesh was cut in
    some places only, their bar is three times their range too: no less than two runs alone
    would make it.

    Args:
        problem: The problem at whose points the runs are read.
        runs: Three, the shortest step or the finest mesh first, each half the next.
    """
    try:
        offsets, uncertainty = oscillation_offsets(runs)
    except InputError:  # nothing swings: nothing to be said of it
        offsets, uncertainty = (), None
    found = {}
    for metric in truth_metrics(problem):
        of_one_fit, values = 0.0, [math.nan]
        if metric not in OSCILLATION:
            last = difference(metric, problem, runs[1], runs[0])
            values = [0.0, last, last + difference(metric, problem, runs[2], runs[1])]
        elif uncertainty is not None:
            word = metric.removeprefix("oscillation_")
            values = [float(getattr(offset, word)) for offset in offsets]
            of_one_fit = float(getattr(uncertainty, word))
        found[metric] = _settled(values, of_one_fit, is_norm=metric in _NORMS)
    return found


def _settled(values: Sequence[float], of_one_fit: float, *, is_norm: bool) -> GridConvergence:
    """How a metric settles, by its values on three runs and what one fit of it may be off by."""
    if not np.isfinite(values).all():
        return GridConvergence(0.0, Convergence.DIVERGING)
    shown = assess_grid_convergence(values, (1.0, 2.0, 4.0), expected_order=_ORDER, noise=_NOISE)
    if shown.error_bar is not None:
        if shown.order is None or shown.order <= _ORDER:
            return shown
        slower = (2.0**shown.order - 1.0) / (2.0**_ORDER - 1.0)
        return dataclasses.replace(shown, error_bar=slower * shown.error_bar)
    reach = float(np.ptp(values))
    if reach <= of_one_fit:
        shown = dataclasses.replace(shown, behaviour=Convergence.BELOW_NOISE)
    elif not (is_norm and values[1] - values[0] <= LARGEST_GROWTH * (values[2] - values[1])):
        return shown
    return dataclasses.replace(shown, error_bar=SAFETY_FACTOR * reach + _NOISE)


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
    if one.trajectory is None or other.trajectory is None or not found.scale > 0.0:
        return found.value
    last = max(LEAST_OUTPUTS, math.ceil(LAST_PART * len(other.trajectory.times)))
    apart = one.trajectory.displacements[-last:] - other.trajectory.displacements[-last:]
    if name == "displacement_l2":
        return max(found.value, float(l2_norms(problem.mesh, apart).max()) / found.scale)
    if name == "displacement_max":
        return max(found.value, float(np.linalg.norm(apart, axis=2).max()) / found.scale)
    return found.value


def _bar_of(convergence: GridConvergence) -> float:
    """The error bar, infinite where nothing can be concluded."""
    return math.inf if convergence.error_bar is None else convergence.error_bar


def _as_data(found: Mapping[str, GridConvergence]) -> dict[str, dict[str, Any]]:
    """The convergence as plain data, for the file and the report."""
    return {metric: dataclasses.asdict(convergence) for metric, convergence in found.items()}
