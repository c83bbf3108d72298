"""The simulators, and one function for all problems: statics or motion, with tools or not."""

from __future__ import annotations

import dataclasses
from enum import StrEnum
from typing import Literal, TypeAlias, TypeVar

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain, TimeSpan
from palpate.reference.result import Formulation
from palpate.validation.states import Elements, Method, Progress, State, in_silence


class Simulator(StrEnum):
    """The simulator: fastsim, its condensed linear model, or the reference, which needs FEniCSx.

    >>> import palpate
    >>> palpate.Simulator("reference")
    <Simulator.REFERENCE: 'reference'>
    """

    FASTSIM = "fastsim"
    CONDENSED = "condensed"
    REFERENCE = "reference"


StrainName: TypeAlias = Strain | Literal["linear", "green"]
SimulatorName: TypeAlias = Simulator | Literal["fastsim", "condensed", "reference"]
MethodName: TypeAlias = Method | Literal["newton", "relaxation"]
ElementName: TypeAlias = Element | Literal["linear", "smoothed"]
ElementsName: TypeAlias = Elements | Literal["linear", "smoothed", "both"]
FormulationName: TypeAlias = Formulation | Literal["displacement", "mixed"]
_Choice = TypeVar("_Choice", bound=StrEnum)


def solve(
    problem: Problem,
    *,
    with_: SimulatorName = Simulator.FASTSIM,
    strain: StrainName = Strain.GREEN,
    degree: int = 1,
    method: MethodName = Method.NEWTON,
    formulation: FormulationName | None = None,
    element: ElementName = Element.LINEAR,
    device: str = "cpu",
    multirate: bool = False,
    progress: Progress = in_silence,
) -> State:
    """Solve a problem: statics or motion, with tools or without.

    Args:
        problem: With a time span it is a motion from rest, otherwise equilibrium.
        with_: fastsim; "condensed", its condensed linear model, for linear strain and statics; or
            the reference (UFL on FEniCSx, which it needs).
        strain: "linear" (engineering strain), or "green": the problem's law at finite strain.
        degree: Degree of the reference's elements, 1 to 3; for a motion 1 or 2.
        method: How fastsim finds equilibrium: Newton's method, or dynamic relaxation, which
            solves no equations.
        formulation: The reference's equilibrium: displacements alone, or also pressure, with degree
            2 or 3, for tissue near incompressibility. None adds pressure from Poisson's ratios of
            0.49 on, if the degree is 2 or 3.
        element: Linear tetrahedra, or the same smoothed over edges and nodes, which are nearer the
            truth on the same mesh; for the reference with degree 1.
        device: For fastsim's explicit steps, in motions and relaxation: "cpu" is the compiled core;
            "cuda:0" a GPU, "warp:cpu" its kernels on the processor, both with the extra `gpu`.
        multirate: Steps of several lengths in a motion of fastsim, where they save work: small
            cells make more of them than large ones. Contact of tools is then a penalty over
            facets. The state's details name the classes: numbers of cells and steps [s].
        progress: Called with a line of text from time to time.

    Returns:
        Displacement [m], (num_points, 3), with volume, area, smallest det F and, for a motion, the
        `trajectory`.

    Raises:
        InputError: A name is not known, or this simulator cannot solve such a problem.
        CandidateFailedError: fastsim found no solution; the message says why.
        ReferenceFailedError, ReferenceUnavailableError: The reference failed or is not installed.

    >>> import palpate
    >>> problem = palpate.load_case("block").problem
    >>> green = palpate.solve(problem)
    >>> linear = palpate.solve(problem, strain="linear")
    >>> green.displacement.shape == problem.mesh.points.shape
    True
    >>> bool(linear.max_displacement > green.max_displacement)
    True
    >>> palpate.solve(problem, element="smoothed").label
    'fastsim (smoothed)'
    """
    if degree not in (1, 2, 3):
        raise InputError(f"degree = {degree}: use 1, 2 or 3")
    simulator = known_word(Simulator, with_, "with_")
    used = known_word(Strain, strain, "strain")
    way = known_word(Method, method, "method")
    form = None if formulation is None else known_word(Formulation, formulation, "formulation")
    kind = known_word(Element, element, "element")
    _require_possible(problem, simulator, way, form)
    if multirate and (simulator is not Simulator.FASTSIM or problem.time is None):
        raise InputError("steps of several lengths (multirate) are of fastsim's motions")
    if device != "cpu":
        _require_stepped(problem, simulator, way, device)
    # Both import pydantic and meshio, which `import palpate` and --help do without.
    if simulator is Simulator.REFERENCE:
        from palpate.validation.references.runs import solve_reference

        found = solve_reference(problem, used, degree, progress, formulation=form, element=kind)
        return _of(problem, found)
    if simulator is Simulator.CONDENSED:
        from palpate.validation.candidates.fastsim import run_condensed

        found = run_condensed(problem, used, progress, element=kind)
        return _of(problem, found)
    from palpate.validation.candidates.candidate import fastsim_candidate

    candidate = fastsim_candidate(method=way, element=kind, device=device, multirate=multirate)
    return _of(problem, candidate.solve(problem, used, progress))


