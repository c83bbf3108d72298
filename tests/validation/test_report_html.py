"""The report: whole, offline, and unharmed by what stands in a case."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import pytest

from palpate.validation.case import load_case
from palpate.validation.judge import judge_case
from palpate.validation.report import html
from palpate.validation.report.table_one import state_table
from palpate.validation.results import CaseResult, Verdict


@pytest.fixture(scope="module")
def kidney() -> CaseResult:
    return judge_case(load_case("kidney"))


def test_table_one_prints_the_paper_and_the_fitted_reference(kidney: CaseResult) -> None:
    table = state_table(kidney)
    assert table.columns[0] == "paper"
    assert table.columns[-1] == "fastsim"
    truth = table.columns.index("reference P2, refined")
    rows = {(row.quantity, row.state): row.cells for row in table.rows}
    for state, growth in (("linear strain", 9.51), ("Green strain", 5.92)):
        cells = rows["volume", state]
        assert cells[0][1] == pytest.approx(growth, abs=0.005)
        # The fit: to 0.05 percentage points.
        assert cells[truth][1] == pytest.approx(growth, abs=0.05)
    assert rows["surface area", "original"][0][0] == 208017.0
    assert rows["surface area", "original"][truth][0] == pytest.approx(26400.0, rel=0.01)


def test_the_page_is_whole_and_offline(kidney: CaseResult, tmp_path: Path) -> None:
    text = html.write_report([kidney], tmp_path).read_text("utf-8")
    assert "10 of 10 checks passed" in text
    assert "calibration, not a validation" in re.sub(r"\s+", " ", text)
    assert "default-src 'none'" in text
    assert not re.search(r"(src|href)=\"(?!data:)", text.replace('xlink:href="#', ""))
    assert text.count("data:image/png") == 2
    assert len(text) < 5_000_000
    assert (tmp_path / "kidney-states.csv").read_text().count("\n") == 7


def test_a_hostile_title_is_text(
    kidney: CaseResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(html, "draw_pictures", lambda _result, _folder: {})
    hostile = "<script>alert(1)</script>"
    check = dataclasses.replace(kidney.checks[0], reason=hostile, message=hostile)
    result = dataclasses.replace(
        kidney, title=hostile, checks=(check,), verdict=Verdict.FAILED, notes=(hostile,),
        provenance={**kidney.provenance, "command": hostile},
    )  # fmt: skip
    text = html.write_report([result], tmp_path).read_text("utf-8")
    assert "<script" not in text
    assert text.count("&lt;script&gt;") >= 5


def test_no_picture_is_said_and_the_verdict_stays(
    kidney: CaseResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(html, "draw_pictures", lambda _result, _folder: {})
    text = html.write_report([kidney], tmp_path).read_text("utf-8")
    assert "could not be drawn" in text
    assert "10 of 10 checks passed" in text
