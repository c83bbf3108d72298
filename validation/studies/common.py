"""What every study of a case leaves: report, tables, machine-readable results."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.table import Table

from palpate.validation.case import load_case
from palpate.validation.judging import outputs
from palpate.validation.judging.judge import exit_code, judge_case
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.html import write_report
from palpate.validation.report.table_one import StateTable, state_table
from palpate.validation.run_folder import RESULTS


def judge_and_report(
    name: str, folder: Path, progress: Callable[[str], None], console: Console
) -> CaseResult:
    """Judge a built-in case, write the report into the folder, and print its tables."""
    result = judge_case(load_case(name), live=True, progress=progress)
    progress("drawing the report")
    write_report([result], folder)
    (folder / "summary.md").write_text(outputs.summary_markdown([result]), encoding="utf-8")
    text = outputs.results_json([result], str(result.provenance["palpate"]))
    (folder / RESULTS).write_text(text, encoding="utf-8")
    console.print(rich_state_table(state_table(result)))
    outputs.print_results([result], console)
    return result


def code_of(result: CaseResult) -> int:
    """The exit code of one case."""
    return exit_code([result])


def rich_state_table(table: StateTable) -> Table:
    """Volumes and areas for the terminal."""
    out = Table(title="Volume [mm3] and surface area [mm2]", title_justify="left")
    for column in ("quantity", "state", *table.columns):
        out.add_column(column, justify="right" if column in table.columns else "left")
    for row in table.rows:
        cells = [
            "-" if value is None else f"{value:.0f}" + ("" if c is None else f" ({c:+.2f} %)")
            for value, c in row.cells
        ]
        out.add_row(row.quantity, row.state, *cells)
    return out
