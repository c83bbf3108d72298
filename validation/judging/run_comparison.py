"""Two runs side by side: what each check found in one results.json and in another.

Two versions of a simulator, two simulators, one on two machines, or today beside a run that
somebody accepted. Nothing is judged anew, but a file whose verdicts its own numbers do not give is
refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from palpate.meshes.errors import FileFormatError
from palpate.meshes.problem import Element
from palpate.meshes.untrusted import parse_json, read_text
from palpate.validation.case.body_schema import Number
from palpate.validation.judging.checks import decide
from palpate.validation.judging.results import check_name
from palpate.validation.metrics import CATALOGUE
from palpate.validation.quoting import for_markdown
from palpate.validation.states import ExitCode, Verdict, gravest

# Fractions of the limit: changes below the first are rounding and solver noise; an error that grew
# by more than the second is worse, though its verdict may be as it was.
_QUIET, _WORSE = 1e-6, 0.01
# From good to bad: a verdict further on is worse. A skipped check says nothing.
_RANK = (Verdict.PASSED, Verdict.SKIPPED, Verdict.INCONCLUSIVE, Verdict.FAILED)
# The changes that make the second run the worse, in the order of a table; then the others.
_REGRESSIONS = (
    "worse", "gone", "new and not passed", "value lost", "looser limit", "larger error",
)  # fmt: skip
_ORDER = (*_REGRESSIONS, "slightly larger error", "changed", "new", "better", "smaller error")
# What the verdicts of these follow from: value, bar and limit.
_BY_NUMBERS = ("truth", "same_mesh", "candidate", "versus")


class CheckOfRun(BaseModel):
    """The parts of a check that are compared."""

    metric: str
    against: str
    strain: str
    element: str = Element.LINEAR.value
    verdict: Verdict
    limit: Number
    value: Number | None
    reference_error: Number | None = 0.0

    def __str__(self) -> str:
        """Value, bar and verdict."""
        value = "no value" if self.value is None else f"{self.value:.3g}"
        error = self.reference_error
        bar = " ± unknown" if error is None else f" ± {error:.1g}" if error else ""
        return f"{value}{bar}, {self.verdict}"

    @property
    def name(self) -> str:
        """See `check_name`."""
        return check_name(self.metric, self.against, self.strain, self.element)

    @property
    def is_lower_limit(self) -> bool:
        """Whether the limit is the least that the value may be."""
        return self.metric in CATALOGUE and CATALOGUE[self.metric].is_lower_limit

    @property
    def contradicts_itself(self) -> bool:
        """Whether it says passed, and its numbers do not."""
        if self.verdict is not Verdict.PASSED or self.against not in _BY_NUMBERS:
            return False
        if self.value is not None and self.is_lower_limit:
            return not self.value > self.limit
        value = math.inf if self.value is None else self.value
        bar = math.inf if self.reference_error is None else self.reference_error
        return decide(value, bar, self.limit) is not Verdict.PASSED


class CaseOfRun(BaseModel):
    """The parts of a case that are compared."""

    name: str
    verdict: Verdict
    checks: list[CheckOfRun]
    metrics: dict[str, Number | None] = {}
    provenance: dict[str, Any] = {}


class _Run(BaseModel):
    """The parts of a results.json that are compared; other keys are left alone."""

    cases: list[CaseOfRun]


def read_run(path: str | Path) -> dict[str, CaseOfRun]:
    """The cases of a results.json, by name.

    Raises:
        FileFormatError: Missing, not a results.json of this schema, without any check, with two
            cases of one name, or with a verdict that its own numbers do not give.
    """
    try:
        document = parse_json(read_text(path))
        if not isinstance(document, dict) or type(document.get("schema")) is not int:
            raise ValueError("no schema")
        if document["schema"] != 1:
            raise ValueError(f"schema {document['schema']} is not known here (1 is)")
        cases = _Run.model_validate(document).cases
        _require_sound(cases)
        return {case.name: case for case in cases}
    except FileFormatError:
        raise
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise FileFormatError(path, f"not a results.json ({where}: {first['msg']})") from error
    except ValueError as error:
        raise FileFormatError(path, f"not a results.json ({error})") from error


def _require_sound(cases: Sequence[CaseOfRun]) -> None:
    """Raise ValueError for a run that says nothing, or what its own numbers contradict."""
    if not any(case.checks for case in cases):
        raise ValueError("no case with a check in it: nothing was judged, so nothing compares")
    names = [case.name for case in cases]
    for case in cases:
        if names.count(case.name) > 1:
            raise ValueError(f"two cases are called {case.name!r}: judge each once")
        for check in case.checks:
            if check.contradicts_itself:
                raise ValueError(
                    f"{case.name}, {check.name} is said to have passed, but its value is "
                    f"{check.value}, its bar {check.reference_error} and its limit {check.limit}: "
                    "the file is not as it was written; judge the case again"
                )
        least = gravest([check.verdict for check in case.checks])
        if _RANK.index(case.verdict) < _RANK.index(least):
            raise ValueError(
                f"{case.name} is said to be {case.verdict}, but a check of it {least}: the file "
                "is not as it was written; judge the case again"
            )


@dataclass(frozen=True)
class Pair:
    """One check in both runs; None where a run does not have it.

    Attributes:
        case: The case's name.
        check: Metric, compared with what, which strain, which element.
        first: The check in the first run.
        second: The check in the second run.
    """

    case: str
    check: str
    first: CheckOfRun | None
    second: CheckOfRun | None

    @property
    def change(self) -> str:
        """What changed in a word or two: by verdict, limit, then value; "same" if nothing did."""
        if self.second is None:
            return "gone"
        now = self.second
        if self.first is None:
            is_good = now.verdict in (Verdict.PASSED, Verdict.SKIPPED)
            return "new" if is_good else "new and not passed"
        before = self.first
        ranks = [_RANK.index(check.verdict) for check in (before, now)]
        if ranks[1] > ranks[0]:
            return "worse"
        if now.value is None and before.value is not None:
            return "value lost"
        if self.is_looser:
            return "looser limit"
        if ranks[1] < ranks[0]:
            return "better"
        return self._change_of_value(before, now)

    @staticmethod
    def _change_of_value(before: CheckOfRun, now: CheckOfRun) -> str:
        if before.value is None or now.value is None:
            return "same" if before.value == now.value else "changed"
        grown, limit = abs(now.value) - abs(before.value), max(abs(before.limit), abs(now.limit))
        if now.is_lower_limit:
            grown = before.value - now.value
        if abs(now.value - before.value) <= _QUIET * limit:
            return "same"
        if now.against not in _BY_NUMBERS:  # its limit may be the least that it may be
            return "changed"
        if grown <= 0.0:
            return "smaller error"
        return "larger error" if grown > _WORSE * limit else "slightly larger error"

    @property
    def is_looser(self) -> bool:
        """Whether the second run's limit allows more."""
        if self.first is None or self.second is None or self.first.limit == self.second.limit:
            return False
        return (self.second.limit > self.first.limit) is not self.second.is_lower_limit

    @property
    def is_worse(self) -> bool:
        """Whether the second run is worse here: see `change`."""
        return self.change in _REGRESSIONS

    @property
    def cells(self) -> tuple[str, str, str, str, str]:
        """The row in a table: case, check, first, second, change."""
        both = (str(self.first or "-"), str(self.second or "-"))
        return (self.case, self.check, *both, self.change)


