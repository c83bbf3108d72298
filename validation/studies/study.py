"""What a study is: compute, judge, present. What it leaves is the same for all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from rich.console import Console

from palpate.validation.report.study_page import Finding, Page, leave
from palpate.validation.states import ExitCode, Progress

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
