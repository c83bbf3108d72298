"""The gates' own proof: seeded faults turn checks red that a right candidate passes.

Each fault is tried on a case that can see it: mass and damping on one that moves, mirrors under
lopsided loads, Lamé's parameters where Poisson's ratio is far from 0.25.

And which metric sees which fault: a case is judged by one metric only, for each metric of the
catalogue, and the candidate's result is corrupted by every fault that can show there. A metric that
no realistic fault turns red would be an ornament.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from unittest import mock

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.temporaries import scratch_folder
from palpate.validation.candidates.candidate import Candidate, fastsim_candidate
from palpate.validation.candidates.faults import CannotShowError, Fault, on_own_mesh, with_fault
from palpate.validation.case import Case, load_case
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.case_references import find_references
from palpate.validation.judging.checks import CaseJudge
from palpate.validation.judging.expectation import read_expected, unexpected
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.results import CaseResult, CheckResult, Judged
from palpate.validation.metrics import CATALOGUE
from palpate.validation.references.stored import references_folder
from palpate.validation.states import (
    CandidateFailedError,
    Progress,
    State,
    Verdict,
    gravest,
    in_silence,
)

# The cases that each fault is tried on.
_CASES = {
    Fault.WRONG_MASS: "block-motion wave slide",
    Fault.NO_DAMPING: "block-motion decay strip",
    Fault.LAST_STATE_REPEATED: "block-motion",
    Fault.EVERY_SECOND_STATE: "block-motion",
    Fault.LATE: "wave",
    Fault.SWAPPED_LAME: "block kidney shear",
    Fault.SOFTER: "block kidney beam confined csm2 column wave slide",
    Fault.MIRRORED_MESH: "block kidney",
    Fault.MIRRORED: "beam csm2",
    Fault.DROPPED_LOAD: "beam block-motion",
    Fault.REVERSED_LOAD: "block cantilever strip",
    Fault.INVERTED_CELL: "block kidney",
    Fault.NAN: "kidney block-motion",
    Fault.UNIT_ERROR: "kidney",
    Fault.LINEAR_INSTEAD_OF_GREEN: "kidney beam stretch csm1 cantilever sze",
    Fault.SHIFTED_NUMBERS: "block",
    Fault.DROPPED_TOOL: "press slide drop",
    Fault.REVERSED_TOOL_FORCE: "press slide drop",
    Fault.VERTICES_ONLY: "press slide",
}
TRIALS = tuple((fault, name) for fault, names in _CASES.items() for name in names.split())
REFERENCE_FAULTS = tuple(
    f"{word}-reference" for word in ("missing", "stale", "damaged", "altered", "unhashed")
)
_CASE_OF_REFERENCES = "block"
# Two results of one simulator are the same within this part of the largest displacement: each is
# solved to 1e-10 of its forces, and a body that bends shows a hundred times that.
_SAME = 1e-7

# Kind of a case, the built-in one, and whether the result comes on a mesh of its own.
KINDS = (
    ("statics", "block", False),
    ("motion", "block-motion", False),
    ("pressed tool", "press", False),
    ("moving tool", "slide", False),
    ("own mesh", "block", True),
)
# Cases of which checks of the candidate alone are tried, each metric at the first that has it:
# published numbers, and the balances of an impact.
CASES_OF_NUMBERS = (
    ("statics", "stretch"),
    ("motion", "wave"),
    ("statics", "turned"),
    ("pressed tool", "drag"),
    ("impact", "drop"),
)
# Limits for the same equations on the same mesh; a fit to a motion is as good as its samples.
_SAME_MESH, _FITTED = 1e-6, 1e-3
# Limit for a mesh cut in eight, against the truth: a body that bends easily is a third off.
_OWN_MESH = 0.35
# A region that contains every case above, metres or millimetres.
_EVERYWHERE = {"half_space": {"point": (-1e6, 0.0, 0.0), "normal": (1.0, 0.0, 0.0)}}


def run_self_test(
    progress: Progress, *, cases: Sequence[Case] = (), candidate: Candidate | None = None
) -> CaseResult:
    """Seed faults; each check of the result is one trial, passed when it was caught.

    Args:
        progress: Called with one line for each trial.
        cases: Where the faults are tried, each that can show there; the built-in trials, with the
            table of metrics by faults and corrupted references, where there are none.
        candidate: The candidate whose results are corrupted; fastsim's where None.
    """
    judged = candidate or fastsim_candidate()
    seeded = [fault for fault in Fault if fault is not Fault.NONE]
    trials: list[tuple[Fault, Case]] = [(fault, case) for case in cases for fault in seeded]
    table: list[MetricRow] = []
    if not cases:
        known = {name: load_case(name) for name in dict.fromkeys(name for _, name in TRIALS)}
        trials = [(fault, known[name]) for fault, name in TRIALS]
        table = metric_table(judged, progress)
    checks = []
    healthy: dict[str, CaseResult] = {}
    for case in dict.fromkeys(case for _, case in trials):
        healthy[case.name] = result = judge_case(case, candidate=judged)
        progress(f"healthy, {case.name}: {result.verdict}")
        checks.append(_trial("healthy", case, _is_healthy(result), _summary(result)))
    for fault, case in trials:
        check = _try(fault, case, judged, healthy[case.name])
        if not cases and check.verdict is Verdict.SKIPPED:
            # Chosen because it shows there: a result that stays the same was not corrupted.
            check = replace(check, verdict=Verdict.FAILED)
        word = {Verdict.PASSED: "caught", Verdict.SKIPPED: "cannot show"}.get(check.verdict)
        progress(f"{fault}, {case.name}: {word or 'NOT caught'}")
        checks.append(check)
    if not cases:
        checks += [_try_references(word, progress) for word in REFERENCE_FAULTS]
        checks += [row.trial for row in table]
    first = next(iter(healthy.values()))
    verdict = gravest([check.verdict for check in checks])
    if not any(check.verdict is Verdict.PASSED for check in checks[len(healthy) :]):
        raise InputError("no fault shows on these cases; try `palpate gate --self-test` alone")
    return CaseResult(
        name="self-test",
        title=f"{len(checks)} trials of the gates themselves",
        verdict=verdict,
        checks=tuple(replace(check, element=judged.element) for check in checks),
        candidates=(Judged(judged.name, verdict, judged.element),),
        problem=first.problem,
        provenance=first.provenance,
        notes=(
            "A trial passes when its fault turned the gate red, or the healthy one did not.",
            *table_lines(table),
        ),
        candidate_says=first.candidate_says,
    )


def _try(fault: Fault, case: Case, candidate: Candidate, healthy: CaseResult) -> CheckResult:
    """One fault on one case; skipped where the result is the same with it and without."""
    try:
        result = judge_case(case, candidate=with_fault(candidate, fault), diagnoses=False)
    except CannotShowError as error:
        return replace(_trial(fault, case, True, str(error)), verdict=Verdict.SKIPPED)
    caught = _red(result) - _red(healthy)
    if not caught and _is_same(result, healthy):
        message = "the result is the same with this fault and without"
        return replace(_trial(fault, case, True, message), verdict=Verdict.SKIPPED)
    return _trial(fault, case, bool(caught), _summary(result))


def _red(result: CaseResult) -> set[tuple[int, str]]:
    """Checks that failed, by number and name: what a fault adds to them has caught it."""
    return {
        (number, check.name)
        for number, check in enumerate(result.checks)
        if check.verdict is Verdict.FAILED
    }


def _is_healthy(result: CaseResult) -> bool:
    """Whether the equations are satisfied: on the same mesh nothing fails, and something passes.

    What an element misses of the truth is reported by the gate itself, no fault of the solver. A
    case without checks on the same mesh must pass, or fail as it is known to.
    """
    on_mesh = [check.verdict for check in result.checks if check.against == "same_mesh"]
    if not on_mesh:
        known = result.name in read_expected() and not unexpected([result], read_expected())
        return known or result.verdict is Verdict.PASSED
    return Verdict.PASSED in on_mesh and set(on_mesh) <= {Verdict.PASSED, Verdict.SKIPPED}


def _is_same(one: CaseResult, other: CaseResult) -> bool:
    """Whether the two results that are checked are the same at every point, to rounding."""
    checked = {check.strain for check in one.checks}
    pairs = [
        (state, other.state(state.label, state.strain))
        for state in one.states
        if not state.is_reference and state.strain in checked
    ]
    return all(
        b is not None
        and float(np.abs(a.displacement - b.displacement).max()) <= _SAME * b.max_displacement
        for a, b in pairs
    )


def _summary(result: CaseResult) -> str:
    """The checks that failed, the sharpest first."""
    failed = [check for check in result.checks if check.verdict is Verdict.FAILED]
    if not failed:
        return f"{result.verdict}, {len(result.checks)} checks"
    named = ", ".join(check.name for check in failed[:3])
    more = f" and {len(failed) - 3} more" if len(failed) > 3 else ""
    return f"caught by {named}{more}: {failed[0].message[:60]}"


def _trial(fault: str, case: Case, is_good: bool, message: str) -> CheckResult:
    """Passed where the gate did what it should; it has no number and no limit."""
    return CheckResult(
        metric=f"{fault} on {case.name}",
        against="self-test",
        strain=case.strain,
        verdict=Verdict.PASSED if is_good else Verdict.FAILED,
        reason="a gate must be able to go red",
        message=message,
    )


def _try_references(word: str, progress: Progress) -> CheckResult:
    case = load_case(_CASE_OF_REFERENCES)
    with _corrupted_references(word):
        try:
            message, is_caught = f"NOT caught: {judge_case(case).verdict}", False
        except InputError as error:
            message, is_caught = f"exit 2: {error}", True
    progress(f"{word}: {'caught' if is_caught else 'NOT caught'}")
    return _trial(word, case, is_caught, message)


@contextmanager
def _corrupted_references(word: str) -> Iterator[None]:
    """Stored references that are missing, another case's, cut off, halved, or without a hash."""
    own, name = references_folder(), f"{_CASE_OF_REFERENCES}.npz"
    with scratch_folder("self-test") as folder:
        match word:
            case "stale-reference":
                shutil.copy(own / "kidney.npz", folder / name)
            case "damaged-reference":
                whole = (own / name).read_bytes()
                (folder / name).write_bytes(whole[: len(whole) // 2])
            case "altered-reference" | "unhashed-reference":
                with np.load(own / name) as stored:
                    arrays = dict(stored)
                if word == "altered-reference":
                    arrays["displacement_0"] = 0.5 * arrays["displacement_0"]
                else:
                    del arrays["sha256"]
                np.savez(folder / name, **arrays)
        with mock.patch.dict(os.environ, PALPATE_REFERENCES=str(folder)):
            yield


@dataclass(frozen=True)
class MetricRow:
    """One metric on one kind of case.

    Attributes:
        metric: Name of the metric.
        kind: Statics, motion, a tool, or a result on a mesh of its own.
        healthy: Verdict on the uncorrupted result with this metric alone.
        seen: By fault that can show there, whether it turns the metric red.
    """

    metric: str
    kind: str
    healthy: Verdict
    seen: Mapping[Fault, bool]

    @property
    def trial(self) -> CheckResult:
        """The row as a trial: passed where a fault is seen and the uncorrupted result is not."""
        seen = [fault for fault, is_seen in self.seen.items() if is_seen]
        is_good = bool(seen) and self.healthy is not Verdict.FAILED
        named = ", ".join(seen[:3]) or "nothing"
        return CheckResult(
            metric=f"{self.metric} alone, {self.kind}",
            against="self-test",
            strain=Strain.GREEN,
            verdict=Verdict.PASSED if is_good else Verdict.FAILED,
            reason="each metric must be able to go red alone",
            message=f"healthy: {self.healthy}; red with {len(seen)} of {len(self.seen)}: {named}",
        )


def metric_table(candidate: Candidate, progress: Progress) -> list[MetricRow]:
    """Every metric alone against every fault, on a case of each kind."""
    rows: list[MetricRow] = []
    for kind, name, is_own in KINDS:
        progress(f"metrics alone, {kind}: {name}")
        given = on_own_mesh(candidate) if is_own else candidate
        case = load_case(name)
        rows += _rows(kind, case, given, list(_specs(case.problem, is_own=is_own)))
    for kind, name in CASES_OF_NUMBERS:
        progress(f"metrics alone, numbers of one result: {name}")
        known, case = {row.metric for row in rows}, load_case(name)
        firsts: dict[str, CheckSpec] = {}
        for spec in case.checks:
            if spec.against == "candidate" and spec.metric not in known:
                firsts.setdefault(spec.metric, spec)
        rows += _rows(kind, case, candidate, list(firsts.values()))
    return rows


def _rows(
    kind: str, case: Case, candidate: Candidate, specs: Sequence[CheckSpec]
) -> Iterator[MetricRow]:
    references = find_references(case, live=False, progress=in_silence)
    judge = CaseJudge(case, references.of_element(candidate.element))
    solutions = {
        strain: {
            fault: _solution(case, candidate, fault, strain)
            for fault in Fault
            if fault is not Fault.NAN  # seen when a result is read, whatever is checked
        }
        for strain in dict.fromkeys(map(judge.strain_of, specs))
    }
    for spec in specs:
        of_fault = dict(solutions[judge.strain_of(spec)])
        try:
            healthy = judge.check(spec, *of_fault.pop(Fault.NONE)).verdict
        except InputError:
            continue  # the reference itself does not swing there
        seen: dict[Fault, bool] = {
            fault: judge.check(spec, solution, failure).verdict is Verdict.FAILED
            for fault, (solution, failure) in of_fault.items()
            if solution is not None or failure
        }
        yield MetricRow(spec.metric, kind, healthy, seen)


def _solution(
    case: Case, candidate: Candidate, fault: Fault, strain: Strain
) -> tuple[State | None, str]:
    """The corrupted result; nothing where the fault cannot show, or its result is refused."""
    try:
        return with_fault(candidate, fault).solve(case.problem, strain, in_silence), ""
    except InputError:
        return None, ""
    except CandidateFailedError as error:
        return None, str(error)


def _specs(problem: Problem, *, is_own: bool) -> Iterator[CheckSpec]:
    """Each metric that such a case can be asked for, alone."""
    for metric in CATALOGUE.values():
        if metric.is_published or not metric.fits(problem):
            continue
        keys: dict[str, object] = {"metric": metric.name, "reason": "this metric alone"}
        if metric.is_own:
            keys |= {"against": "candidate", "limit": 0.0}
        elif not is_own:
            limit = _FITTED if metric.is_fitted else _SAME_MESH
            keys |= {"against": "same_mesh", "limit": limit}
        elif not metric.needs_same_mesh and (not problem.time or metric.has_moving_truth):
            keys |= {"against": "truth", "limit": _OWN_MESH}
        else:
            continue
        if metric.is_of_surface:
            keys["support"] = 1
        elif metric.of_part is not None:
            keys["region"] = _EVERYWHERE
        yield CheckSpec.model_validate(keys)


def table_lines(rows: Sequence[MetricRow]) -> list[str]:
    """The table metric by fault in fixed columns, with a legend."""
    if not rows:
        return []
    faults = [fault for fault in Fault if fault not in (Fault.NONE, Fault.NAN)]
    marks = [chr(ord("a") + number) for number in range(len(faults))]
    width = max(len(f"{row.metric}, {row.kind}") for row in rows)
    lines = ["Which metric alone sees which fault (x: red, .: let pass, blank: cannot show there):"]
    lines += [f"  {m}  {fault}: {fault.meaning}" for m, fault in zip(marks, faults, strict=True)]
    lines.append(" " * (width + 2) + " ".join(marks))
    words = {True: "x", False: ".", None: " "}
    for row in rows:
        cells = [words[row.seen.get(fault)] for fault in faults]
        lines.append(f"{row.metric}, {row.kind}".ljust(width + 2) + " ".join(cells))
    return lines
