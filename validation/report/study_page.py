"""The results of a study and their page: HTML that opens offline and begins with findings."""

from __future__ import annotations

import datetime
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from markupsafe import Markup
from rich.console import Console

from palpate.validation.judging.results import CaseResult
from palpate.validation.quoting import csv_text, for_json, for_terminal
from palpate.validation.report.html import page_environment, write_report
from palpate.validation.report.plots import Figure
from palpate.validation.run_folder import RESULTS
from palpate.validation.states import ExitCode, Verdict, gravest
from palpate.validation.versions import version_of


@dataclass(frozen=True)
class Finding:
    """A claim that was tested: what was expected, and what was found."""

    claim: str
    found: str
    verdict: Verdict


def judged(claim: str, found: str, is_true: bool) -> Finding:
    """A finding on a claim that is either true or false."""
    return Finding(claim, found, Verdict.PASSED if is_true else Verdict.FAILED)


@dataclass(frozen=True)
class Table:
    """Rows of numbers and words, from which the page, the CSV and the JSON are made.

    `columns` are headings, each with the format of its numbers on the page, "" for words; None in a
    row is shown as a dash. A table that is not shown is in the files only, and so is a column of
    words in which no row says anything.
    """

    title: str
    columns: Mapping[str, str]
    rows: Sequence[Sequence[Any]]
    is_shown: bool = True

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"{self.title}: {len(row)} cells, {len(self.columns)} columns")

    @property
    def shown(self) -> dict[str, str]:
        """The columns of the page, each with the format of its numbers."""
        return {
            name: form
            for k, (name, form) in enumerate(self.columns.items())
            if form or not self.rows or any(row[k] for row in self.rows)
        }

    @property
    def texts(self) -> list[list[str]]:
        """The cells as text, as the page shows them."""
        return [
            [
                _text(cell, form)
                for cell, (name, form) in zip(row, self.columns.items(), strict=True)
                if name in self.shown
            ]
            for row in self.rows
        ]

    @property
    def records(self) -> list[dict[str, Any]]:
        """The rows, each as a record by heading."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.rows]

    @property
    def csv(self) -> str:
        """The table as CSV, with numbers to ten digits and None as an empty cell."""
        cells = ([f"{c:.10g}" if isinstance(c, float) else c for c in row] for row in self.rows)
        return csv_text(list(self.columns), cells)


def _text(cell: Any, form: str) -> str:
    if cell is None:
        return "-"
    # Adding 0.0 turns minus zero into zero.
    return cell if isinstance(cell, str) else format(cell + 0, form)


@dataclass(frozen=True)
class Page:
    """Figures and tables by file name without suffix; remarks go below the text.

    `lead` is the answer to what was asked, at the head of the page in the place of the verdict.
    `numbers` are further ones for results.json; the own report of a judged `case` is the page.
    """

    figures: Mapping[str, Figure] = field(default_factory=dict)
    tables: Mapping[str, Table] = field(default_factory=dict)
    remarks: Sequence[str] = ()
    numbers: Mapping[str, Any] = field(default_factory=dict)
    case: CaseResult | None = None
    lead: str = ""


def study_page(title: str, about: Sequence[str], findings: Sequence[Finding], page: Page) -> str:
    """The page as HTML; everything except the drawings is escaped."""
    return (
        page_environment()
        .get_template("study.html.j2")
        .render(
            title=title,
            version=version_of("palpate"),
            day=f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d}",
            lead=page.lead,
            about=[*about, *page.remarks],
            findings=findings,
            verdict=gravest([f.verdict for f in findings]),
            figures=[(Markup(f.svg), f.caption) for f in page.figures.values()],
            tables=[table for table in page.tables.values() if table.is_shown],
        )
    )


def leave(
    folder: Path,
    console: Console,
    *,
    name: str,
    title: str,
    about: Sequence[str],
    findings: Sequence[Finding],
    page: Page,
) -> ExitCode:
    """Write report.html, NAME.svg and NAME.csv for each figure and table, and results.json.

    The folder exists; findings (at least one) are printed, and paragraphs `about` the study stand
    below them. Returns the exit code of the gravest verdict: passed, failed or inconclusive.
    """
    for stem, table in page.tables.items():
        (folder / f"{stem}.csv").write_text(table.csv, encoding="utf-8")
    for stem, figure in page.figures.items():
        (folder / f"{stem}.svg").write_text(figure.svg, encoding="utf-8")
    if page.case is None:
        html = study_page(title, about, findings, page)
        (folder / "report.html").write_text(html, encoding="utf-8")
    else:
        write_report([page.case], folder)
    verdict = gravest([f.verdict for f in findings])
    document = {
        "study": name,
        "verdict": verdict,
        "findings": [asdict(f) for f in findings],
        "tables": {stem: table.records for stem, table in page.tables.items()},
        **page.numbers,
    }
    text = json.dumps(for_json(document), indent=1, allow_nan=False)
    (folder / RESULTS).write_text(text + "\n", encoding="utf-8")
    if page.lead:
        console.print(for_terminal(page.lead), markup=False, soft_wrap=True)
    for f in findings:
        line = for_terminal(f"{f.verdict}: {f.claim}: {f.found}")
        console.print(line, markup=False, soft_wrap=True)
    return ExitCode[verdict.name]
