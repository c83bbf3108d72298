"""Solve a case with the candidate, find its reference, and judge every check."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference import availability
from palpate.validation.candidates.candidate import Candidate, fastsim_candidate
from palpate.validation.case import Case
from palpate.validation.case.schema import CheckSpec
from palpate.validation.diagnosis import Diagnosis, diagnose
from palpate.validation.judging.askable import is_answered, missing_check
from palpate.validation.judging.case_judge import CaseJudge
from palpate.validation.judging.checks import skipped_check
from palpate.validation.judging.own_steps import (
    are_the_cases,
    notes_on_damping,
    with_own_steps,
)
from palpate.validation.judging.precision import PrecisionGrant
from palpate.validation.judging.record import all_metrics, case_name, error_lengths, provenance_of
from palpate.validation.judging.results import CaseResult, CheckResult, Judged
from palpate.validation.judging.together import together
from palpate.validation.judging.truth_request import truth_request
from palpate.validation.metrics.possible_motion import state_out_of_reach, unmeasurable_state
from palpate.validation.quoting import own_words
from palpate.validation.references.geometry import LIVE_SECONDS, geometry_notes, with_geometry
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.references.statics import solve_live
from palpate.validation.references.stored import (
    MissingReferenceError,
    StaleReferenceError,
    load_stored,
    references_folder,
)
from palpate.validation.states import (
    CandidateFailedError,
    ExitCode,
    Precision,
    Progress,
    State,
    Verdict,
    gravest,
    in_silence,
)

# A candidate that takes longer [s] is not asked again, when its answer is diagnosed.
_QUICK = 10.0
# Added to what a check found.
VACUOUS = " (vacuous: an answer in which nothing moves passes it)"


def judge_case(
    case: Case,
    *,
    live: bool = False,
    candidate: Candidate | Sequence[Candidate] | None = None,
    diagnoses: bool = True,
    precision: Precision | None = None,
    progress: Progress = in_silence,
) -> CaseResult:
    """Judge a candidate on a case, or several beside one another.

    Args:
        case: The case; it needs at least one check.
        live: Solve the reference here when FEniCSx is installed; a stored one otherwise.
        candidate: Who is judged, one or more of different names; fastsim where None.
        diagnoses: Whether to look for what explains an answer that fails.
        precision: Granted to the candidate; what the case grants where None.
        progress: Called with one line for each thing done.

    Raises:
        InputError: The case cannot be used, has no check for this candidate, its stored reference
            is missing or stale, or the candidate's result cannot be read.
    """
    if not case.checks:
        raise InputError(f"{case.path.name}: no [[check]]: nothing would be judged; add one")
    progress(f"case {case.name}: {case.title}")
    progress(f"mesh {case.mesh.origin}")
    given = fastsim_candidate() if candidate is None else candidate
    everybody = [given] if isinstance(given, Candidate) else list(given)
    for judged in everybody:
        if missing := missing_check(case, judged):
            raise InputError(f"{case.path.name}: {missing}; add one")
    elements = {judged.element for judged in everybody}
    references = find_references(case, live=live, elements=elements, progress=progress)
    return together(
        [
            _judge_one(
                case,
                judged,
                references,
                diagnoses=diagnoses,
                precision=precision,
                progress=progress,
            )
            for judged in everybody
        ]
    )


def _judge_one(
    case: Case,
    judged: Candidate,
    references: ReferenceSet,
    *,
    diagnoses: bool,
    precision: Precision | None,
    progress: Progress,
) -> CaseResult:
    """One candidate with every reference of the case."""
    problem, element = case.problem, judged.element
    notes = [f"Mesh: {case.mesh.origin}.", *judged.notes]
    notes.extend([f"Reference: {references.origin}.", *references.remarks])
    notes.extend(geometry_notes(case, references))
    candidates: dict[Strain, State] = {}
    failures: dict[Strain, str] = {}
    said: dict[str, Any] = {}
    strains = judged.strains_of(case.strain)
    for strain, answer in _answers(judged, problem, strains, progress).items():
        if isinstance(answer, CandidateFailedError):
            failures[strain] = case.spec.units.in_case_units(str(answer))
            continue
        notes.extend(answer.remarks)
        unmeasurable = unmeasurable_state(answer)
        impossible = unmeasurable or state_out_of_reach(problem, answer)
        if impossible:
            failures[strain] = impossible
        if not unmeasurable:
            candidates[strain] = answer
        said.update(answer.says)
        element = answer.element
    references = with_own_steps(problem, candidates, references.of_element(element), progress)
    notes.extend(note for note in references.remarks if note not in notes)
    notes.extend(notes_on_damping(problem, candidates))
    notes.extend(f"{why} ({strain} strain)." for (_, strain), why in references.failures.items())
    if said:
        notes.append(own_words(judged.name, said))

    grant = PrecisionGrant(case, references, precision)
    notes.extend(grant.notes)
    judge = CaseJudge(case, references, grant.checks())
    checks = [
        grant.with_remark(
            spec, _judged(judge, spec, judged, candidates.get(judge.strain_of(spec)), failures)
        )
        for spec in judge.checks
    ]
    unseen = judge.unseen()
    if unseen:
        notes.append(
            f"No check of this case turns red when the answer is wrong like this: "
            f"{', '.join(unseen)}. Add a check of displacement_l2."
        )
    found: list[Diagnosis] = []
    failed = {check.strain for check in checks if check.verdict is Verdict.FAILED}
    # Slips are looked for with the case's own steps.
    failed -= {s for s, answer in candidates.items() if not are_the_cases(problem, answer.steps)}
    for strain in (s for s in candidates if diagnoses and s in failed):
        progress(f"diagnosis, {strain} strain")
        found.append(_diagnosed(judge, judged, candidates[strain]))
    notes.extend(f"Diagnosis, {each.strain} strain: {each}." for each in found)
    verdict, why = _verdict(checks)
    notes.extend(why)
    states = (*candidates.values(), *references.states.values())
    return CaseResult(
        name=case.name,
        title=case.title,
        verdict=verdict,
        checks=tuple(checks),
        states=states,
        problem=problem,
        candidates=(Judged(judged.name, verdict, element),),
        metrics=all_metrics(case, candidates, references),
        provenance=provenance_of(case, references),
        notes=tuple(notes),
        published=case.spec.published,
        error_fields=error_lengths(candidates, references),
        case_text=case.text,
        candidate_says=said,
        evidence=case.spec.evidence.model_dump(exclude_defaults=True),
        unseen=unseen,
        diagnoses=tuple(found),
    )


def _answers(
    judged: Candidate, problem: Problem, strains: Sequence[Strain], progress: Progress
) -> dict[Strain, State | CandidateFailedError]:
    """With each strain measure; motions side by side where the candidate can."""

    def answer(strain: Strain) -> State | CandidateFailedError:
        try:
            return judged.solve(problem, strain, progress)
        except CandidateFailedError as error:
            return error

    if problem.time is None or not judged.steps_without_lock:
        return {strain: answer(strain) for strain in strains}
    with ThreadPoolExecutor(len(strains)) as pool:
        return dict(zip(strains, pool.map(answer, strains), strict=True))


def _diagnosed(judge: CaseJudge, candidate: Candidate, answer: State) -> Diagnosis:
    """What would explain an answer; one of a quick candidate by asking it again too."""

    def ask(problem: Problem) -> Points:
        return candidate.solve(problem, answer.strain, in_silence).displacement

    may_ask = candidate.can_be_asked and answer.seconds < _QUICK
    (other,) = (strain for strain in Strain if strain is not answer.strain)
    return diagnose(
        judge.problem,
        answer,
        judge.references.same_mesh(answer.strain),
        other_strain=judge.references.same_mesh(other),
        ask=ask if may_ask else None,
        length_unit=judge.case.spec.units.length,
    )


def _judged(
    judge: CaseJudge,
    spec: CheckSpec,
    candidate: Candidate,
    answer: State | None,
    failures: dict[Strain, str],
) -> CheckResult:
    """One check of a candidate, or why it is left out, and whether it says anything."""
    strain = judge.strain_of(spec)
    if not is_answered(spec, judge.case, candidate):
        (asked,) = candidate.strains_of(judge.case.strain)
        why = f"{candidate.name} is asked for {asked} strain only"
        return skipped_check(spec, strain, why)
    has_failed = strain in failures
    found = judge.check(spec, None if has_failed else answer, failures.get(strain, ""))
    if not judge.is_vacuous(spec):
        return found
    has_remark = found.verdict is Verdict.PASSED and not spec.is_of_truth_alone
    remark = VACUOUS if has_remark else ""
    return dataclasses.replace(found, is_vacuous=True, message=found.message + remark)


def _verdict(checks: list[CheckResult]) -> tuple[Verdict, list[str]]:
    """The gravest of the checks; checks that any answer passes are no support."""
    verdict = gravest([check.verdict for check in checks])
    if verdict is not Verdict.PASSED:
        return verdict, []
    if any(check.verdict is Verdict.PASSED and not check.is_vacuous for check in checks):
        return verdict, []
    return Verdict.INCONCLUSIVE, [
        "Inconclusive: an answer in which nothing moves passes every check that was made. Let a "
        "load or a tool move the body, and check displacement_l2."
    ]


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
        live: See `judge_case`.
        elements: On the same mesh, which are solved here; a file has what it has.
        progress: Called with one line for each thing done.

    Raises:
        InputError: Neither is to be had.
    """
    problem = case.problem
    stored: ReferenceSet | None = None
    trouble: InputError | None = None
    try:
        stored = _load_stored(case)
    except (MissingReferenceError, StaleReferenceError) as error:
        trouble = error
    if live and availability.is_available():
        if trouble is not None:
            progress(f"left aside: {trouble}")
        wanted = {spec.against for spec in case.checks}
        found = solve_live(
            problem,
            progress,
            stored=stored,
            wanted=wanted,
            elements=elements,
            request=truth_request(case),
            has_stress=any(spec.about.is_of_integrals for spec in case.checks),
        )
        return found if stored is not None else _with_geometry(case, found, progress)
    if stored is not None:
        progress(f"reference {stored.origin}")
        return stored
    if trouble is not None:
        raise trouble
    how = (
        "FEniCSx is not installed here: FENICSX=apt or FENICSX=wheel adds it (see README)"
        if live
        else "solve it here with --live, which needs FEniCSx (see README)"
    )
    raise MissingReferenceError(f"{case.name}: no reference is stored for this case; {how}")


def _with_geometry(case: Case, found: ReferenceSet, progress: Progress) -> ReferenceSet:
    """What the true surface adds, for the strain measures that are held against the truth.

    A motion's may take as long as a run of its truth.
    """
    asked = {s.strain or case.strain for s in case.checks if s.against == "truth"}
    truths = [truth for strain in asked if (truth := found.truth(strain)) is not None]
    seconds = max([LIVE_SECONDS, *(truth.seconds for truth in truths)])
    return with_geometry(
        case, found, progress, strains=asked, request=truth_request(case), seconds=seconds
    )


def _load_stored(case: Case) -> ReferenceSet | None:
    """A built-in case's reference; of one's own case, what lies in `references` beside it.

    None of a body that follows another law than its case's.
    """
    if case.other_law is not None:
        return None
    folder = references_folder(case.beside)
    if not case.is_builtin and not (folder / f"{case.name}.npz").is_file():
        return None
    return load_stored(case.name, case.problem, folder=folder, called=case_name(case))


def exit_code(results: list[CaseResult]) -> int:
    """0 passed, 1 failed, 3 inconclusive; the gravest case decides."""
    return ExitCode[gravest([result.verdict for result in results]).name]
