"""The gates' own proof: seeded faults turn checks red that a healthy candidate keeps green.

Each fault is tried on a case that can see it: mass and damping on one that moves, mirrors under
lopsided loads, Lamé's parameters where Poisson's ratio is far from 0.25.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from unittest import mock

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.temporaries import scratch_folder
from palpate.validation.candidates.candidate import Candidate, fastsim_candidate
from palpate.validation.candidates.faults import CannotShowError, Fault, with_fault
from palpate.validation.case import Case, load_case
from palpate.validation.judging.expectation import read_expected, unexpected
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.metric_table import (
    Row,
    metric_table,
    row_check,
    table_lines,
    trial_check,
)
from palpate.validation.judging.outputs import check_name
from palpate.validation.judging.results import CaseResult, CheckResult, Judged
from palpate.validation.references.stored import references_folder
from palpate.validation.states import Progress, Verdict, gravest

# Where each fault is tried.
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
    Fault.DROPPED_TOOL: "press slide",
    Fault.REVERSED_TOOL_FORCE: "press slide",
}
TRIALS = tuple((fault, name) for fault, names in _CASES.items() for name in names.split())
REFERENCE_FAULTS = tuple(
    f"{word}-reference" for word in ("missing", "stale", "damaged", "altered", "unhashed")
)
_CASE_OF_REFERENCES = "block"
# Two answers of one simulator are the same within this part of the largest displacement: each is
# solved to 1e-10 of its forces, and a body that bends shows a hundred times that.
_SAME = 1e-7


def run_self_test(
    progress: Progress, *, cases: Sequence[Case] = (), candidate: Candidate | None = None
) -> CaseResult:
    """Seed faults; each check of the result is one trial, passed when it was caught.

    Args:
        progress: Called with one line for each trial.
        cases: Where the faults are tried, each that can show there; the built-in trials, with the
            table of metrics by faults and spoiled references, where there are none.
        candidate: Whose answers are spoiled; fastsim's where None.
    """
    judged = candidate or fastsim_candidate()
    if cases:
        trials: list[tuple[Fault, Case]] = [
            (fault, case) for case in cases for fault in Fault if fault is not Fault.NONE
        ]
        table: list[Row] = []
    else:
        known = {name: load_case(name) for name in dict.fromkeys(name for _, name in TRIALS)}
        trials = [(fault, known[name]) for fault, name in TRIALS]
        table = metric_table(judged, progress)
    checks = []
    healthy: dict[str, CaseResult] = {}
    for case in dict.fromkeys(case for _, case in trials):
        healthy[case.name] = result = judge_case(case, candidate=judged)
        progress(f"healthy, {case.name}: {result.verdict}")
        checks.append(_trial("healthy", case, _is_healthy(result), _tell(result)))
    for fault, case in trials:
        check = _try(fault, case, judged, healthy[case.name])
        if not cases and check.verdict is Verdict.SKIPPED:
            # Chosen because it shows there: an answer that stays the same was not spoiled.
            check = replace(check, verdict=Verdict.FAILED)
        word = {Verdict.PASSED: "caught", Verdict.SKIPPED: "cannot show"}.get(check.verdict)
        progress(f"{fault}, {case.name}: {word or 'NOT caught'}")
        checks.append(check)
    if not cases:
        checks += [_spoil_references(word, progress) for word in REFERENCE_FAULTS]
        checks += [row_check(row) for row in table]
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
    """One fault on one case; skipped where the answer is the same with it and without."""
    faulty = with_fault(candidate, fault)
    try:
        result = judge_case(case, candidate=faulty, diagnoses=False)
    except CannotShowError as error:
        return replace(_trial(fault.value, case, True, str(error)), verdict=Verdict.SKIPPED)
    caught = _red(result) - _red(healthy)
    if not caught and _is_same(result, healthy):
        message = "the answer is the same with this fault and without"
        return replace(_trial(fault.value, case, True, message), verdict=Verdict.SKIPPED)
    return _trial(fault.value, case, bool(caught), _tell(result))


def _red(result: CaseResult) -> set[tuple[int, str]]:
    """Checks that failed, by place and name: what a fault adds to them has caught it."""
    return {
        (number, check_name(check))
        for number, check in enumerate(result.checks)
        if check.verdict is Verdict.FAILED
    }


def _is_healthy(result: CaseResult) -> bool:
    """Whether the equations are kept: on the same mesh nothing fails, and something passes there.

    What an element misses of the truth is told by the gate itself, and is no fault of the solver.
    A case without checks on the same mesh must pass, or fail as it is known to.
    """
    on_mesh = [check.verdict for check in result.checks if check.against == "same_mesh"]
    if not on_mesh:
        known = result.name in read_expected() and not unexpected([result], read_expected())
        return known or result.verdict is Verdict.PASSED
    return Verdict.PASSED in on_mesh and set(on_mesh) <= {Verdict.PASSED, Verdict.SKIPPED}


def _is_same(one: CaseResult, other: CaseResult) -> bool:
    """Whether the two answers that are checked are the same at every point, to rounding."""
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


def _spoil_references(word: str, progress: Progress) -> CheckResult:
    case = load_case(_CASE_OF_REFERENCES)
    with _spoiled_references(word):
        try:
            message, is_caught = f"NOT caught: {judge_case(case).verdict}", False
        except InputError as error:
            message, is_caught = f"exit 2: {error}", True
    progress(f"{word}: {'caught' if is_caught else 'NOT caught'}")
    return _trial(word, case, is_caught, message)


def _tell(result: CaseResult) -> str:
    """The checks that failed, the sharpest first."""
    failed = [check for check in result.checks if check.verdict is Verdict.FAILED]
    if not failed:
        return f"{result.verdict}, {len(result.checks)} checks"
    named = ", ".join(check_name(check) for check in failed[:3])
    more = f" and {len(failed) - 3} more" if len(failed) > 3 else ""
    return f"caught by {named}{more}: {failed[0].message[:60]}"


def _trial(fault: str, case: Case, is_good: bool, message: str) -> CheckResult:
    name = f"{fault} on {case.name}"
    return trial_check(name, case.strain, is_good, message, reason="a gate must be able to go red")


@contextmanager
def _spoiled_references(word: str) -> Iterator[None]:
    """Stored references that are missing, another case's, cut off, halved, or of version 0.1."""
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
