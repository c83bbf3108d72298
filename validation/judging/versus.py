"""Two candidates on one case, compared with each other: no reference, and limits by the user.

Two simulators, or one on two machines, devices or precisions. Differences are reported by metric,
relative to the second one's result; nothing says which of the two is right. What the case checks
without a reference (inverted cells, published numbers) is checked of both; two results that are
identical are no evidence.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from palpate.meshes.errors import InputError
from palpate.validation.candidates.candidate import (
    Candidate,
    candidates_for,
    fastsim_candidate,
)
from palpate.validation.case import Case
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.checks import judge_check, unjudged_check
from palpate.validation.judging.results import CaseResult, CheckResult, Judged
from palpate.validation.metrics import CATALOGUE, is_still
from palpate.validation.metrics.validity import state_out_of_reach, unmeasurable_state
from palpate.validation.quoting import own_words
from palpate.validation.states import (
    CandidateFailedError,
    Elements,
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
# Two solvers, or two builds of one, round differently: results are identical that differ by less
# than this, relative to the largest displacement.
_IDENTICAL = 4.0 * np.finfo(np.float64).eps


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
        A check for each metric with a limit, and each of the case's that needs no reference, of
        whichever result is worse; every other metric, if both gave results, a skipped check.
        Inconclusive where nothing moves, or the two results are identical.

    Raises:
        InputError: No limit at all, one of a metric that does not compare two results, or a result
            that cannot be read.
    """
    asked = _asked(case, limits or {})
    progress(f"case {case.name}: {case.title}")
    names = (candidate.name, other.name)
    if candidate.name == other.name:
        names = (f"{candidate.name} (first)", f"{other.name} (second)")
    solutions: list[State] = []
    failures: list[str] = []
    notes = [f"Mesh: {case.mesh_origin}.", f"{names[0]} against {names[1]}: no reference."]
    for each, name in zip((candidate, other), names, strict=True):
        notes.extend(each.notes)
        solution, failure = _solution(each, case, progress)
        if failure:
            failures.append(f"{name}: {case.spec.units.in_case_units(failure)}")
        if solution is not None:
            solutions.append(solution)
            notes.extend(solution.remarks)
            said = dict(solution.says)
            notes.extend([own_words(name, said)] if said else [])
    if failures:
        why = "; ".join(failures)
        checks = [unjudged_check(spec, case.strain, Verdict.FAILED, why) for spec in asked]
        own = []
    else:
        asked += _without_limit(case, asked)
        checks = [_check(spec, case, *solutions, of=names[1]) for spec in asked]
        own = _own_checks(case, dict(zip(names, solutions, strict=True)))
    checks = [*(dataclasses.replace(check, against=VERSUS) for check in checks), *own]
    verdict = gravest([check.verdict for check in checks])
    for is_empty, why in (
        (
            not failures and all(is_still(case.problem.mesh, each) for each in solutions),
            "Nothing moves in either result: that they agree says nothing.",
        ),
        (
            not failures and _are_identical(*solutions),
            "The two results are identical to rounding: that they agree is no evidence. Compare "
            "two simulators or builds that compute apart from one another, or judge one of them "
            "against a reference, without --versus.",
        ),
    ):
        if is_empty:
            verdict = gravest([verdict, Verdict.INCONCLUSIVE])
            notes.append(why)
    return CaseResult(
        name=case.name,
        title=case.title,
        verdict=verdict,
        checks=tuple(checks),
        problem=case.problem,
        candidates=(Judged(f"{names[0]} against {names[1]}", verdict),),
        states=tuple(solutions),
        metrics={f"{check.against}.{check.metric}": check.value for check in checks},
        provenance={"palpate": version_of("palpate"), "case_file": case.file},
        notes=tuple(dict.fromkeys(notes)),
        case_text=case.text,
        units=case.spec.units,
    )


