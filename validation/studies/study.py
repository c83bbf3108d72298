"""What a study is: compute, judge, present. What it leaves is the same for all."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Generic, TypeVar

from rich.console import Console

from palpate.validation.quoting import for_json, for_terminal
from palpate.validation.report.html import write_report
from palpate.validation.report.study_page import Finding, Page, study_page
from palpate.validation.run_folder import RESULTS
from palpate.validation.states import ExitCode, Progress, gravest

Found = TypeVar("Found")


@dataclass(frozen=True)
class Study(Generic[Found]):
    """Three steps, each of which can be tried alone.

    Attributes:
        title: Of its page.
        about: A heading, then paragraphs for the page: the docstring of its module.
        compute: Everything that takes time.
        judge: Claims put to the test; the gravest verdict is the study's.
        present: Figures, tables, remarks.
    """

    title: str
    about: str | None
    compute: Callable[[Progress], Found]
    judge: Callable[[Found], list[Finding]]
    present: Callable[[Found], Page]

    def run(self, name: str, folder: Path, progress: Progress, console: Console) -> ExitCode:
        """Take the three steps, leave what they give in an empty folder; see `leave`."""
        found = self.compute(progress)
        findings = self.judge(found)
        progress("drawing the report")
        page = self.present(found)
        about = (self.about or "").split("\n\n")[1:]
        return leave(
            folder, console, name=name, title=self.title, about=about, findings=findings, page=page
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

    Args:
        folder: That exists.
        console: Where the findings are printed.
        name: Of the study.
        title: Of the page.
        about: Paragraphs below the findings.
        findings: Claims put to the test, one at least.
        page: What is shown.

    Returns:
        By the gravest verdict: passed, failed or inconclusive.
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
    for f in findings:
        line = for_terminal(f"{f.verdict}: {f.claim}: {f.found}")
        console.print(line, markup=False, soft_wrap=True)
    return ExitCode[verdict.name]
