"""The gates' own proof: seeded faults turn them red, a healthy candidate does not.

Each fault is tried on a case that can see it: mass and damping on one that moves, mirrors under
lopsided loads, Lamé's parameters where Poisson's ratio is far from 0.25.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from palpate.meshes.errors import InputError
from palpate.meshes.temporaries import scratch_folder
from palpate.validation.case import load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.outputs import check_name
from palpate.validation.judging.results import CaseResult, CheckResult
from palpate.validation.references.stored import references_folder
from palpate.validation.simulators.candidate import fastsim_candidate
from palpate.validation.simulators.faults import Fault
from palpate.validation.states import Verdict, gravest

TRIALS: tuple[tuple[Fault, str], ...] = (
    (Fault.WRONG_MASS, "block-motion"),
    (Fault.NO_DAMPING, "block-motion"),
    (Fault.TRANSPOSED_GRADIENT, "block-motion"),
    (Fault.SWAPPED_LAME, "block"),
    (Fault.SWAPPED_LAME, "kidney"),
    (Fault.SOFTER, "block"),
    (Fault.SOFTER, "kidney"),
    (Fault.SOFTER, "beam"),
    (Fault.MIRRORED_MESH, "block"),
    (Fault.MIRRORED_MESH, "kidney"),
    (Fault.MIRRORED, "beam"),
    (Fault.DROPPED_LOAD, "beam"),
    (Fault.DROPPED_LOAD, "block-motion"),
    (Fault.REVERSED_LOAD, "block"),
    (Fault.INVERTED_CELL, "block"),
    (Fault.INVERTED_CELL, "kidney"),
    (Fault.NAN, "kidney"),
    (Fault.NAN, "block-motion"),
    (Fault.UNIT_ERROR, "kidney"),
    (Fault.LINEAR_INSTEAD_OF_GREEN, "kidney"),
    (Fault.LINEAR_INSTEAD_OF_GREEN, "beam"),
    (Fault.SHIFTED_NUMBERS, "block"),
    (Fault.LINEAR_INSTEAD_OF_GREEN, "stretch"),
    (Fault.SOFTER, "confined"),
    (Fault.SWAPPED_LAME, "shear"),
    (Fault.LINEAR_INSTEAD_OF_GREEN, "csm1"),
    (Fault.SOFTER, "csm2"),
    (Fault.MIRRORED, "csm2"),
    (Fault.REVERSED_LOAD, "cantilever"),
    (Fault.LINEAR_INSTEAD_OF_GREEN, "cantilever"),
    (Fault.LINEAR_INSTEAD_OF_GREEN, "sze"),
    (Fault.SOFTER, "column"),
    (Fault.WRONG_MASS, "wave"),
    (Fault.SOFTER, "wave"),
    (Fault.NO_DAMPING, "decay"),
    (Fault.REVERSED_LOAD, "csm3"),
    (Fault.DROPPED_TOOL, "press"),
    (Fault.DROPPED_TOOL, "slide"),
    (Fault.SOFTER, "slide"),
    (Fault.WRONG_MASS, "slide"),
)
REFERENCE_FAULTS = ("missing-reference", "stale-reference", "damaged-reference")
_CASE_OF_REFERENCES = "block"


def run_self_test(
    progress: Callable[[str], None], names: Sequence[str] | None = None
) -> CaseResult:
    """Seed every fault; each check of the result is one trial, passed when it was caught.

    Args:
        progress: Called with one line of text now and then.
        names: Only trials on these built-in cases; all trials where None.

    Raises:
        InputError: A case on which no fault is tried.
    """
    tried = list(dict.fromkeys(name for _, name in TRIALS))
    if unknown := [name for name in names or () if name not in tried]:
        raise InputError(
            f"--self-test tries no fault on {unknown[0]!r}; it does on {', '.join(tried)}"
        )
    names = tried if names is None else list(dict.fromkeys(names))
    cases = {name: load_case(name) for name in names}
    checks = []
    healthy = {name: judge_case(case) for name, case in cases.items()}
    for name, result in healthy.items():
        progress(f"healthy, {name}: {result.verdict}")
        checks.append(_trial("healthy", name, result.verdict is Verdict.PASSED, _tell(result)))
    for fault, name in TRIALS:
        if name not in names:
            continue
        result = judge_case(cases[name], candidate=fastsim_candidate(fault))
        is_caught = result.verdict is Verdict.FAILED
        progress(f"{fault}, {name}: {'caught' if is_caught else 'NOT caught'}")
        checks.append(_trial(fault.value, name, is_caught, _tell(result)))
    for word in REFERENCE_FAULTS if _CASE_OF_REFERENCES in names else ():
        with _spoiled_references(word):
            try:
                told = f"NOT caught: {judge_case(cases[_CASE_OF_REFERENCES]).verdict}"
                is_caught = False
            except InputError as error:
                told, is_caught = f"exit 2: {error}", True
        progress(f"{word}: {'caught' if is_caught else 'NOT caught'}")
        checks.append(_trial(word, _CASE_OF_REFERENCES, is_caught, told))
    return replace(
        next(iter(healthy.values())),
        name="self-test",
        title=f"{len(checks)} trials of the gates themselves",
        verdict=gravest([check.verdict for check in checks]),
        checks=tuple(checks),
        states=(),
        metrics={},
        notes=("A trial passes when its fault turned the gate red, or the healthy one did not.",),
        published={},
        error_fields={},
    )


def _tell(result: CaseResult) -> str:
    """The checks that failed, the sharpest first."""
    failed = [check for check in result.checks if check.verdict is Verdict.FAILED]
    if not failed:
        return f"{result.verdict}, {len(result.checks)} checks"
    named = ", ".join(check_name(check) for check in failed[:3])
    more = f" and {len(failed) - 3} more" if len(failed) > 3 else ""
    return f"caught by {named}{more}: {failed[0].message[:60]}"


def _trial(fault: str, case: str, is_good: bool, message: str) -> CheckResult:
    healthy = load_case(case)
    return CheckResult(
        metric=f"{fault} on {case}",
        against="self-test",
        strain=healthy.strain,
        value=None,
        limit=0.0,
        scale="-",
        unit="-",
        reference_error=0.0,
        verdict=Verdict.PASSED if is_good else Verdict.FAILED,
        reason="a gate must be able to go red",
        message=message,
    )


@contextmanager
def _spoiled_references(word: str) -> Iterator[None]:
    """Stored references that are missing, another case's, or cut off."""
    own = references_folder()
    before = os.environ.get("PALPATE_REFERENCES")
    with scratch_folder("self-test") as folder:
        target = folder / f"{_CASE_OF_REFERENCES}.npz"
        if word == "stale-reference":
            shutil.copy(own / "kidney.npz", target)
        elif word == "damaged-reference":
            whole = (own / f"{_CASE_OF_REFERENCES}.npz").read_bytes()
            target.write_bytes(whole[: len(whole) // 2])
        os.environ["PALPATE_REFERENCES"] = str(folder)
        try:
            yield
        finally:
            if before is None:
                del os.environ["PALPATE_REFERENCES"]
            else:
                os.environ["PALPATE_REFERENCES"] = before
