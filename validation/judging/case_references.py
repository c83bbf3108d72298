"""What a result of a case is judged against: the reference that is stored, or solved here.

On the same mesh it is stepped as the caller asks for it, so that what is left is the solver's.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from typing import TYPE_CHECKING

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference import availability
from palpate.reference.errors import ReferenceFailedError
from palpate.reference.schemes import Integrator, Steps
from palpate.validation.candidates.equations import AskedSteps
from palpate.validation.case import Case
from palpate.validation.case.regions import part_of_check
from palpate.validation.judging.checks import has_same_mesh_check, metric_of_bar
from palpate.validation.metrics import Part
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.references.stored import (
    MissingReferenceError,
    StaleReferenceError,
    load_stored,
    references_folder,
)
from palpate.validation.states import Progress

if TYPE_CHECKING:
    from palpate.validation.references.adaptive_truth import TruthRequest


def find_references(
    case: Case,
    *,
    live: bool,
    elements: Collection[Element] = (Element.LINEAR,),
    progress: Progress,
) -> ReferenceSet:
    """The reference of a case: solved here, or the stored one.

    Args:
        case: The case.
        live: Solve the reference here when FEniCSx is installed; a stored one otherwise.
        elements: On the same mesh, which are solved here; a file has what it has.
        progress: Called with one line for each thing done.

    Raises:
        InputError: Neither is to be had.
    """
    problem = case.problem  # what is wrong with the case is said before what is wrong with a file
    is_solved_here = live and availability.is_available()
    try:
        stored = _load_stored(case)
    except (MissingReferenceError, StaleReferenceError) as error:
        if not is_solved_here:
            raise
        progress(f"left aside: {error}")
        stored = None
    if is_solved_here:
        return _solve_here(case, problem, stored, elements, progress)
    if stored is not None:
        progress(f"reference {stored.origin}")
        return stored
    how = (
        "FEniCSx is not installed here: FENICSX=apt or FENICSX=wheel adds it (see README)"
        if live
        else "solve it here with --live, which needs FEniCSx (see README)"
    )
    raise MissingReferenceError(f"{case.name}: no reference is stored for this case; {how}")


def is_truth_stored(case: Case) -> bool:
    """Whether there is a valid stored truth of the case, on whichever mesh it is judged."""
    try:
        return _load_stored(dataclasses.replace(case, near_tool=None)) is not None
    except (MissingReferenceError, StaleReferenceError):
        return False


def is_to_be_solved(case: Case) -> bool:
    """Whether its law or contact is not the file's, and no truth is stored for that."""
    return case.is_changed and not is_truth_stored(case)


def _load_stored(case: Case) -> ReferenceSet | None:
    """A built-in case's reference; of one's own case, what lies in `references` beside it.

    Under another law than the case's what lies there for that law; None of other contact, or of
    small cells near tools.
    """
    if case.other_contact is not None or case.near_tool is not None:
        return None
    folder = references_folder(case.beside)
    is_optional = case.other_law is not None or not case.is_builtin
    if is_optional and not (folder / f"{case.name}.npz").is_file():
        return None
    return load_stored(case.name, case.problem, folder=folder, called=case.called)


def _solve_here(
    case: Case,
    problem: Problem,
    stored: ReferenceSet | None,
    elements: Collection[Element],
    progress: Progress,
) -> ReferenceSet:
    """Solved now; where nothing is stored with what the true surface adds to the bars."""
    from palpate.validation.references.geometry import LIVE_SECONDS, with_geometry
    from palpate.validation.references.statics import solve_live

    request = truth_request(case)
    wanted = {spec.against for spec in case.checks}
    found = solve_live(
        problem,
        progress,
        stored=stored,
        wanted=wanted,
        # On small cells it takes long, and is that of the case itself.
        has_truth=case.near_tool is None or "truth" in wanted,
        elements=elements,
        request=request,
        has_stress=any(spec.about.is_of_integrals for spec in case.checks),
    )
    if stored is not None:
        return found
    asked = {s.strain or case.strain for s in case.checks if s.against == "truth"}
    truths = [truth for strain in asked if (truth := found.truth(strain)) is not None]
    # A motion's may take as long as a run of its truth.
    seconds = max([LIVE_SECONDS, *(truth.seconds for truth in truths)])
    return with_geometry(case, found, progress, strains=asked, request=request, seconds=seconds)


def truth_request(case: Case) -> TruthRequest:
    """What a case asks of its truth: bar and budget, for the metrics whose bars its checks use.

    Raises:
        InputError: A check names a part of the body that is not there.
    """
    from palpate.validation.references.adaptive_truth import TruthRequest

    asked, problem, units = case.spec.truth, case.problem, case.spec.units
    metrics: dict[Strain, set[str]] = {strain: set() for strain in Strain}
    parts: dict[Strain, list[tuple[str, Part]]] = {strain: [] for strain in Strain}
    for number, spec in enumerate(case.checks, start=1):
        if spec.against != "truth":
            continue
        strain = spec.strain or case.strain
        part = part_of_check(spec, problem, units, f"check {number}")
        if part is None or not spec.about.is_of_integrals:
            metrics[strain].add(metric_of_bar(spec))
        else:
            parts[strain].append((metric_of_bar(spec), part))
    return TruthRequest(asked.bar, 60.0 * asked.minutes, asked.memory, metrics, parts=parts)


def are_the_cases(problem: Problem, steps: Steps | None) -> bool:
    """Whether a candidate's steps are those of the case: its time step by central differences."""
    if steps is None or problem.time is None:
        return True
    return steps == Steps(Integrator.CENTRAL_DIFFERENCES, problem.time.time_step or steps.time_step)


def with_asked_steps(
    case: Case,
    strains: Collection[Strain],
    references: ReferenceSet,
    asked: AskedSteps,
    progress: Progress,
) -> ReferenceSet:
    """The set with the same mesh stepped as the caller asks: what remains is the solver's.

    Args:
        case: The case.
        strains: The strain measures of the candidate's results.
        references: For its element; returned unchanged where the case's own steps are asked for.
        asked: The scheme, the step, and the time limit of each run.
        progress: Called with one line for each run.
    """
    steps = asked.of(case.problem)
    for strain in strains:
        if steps is None or not has_same_mesh_check(case, strain):
            continue
        from palpate.validation.references.runs import solve_by_steps

        note = f"Same mesh, {strain} strain: the reference solved here by {steps}, as asked for."
        state, failure = None, ""
        try:
            state = solve_by_steps(
                case.problem, strain, steps, progress,
                element=references.element, time_limit=asked.time_limit,
            )  # fmt: skip
        except (ReferenceFailedError, InputError) as error:
            failure = f"the same mesh by {steps}: {error}"
        references = references.with_same_mesh(strain, state, note, failure)
    return references