@dataclass(frozen=True)
class RunComparison:
    """Two runs side by side.

    Attributes:
        pairs: Every check, matched by case, metric, strain and element; what is worse first.
        remarks: Sentences on limits, problems and the numbers that changed most.
        worse_cases: Sentences on whole cases that are worse, or another problem.
    """

    pairs: tuple[Pair, ...]
    remarks: tuple[str, ...]
    worse_cases: tuple[str, ...] = ()

    @property
    def exit_code(self) -> ExitCode:
        """Failed where a check or a case of the second run is worse or gone, else passed."""
        is_worse = bool(self.worse_cases) or any(pair.is_worse for pair in self.pairs)
        return ExitCode.FAILED if is_worse else ExitCode.PASSED

    @property
    def changed(self) -> list[Pair]:
        """Checks that did not find the same."""
        return [pair for pair in self.pairs if pair.change != "same"]

    def markdown(self, first: str, second: str) -> str:
        """A table, what is worse first; checks that found the same are counted below it."""
        rows = [("case", "check", first, second, "change"), ("---",) * 5]
        rows += [pair.cells for pair in self.changed]
        lines = [f"| {' | '.join(map(for_markdown, row))} |" for row in rows]
        table = [*lines, ""] if self.changed else []
        return "\n".join([*table, *map(for_markdown, self.remarks)]) + "\n"


