"""The tables of a report as CSV: errors and limits in full digits, SI units."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from palpate.validation.judging.error_budget import Budget, budget_rows
from palpate.validation.judging.results import CaseResult
from palpate.validation.quoting import csv_text
from palpate.validation.report.table_one import state_table_csv

_CHECK = (
    "metric", "against", "strain", "element", "verdict", "value", "limit", "reference_error",
    "unit", "scale", "bar_says", "is_vacuous", "precision", "reason",
)  # fmt: skip
_SOLUTION = ("label", "strain", "element", "degree")
_NUMBERS = {
    "max_displacement": "largest displacement [m]",
    "volume": "volume [m3]",
    "surface_area": "surface area [m2]",
    "smallest_det_f": "smallest det F",
    "seconds": "time [s], none of what was stored",
}


def write_tables(result: CaseResult, folder: Path, budgets: Sequence[Budget] = ()) -> list[Path]:
    """Write NAME-states.csv, NAME-checks.csv, NAME-solutions.csv, and NAME-budget.csv with budgets.

    Args:
        result: A judged case.
        folder: That exists.
        budgets: Of the candidates' errors, where they are known.

    Returns:
        The files.
    """
    texts = {
        "states": state_table_csv(result),
        "checks": csv_text(_CHECK, ([_cell(getattr(c, n)) for n in _CHECK] for c in result.checks)),
        "solutions": csv_text(
            ["simulator", *_SOLUTION[1:], *_NUMBERS.values()],
            (
                [_cell(getattr(s, n) or None) for n in (*_SOLUTION, *_NUMBERS)]
                for s in result.states
            ),
        ),
    }
    if budgets:
        texts["budget"] = csv_text(*budget_rows(list(budgets)))
    made = []
    for name, text in texts.items():
        path = folder / f"{result.name}-{name}.csv"
        path.write_text(text, encoding="utf-8")
        made.append(path)
    return made


def _cell(value: object) -> object:
    """Numbers to ten digits; words of a kind as they are."""
    if value is None:
        return ""
    return (
        f"{value:.10g}" if isinstance(value, float) else value if type(value) is int else str(value)
    )
