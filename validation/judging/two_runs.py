"""Two runs side by side: what each check found in one results.json and in another.

Two versions of a simulator, two simulators, or one on two machines. Unlike `--since`, nobody is the
accepted one, and nothing is judged anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

from palpate.validation.judging.outputs import named
from palpate.validation.judging.result_changes import (
    QUIET,
    AcceptedCase,
    AcceptedCheck,
    read_accepted,
)
from palpate.validation.quoting import for_markdown
from palpate.validation.states import ExitCode

# From good to bad: a verdict further on is worse. A skipped check says nothing.
_RANK = {"passed": 0, "skipped": 1, "inconclusive": 2, "failed": 3}


@dataclass(frozen=True)
class Pair:
    """One check in both runs; None where a run does not have it.

    Attributes:
        case: The case's name.
        check: Metric, against what, which strain, which element.
        first: As the first run found it.
        second: As the second did.
        is_other_problem: Whether mesh, material, supports or loads differ between the runs.
    """

    case: str
    check: str
    first: AcceptedCheck | None
    second: AcceptedCheck | None
    is_other_problem: bool

    @property
    def change(self) -> str:
        """In one word: better, worse, same, new or gone; by verdict, then by the error."""
        if self.first is None or self.second is None:
            return "new" if self.first is None else "gone"
        ranks = [_RANK.get(check.verdict, 3) for check in (self.first, self.second)]
        if ranks[0] != ranks[1]:
            return "worse" if ranks[1] > ranks[0] else "better"
        before, now = self.first.value, self.second.value
        if before is None or now is None:
            return "same" if before == now else "changed"
        limit = max(abs(self.first.limit), abs(self.second.limit))
        if abs(now - before) <= QUIET * limit:
            return "same"
        return "larger error" if abs(now) > abs(before) else "smaller error"

    @property
    def is_worse(self) -> bool:
        """Whether the second run's verdict is the worse, or it has lost the check."""
        return self.change in ("worse", "gone")


def pair_runs(first: str | Path, second: str | Path) -> list[Pair]:
    """Every check of two results.json, matched by case, metric, strain and element.

    Raises:
        FileFormatError: One is missing, or not a results.json of this schema.
    """
    runs = [read_accepted(path) for path in (first, second)]
    names = dict.fromkeys([*runs[0], *runs[1]])
    return [pair for name in names for pair in _of_case(name, *(run.get(name) for run in runs))]


def _of_case(name: str, first: AcceptedCase | None, second: AcceptedCase | None) -> list[Pair]:
    keys = [case.provenance.get("case_key") for case in (first, second) if case is not None]
    differs = len(keys) == 2 and keys[0] != keys[1]
    found: dict[str, tuple[list[AcceptedCheck], list[AcceptedCheck]]] = {}
    for place, case in enumerate((first, second)):
        for check in case.checks if case is not None else ():
            called = named(check.metric, check.against, check.strain, check.element)
            found.setdefault(called, ([], []))[place].append(check)
    # A metric may be asked for at several points: such checks are matched in their order.
    return [
        Pair(name, check, *both, is_other_problem=differs)
        for check, lists in found.items()
        for both in zip_longest(*lists)
    ]


def exit_code_of(pairs: Sequence[Pair]) -> ExitCode:
    """Failed where a check of the second run is worse or gone, passed otherwise."""
    return ExitCode.FAILED if any(pair.is_worse for pair in pairs) else ExitCode.PASSED


def pairs_markdown(pairs: Sequence[Pair], first: str, second: str) -> str:
    """A table, what is worse first; checks that found the same are counted below it."""
    order = ["worse", "gone", "larger error", "changed", "new", "better", "smaller error"]
    told = sorted((p for p in pairs if p.change != "same"), key=lambda p: order.index(p.change))
    rows = [
        f"| {for_markdown(p.case)} | {for_markdown(p.check)} | {shown(p.first)} "
        f"| {shown(p.second)} | {p.change} |"
        for p in told
    ]
    head = f"| case | check | {for_markdown(first)} | {for_markdown(second)} | change |"
    lines = [head, "| --- | --- | --- | --- | --- |", *rows] if rows else []
    return "\n".join([*lines, *(["", *_remarks(pairs)] if lines else _remarks(pairs))]) + "\n"


def _remarks(pairs: Sequence[Pair]) -> list[str]:
    same = sum(pair.change == "same" for pair in pairs)
    lines = [f"{same} of {len(pairs)} checks found the same."]
    others = dict.fromkeys(pair.case for pair in pairs if pair.is_other_problem)
    lines += [
        f"{for_markdown(name)} is another problem in the two runs: mesh, material, supports or "
        "loads differ."
        for name in others
    ]
    return lines


def shown(check: AcceptedCheck | None) -> str:
    """Value, bar and verdict of one run."""
    if check is None:
        return "-"
    value = "no value" if check.value is None else f"{check.value:.3g}"
    error = check.reference_error
    bar = " ± unknown" if error is None else f" ± {error:.1g}" if error else ""
    return f"{value}{bar}, {check.verdict}"
