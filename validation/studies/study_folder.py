"""What a study leaves in its folder: page, figures, tables as CSV, numbers as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import matplotlib as mpl
from rich.console import Console

from palpate.validation.quoting import csv_text
from palpate.validation.report.study_page import (
    Finding,
    StudyFigure,
    StudyTable,
    gravest,
    write_study_page,
)
from palpate.validation.run_folder import RESULTS
from palpate.validation.states import Verdict

CODES = {Verdict.PASSED: 0, Verdict.FAILED: 1, Verdict.INCONCLUSIVE: 3}


def paper_style() -> AbstractContextManager[None]:
    """Figures whose text stays text and which fit a paper."""
    return mpl.rc_context({"font.size": 10, "svg.fonttype": "none", "font.family": "sans-serif"})


def judged(claim: str, found: str, is_true: bool) -> Finding:
    """A claim that is either true or false."""
    return Finding(claim, found, Verdict.PASSED if is_true else Verdict.FAILED)


def leave_study(
    folder: Path,
    console: Console,
    *,
    name: str,
    title: str,
    about: Sequence[str],
    findings: Sequence[Finding],
    figures: Mapping[str, StudyFigure],
    tables: Mapping[str, StudyTable],
    numbers: Mapping[str, Any],
) -> int:
    """Write report.html, NAME.svg and NAME.csv for each figure and table, and results.json.

    Args:
        folder: An empty folder.
        console: Where the findings are printed.
        name: Of the study.
        title: Of the page.
        about: Paragraphs below the findings.
        findings: Claims put to the test; the gravest verdict is the study's.
        figures: By file name without its end.
        tables: Likewise.
        numbers: All that was measured, for results.json; no NaN.

    Returns:
        The exit code: 0 passed, 1 failed, 3 inconclusive.
    """
    for stem, table in tables.items():
        (folder / f"{stem}.csv").write_text(csv_text(table.columns, table.rows), encoding="utf-8")
    for stem, figure in figures.items():
        (folder / f"{stem}.svg").write_text(figure.svg, encoding="utf-8")
    write_study_page(
        folder / "report.html",
        title=title,
        about=about,
        findings=findings,
        figures=list(figures.values()),
        tables=list(tables.values()),
    )
    document = {"study": name, "findings": [asdict(f) for f in findings], **numbers}
    text = json.dumps(document, indent=1, allow_nan=False)
    (folder / RESULTS).write_text(text + "\n", encoding="utf-8")
    for f in findings:
        console.print(f"{f.verdict}: {f.claim}: {f.found}", markup=False, soft_wrap=True)
    return CODES[gravest(findings)]
