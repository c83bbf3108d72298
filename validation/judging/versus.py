"""Two candidates on one case, compared with each other: no reference, and limits by the user.

Two simulators, or one on two machines, devices or precisions. Differences are reported by metric,
relative to the second one's result; nothing says which of the two is right.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.validation.candidates.candidate import (
    Candidate,
    candidates_for,
    fastsim_candidate,
)
from palpate.validation.case import Case
from palpate.validation.case.regions import part_of_check
from palpate.validation.judging.case_references import case_file
from palpate.validation.judging.checks import decide
from palpate.validation.judging.results import CaseResult, CheckResult, Judged
from palpate.validation.metrics import CATALOGUE, Metric, Part, is_still, measure
from palpate.validation.metrics.difference import Difference
from palpate.validation.metrics.validity import state_out_of_reach, unmeasurable_state
from palpate.validation.quoting import own_words
from palpate.validation.states import (
    CandidateFailedError,
    Progress,
    State,
    Verdict,
    gravest,
    in_silence,
)
from palpate.validation.versions import version_of

# The value of `against` of such a check, in results.
VERSUS = "versus"
# Instead of a command line.
FASTSIM = "fastsim"


@dataclass(frozen=True)
class Asked:
    """A metric between the two, and how large it may be; infinite where nobody says."""

    metric: str
    limit: float
    reason: str
    part: Part | None = None


def judge_versus(
    case: Case,
    candidate: Candidate,
    other: Candidate,
    *,
    limits: Mapping[str, float] | None = None,
    progress: Progress = in_silence,
) -> CaseResult:
    """Solve a case with two candidates, and measure how far apart their results are.

    Args:
        case: The case; it is solved with its strain measure.
        candidate: The first.
        other: The second; differences are relative to its result.
        limits: By metric, above 0; those of the case's checks on the same mesh where None.
        progress: Called with one line for each thing done.

    Returns:
        A check for each metric with a limit; every other metric, if both gave results, a skipped
        check.

    Raises:
        InputError: No limit at all, one of a metric that does not compare two results, or a result
            that cannot be read.
    """
    asked = _asked(case, limits)
    progress(f"case {case.name}: {case.title}")
    problem, strain = case.problem, case.strain
    names = (candidate.name, other.name)
    if candidate.name == other.name:
        names = (f"{candidate.name} (first)", f"{other.name} (second)")
    solutions: list[State] = []
    failures: list[str] = []
    notes = [f"Mesh: {case.mesh.origin}.", f"{names[0]} against {names[1]}: no reference."]
    for each, name in zip((candidate, other), names, strict=True):
        notes.extend(each.notes)
        solution, failure = _solution(each, problem, strain, progress)
        if failure:
            failures.append(f"{name}: {case.spec.units.in_case_units(failure)}")
        if solution is not None:
            solutions.append(solution)
            notes.extend(solution.remarks)
            said = dict(solution.says)
            notes.extend([own_words(name, said)] if said else [])
    asked += [] if failures else _others(problem, asked)
    checks = tuple(
        _check(one, problem, strain, solutions, "; ".join(failures), names[1]) for one in asked
    )
    verdict = gravest([check.verdict for check in checks])
    if not failures and all(is_still(problem.mesh, solution) for solution in solutions):
        verdict = gravest([verdict, Verdict.INCONCLUSIVE])
        notes.append("Nothing moves in either answer: that they agree says nothing.")
    return CaseResult(
        name=case.name,
        title=case.title,
        verdict=verdict,
        checks=checks,
        problem=problem,
        candidates=(Judged(f"{names[0]} against {names[1]}", verdict),),
        states=tuple(solutions),
        metrics={f"versus.{c.metric}": c.value for c in checks},
        provenance={"palpate": version_of("palpate"), "case_file": case_file(case)},
        notes=tuple(dict.fromkeys(notes)),
        case_text=case.text,
    )


def other_candidate(command: str, time_limit: float, candidate: Candidate) -> Candidate:
    """The simulator that a candidate is compared with.

    Args:
        command: "mysim {case} {result}"; "fastsim" is its compiled core with the candidate's
            element, so that it is compared with itself on another device.
        time_limit: Time limit of a program [s].
        candidate: The first.

    Raises:
        InputError: The command line cannot be used.
    """
    if command == FASTSIM:
        return fastsim_candidate(element=candidate.element)
    (other,) = candidates_for(command, time_limit)
    return other


def read_limits(words: list[str]) -> dict[str, float]:
    """Limits as they stand on a command line: METRIC=VALUE.

    Raises:
        InputError: No such metric between two results, or no number above 0.

    >>> read_limits(["displacement_l2=1e-6"])
    {'displacement_l2': 1e-06}
    """
    limits: dict[str, float] = {}
    for word in words:
        metric, _, text = word.partition("=")
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0.0 < value < math.inf:
            raise InputError(f"--limit {word}: needs METRIC=VALUE with a finite value above 0")
        if metric in limits:
            raise InputError(f"--limit {word}: {metric} has a limit already")
        if metric not in CATALOGUE or not CATALOGUE[metric].is_of_whole:
            known = ", ".join(m.name for m in CATALOGUE.values() if m.is_of_whole)
            raise InputError(f"--limit {word}: no metric between two answers; there are {known}")
        limits[metric] = value
    return limits


def _asked(case: Case, limits: Mapping[str, float] | None) -> list[Asked]:
    problem = case.problem
    if limits:
        for name in limits:
            if not _fits(CATALOGUE[name], problem):
                needs = "[time]" if CATALOGUE[name].needs_time else "[tool]"
                raise InputError(f"limit of {name}: it is of a case with {needs}")
        return [Asked(name, value, "asked for") for name, value in limits.items()]
    asked = [
        Asked(
            spec.metric,
            spec.limit,
            spec.reason,
            part_of_check(spec, problem, case.spec.units, f"check {number}"),
        )
        for number, spec in enumerate(case.checks, start=1)
        if spec.against == "same_mesh" and (spec.strain or case.strain) is case.strain
    ]
    if not asked:
        raise InputError(
            f"{case.path.name}: no check on the same mesh whose limit could be taken; say how far "
            "apart the two may be, as in --limit displacement_l2=0.01"
        )
    return asked


def _fits(metric: Metric, problem: Problem) -> bool:
    return (problem.time is not None or not metric.needs_time) and (
        bool(problem.tools) or not metric.needs_tools
    )


def _others(problem: Problem, asked: list[Asked]) -> list[Asked]:
    """Every other metric of the whole body that such a case has; fits only where asked for."""
    taken = {one.metric for one in asked}
    return [
        Asked(metric.name, math.inf, "no limit asked for")
        for metric in CATALOGUE.values()
        if metric.is_of_whole and metric.name not in taken and not metric.is_fitted
        if _fits(metric, problem)
    ]


def _solution(
    each: Candidate, problem: Problem, strain: Strain, progress: Progress
) -> tuple[State | None, str]:
    """The candidate's state or None, and why it has failed."""
    try:
        solution = each.solve(problem, strain, progress)
    except CandidateFailedError as error:
        return None, str(error)
    unmeasurable = unmeasurable_state(solution)
    if unmeasurable:
        return None, unmeasurable
    return solution, state_out_of_reach(problem, solution)