def other_candidate(command: str, time_limit: float, candidate: Candidate) -> Candidate:
    """The simulator that a candidate is compared with, asked for the same equations.

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
    (other,) = candidates_for(
        command,
        time_limit,
        Elements(candidate.element),
        integrator=candidate.asked.integrator,
        time_step=candidate.asked.time_step,
    )
    return other


def read_limits(words: Sequence[str]) -> dict[str, float]:
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
            raise InputError(f"--limit {word}: no metric between two results; there are {known}")
        limits[metric] = value
    return limits


def _asked(case: Case, limits: Mapping[str, float]) -> list[CheckSpec]:
    """The checks with a limit: the caller's, or the case's own on the same mesh."""
    for name in limits:
        if not CATALOGUE[name].fits(case.problem):
            needs = "[time]" if CATALOGUE[name].needs_time else "[tool]"
            raise InputError(f"limit of {name}: it is of a case with {needs}")
    asked = [CheckSpec(metric=m, limit=limit, reason="asked for") for m, limit in limits.items()]
    asked = asked or [
        spec
        for spec in case.checks
        if spec.against == "same_mesh" and (spec.strain or case.strain) is case.strain
    ]
    if not asked:
        raise InputError(
            f"{case.path.name}: no check on the same mesh whose limit could be taken; say how far "
            "apart the two may be, as in --limit displacement_l2=0.01"
        )
    return asked


def _own_checks(case: Case, solutions: Mapping[str, State]) -> list[CheckResult]:
    """The case's checks that need no reference, each of the result that does worse, by name."""
    found = []
    for spec in case.checks:
        strain = spec.strain or case.strain
        if spec.against != "candidate" or strain is not case.strain:
            continue
        of_both = [
            (name, judge_check(spec, strain, case.problem, each, None, 0.0, "", case.spec.units))
            for name, each in solutions.items()
        ]
        worst = gravest([check.verdict for _, check in of_both])
        name, check = next(each for each in of_both if each[1].verdict is worst)
        found.append(dataclasses.replace(check, message=f"{name}: {check.message}"))
    return found


def _are_identical(one: State, other: State) -> bool:
    """Whether two results are the same to rounding, on a mesh of their own too."""
    size = max(one.max_displacement, other.max_displacement)
    return len(one.fields) == len(other.fields) and all(
        mine.shape == theirs.shape and bool((np.abs(mine - theirs) <= _IDENTICAL * size).all())
        for mine, theirs in zip(one.fields, other.fields, strict=True)
    )


def _without_limit(case: Case, asked: Sequence[CheckSpec]) -> list[CheckSpec]:
    """Every other metric of the whole body that such a case has; fits only where asked for."""
    taken = {spec.metric for spec in asked}
    return [
        CheckSpec.model_construct(
            metric=metric.name, limit=math.inf, reason="no limit asked for", against="same_mesh"
        )
        for metric in CATALOGUE.values()
        if metric.is_of_whole and metric.name not in taken and not metric.is_fitted
        if metric.fits(case.problem)
    ]


def _solution(each: Candidate, case: Case, progress: Progress) -> tuple[State | None, str]:
    """The candidate's state or None, and why it has failed."""
    try:
        solution = each.solve(case.problem, case.strain, progress)
    except CandidateFailedError as error:
        return None, str(error)
    unmeasurable = unmeasurable_state(solution)
    if unmeasurable:
        return None, unmeasurable
    return solution, state_out_of_reach(case.problem, solution)


def _check(spec: CheckSpec, case: Case, one: State, other: State, *, of: str) -> CheckResult:
    """One metric; `of` names the second, whose parts the difference is.

    Where both have a mesh of their own it is the worse of both ways.
    """
    about, has_limit = spec.about, spec.limit < math.inf
    if (one.own or other.own) and (about.needs_same_mesh or about.of_part):
        verdict = Verdict.INCONCLUSIVE if has_limit else Verdict.SKIPPED
        found = unjudged_check(
            spec, case.strain, verdict, "it needs both results on the case's mesh"
        )
    else:
        # Whoever has a mesh of its own is measured there too, and so is the first of the two.
        pairs = [(one, other)] if one.own or not other.own else []
        pairs += [(other, one)] if other.own else []
        units = case.spec.units
        ways = [
            judge_check(spec, case.strain, case.problem, mine, theirs, 0.0, "", units)
            for mine, theirs in pairs
        ]
        found = max(ways, key=lambda way: math.inf if way.value is None else way.value)
    if not has_limit:
        found = dataclasses.replace(found, verdict=Verdict.SKIPPED, limit=0.0)
    return dataclasses.replace(found, scale=found.scale.replace("the reference", of))
