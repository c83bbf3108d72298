"""What a study is: compute, judge, present. What it writes is the same for all."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from rich.console import Console

from palpate.meshes.arrays import Points
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.case import load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.outputs import results_json
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.study_page import Finding, Page, leave
from palpate.validation.states import ExitCode, Progress, Verdict

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


def volume_change(mesh: TetMesh, displacement: Points) -> float:
    """Change of volume over the rest volume [-]."""
    return float(signed_volumes(mesh.points + displacement, mesh.cells).sum()) / mesh.volume - 1.0


# A case of the paper as a study: its checks are the findings, its report is the page.


def judge_live(name: str, progress: Progress) -> CaseResult:
    """Judge a built-in case, its reference solved here where FEniCSx is."""
    return judge_case(load_case(name), live=True, progress=progress)


def findings_of(result: CaseResult) -> list[Finding]:
    """The case, then each of its checks."""
    passed = sum(check.verdict is Verdict.PASSED for check in result.checks)
    whole = f"{passed} of {len(result.checks)} checks passed"
    return [
        Finding(f"case {result.name}", whole, result.verdict),
        *(Finding(c.name, c.message, c.verdict) for c in result.checks),
    ]


def page_of(result: CaseResult) -> Page:
    """The case's report, and its results by the schema of every other verb."""
    text = results_json([result], str(result.provenance["palpate"]))
    return Page(numbers=json.loads(text), case=result)
