"""fastsim as a candidate.

A candidate that diverges, crashes or answers NaN has failed; that is a verdict, not an error.
"""

from __future__ import annotations

import dataclasses
import time

import numpy as np

from palpate.meshes.problem import Problem, Strain
from palpate.validation.simulators.answer import Answer, CandidateFailedError, Progress
from palpate.validation.states import Method, Trajectory


def run_fastsim(
    problem: Problem, strain: Strain, progress: Progress, *, method: Method = Method.NEWTON
) -> Answer:
    """Solve by fastsim: statics, or from rest where there is time.

    Args:
        problem: What is held and pushed.
        strain: Strain measure.
        progress: Called with one line now and then.
        method: Of statics; a motion is stepped.

    Raises:
        CandidateFailedError: It diverged, or answered NaN.
    """
    from palpate.fastsim.errors import FastsimError

    progress(f"fastsim, {strain} strain, {problem.mesh.num_cells} cells")
    start = time.perf_counter()
    try:
        if problem.time is not None:
            solve = _run_motion
        else:
            solve = _run_relaxation if method is Method.RELAXATION else _run_statics
        answer = solve(problem, strain, progress)
    except FastsimError as error:
        raise CandidateFailedError(f"fastsim: {error}") from error
    bad = np.flatnonzero(~np.isfinite(answer.displacement).all(axis=1))
    if bad.size:
        raise CandidateFailedError(
            f"the answer holds NaN or infinity at {bad.size} point(s), first {int(bad[0])}"
        )
    return dataclasses.replace(answer, seconds=time.perf_counter() - start)


def _run_statics(problem: Problem, strain: Strain, progress: Progress) -> Answer:
    from palpate.fastsim.statics import solve_static

    if problem.tools:
        return _run_tools(problem, strain, progress)
    result = solve_static(problem, strain=strain, progress=progress)
    details: dict[str, object] = {
        "newton_iterations": result.iterations,
        "linear_iterations": result.linear_iterations,
        "relative_residual": result.residual_history[-1],
    }
    return Answer(result.displacement, 0.0, details)


def _run_tools(problem: Problem, strain: Strain, progress: Progress) -> Answer:
    from palpate.fastsim.contact.static_contact import solve_contact

    result = solve_contact(problem, strain=strain, progress=progress)
    details: dict[str, object] = {
        "newton_iterations": result.iterations,
        "linear_iterations": result.linear_iterations,
        "relative_residual": result.residual_history[-1],
    }
    return Answer(result.displacements[-1], 0.0, details, tool_forces=result.forces[-1])


def _run_relaxation(problem: Problem, strain: Strain, progress: Progress) -> Answer:
    from palpate.fastsim.dynamic_relaxation import relax

    result = relax(problem, strain=strain, progress=progress)
    details: dict[str, object] = {
        "method": Method.RELAXATION.value,
        "steps": result.steps,
        "relative_residual": result.relative_residual,
    }
    forces = result.tool_forces if problem.tools else None
    return Answer(result.displacement, 0.0, details, tool_forces=forces)


def _run_motion(problem: Problem, strain: Strain, progress: Progress) -> Answer:
    from palpate.fastsim.dynamics import simulate

    result = simulate(problem, strain=strain, progress=progress)
    details: dict[str, object] = {
        "time_step": result.time_step,
        "critical_time_step": result.critical_time_step,
        "num_steps": result.num_steps,
    }
    forces = np.array([track.mean_forces for track in result.tools]) if problem.tools else None
    motion = Trajectory(result.times, result.displacements)
    return Answer(result.displacements[-1], 0.0, details, motion, forces)
