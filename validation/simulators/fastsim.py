"""fastsim as a candidate.

A candidate that diverges, crashes or answers NaN has failed; that is a verdict, not an error.
"""

from __future__ import annotations

import dataclasses
import time

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.simulators.answer import Answer, CandidateFailedError, Progress
from palpate.validation.states import Method, Trajectory


def name_of(element: Element) -> str:
    """What fastsim with an element is called."""
    return "fastsim" if element is Element.LINEAR else f"fastsim ({element})"


def run_fastsim(
    problem: Problem,
    strain: Strain,
    progress: Progress,
    *,
    method: Method = Method.NEWTON,
    element: Element = Element.LINEAR,
) -> Answer:
    """Solve by fastsim: statics, or from rest where there is time.

    Args:
        problem: What is held and pushed.
        strain: Strain measure.
        progress: Called with one line now and then.
        method: Of statics; a motion is stepped.
        element: Linear tetrahedra, plain or smoothed.

    Raises:
        CandidateFailedError: It diverged, or answered NaN.
        InputError: An element that it cannot step.
    """
    from palpate.fastsim.errors import FastsimError

    is_stepped = problem.time is not None or method is Method.RELAXATION
    if is_stepped and element is not Element.LINEAR:
        raise InputError(
            f"fastsim takes {element} tetrahedra to equilibrium by Newton's method only: not "
            "through time, and not by relaxation; ask for linear ones"
        )
    progress(f"{name_of(element)}, {strain} strain, {problem.mesh.num_cells} cells")
    start = time.perf_counter()
    try:
        if problem.time is not None:
            answer = _run_motion(problem, strain, element, progress)
        elif method is Method.RELAXATION:
            answer = _run_relaxation(problem, strain, element, progress)
        else:
            answer = _run_statics(problem, strain, element, progress)
    except FastsimError as error:
        raise CandidateFailedError(f"fastsim: {error}") from error
    bad = np.flatnonzero(~np.isfinite(answer.displacement).all(axis=1))
    if bad.size:
        raise CandidateFailedError(
            f"the answer holds NaN or infinity at {bad.size} point(s), first {int(bad[0])}"
        )
    return dataclasses.replace(answer, seconds=time.perf_counter() - start)


def _run_statics(problem: Problem, strain: Strain, element: Element, progress: Progress) -> Answer:
    from palpate.fastsim.statics import solve_static

    if problem.tools:
        return _run_tools(problem, strain, element, progress)
    result = solve_static(problem, strain=strain, element=element, progress=progress)
    details: dict[str, object] = {
        "newton_iterations": result.iterations,
        "linear_iterations": result.linear_iterations,
        "relative_residual": result.residual_history[-1],
    }
    return Answer(result.displacement, 0.0, details)


def _run_tools(problem: Problem, strain: Strain, element: Element, progress: Progress) -> Answer:
    from palpate.fastsim.contact.static_contact import solve_contact

    result = solve_contact(problem, strain=strain, element=element, progress=progress)
    details: dict[str, object] = {
        "newton_iterations": result.iterations,
        "linear_iterations": result.linear_iterations,
        "relative_residual": result.residual_history[-1],
    }
    return Answer(result.displacements[-1], 0.0, details, tool_forces=result.forces[-1])


def _run_relaxation(
    problem: Problem, strain: Strain, element: Element, progress: Progress
) -> Answer:
    from palpate.fastsim.dynamic_relaxation import relax

    del element
    result = relax(problem, strain=strain, progress=progress)
    details: dict[str, object] = {
        "method": Method.RELAXATION.value,
        "steps": result.steps,
        "relative_residual": result.relative_residual,
    }
    forces = result.tool_forces if problem.tools else None
    return Answer(result.displacement, 0.0, details, tool_forces=forces)


def _run_motion(problem: Problem, strain: Strain, element: Element, progress: Progress) -> Answer:
    from palpate.fastsim.dynamics import simulate

    del element
    result = simulate(problem, strain=strain, progress=progress)
    details: dict[str, object] = {
        "time_step": result.time_step,
        "critical_time_step": result.critical_time_step,
        "num_steps": result.num_steps,
    }
    forces = np.array([track.mean_forces for track in result.tools]) if problem.tools else None
    motion = Trajectory(result.times, result.displacements)
    return Answer(result.displacements[-1], 0.0, details, motion, forces)
