"""A candidate of this very process: a function, or an answer that is already there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from palpate.meshes.problem import Problem, Strain
from palpate.validation.exchange.result_files import ResultFile, ResultFileError
from palpate.validation.simulators.answer import CandidateFailedError, Progress
from palpate.validation.simulators.candidate import (
    Candidate,
    candidate_name,
    result_candidate,
)
from palpate.validation.simulators.result_states import state_of_result
from palpate.validation.states import State

# Displacement [m] at the points of the problem's mesh: (num_points, 3), of a motion
# (num_outputs + 1, num_points, 3), from rest to the end at even distances.
Function: TypeAlias = Callable[[Problem], ArrayLike]


def function_candidate(function: Function) -> Candidate:
    """A function as a candidate; what it raises is its failure."""
    name = candidate_name(getattr(function, "__name__", type(function).__name__))

    def solve(problem: Problem, strain: Strain, progress: Progress) -> State:
        progress(f"{name}, {strain} strain, {problem.mesh.num_cells} cells")
        try:
            answer = function(problem)
        except Exception as error:
            raise CandidateFailedError(f"{name}: {type(error).__name__}: {error}") from error
        return _state(answer, problem, name, strain)

    return Candidate(name, solve)


def answer_candidate(answer: str | Path | State | ArrayLike) -> Candidate:
    """An answer as a candidate: a result file, a state, or displacements in memory."""
    if isinstance(answer, str | Path):
        return result_candidate(answer)
    if isinstance(answer, State):
        # Its own label would be taken for the reference's.
        name = candidate_name(answer.label)
        given: ArrayLike = (
            answer.displacement if answer.trajectory is None else answer.trajectory.displacements
        )
    else:
        name, given = "answer", answer

    def solve(problem: Problem, strain: Strain, progress: Progress) -> State:
        progress(f"{name} is looked at")
        return _state(given, problem, name, strain, like=answer)

    return Candidate(name, solve, can_be_asked=False)


def _state(
    answer: ArrayLike, problem: Problem, name: str, strain: Strain, like: object = None
) -> State:
    """Displacements as a state, checked as those of a result file are."""
    num_points = problem.mesh.num_points
    span = problem.time
    shape = (num_points, 3) if span is None else (span.num_outputs + 1, num_points, 3)
    try:
        values = np.array(answer, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ResultFileError(name, f"no array of numbers ({error})") from error
    if values.shape != shape:
        raise ResultFileError(
            name, f"displacement has shape {values.shape}; this case needs {shape} [m]"
        )
    times = None if span is None else np.linspace(0.0, span.end_time, span.num_outputs + 1)
    about: dict[str, object] = {}
    if isinstance(like, State):
        about["element"] = like.element.value
        if like.tool_forces is not None:
            about["tool_forces"] = like.tool_forces
    values = values.reshape(-1, num_points, 3)
    result = ResultFile(Path(name), values, are_positions=False, times=times, about=about)
    return state_of_result(result, problem, name, strain)
