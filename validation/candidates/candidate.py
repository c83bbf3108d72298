"""A candidate as the judge sees it: a name, and a way to its states; and each kind of them."""

from __future__ import annotations

import copy
import dataclasses
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference.schemes import Integrator
from palpate.validation.candidates.equations import AskedSteps
from palpate.validation.candidates.fastsim import (
    CONDENSED,
    CORE,
    condensed_refusal,
    name_of,
    run_condensed,
    run_fastsim,
)
from palpate.validation.candidates.outside import OutsideSimulator
from palpate.validation.candidates.result_states import state_of_result
from palpate.validation.exchange.result_files import (
    ResultFile,
    ResultFileError,
    read_result,
    room_for_result,
)
from palpate.validation.quoting import visible
from palpate.validation.states import (
    REFERENCE,
    CandidateFailedError,
    Elements,
    Method,
    Precision,
    Progress,
    State,
)

Solve = Callable[[Problem, Strain, Progress], State]
# Displacement [m] at the points of the problem's mesh: (num_points, 3), of a motion
# (num_outputs + 1, num_points, 3), from rest to the end at even distances.
Function: TypeAlias = Callable[[Problem], ArrayLike]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A simulator or result that is judged.

    Attributes:
        name: Name for people, and the label of its states.
        solve: Its state of a problem with a strain measure; raises CandidateFailedError.
        has_both_strains: Whether it is asked for both strain measures, or for the case's only.
        notes: What a reader of the verdict must know of it.
        can_be_asked: Whether it solves other problems than the case's, as a file cannot.
        element: Its tetrahedra, by which it is judged whatever its result states.
        asked: The scheme and step that its motions are judged by.
        only_strain: The one strain measure that it knows, whatever the case's; None asks for the
            case's.
        refusal: Why it cannot be asked a problem; empty where it can.
        steps_without_lock: Whether its motions let go of Python's lock, so that both strain
            measures may be stepped side by side.
    """

    name: str
    solve: Solve
    has_both_strains: bool = False
    notes: tuple[str, ...] = ()
    can_be_asked: bool = True
    element: Element = Element.LINEAR
    asked: AskedSteps = field(default_factory=AskedSteps)
    only_strain: Strain | None = None
    refusal: Callable[[Problem], str] = lambda _problem: ""
    steps_without_lock: bool = False

    def strains_of(self, case_strain: Strain) -> tuple[Strain, ...]:
        """Which strain measures it is asked for on a case of one of them."""
        if self.has_both_strains:
            return tuple(Strain)
        return (self.only_strain or case_strain,)


def fastsim_candidate(
    *,
    method: Method = Method.NEWTON,
    element: Element = Element.LINEAR,
    device: str = CORE,
    precision: Precision = Precision.DOUBLE,
    multirate: bool = False,
) -> Candidate:
    """fastsim, which solves with both strain measures.

    Args:
        method: How it looks for equilibrium.
        element: Linear tetrahedra, plain or smoothed.
        device: Device of explicit steps: "cpu" is the compiled core; others find equilibrium by
            dynamic relaxation.
        precision: Precision of a motion's steps.
        multirate: Steps of several lengths in a motion.

    Raises:
        DeviceUnavailableError: There is no such device, or Warp is not installed.
    """
    from palpate.fastsim.gpu.devices import check_device

    device = check_device(device)
    used = method if device == CORE else Method.RELAXATION
    return Candidate(
        name_of(element, device),
        partial(
            run_fastsim,
            method=used,
            element=element,
            device=device,
            precision=precision,
            multirate=multirate,
        ),
        has_both_strains=True,
        element=element,
        # Warp's launches come from one thread.
        steps_without_lock=device == CORE,
    )


def condensed_candidate(*, element: Element = Element.LINEAR) -> Candidate:
    """Fastsim's condensed linear model, which solves with linear strain alone.

    Args:
        element: Linear tetrahedra, plain or smoothed.
    """
    return Candidate(
        name_of(element, model=CONDENSED),
        partial(run_condensed, element=element),
        element=element,
        only_strain=Strain.LINEAR,
        refusal=condensed_refusal,
    )


def linear_candidate(element: Element) -> Candidate:
    """The condensed linear model's result, also where it is judged by Green strain."""

    def solve(problem: Problem, _strain: Strain, progress: Progress) -> State:
        return run_condensed(problem, Strain.LINEAR, progress, element=element)

    return Candidate(name_of(element, model=CONDENSED), solve, element=element)


