"""Two results.json side by side: what is better, worse, new and gone."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from palpate.meshes.errors import FileFormatError
from palpate.validation.cli import app
from palpate.validation.judging.two_runs import exit_code_of, pair_runs, pairs_markdown
from palpate.validation.states import ExitCode


def check(metric: str, value: float | None, verdict: str, **others: Any) -> dict[str, Any]:
    about = {"metric": metric, "against": "truth", "strain": "green", "limit": 0.05}
    return {**about, "value": value, "verdict": verdict, "reference_error": 0.003, **others}


RUN = {
    "palpate": "0",
    "schema": 1,
    "cases": [
        {
            "name": "liver",
            "provenance": {"case_key": "k"},
            "checks": [
                check("displacement_l2", 0.02, "passed"),
                check("volume", 0.03, "passed"),
                check("volume", 0.04, "passed", element="smoothed"),
            ],
        }
    ],
}


def written(folder: Path, name: str, change: Any = None) -> Path:
    run = copy.deepcopy(RUN)
    if change is not None:
        change(run["cases"])
    path = folder / name
    path.write_text(json.dumps(run), "utf-8")
    return path


def changes(folder: Path, change: Any) -> tuple[dict[str, str], ExitCode]:
    pairs = pair_runs(written(folder, "a.json"), written(folder, "b.json", change))
    return {pair.check: pair.change for pair in pairs}, exit_code_of(pairs)


def test_the_same_run_twice_is_the_same(tmp_path: Path) -> None:
    found, code = changes(tmp_path, None)
    assert set(found.values()) == {"same"}
    assert len(found) == 3  # the two volumes are told apart by their element
    assert code is ExitCode.PASSED


def test_a_verdict_that_got_worse_fails_and_stands_first(tmp_path: Path) -> None:
    def spoil(cases: Any) -> None:
        cases[0]["checks"][0].update(value=0.021)
        cases[0]["checks"][1].update(value=0.09, verdict="failed")

    found, code = changes(tmp_path, spoil)
    assert found["volume (truth, green)"] == "worse"
    assert found["displacement_l2 (truth, green)"] == "larger error"
    assert found["volume (truth, green, smoothed)"] == "same"
    assert code is ExitCode.FAILED
    pairs = pair_runs(tmp_path / "a.json", tmp_path / "b.json")
    rows = pairs_markdown(pairs, "old", "new").splitlines()
    assert rows[0] == "| case | check | old | new | change |"
    assert rows[2].startswith("| liver | volume (truth, green) | 0.03 ± 0.003, passed | 0.09")


def test_a_check_that_is_gone_is_worse_and_a_new_one_is_not(tmp_path: Path) -> None:
    found, code = changes(tmp_path, lambda cases: cases[0]["checks"].pop())
    assert found["volume (truth, green, smoothed)"] == "gone"
    assert code is ExitCode.FAILED
    pairs = pair_runs(tmp_path / "b.json", tmp_path / "a.json")
    assert {pair.change for pair in pairs} == {"same", "new"}
    assert exit_code_of(pairs) is ExitCode.PASSED


def test_another_problem_is_told(tmp_path: Path) -> None:
    changes(tmp_path, lambda cases: cases[0]["provenance"].update(case_key="other"))
    pairs = pair_runs(tmp_path / "a.json", tmp_path / "b.json")
    assert "liver is another problem" in pairs_markdown(pairs, "a", "b")


def test_an_answer_that_lost_its_number_is_told(tmp_path: Path) -> None:
    found, _ = changes(tmp_path, lambda cases: cases[0]["checks"][0].update(value=None))
    assert found["displacement_l2 (truth, green)"] == "changed"


def test_the_command_writes_the_table_and_ends_as_it_found(tmp_path: Path) -> None:
    def spoil(cases: Any) -> None:
        cases[0]["checks"][0].update(value=0.5, verdict="failed")

    first, second = written(tmp_path, "a.json"), written(tmp_path, "b.json", spoil)
    table = tmp_path / "table.md"
    words = ["compare-runs", str(first), str(second), "--summary", str(table)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == ExitCode.FAILED, done.output
    assert "worse" in done.output
    assert "worse" in table.read_text("utf-8")
    assert CliRunner().invoke(app, ["compare-runs", str(first), str(first)]).exit_code == 0


def test_a_file_that_is_no_run_is_refused(tmp_path: Path) -> None:
    bad = tmp_path / "bad.json"
    bad.write_text("{}", "utf-8")
    with pytest.raises(FileFormatError):
        pair_runs(written(tmp_path, "a.json"), bad)
