"""Solve a case with the candidate, find its reference, and judge every check."""

from __future__ import annotations

import dataclasses
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.reference.schemes import Steps
from palpate.validation.candidates.candidate import Candidate, fastsim_candidate
from palpate.validation.case import Case
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.case_references import (
    are_the_cases,
    find_references,
    with_asked_steps,
)
from palpate.validation.judging.checks import (
    CaseJudge,
    check_statements,
    has_same_mesh_check,
    unjudged_check,
)
from palpate.validation.judging.near_tools import judge_near_tools
from palpate.validation.judging.precision import PrecisionGrant
from palpate.validation.judging.provenance import provenance_of, time_now
from palpate.validation.judging.results import (
    CaseResult,
    CheckResult,
    Judged,
    MeasuredValues,
    Scope,
    error_name,
    merge_candidates,
)
from palpate.validation.metrics import CATALOGUE, measure
from palpate.validation.metrics.validity import state_out_of_reach, unmeasurable_state
from palpate.validation.quoting import own_words
from palpate.validation.references.reference_set import SCALARS, ReferenceSet
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
from palpate.validation.versions import version_of

if TYPE_CHECKING:
    from palpate.validation.diagnosis import Diagnosis

# A candidate that takes longer [s] is not run again when its result is diagnosed.
_QUICK = 10.0
# Added to what a check found.
VACUOUS = " (vacuous: a result in which nothing moves passes it)"
# A process needs a second to begin, as long as a few cases take.
_CASES_OF_A_PROCESS = 6
_MOST_PROCESSES = 4


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
        candidate: The candidate, or several of different names; fastsim where None.
        diagnoses: Whether to look for what explains a result that fails.
        precision: The precision granted to the candidate; what the case grants where None.
        progress: Called with one line for each thing done.

    Raises:
        InputError: The case cannot be used, has no check for this candidate, its stored reference
            is missing or stale, the candidate's result cannot be read, or steps are asked for that
            the case or the reference cannot take.
    """
    if not case.checks:
        raise InputError(f"{case.path.name}: no [[check]]: nothing would be judged; add one")
    given = fastsim_candidate() if candidate is None else candidate
    everybody = [given] if isinstance(given, Candidate) else list(given)
    if case.near_tool is not None and not live:

        def judge_one(of: Case, judged: Sequence[Candidate], is_solved_here: bool) -> CaseResult:
            return judge_case(
                of, live=is_solved_here, candidate=judged, diagnoses=diagnoses and is_solved_here,
                precision=precision, progress=progress,
            )  # fmt: skip

        return judge_near_tools(case, everybody, judge_one)
    progress(f"case {case.name}: {case.title}")
    case.build(progress)
    progress(f"mesh {case.mesh_origin}")
    for judged in everybody:
        if missing := _missing_check(case, judged):
            raise InputError(f"{case.path.name}: {missing}; add one")
        judged.asked.stepped(case.problem)
        if any(has_same_mesh_check(case, each) for each in judged.strains_of(case.strain)):
            judged.asked.require_affordable(case.problem)
    elements = {judged.element for judged in everybody}
    find = partial(find_references, case, live=live, elements=elements, progress=progress)
    references = None if live else find()
    # Before a reference is solved: a simulator that gives no result needs none.
    solved = [_solutions(judged, case, progress) for judged in everybody]
    if references is None:
        is_needed = any(spec.is_of_truth_alone for spec in case.checks) or any(
            isinstance(of, State) for solutions in solved for of in solutions.values()
        )
        references = find() if is_needed else ReferenceSet({}, {}, "not solved, for no result came")
    judge_by = partial(
        _judge_one,
        case,
        references=references,
        diagnoses=diagnoses,
        precision=precision,
        progress=progress,
    )
    pairs = zip(everybody, solved, strict=True)
    return merge_candidates([judge_by(judged, solutions) for judged, solutions in pairs])


def _judge_one(
    case: Case,
    judged: Candidate,
    solutions: Mapping[Strain, State | CandidateFailedError],
    *,
    references: ReferenceSet,
    diagnoses: bool,
    precision: Precision | None,
    progress: Progress,
) -> CaseResult:
    """One candidate with every reference of the case."""
    from palpate.validation.references.branches import says_of_branches
    from palpate.validation.references.geometry import geometry_notes

    problem, element, units = case.problem, judged.element, case.spec.units
    notes = [f"Mesh: {case.mesh_origin}.", *judged.notes]
    notes.extend([f"Reference: {references.origin}.", *references.remarks])
    notes.extend(says_of_branches(references.provenance))
    notes.extend(geometry_notes(case, references))
    candidates: dict[Strain, State] = {}
    sent: list[State] = []
    failures: dict[Strain, str] = {}
    said: dict[str, Any] = {}
    for strain, solution in solutions.items():
        if isinstance(solution, CandidateFailedError):
            failures[strain] = units.in_case_units(str(solution))
            continue
        notes.extend(solution.remarks)
        sent.append(solution)
        unmeasurable = unmeasurable_state(solution)
        if not unmeasurable:
            candidates[strain] = solution
        if impossible := unmeasurable or state_out_of_reach(problem, solution):
            failures[strain] = units.in_case_units(impossible)
        said.update(solution.says)
    references = references.of_element(element)
    references = with_asked_steps(case, candidates, references, judged.asked, progress)
    notes.extend(note for note in references.remarks if note not in notes)
    notes.extend(_notes_on_damping(problem, candidates))
    for strain in failures.keys() & candidates.keys():
        basis = references.same_mesh(strain) or references.truth(strain)
        if problem.time is not None and basis is not None:
            from palpate.validation.metrics.motion import departure

            left = departure(problem, candidates[strain], basis)
            failures[strain] += f"; {left}" if left else ""
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
    measured = {check.strain for check in checks if check.verdict is Verdict.FAILED}
    for state in sent:
        checks += check_statements(case, state, element, judged.asked, judge.checks)
    beside: list[MeasuredValues] = []
    if case.spec.measurement:
        from palpate.validation.judging.measured import judge_measurements

        for check, values in judge_measurements(
            case, judged, candidates, failures, references, progress
        ):
            checks.append(check)
            if values is not None:
                beside.append(values)
    unseen = judge.unseen()
    if unseen:
        notes.append(
            f"No check of this case turns red when the result is wrong like this: "
            f"{', '.join(unseen)}. Add a check of displacement_l2."
        )
    found = []
    if diagnoses:
        for strain, solution in candidates.items():
            # Mistakes are looked for with the case's own steps.
            if strain in measured and are_the_cases(problem, solution.steps):
                progress(f"diagnosis, {strain} strain")
                found.append(_diagnosed(judge, judged, solution))
            elif strain in measured:
                notes.append(
                    "No diagnosis: mistakes are looked for in motions by the case's own scheme and "
                    "step alone."
                )
    notes.extend(f"Diagnosis, {each.strain} strain: {each}." for each in found)
    verdict, why = _verdict(checks, judged.asked.of(problem))
    notes.extend(why)
    return CaseResult(
        name=case.name,
        title=case.title,
        verdict=verdict,
        checks=tuple(checks),
        states=(*candidates.values(), *references.states.values()),
        problem=problem,
        candidates=(Judged(judged.name, verdict, element),),
        metrics=_all_metrics(case, candidates, references),
        provenance=provenance_of(case, references, precision),
        notes=tuple(units.in_case_units(note) for note in notes),
        published=case.spec.published,
        error_fields=_error_lengths(candidates, references),
        case_text=case.text,
        candidate_says=said,
        evidence=case.spec.evidence.model_dump(exclude_defaults=True),
        unseen=unseen,
        diagnoses=tuple(found),
        measured=tuple(beside),
        units=units,
    )


def _solutions(
    judged: Candidate, case: Case, progress: Progress
) -> dict[Strain, State | CandidateFailedError]:
    """Solve with each strain measure; motions in parallel where the candidate can."""
    strains = judged.strains_of(case.strain)

    def solution(strain: Strain) -> State | CandidateFailedError:
        try:
            return judged.solve(case.problem, strain, progress)
        except CandidateFailedError as error:
            return error

    if case.problem.time is None or not judged.steps_without_lock:
        return {strain: solution(strain) for strain in strains}
    with ThreadPoolExecutor(len(strains)) as pool:
        return dict(zip(strains, pool.map(solution, strains), strict=True))


def _notes_on_damping(problem: Problem, solutions: dict[Strain, State]) -> list[str]:
    """A sentence on the numerical damping of each result that states its steps and swings."""
    notes = []
    for strain, solution in solutions.items():
        if solution.steps is None:
            continue
        from palpate.validation.metrics.motion import measure_numerical_damping

        try:
            found = measure_numerical_damping(problem, solution)
        except InputError:  # nothing swings long enough: nothing is measured
            continue
        notes.append(f"{solution.label}, {strain} strain: {found}.")
    return notes


def _diagnosed(judge: CaseJudge, candidate: Candidate, solution: State) -> Diagnosis:
    """What would explain a result; a quick candidate is run again for it too."""
    from palpate.validation.diagnosis import diagnose

    def ask(problem: Problem) -> Points:
        return candidate.solve(problem, solution.strain, in_silence).displacement

    may_ask = candidate.can_be_asked and solution.seconds < _QUICK
    (other,) = (strain for strain in Strain if strain is not solution.strain)
    return diagnose(
        judge.problem,
        solution,
        judge.references.same_mesh(solution.strain),
        other_strain=judge.references.same_mesh(other),
        ask=ask if may_ask else None,
        length_unit=judge.case.spec.units.length,
    )


def _judged(
    judge: CaseJudge,
    spec: CheckSpec,
    candidate: Candidate,
    solution: State | None,
    failures: dict[Strain, str],
) -> CheckResult:
    """One check of a candidate, or why it is left out, and whether it says anything."""
    strain = judge.strain_of(spec)
    if not _is_answered(spec, judge.case, candidate):
        (asked,) = candidate.strains_of(judge.case.strain)
        why = f"{candidate.name} is asked for {asked} strain only"
        return unjudged_check(spec, strain, Verdict.SKIPPED, why)
    has_failed = strain in failures
    found = judge.check(spec, None if has_failed else solution, failures.get(strain, ""))
    if not judge.is_vacuous(spec):
        return found
    has_remark = found.verdict is Verdict.PASSED and not spec.is_of_truth_alone
    remark = VACUOUS if has_remark else ""
    return dataclasses.replace(found, is_vacuous=True, message=found.message + remark)


def _verdict(checks: list[CheckResult], steps: Steps | None) -> tuple[Verdict, list[str]]:
    """The gravest of the checks; some do not support a verdict.

    These are what any result passes; and where other steps than the case's were asked for, what is
    judged by those alone, which may be as far from the motion as they are coarse.
    """
    verdict = gravest([check.verdict for check in checks])
    good = [check for check in checks if check.verdict is Verdict.PASSED and not check.is_vacuous]
    if verdict is not Verdict.PASSED:
        return verdict, []
    if not good:
        return Verdict.INCONCLUSIVE, [
            "Inconclusive: a result in which nothing moves passes every check that was made. Let "
            "a load or a tool move the body, and check displacement_l2."
        ]
    if steps is not None and not any(check.scope is Scope.TRUTH for check in good):
        return Verdict.INCONCLUSIVE, [
            f"Inconclusive: by {steps} as asked for, the checks on the same mesh say that each "
            "step is solved right, and nothing of how far such steps lead from the case's motion. "
            "Add a check against the truth, or judge the simulator by the case's own steps."
        ]
    return verdict, []


def _pairs(
    candidates: Mapping[Strain, State], references: ReferenceSet
) -> Iterator[tuple[str, Strain, State, State]]:
    """What a state is compared with, the strain it was asked for, the state, and the reference."""
    for strain, candidate in candidates.items():
        found = {"same_mesh": references.same_mesh(strain), "truth": references.truth(strain)}
        for against, reference in found.items():
            if reference is not None:
                yield against, strain, candidate, reference


def _error_lengths(
    candidates: Mapping[Strain, State], references: ReferenceSet
) -> dict[str, Points]:
    """Length of the displacement error at each point [m], (num_points,), by pair of states."""
    return {
        f"{candidate.label} - {reference.label}, {strain}": np.linalg.norm(
            candidate.displacement - reference.displacement, axis=1
        )
        for _, strain, candidate, reference in _pairs(candidates, references)
    }


def _all_metrics(
    case: Case, candidates: Mapping[Strain, State], references: ReferenceSet
) -> dict[str, float | None]:
    """Every metric of every pair, whether a check asks for it or not."""
    mesh = case.problem.mesh
    metrics: dict[str, float | None] = {
        "rest.volume": mesh.volume,
        "rest.surface_area": mesh.surface_area,
    }
    for state in (*candidates.values(), *references.states.values()):
        name = f"{state.label.replace(',', '').replace(' ', '_').lower()}.{state.strain}"
        for number in SCALARS:
            metrics[f"{name}.{number}"] = getattr(state, number)
    for against, strain, candidate, reference in _pairs(candidates, references):
        for metric in _comparable(against, case.problem):
            value = measure(metric, case.problem, candidate, reference).value
            name = error_name(against, strain, candidate.element, metric)
            metrics[name] = value if np.isfinite(value) else None
    return metrics


def _comparable(against: str, problem: Problem) -> list[str]:
    """Metrics that compare with a reference of this kind; oscillations only where asked for."""
    is_truth = against == "truth"
    return [
        metric.name
        for metric in CATALOGUE.values()
        if metric.is_of_whole
        and metric.fits(problem)
        and not metric.is_fitted
        and not (is_truth and metric.needs_same_mesh)
        and not (is_truth and problem.time and not metric.has_moving_truth)
    ]


def exit_code(results: list[CaseResult]) -> int:
    """2 where a case was not judged; else 0 passed, 1 failed, 3 inconclusive, by the gravest."""
    if any(result.not_judged for result in results):
        return ExitCode.UNUSABLE_INPUT
    return ExitCode[gravest([result.verdict for result in results]).name]


def _is_answered(spec: CheckSpec, case: Case, candidate: Candidate) -> bool:
    """Whether a candidate is asked for the strain measure that a check is about."""
    return (spec.strain or case.strain) in candidate.strains_of(case.strain)


def _missing_check(case: Case, candidate: Candidate) -> str:
    """Why a case judges nothing of a candidate; empty where it does."""
    if any(_is_answered(spec, case, candidate) for spec in case.checks):
        return ""
    asked = " and ".join(candidate.strains_of(case.strain))
    return f"no check for {asked} strain, for which {candidate.name} is asked"


def suitable_cases(
    cases: Sequence[Case], candidates: Sequence[Candidate], progress: Progress
) -> list[Case]:
    """The cases that can be posed to every candidate; `progress` gets why others cannot.

    A candidate has to be able to pose the problem, and a check has to be of its strain measure.

    Raises:
        InputError: None is left.
    """
    left = []
    for case in cases:
        reasons = (_missing_check(case, c) or c.refusal(case.problem) for c in candidates)
        reason = next(filter(None, reasons), "")
        if reason:
            progress(f"left out: {case.name}: {reason}")
        else:
            left.append(case)
    if not left:
        raise InputError("none of these cases can be asked of this candidate")
    return left


def judge_or_say_why(
    judge_one: Callable[[Case], CaseResult], case: Case, candidates: Sequence[Candidate]
) -> CaseResult:
    """A case judged or, where an input of it cannot be used, why not: the next has its verdict."""
    try:
        return judge_one(case)
    except (InputError, ReferenceFailedError) as error:
        is_unusable = isinstance(error, (InputError, ReferenceUnavailableError))
        verdict, why = Verdict.INCONCLUSIVE, str(error)
        try:
            problem = case.problem
        except InputError:  # its mesh cannot be read; without a check nobody looks at one
            points = np.vstack([np.zeros(3), np.eye(3)])
            one = TetMesh(points, np.array([[0, 1, 2, 3]], np.int32))
            problem = Problem(one, Material(1.0, 0.0, 1.0), supports=(), loads=())
        return CaseResult(
            name=case.name,
            title=case.title,
            verdict=verdict,
            checks=(),
            problem=problem,
            candidates=tuple(Judged(c.name, verdict, c.element) for c in candidates),
            provenance={
                "palpate": version_of("palpate"),
                "case_file": case.file,
                "time": time_now(),
            },
            notes=(why,),
            not_judged=why if is_unusable else "",
            case_text=case.text,
            units=case.spec.units,
        )


def judge_cases(
    cases: Sequence[Case],
    candidates: Sequence[Candidate],
    *,
    precision: Precision | None = None,
    progress: Progress = in_silence,
    processes: int | None = None,
) -> list[CaseResult]:
    """Judge candidates on cases by their stored references, on several cores; see `judge_case`.

    A case that cannot be judged says why in its result, and the others have their verdicts.

    Args:
        cases: The cases, in the order of the results.
        candidates: Candidates of fastsim: their solve functions are sent to other processes.
        precision: The precision granted to them.
        progress: Called with the lines of a case once it is judged, in the order of the cases.
        processes: How many; None chooses by the available cores and the number of cases.
    """
    count = processes
    if count is None:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
        count = min(cores, _MOST_PROCESSES, len(cases) // _CASES_OF_A_PROCESS)
    judge_one = partial(judge_case, candidate=candidates, precision=precision)
    here = partial(judge_one, progress=progress)
    if count <= 1:
        return [judge_or_say_why(here, case, candidates) for case in cases]
    context, results = multiprocessing.get_context("spawn"), []
    with ProcessPoolExecutor(count, context, _leave_interrupts_alone) as pool:
        waiting = [pool.submit(_with_lines, judge_one, case) for case in cases]
        for case, future in zip(cases, waiting, strict=True):
            try:
                lines, result = future.result()
            except Exception:
                # Also of a process that was killed: judged here the case raises its own error.
                lines, result = [], judge_or_say_why(here, case, candidates)
            for line in lines:
                progress(line)
            results.append(result)
    return results


def _with_lines(judge_one: Callable[..., CaseResult], case: Case) -> tuple[list[str], CaseResult]:
    """A case judged in another process, with the lines of its progress."""
    lines: list[str] = []
    return lines, judge_one(case, progress=lines.append)


def _leave_interrupts_alone() -> None:
    """Ctrl-C ends the process that asked, which ends these."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