def _check(
    asked: Asked,
    problem: Problem,
    strain: Strain,
    solutions: list[State],
    failure: str,
    of: str,
) -> CheckResult:
    """One metric; `of` names the second, whose parts the difference is."""
    has_limit = asked.limit < math.inf
    check = CheckResult(
        metric=asked.metric,
        against=VERSUS,
        strain=strain,
        verdict=Verdict.FAILED,
        reason=asked.reason,
        message=failure,
        limit=asked.limit if has_limit else 0.0,
    )
    if failure:
        return check
    found = _apart(asked, problem, *solutions)
    if found is None:
        verdict = Verdict.INCONCLUSIVE if has_limit else Verdict.SKIPPED
        message = "it needs both answers on the case's mesh"
        return dataclasses.replace(check, verdict=verdict, message=message)
    bar = found.uncertainty
    verdict = decide(found.value, bar, asked.limit) if has_limit else Verdict.SKIPPED
    sign = {Verdict.PASSED: "<=", Verdict.FAILED: ">"}.get(verdict, "~")
    says = f"{found.value:.3g}" + (f" (+- {bar:.2g})" if bar else "")
    says += f" {sign} {asked.limit:g}" if has_limit else ""
    return dataclasses.replace(
        check,
        verdict=verdict,
        message=says + (f"; {found.remark}" if found.remark else ""),
        value=found.value if math.isfinite(found.value) else None,
        scale=found.scale_name.replace("the reference", of),
        unit=CATALOGUE[asked.metric].unit,
        reference_error=bar,
    )


def _apart(asked: Asked, problem: Problem, one: State, other: State) -> Difference | None:
    """The worse of both ways where both have a mesh of their own; None where neither is known."""
    about = CATALOGUE[asked.metric]
    if (one.own or other.own) and (about.needs_same_mesh or about.of_part):
        return None
    # Whoever has a mesh of its own is measured there too, and so is the first of the two.
    pairs = [(one, other)] if one.own or not other.own else []
    pairs += [(other, one)] if other.own else []
    found = [measure(asked.metric, problem, *pair, asked.part) for pair in pairs]
    return max(found, key=lambda difference: difference.value)
