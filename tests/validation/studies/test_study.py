"""The contract of studies: every name has its three steps, and what they leave is the same."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

from palpate.meshes.errors import InputError
from palpate.validation import studies
from palpate.validation.case import load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.report.plots import Figure
from palpate.validation.report.study_page import Finding, Page, Table, leave
from palpate.validation.states import ExitCode, Progress, Verdict
from palpate.validation.studies import STUDIES, load_study, run_study
from palpate.validation.studies.kidney import findings_of, page_of


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_has_the_three_steps(name: str) -> None:
    study = load_study(name)
    assert study.TITLE
    assert study.__doc__
    assert all(callable(step) for step in (study.compute, study.judge, study.present))


def test_a_study_that_is_not_there_is_reported_with_those_that_are() -> None:
    with pytest.raises(InputError, match=r"no study 'moon'.*kidney"):
        load_study("moon")


def small(verdict: Verdict) -> SimpleNamespace:
    def compute(progress: Progress) -> float:
        progress("computing")
        return 0.5

    def judge(found: float) -> list[Finding]:
        passed = Finding("first", "1", Verdict.PASSED)
        return [passed, Finding("half::is half", f"{found}", verdict)]

    def present(found: float) -> Page:
        table = Table("T", {"x": ".1f"}, [(found,), (float("nan"),)])
        return Page({"fig": Figure("<svg></svg>", "")}, {"tab": table}, numbers={"y": float("inf")})

    return SimpleNamespace(
        TITLE="Small", __doc__="Heading.\n\nWhy.", compute=compute, judge=judge, present=present
    )


@pytest.mark.parametrize(
    ("verdict", "code"),
    [
        (Verdict.PASSED, ExitCode.PASSED),
        (Verdict.FAILED, ExitCode.FAILED),
        (Verdict.INCONCLUSIVE, ExitCode.INCONCLUSIVE),
    ],
)
def test_a_study_leaves_page_figures_tables_and_numbers(
    tmp_path: Path, verdict: Verdict, code: ExitCode, monkeypatch: pytest.MonkeyPatch
) -> None:
    console, lines = Console(record=True, width=40), list[str]()
    monkeypatch.setattr(studies, "load_study", lambda _name: small(verdict))
    assert run_study("small", tmp_path, lines.append, console) == code
    assert lines == ["computing", "drawing the report"]
    assert {f.name for f in tmp_path.iterdir()} == {
        "report.html", "fig.svg", "tab.csv", "results.json"
    }  # fmt: skip
    document = json.loads((tmp_path / "results.json").read_text("utf-8"))
    assert (document["study"], document["verdict"]) == ("small", verdict)
    assert document["findings"][1]["found"] == "0.5"
    # Strict JSON: what is no number is null.
    assert document["tables"]["tab"] == [{"x": 0.5}, {"x": None}]
    assert document["y"] is None
    assert (tmp_path / "tab.csv").read_text("utf-8").splitlines()[:2] == ["x", "0.5"]
    page = (tmp_path / "report.html").read_text("utf-8")
    assert "<p>Why.</p>" in page
    assert "Heading." not in page
    # No workflow command in the log of a CI, whatever a claim says.
    assert f"{verdict}: half: :is half: 0.5" in console.export_text()


def test_a_case_as_a_study_has_its_own_report_and_its_checks_as_findings(tmp_path: Path) -> None:
    result = judge_case(load_case("block"))
    findings = findings_of(result)
    assert len(findings) == 1 + len(result.checks)
    assert findings[0].verdict is result.verdict is Verdict.PASSED
    page = page_of(result)
    console = Console(quiet=True)
    given = {"name": "block", "title": "Block", "about": (), "findings": findings, "page": page}
    assert leave(tmp_path, console, **given) == 0
    document = json.loads((tmp_path / "results.json").read_text("utf-8"))
    assert [case["name"] for case in document["cases"]] == ["block"]
    assert document["schema"] == 1
    html = (tmp_path / "report.html").read_text("utf-8")
    assert result.title in html
    assert "viewer" in html