def candidates_for(
    command: str | None,
    time_limit: float,
    elements: Elements | None = None,
    *,
    integrator: Integrator | None = None,
    time_step: float | None = None,
    iterations: int | None = None,
    device: str = CORE,
    precision: Precision = Precision.DOUBLE,
    is_condensed: bool = False,
) -> list[Candidate]:
    """Fastsim by element, or the program of a command line.

    Args:
        command: The program; fastsim where None.
        time_limit: Time limit of the program [s].
        elements: Elements of fastsim, or the one that the program is judged by; linear where None.
        integrator: Scheme that the program is judged by; see `OutsideSimulator`.
        time_step: Time step that the program is asked for instead of the case's [s].
        iterations: Number for {iterations} in its command.
        device: Device of fastsim's explicit steps; see `fastsim_candidate`.
        precision: Precision of those steps.
        is_condensed: Whether fastsim's condensed linear model solves instead.

    Raises:
        InputError: The command line cannot be used, or an element or device goes with it.
    """
    if command is None:
        if (integrator, time_step, iterations) != (None, None, None):
            raise InputError(
                "--integrator, --time-step and --iterations are of another simulator: fastsim "
                "takes central differences with the case's step; give --simulator"
            )
        chosen = Elements.LINEAR if elements is None else elements
        if is_condensed:
            if device != CORE:
                raise InputError("--device is of explicit steps; the condensed model has none")
            return [condensed_candidate(element=element) for element in chosen.each]
        return [
            fastsim_candidate(element=element, device=device, precision=precision)
            for element in chosen.each
        ]
    if is_condensed:
        raise InputError("--with is of fastsim; another simulator is named by --simulator alone")
    if device != CORE:
        raise InputError("--device is of fastsim; another simulator has its own: leave it out")
    if elements is Elements.BOTH:
        raise InputError("element = both: is of fastsim; say which one another simulator has")
    program = OutsideSimulator(command, time_limit, iterations, integrator, time_step)
    return [outside_candidate(program, (elements or Elements.LINEAR).each[0])]


def candidate_name(name: str) -> str:
    """A candidate's name for people, not taken for one of the reference's own labels."""
    shown = visible(name)
    return f"{shown} (candidate)" if shown.casefold().startswith(REFERENCE) else shown


def outside_candidate(simulator: OutsideSimulator, element: Element = Element.LINEAR) -> Candidate:
    """A program that reads a case folder and writes a result, judged by an element."""
    name = candidate_name(simulator.name)

    def solve(problem: Problem, strain: Strain, progress: Progress) -> State:
        given = simulator.stepped(problem)
        result, seconds = simulator.run(given, strain, progress)
        if simulator.iterations is not None:
            about = {"iterations": simulator.iterations, **result.about}
            result = dataclasses.replace(result, about=about)
        return state_of_result(
            result,
            given,
            name,
            strain,
            element=element,
            asked=simulator.asked,
            seconds=seconds,
            details={"command": simulator.command},
        )

    note = f"Simulator: `{simulator.command}`, at most {simulator.time_limit:g} s."
    return Candidate(name, solve, notes=(note,), element=element, asked=simulator.asked)


def result_candidate(
    path: str | Path, element: Element | None = None, asked: AskedSteps | None = None
) -> Candidate:
    """A result file that somebody brings.

    Args:
        path: Path of the file.
        element: The tetrahedra that it is judged by; linear where None.
        asked: The scheme and step that it is judged by; the case's where None.
    """
    name, kind, steps = candidate_name(Path(path).stem), element or Element.LINEAR, asked

    def solve(problem: Problem, strain: Strain, progress: Progress) -> State:
        progress(f"reading {path}")
        result = read_result(path, most_bytes=room_for_result(problem))
        return state_of_result(result, problem, name, strain, element=kind, asked=steps)

    return Candidate(
        name,
        solve,
        notes=(f"Result: {Path(path).name}.",),
        can_be_asked=False,
        element=kind,
        asked=steps or AskedSteps(),
    )


