"""How far each of several candidates is from the truth, case by case: one table."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.validation.judging.expectation import errors_of, named_checks
from palpate.validation.judging.results import CaseResult
from palpate.validation.quoting import for_markdown


def side_by_side(results: Sequence[CaseResult]) -> tuple[list[str], list[list[str]]]:
    """Column names, and a row for each error against the truth or a published number.

    Of cases with several candidates; errors, the truth's own bar and limits in per cent.
    """
    several = [result for result in results if len(result.candidates) > 1]
    if not several:
        return [], []
    columns = ["case", "error", *(one.name for one in several[0].candidates), "bar", "limit"]
    rows = []
    for result in several:
        checks = dict(named_checks(result, result.candidates[0]))
        found = [errors_of(result, judged) for judged in result.candidates]
        for name, *values in zip(found[0], *(errors.values() for errors in found), strict=True):
            check = checks.get(name)
            told = [None, None] if check is None else [check.reference_error, check.limit]
            shown = (_percent(value) for value in (*values, *told))
            rows.append([result.name, name, *shown])
    return columns, rows


def side_by_side_markdown(results: Sequence[CaseResult]) -> str:
    """The table for a job summary; empty where no case has several candidates."""
    columns, rows = side_by_side(results)
    if not rows:
        return ""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n" + "".join(f"| {' | '.join(map(for_markdown, line))} |\n" for line in lines)


def _percent(value: float | None) -> str:
    return "-" if value is None or not value < float("inf") else f"{100.0 * value:.2g} %"