def _require_possible(
    problem: Problem, simulator: Simulator, method: Method, formulation: Formulation | None
) -> None:
    if formulation is Formulation.MIXED and simulator is not Simulator.REFERENCE:
        raise InputError(
            'formulation = "mixed" is the reference\'s: solve with the reference, degree 2'
        )
    if method is Method.RELAXATION and simulator is not Simulator.FASTSIM:
        raise InputError('method = "relaxation" is fastsim\'s: leave it out, or solve with fastsim')
    if method is Method.RELAXATION and problem.time is not None:
        raise InputError(
            'method = "relaxation" finds equilibrium, and this problem is a motion: leave it out, '
            "or take the time span away"
        )


def _require_stepped(problem: Problem, simulator: Simulator, method: Method, device: str) -> None:
    if simulator is not Simulator.FASTSIM:
        of = "reference" if simulator is Simulator.REFERENCE else "condensed model"
        raise InputError(f"device = {device!r} is fastsim's: leave it out for the {of}")
    if problem.time is None and method is not Method.RELAXATION:
        raise InputError(
            f"device = {device!r} makes explicit steps, and Newton's method has none: say "
            'method = "relaxation" with it, or device = "cpu"'
        )


def _of(problem: Problem, state: State) -> State:
    """A state that knows what was solved, and so does its motion."""
    motion = state.trajectory and dataclasses.replace(state.trajectory, problem=problem)
    return dataclasses.replace(state, problem=problem, trajectory=motion)


def simulate(
    problem: Problem,
    *,
    time: TimeSpan | None = None,
    with_: SimulatorName = Simulator.FASTSIM,
    strain: StrainName = Strain.GREEN,
    degree: int = 1,
    element: ElementName = Element.LINEAR,
    device: str = "cpu",
    multirate: bool = False,
    progress: Progress = in_silence,
) -> State:
    """Solve a motion from rest, over the problem's time span or another.

    Args:
        problem: See `solve`.
        time: Time span instead of the problem's own.
        with_: See `solve`, also for the other errors.
        strain: See `solve`.
        degree: See `solve`.
        element: See `solve`.
        device: See `solve`.
        multirate: See `solve`.
        progress: See `solve`.

    Returns:
        The last state; its `trajectory` has all of them, its `tool_forces` the forces on tools.

    Raises:
        InputError: There is no time span.

    >>> import palpate
    >>> problem = palpate.load_case("block").problem
    >>> moved = palpate.simulate(problem, time=palpate.TimeSpan(end_time=0.1, num_outputs=10))
    >>> moved.trajectory.displacements.shape == (11, problem.mesh.num_points, 3)
    True
    """
    moving = problem if time is None else dataclasses.replace(problem, time=time)
    if moving.time is None:
        raise InputError("the problem has no time span; give time = palpate.TimeSpan(end_time=...)")
    return solve(
        moving,
        with_=with_,
        strain=strain,
        degree=degree,
        element=element,
        device=device,
        multirate=multirate,
        progress=progress,
    )


def known_word(kind: type[_Choice], word: str, option: str) -> _Choice:
    """The member of an enumeration that has this name.

    Raises:
        InputError: There is no such member.
    """
    try:
        return kind(word)
    except ValueError:
        raise InputError(f"{option} = {word!r}: use one of {', '.join(kind)}") from None
