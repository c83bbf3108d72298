"""A candidate as the judge sees it: a name, and a way to its states."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.exchange.result_files import (
    read_result,
    room_for_answer,
)
from palpate.validation.metrics import make_state
from palpate.validation.quoting import visible
from palpate.validation.simulators.answer import Progress
from palpate.validation.simulators.fastsim import name_of, run_fastsim
from palpate.validation.simulators.outside import OutsideSimulator
from palpate.validation.simulators.result_states import state_of_result
from palpate.validation.states import REFERENCE, Elements, Method, State

Solve = Callable[[Problem, Strain, Progress], State]


@dataclass(frozen=True, eq=False)
class Candidate:
    """Who is judged.

    Attributes:
        name: For people, and the label of its states.
        solve: Its state of a problem with a strain measure; raises CandidateFailedError.
        has_both_strains: Whether it is asked for both strain measures, or for the case's only.
        notes: What a reader of the verdict must know of it.
        can_be_asked: Whether it solves other problems than the case's, as a file cannot.
        element: What its tetrahedra are, where it does not say another in its answer.
    """

    name: str
    solve: Solve
    has_both_strains: bool = False
    notes: tuple[str, ...] = field(default=())
    can_be_asked: bool = True
    element: Element = Element.LINEAR


def fastsim_candidate(
    *, method: Method = Method.NEWTON, element: Element = Element.LINEAR
) -> Candidate:
    """fastsim, which answers for both strain measures.

    Args:
        method: How it looks for equilibrium.
        element: Linear tetrahedra, plain or smoothed.
    """
    name = name_of(element)

    def solve(problem: Problem, strain: Strain, progress: Progress) -> State:
        answer = run_fastsim(problem, strain, progress, method=method, element=element)
        return make_state(
            problem.mesh,
            answer.displacement,
            label=name,
            simulator="fastsim",
            element=element,
            strain=strain,
            seconds=answer.seconds,
            details=answer.details,
            trajectory=answer.trajectory,
            tool_forces=answer.tool_forces,
        )

    return Candidate(name, solve, has_both_strains=True, element=element)


def candidates_for(
    command: str | None, time_limit: float, elements: Elements | None = None
) -> list[Candidate]:
    """Fastsim by element, or the program of a command line.

    Args:
        command: The program; fastsim where None.
        time_limit: Of the program [s].
        elements: Of fastsim; linear where None.

    Raises:
        InputError: The command line cannot be used, or an element goes with it.
    """
    if command is None:
        chosen = Elements.LINEAR if elements is None else elements
        return [fastsim_candidate(element=element) for element in chosen.each]
    if elements is not None:
        raise InputError(
            f"element = {elements}: only fastsim is asked for one; another simulator says in its "
            'result what it has, `about`: {"element": "smoothed"}'
        )
    return [outside_candidate(OutsideSimulator(command, time_limit))]


def candidate_name(name: str) -> str:
    """A candidate's name for people, not taken for one of the reference's own labels."""
    shown = visible(name)
    return f"{shown} (candidate)" if shown.casefold().startswith(REFERENCE) else shown


def outside_candidate(simulator: OutsideSimulator) -> Candidate:
    """A program that reads a case folder and writes a result."""
    name = candidate_name(simulator.name)

    def solve(problem: Problem, strain: Strain, progress: Progress) -> State:
        answer = simulator.run(problem, strain, progress)
        return state_of_result(
            answer.result,
            problem,
            name,
            strain,
            seconds=answer.seconds,
            details={"command": simulator.command},
        )

    note = f"Simulator: `{simulator.command}`, at most {simulator.time_limit:g} s."
    return Candidate(name, solve, False, (note,))


def result_candidate(path: str | Path, element: Element | None = None) -> Candidate:
    """A result file that somebody brings.

    Args:
        path: Of the file.
        element: What its tetrahedra are, where it does not say so itself.
    """
    name = candidate_name(Path(path).stem)

    def solve(problem: Problem, strain: Strain, progress: Progress) -> State:
        progress(f"reading {path}")
        result = read_result(path, most_bytes=room_for_answer(problem))
        if element is not None:
            result = dataclasses.replace(result, about={"element": element.value, **result.about})
        return state_of_result(result, problem, name, strain)

    notes = (f"Result: {Path(path).name}.",)
    return Candidate(
        name, solve, False, notes, can_be_asked=False, element=element or Element.LINEAR
    )
