"""fastsim as a candidate, and fastsim with a seeded fault to show that gates go red.

A candidate that diverges, crashes or answers NaN has failed; that is a verdict, not an error.
"""

from __future__ import annotations

import time

import numpy as np

from palpate.meshes.problem import Problem, Strain
from palpate.validation.simulators.answer import Answer, CandidateFailedError, Progress
from palpate.validation.simulators.faults import (
    Fault,
    spoil_displacement,
    spoil_problem,
    spoil_strain,
)
from palpate.validation.simulators.transposed import simulate_in_numpy
from palpate.validation.states import Trajectory


def run_fastsim(
    problem: Problem, strain: Strain, progress: Progress, fault: Fault = Fault.NONE
) -> Answer:
    """Solve by fastsim, with a seeded fault if asked: statics, or from rest where there is time.

    Raises:
        CandidateFailedError: It diverged, or answered NaN.
    """
    from palpate.fastsim.errors import FastsimError

    given, used = spoil_problem(problem, fault), spoil_strain(strain, fault)
    progress(f"fastsim, {used} strain, {problem.mesh.num_cells} cells")
    start = time.perf_counter()
    try:
        if given.time is None:
            answer = _run_statics(given, used, progress)
        elif fault is Fault.TRANSPOSED_GRADIENT:
            motion = simulate_in_numpy(given, is_transposed=True)
            answer = Answer(motion.displacements[-1], 0.0, {}, motion)
        else:
            answer = _run_motion(given, used, progress)
    except FastsimError as error:
        raise CandidateFailedError(f"fastsim: {error}") from error
    seconds = time.perf_counter() - start
    displacement = spoil_displacement(problem.mesh, answer.displacement, fault)
    spoiled = answer.trajectory
    if spoiled is not None:
        fields = spoil_displacement(problem.mesh, spoiled.displacements, fault)
        spoiled = Trajectory(spoiled.times, fields)
    bad = np.flatnonzero(~np.isfinite(displacement).all(axis=1))
    if bad.size:
        raise CandidateFailedError(
            f"the answer holds NaN or infinity at {bad.size} point(s), first {int(bad[0])}"
        )
    return Answer(displacement, seconds, answer.details, spoiled, answer.tool_forces)


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