def compare_runs(first: str | Path, second: str | Path) -> RunComparison:
    """Compare two results.json, check by check.

    Raises:
        FileFormatError: One is missing, or not a results.json of this schema.
    """
    before, now = read_run(first), read_run(second)
    pairs: list[Pair] = []
    remarks: list[str] = []
    worse: list[str] = []
    for name in dict.fromkeys([*before, *now]):
        old, new = before.get(name), now.get(name)
        pairs += _pairs(name, old, new)
        worse += [f"{name} {line}" for line in _worse_cases(old, new)]
        if old is not None and new is not None:
            remarks += [f"{name} {line}" for line in _changed_numbers(old, new)]
    remarks += [line for pair in pairs for line in _changed_limit(pair)]
    same = sum(pair.change == "same" for pair in pairs)
    pairs.sort(key=lambda pair: (*_ORDER, "same").index(pair.change))
    remarks = [f"{same} of {len(pairs)} checks found the same.", *worse, *remarks]
    return RunComparison(tuple(pairs), tuple(remarks), tuple(worse))


def _pairs(name: str, first: CaseOfRun | None, second: CaseOfRun | None) -> Iterator[Pair]:
    found: dict[str, tuple[list[CheckOfRun], list[CheckOfRun]]] = {}
    for which, case in enumerate((first, second)):
        for check in case.checks if case is not None else ():
            found.setdefault(check.name, ([], []))[which].append(check)
    # A metric may be asked for at several points: such checks are matched in their order.
    for check_called, lists in found.items():
        yield from (Pair(name, check_called, *both) for both in zip_longest(*lists))


def _changed_limit(pair: Pair) -> Iterator[str]:
    if pair.first is None or pair.second is None or pair.first.limit == pair.second.limit:
        return
    word = "looser" if pair.is_looser else "tighter"
    limits = f"{pair.first.limit:g}, then {pair.second.limit:g}"
    yield f"{pair.case}, {pair.check}: limit {limits} ({word})."


def _worse_cases(first: CaseOfRun | None, second: CaseOfRun | None) -> Iterator[str]:
    """Whether a case is gone, another problem, or of a worse verdict."""
    if second is None:
        yield "is gone."
    elif first is not None:
        if first.provenance.get("case_key") != second.provenance.get("case_key"):
            yield "is another problem in the two runs: mesh, material, supports or loads differ."
        if _RANK.index(second.verdict) > _RANK.index(first.verdict):
            yield f"was {first.verdict} and is {second.verdict}."


def _changed_numbers(first: CaseOfRun, second: CaseOfRun) -> Iterator[str]:
    """The number of the body that changed most."""
    worst, name = 0.0, ""
    for metric, now in second.metrics.items():
        before = first.metrics.get(metric)
        # Errors of 1e-12 change by themselves: only what is a number of the body counts.
        if metric.startswith("error.") or before is None or now is None:
            continue
        change = abs(now - before) / abs(before) if before else math.inf * (now != before)
        if change > max(worst, _QUIET):
            worst, name = change, metric
    if name:
        numbers = f"{first.metrics[name]:.6g}, then {second.metrics[name]:.6g}"
        yield f"changed most in {name}: {numbers} ({100.0 * worst:.3g} %)."