def function_candidate(
    function: Function, element: Element | None = None, asked: AskedSteps | None = None
) -> Candidate:
    """A function as a candidate; whatever it raises is its failure, SystemExit among it.

    It gets a copy of the problem, so that nothing that it changes there is judged by. An interrupt
    that comes as a signal while it runs is the user's, and ends the program; `os._exit` does too.
    """
    name = candidate_name(getattr(function, "__name__", type(function).__name__))
    kind, steps = element or Element.LINEAR, asked or AskedSteps()

    def solve(problem: Problem, strain: Strain, progress: Progress) -> State:
        progress(f"{name}, {strain} strain, {problem.mesh.num_cells} cells")
        given, has_returned = copy.deepcopy(steps.stepped(problem)), False
        with _noted_interrupts() as interrupts:
            try:
                displacement = function(given)
                has_returned = True
                # Read here: it may compute its numbers when it is asked for them.
                displacement = _numbers(displacement, name)
            except BaseException as error:
                if interrupts or (has_returned and isinstance(error, ResultFileError)):
                    raise
                raise CandidateFailedError(f"{name}: {type(error).__name__}: {error}") from error
        return _state(displacement, problem, name, strain, kind, steps)

    return Candidate(name, solve, element=kind, asked=steps)


@contextmanager
def _noted_interrupts() -> Iterator[list[int]]:
    """A list to which each SIGINT is added that arrives meanwhile, before it is handled as ever."""
    noted: list[int] = []
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield noted  # no interrupt is raised here
        return
    handle = handler

    def note(number: int, frame: FrameType | None) -> None:
        noted.append(number)
        handle(number, frame)

    signal.signal(signal.SIGINT, note)
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, handler)


def solution_candidate(
    solution: str | Path | State | ArrayLike,
    element: Element | None = None,
    asked: AskedSteps | None = None,
) -> Candidate:
    """A solution as a candidate: a result file, a state, or displacements in memory.

    It is judged by the element, scheme and step that are given, not by what a state says it has.
    """
    kind, steps = element or Element.LINEAR, asked or AskedSteps()
    if isinstance(solution, str | Path):
        return result_candidate(solution, kind, steps)
    if isinstance(solution, State):
        # Its own label would be taken for the reference's.
        name = candidate_name(solution.label)
        given: ArrayLike = (
            solution.displacement if solution.trajectory is None else solution.displacements
        )
    else:
        name, given = "solution", solution

    def solve(problem: Problem, strain: Strain, progress: Progress) -> State:
        progress(f"{name} is looked at")
        return _state(given, problem, name, strain, kind, steps, like=solution)

    return Candidate(name, solve, can_be_asked=False, element=kind, asked=steps)


def _state(
    displacement: ArrayLike, problem: Problem, name: str, strain: Strain,
    element: Element, asked: AskedSteps, like: object = None,
) -> State:  # fmt: skip
    """Displacements as a state, checked as those of a result file are."""
    num_points = problem.mesh.num_points
    span = problem.time
    shape = (num_points, 3) if span is None else (span.num_outputs + 1, num_points, 3)
    values = _numbers(displacement, name)
    if values.shape != shape:
        raise ResultFileError(
            name, f"displacement has shape {values.shape}; this case needs {shape} [m]"
        )
    times = None if span is None else span.output_times
    about: dict[str, object] = {}
    if isinstance(like, State):
        about["element"] = like.element.value
        if like.steps is not None:
            about |= {"integrator": like.steps.integrator, "time_step": like.steps.time_step}
        if like.tool_forces is not None:
            about["tool_forces"] = like.tool_forces
    values = values.reshape(-1, num_points, 3)
    result = ResultFile(Path(name), values, are_positions=False, times=times, about=about)
    return state_of_result(result, problem, name, strain, element=element, asked=asked)


def _numbers(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """Plain real numbers as an array of its own.

    Raises:
        ResultFileError: They are none: complex, truth values, text, objects, masked, with a unit.
    """
    for attribute in ("units", "unit"):
        if hasattr(values, attribute):
            raise ResultFileError(
                name,
                f"displacement is in {getattr(values, attribute)}: give plain numbers in metres",
            )
    if _is_masked(values):
        raise ResultFileError(
            name, "displacement is a masked array: fill what is masked, or give its `.data`"
        )
    try:
        array = np.array(values)
    except Exception as error:
        raise ResultFileError(name, f"no array of numbers ({error})") from error
    if array.dtype.kind not in "fiu":
        raise ResultFileError(
            name, f"displacement holds {array.dtype}: give real numbers, as an array of float64"
        )
    return array.astype(np.float64)


def _is_masked(values: object, depth: int = 3) -> bool:
    """Whether something is a masked array, or a list of such."""
    if isinstance(values, list | tuple) and depth:
        return any(_is_masked(value, depth - 1) for value in values)
    return isinstance(values, np.ma.MaskedArray)
