"""Two runs side by side: what each check found in one results.json and in another.

Two versions of a simulator, two simulators, one on two machines, or today beside a run that
somebody accepted. Nothing is judged anew.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from palpate.meshes.errors import FileFormatError
from palpate.meshes.problem import Element
from palpate.meshes.untrusted import parse_json, read_text
from palpate.validation.case.body_schema import Number
from palpate.validation.judging.results import check_name
from palpate.validation.metrics import CATALOGUE
from palpate.validation.quoting import for_markdown
from palpate.validation.states import ExitCode

# Changes smaller than this are rounding and solver noise.
_QUIET = 1e-6
# From good to bad: a verdict further on is worse. A skipped check says nothing.
_RANK = {"passed": 0, "skipped": 1, "inconclusive": 2, "failed": 3}
# The changes that stand first in a table.
_ORDER = ("worse", "gone", "larger error", "changed", "new", "better", "smaller error")


class CheckOfRun(BaseModel):
    """The parts of a check that are compared."""

    metric: str
    against: str
    strain: str
    element: str = Element.LINEAR.value
    verdict: str
    limit: Number
    value: Number | None
    reference_error: Number | None = 0.0

    def __str__(self) -> str:
        """Value, bar and verdict."""
        value = "no value" if self.value is None else f"{self.value:.3g}"
        error = self.reference_error
        bar = " ± unknown" if error is None else f" ± {error:.1g}" if error else ""
        return f"{value}{bar}, {self.verdict}"


class CaseOfRun(BaseModel):
    """The parts of a case that are compared."""

    name: str
    checks: list[CheckOfRun]
    metrics: dict[str, Number | None] = {}
    provenance: dict[str, Any] = {}


class _Run(BaseModel):
    """The parts of a results.json that are compared; other keys are left alone."""

    cases: list[CaseOfRun]


def read_run(path: str | Path) -> dict[str, CaseOfRun]:
    """The cases of a results.json, by name.

    Raises:
        FileFormatError: Missing, or not a results.json of this schema.
    """
    try:
        document = parse_json(read_text(path))
        if not isinstance(document, dict) or type(document.get("schema")) is not int:
            raise ValueError("no schema")
        if document["schema"] != 1:
            raise ValueError(f"schema {document['schema']} is not known here (1 is)")
        return {case.name: case for case in _Run.model_validate(document).cases}
    except FileFormatError:
        raise
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise FileFormatError(path, f"not a results.json ({where}: {first['msg']})") from error
    except ValueError as error:
        raise FileFormatError(path, f"not a results.json ({error})") from error


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
        """The change: better, worse, same, new or gone; by verdict, then by the error."""
        if self.first is None or self.second is None:
            return "new" if self.first is None else "gone"
        ranks = [_RANK.get(check.verdict, 3) for check in (self.first, self.second)]
        if ranks[0] != ranks[1]:
            return "worse" if ranks[1] > ranks[0] else "better"
        before, now = self.first.value, self.second.value
        if before is None or now is None:
            return "same" if before == now else "changed"
        limit = max(abs(self.first.limit), abs(self.second.limit))
        if abs(now - before) <= _QUIET * limit:
            return "same"
        return "larger error" if abs(now) > abs(before) else "smaller error"

    @property
    def is_worse(self) -> bool:
        """Whether the second run's verdict is the worse, or it has lost the check."""
        return self.change in ("worse", "gone")

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
    """

    pairs: tuple[Pair, ...]
    remarks: tuple[str, ...]

    @property
    def exit_code(self) -> ExitCode:
        """Failed where a check of the second run is worse or gone, passed otherwise."""
        return ExitCode.FAILED if any(pair.is_worse for pair in self.pairs) else ExitCode.PASSED

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
    for name in dict.fromkeys([*before, *now]):
        old, new = before.get(name), now.get(name)
        pairs += _pairs(name, old, new)
        if old is not None and new is not None:
            remarks += [f"{name} {remark}" for remark in _changes_of_case(old, new)]
    remarks += [line for pair in pairs for line in _changed_limit(pair)]
    same = sum(pair.change == "same" for pair in pairs)
    pairs.sort(key=lambda pair: (*_ORDER, "same").index(pair.change))
    return RunComparison(tuple(pairs), (f"{same} of {len(pairs)} checks found the same.", *remarks))


def _pairs(name: str, first: CaseOfRun | None, second: CaseOfRun | None) -> Iterator[Pair]:
    found: dict[str, tuple[list[CheckOfRun], list[CheckOfRun]]] = {}
    for which, case in enumerate((first, second)):
        for check in case.checks if case is not None else ():
            called = check_name(check.metric, check.against, check.strain, check.element)
            found.setdefault(called, ([], []))[which].append(check)
    # A metric may be asked for at several points: such checks are matched in their order.
    for check_called, lists in found.items():
        yield from (Pair(name, check_called, *both) for both in zip_longest(*lists))


def _changed_limit(pair: Pair) -> Iterator[str]:
    if pair.first is None or pair.second is None or pair.first.limit == pair.second.limit:
        return
    metric = CATALOGUE.get(pair.second.metric)
    is_lower = metric is not None and metric.is_lower_limit
    word = "looser" if (pair.second.limit > pair.first.limit) != is_lower else "tighter"
    limits = f"{pair.first.limit:g}, then {pair.second.limit:g}"
    yield f"{pair.case}, {pair.check}: limit {limits} ({word})."


def _changes_of_case(first: CaseOfRun, second: CaseOfRun) -> Iterator[str]:
    """Whether it is another problem, and the number of the body that changed most."""
    if first.provenance.get("case_key") != second.provenance.get("case_key"):
        yield ("is another problem in the two runs: mesh, material, supports or loads differ.")
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
