"""References of a case in motion: the same steps on the same mesh, and a truth in time and space.

The twin takes the case's own steps by central differences, so that a candidate with the same ones
must equal it to rounding. The truth is implicit (generalised-alpha) on quadratic tetrahedra; its
error bars come from three time steps, each half the last, and from finer meshes. It asks nothing
of the candidate's step, mesh or method.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.evidence.grid_convergence import (
    Convergence,
    GridConvergence,
    assess_grid_convergence,
)
from palpate.validation.judging.results import State, Trajectory
from palpate.validation.metrics import MOVING_TRUTH_METRICS, measure
from palpate.validation.metrics.motion import OSCILLATION, oscillation_offsets
from palpate.validation.metrics.pairs import make_state
from palpate.validation.references.sequences import as_data, bar_of
from palpate.validation.references.sets import (
    BOTH,
    QUADRATIC,
    SAFETY_FACTOR,
    SAME_MESH,
    TRUTH,
    ReferenceSet,
)

Progress = Callable[[str], None]
Bars = dict[tuple[str, Strain], float]
# Steps from one output to the next; the last is the truth's.
STORED_STEPS = (1, 2, 4)
LIVE_STEPS = (1, 2)
# Of generalised-alpha in the time step; in the mesh less at clamped edges, more inside.
_ORDER = 2.0
# Cells of the finest of three meshes that are still stepped through.
_LARGEST_MOVING = 6_000
# Little is taken from what the mesh resolves, all of what it does not within some hundred steps.
_SPECTRAL_RADIUS = 0.9
# Relative: seven digits kept, and solves to 1e-9 of the forces, step upon step.
_NOISE = 1e-6
_TIME_LIMIT = 4 * 3600.0


def solve_twin(problem: Problem, strain: Strain, progress: Progress) -> State:
    """The trajectory of linear tetrahedra, from rest, with the case's time step.

    Raises:
        InputError: The case states no time step: then there is nothing to be equal to.
        ReferenceFailedError: No FEniCSx, or the run failed.
    """
    from palpate.reference.child import run_task
    from palpate.reference.result import ExplicitResult
    from palpate.reference.tasks import ExplicitTask

    if problem.time is None or problem.time.time_step is None:
        raise InputError("a dynamic case needs time_step in [time] for its reference")
    progress(f"{SAME_MESH} in motion, {strain} strain, {problem.mesh.num_cells} cells")
    start = time.perf_counter()
    found = run_task(ExplicitTask(strain), problem)
    assert isinstance(found, ExplicitResult)
    return make_state(
        problem.mesh,
        found.displacements[-1],
        label=SAME_MESH,
        simulator="reference",
        strain=strain,
        seconds=time.perf_counter() - start,
        details={"time_step": found.time_step, "num_steps": found.num_steps},
        trajectory=Trajectory(found.times, found.displacements),
    )


def solve_implicit(
    problem: Problem,
    strain: Strain,
    steps_per_output: int,
    progress: Progress,
    *,
    degree: int = 2,
    at: TetMesh | None = None,
) -> State:
    """The trajectory by the implicit reference, from rest.

    Args:
        problem: With a time span; its own time step is not used.
        strain: Strain measure.
        steps_per_output: Steps from one output to the next, >= 1.
        progress: Called with one line now and then.
        degree: Of the elements.
        at: The mesh whose points are kept; one it was refined from has them first.

    Raises:
        InputError: Tools, or a load that cannot be used.
        ReferenceFailedError: No FEniCSx, or a step without an answer.
    """
    from palpate.reference.child import run_task
    from palpate.reference.result import ImplicitResult
    from palpate.reference.tasks import ImplicitTask

    span = problem.time
    assert span is not None
    step = span.end_time / span.num_outputs / steps_per_output
    progress(
        f"{QUADRATIC if degree == 2 else SAME_MESH} in motion, implicit, steps of {step:g} s, "
        f"{strain} strain, {problem.mesh.num_cells} cells"
    )
    stepped = dataclasses.replace(problem, time=dataclasses.replace(span, time_step=step))
    start = time.perf_counter()
    task = ImplicitTask(strain, degree, _SPECTRAL_RADIUS)
    found = run_task(task, stepped, time_limit=_TIME_LIMIT)
    assert isinstance(found, ImplicitResult)
    mesh = at or problem.mesh
    # A truth in seven digits: its error bar is far above, and the file half as large.
    kept = found.displacements[:, : mesh.num_points].astype(np.float32).astype(np.float64)
    return make_state(
        mesh,
        kept[-1],
        label=QUADRATIC,
        simulator="reference",
        strain=strain,
        degree=degree,
        seconds=time.perf_counter() - start,
        details={
            "time_step": found.time_step,
            "newton_iterations": found.newton_iterations,
            "largest_energy_error": float(np.abs(found.energy_errors).max()),
            "versions": dict(found.versions),
        },
        trajectory=Trajectory(found.times, kept),
    )


def solve_motion_set(
    problem: Problem,
    progress: Progress,
    *,
    wanted: Collection[str] = BOTH,
    stored: ReferenceSet | None = None,
    is_for_storing: bool = False,
) -> ReferenceSet:
    """Twin and truth of a dynamic case, one for each strain measure.

    Args:
        problem: With a time span.
        progress: Called with one line for each run.
        wanted: What checks ask for: "same_mesh", "truth".
        stored: Where it has a truth, that is taken instead of solving here.
        is_for_storing: Three time steps and a refined mesh for the error bars; otherwise two
            steps, and linear tetrahedra for the mesh's part, an upper estimate.

    Raises:
        InputError: Tools, which the reference's motions do not have yet.
        ReferenceFailedError: A run failed.
    """
    states: dict[tuple[str, Strain], State] = {}
    bars: Bars = {}
    parts: list[str] = []
    convergence: dict[str, Any] = {}
    if "same_mesh" in wanted:
        for strain in Strain:
            states[SAME_MESH, strain] = solve_twin(problem, strain, progress)
        parts.append("P1 in motion by central differences on the case's mesh")
    if "truth" in wanted:
        held = {} if stored is None else _truths(stored)
        if held and stored is not None:
            states |= held
            bars |= stored.bars
            parts.append("the truth stored: P2 in motion, implicit")
        else:
            solve = _truth_for_storing if is_for_storing else _truth_here
            for strain in Strain:
                truth, found, told = solve(problem, strain, progress)
                states[truth.label, strain] = truth
                bars |= {(metric, strain): bar for metric, bar in found.items()}
                convergence[strain.value] = told
            cut = " cut in eight" if truth.label == TRUTH else ""
            parts.append(f"P2 in motion, implicit, on the case's mesh{cut} as the truth")
    versions: Mapping[str, Any] = next(
        (s.details["versions"] for s in states.values() if "versions" in s.details), {}
    )
    provenance: dict[str, Any] = {"versions": versions}
    if convergence:
        provenance["convergence"] = convergence
    return ReferenceSet(states, bars, "; ".join(parts), provenance=provenance)


def _truths(stored: ReferenceSet) -> dict[tuple[str, Strain], State]:
    return {place: state for place, state in stored.states.items() if place[0] != SAME_MESH}


def _truth_for_storing(
    problem: Problem, strain: Strain, progress: Progress
) -> tuple[State, dict[str, float], dict[str, Any]]:
    """Three time steps on one mesh; other meshes with the longest of them.

    Small bodies: the truth's mesh is the case's cut in eight, between that and one cut in eight
    twice, whose index holds the limit; the truth is as far from it as from the finest, and the
    index on top. Others: the case's mesh, and Roache's factor on the difference to the next.
    """
    at, finer = problem.mesh, refine_problem(problem)
    is_small = 8 * finer.mesh.num_cells <= _LARGEST_MOVING
    used = finer if is_small else problem
    runs = [solve_implicit(used, strain, steps, progress, at=at) for steps in STORED_STEPS]
    others = (refine_problem(finer), problem) if is_small else (finer,)
    beside = [solve_implicit(p, strain, STORED_STEPS[0], progress, at=at) for p in others]
    in_time = assess_sequence(problem, runs[::-1])
    told = {"time": as_data(in_time)}
    if is_small:
        finest, coarsest = beside
        meshes = assess_sequence(problem, (finest, runs[0], coarsest))
        told["mesh"] = as_data(meshes)
        in_space = {
            metric: bar_of(meshes[metric]) + _difference(metric, problem, runs[0], finest)
            for metric in MOVING_TRUTH_METRICS
        }
    else:
        in_space = {
            metric: SAFETY_FACTOR * _difference(metric, problem, runs[0], beside[0])
            for metric in MOVING_TRUTH_METRICS
        }
    bars = {metric: bar_of(in_time[metric]) + in_space[metric] for metric in in_space}
    truth = runs[-1]
    if is_small:
        truth = dataclasses.replace(truth, label=TRUTH)
    return truth, bars, told


def _truth_here(
    problem: Problem, strain: Strain, progress: Progress
) -> tuple[State, dict[str, float], dict[str, Any]]:
    """Two time steps, and linear tetrahedra beside quadratic ones: upper estimates of both."""
    coarse, fine = (solve_implicit(problem, strain, steps, progress) for steps in LIVE_STEPS)
    linear = solve_implicit(problem, strain, LIVE_STEPS[0], progress, degree=1)
    bars = {
        metric: _difference(metric, problem, coarse, fine)
        + _difference(metric, problem, linear, coarse)
        for metric in MOVING_TRUTH_METRICS
    }
    try:
        _, uncertainty = oscillation_offsets((fine,))
    except InputError:
        return fine, bars, {}
    for metric in OSCILLATION:
        bars[metric] += float(getattr(uncertainty, metric.removeprefix("oscillation_")))
    return fine, bars, {}


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
    for metric in MOVING_TRUTH_METRICS:
        noise = _NOISE
        if metric in OSCILLATION:
            if uncertainty is None:
                found[metric] = GridConvergence(0.0, Convergence.DIVERGING)
                continue
            word = metric.removeprefix("oscillation_")
            values = [float(getattr(offset, word)) for offset in offsets]
            noise = max(noise, float(getattr(uncertainty, word)))
        else:
            last = _difference(metric, problem, runs[1], runs[0])
            values = [0.0, last, last + _difference(metric, problem, runs[2], runs[1])]
        found[metric] = (
            assess_grid_convergence(values, (1.0, 2.0, 4.0), expected_order=_ORDER, noise=noise)
            if np.isfinite(values).all()
            else GridConvergence(0.0, Convergence.DIVERGING)
        )
    return found


def _difference(metric: str, problem: Problem, one: State, other: State) -> float:
    """Infinite where the metric has nothing to measure: no swing, no displacement."""
    try:
        return measure(metric, problem, one, other).value
    except InputError:
        return math.inf
