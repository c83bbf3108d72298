"""A study as one HTML page that opens offline anywhere: what was found first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from palpate.validation.report.environment import page_environment
from palpate.validation.states import Verdict


@dataclass(frozen=True)
class Finding:
    """One claim that was put to the test: what was expected, what was found."""

    claim: str
    found: str
    verdict: Verdict


@dataclass(frozen=True)
class StudyTable:
    """A table with its heading; cells are text."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class StudyFigure:
    """A drawing of ours, as an <svg> element, and what it shows."""

    svg: str
    caption: str


def write_study_page(
    path: Path,
    *,
    title: str,
    about: Sequence[str],
    findings: Sequence[Finding],
    figures: Sequence[StudyFigure],
    tables: Sequence[StudyTable],
) -> None:
    """Write the page; everything but the drawings is escaped."""
    environment = page_environment()
    page = environment.get_template("study.html.j2").render(
        title=title,
        about=about,
        findings=findings,
        verdict=gravest(findings),
        figures=[(Markup(f.svg), f.caption) for f in figures],
        tables=tables,
    )
    path.write_text(page, encoding="utf-8")


def gravest(findings: Sequence[Finding]) -> Verdict:
    """Failed before inconclusive before passed."""
    for verdict in (Verdict.FAILED, Verdict.INCONCLUSIVE):
        if any(f.verdict is verdict for f in findings):
            return verdict
    return Verdict.PASSED
