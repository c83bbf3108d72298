"""A simulator with more iterations and shorter steps: figure, table, and the finding."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import palpate.validation
from palpate.meshes.errors import InputError
from palpate.validation.cli import app
from palpate.validation.states import Verdict
from palpate.validation.studies.sweep_iterations import Trial, judge, read_moves, remarks_on, table
from palpate.validation.studies.sweep_runs import VaryError

PROGRAM = Path(palpate.validation.__file__).parent / "peers/adapters/vertex_block_descent.py"
COMMAND = f"{sys.executable} {PROGRAM} {{case}} {{result}} {{iterations}}"


def trials(errors: dict[tuple[float, int], float]) -> list[Trial]:
    return [Trial(many, step, error) for (step, many), error in errors.items()]


@pytest.mark.parametrize(
    ("errors", "verdict", "words"),
    [
        # Iterations do it.
        ({(4e-3, 4): 0.3, (4e-3, 16): 1e-3}, Verdict.PASSED, "0.001"),
        # They alone do not, shorter steps do.
        ({(4e-3, 16): 0.05, (4e-3, 64): 0.05, (1e-3, 64): 5e-3}, Verdict.PASSED, "steps of 0.001"),
        # Neither does: another law than the one it states.
        (
            {(4e-3, 16): 0.2, (4e-3, 64): 0.19, (1e-3, 16): 0.2, (1e-3, 64): 0.19},
            Verdict.FAILED,
            "does not converge to the law it states",
        ),
        # It was not given enough of them.
        ({(4e-3, 4): 0.9, (4e-3, 8): 0.4}, Verdict.INCONCLUSIVE, "more iterations"),
        (
            {(4e-3, 4): 0.5, (4e-3, 8): 0.45, (1e-3, 4): 0.15, (1e-3, 8): 0.12},
            Verdict.INCONCLUSIVE,
            "shorter steps",
        ),
    ],
)
def test_the_verdict(errors: dict[tuple[float, int], float], verdict: Verdict, words: str) -> None:
    finding = judge(trials(errors), 0.01)
    assert finding.verdict is verdict
    assert words in finding.found


def test_no_answer_is_a_failure_and_stands_in_the_table() -> None:
    lost = [Trial(4, 1e-3, trouble="it blew up")]
    assert judge(lost, 0.01).verdict is Verdict.FAILED
    assert "it blew up" in judge(lost, 0.01).found
    assert "it blew up" in table(lost).csv
    assert remarks_on(lost) == []


def test_remarks_say_where_more_iterations_are_not_what_is_wanted() -> None:
    (first, second) = remarks_on(
        trials({(4e-3, 4): 0.5, (4e-3, 8): 0.4, (1e-3, 4): 0.5, (1e-3, 8): 0.01})
    )
    assert "more iterations are not what it wants for" in first
    assert "more iterations" not in second


def test_moves_are_read_and_others_refused() -> None:
    assert read_moves(["time_step=4e-3,2e-3", "iterations=2,8"]) == ((2, 8), (4e-3, 2e-3))
    assert read_moves(["iterations=2"]) == ((2,), (None,))
    for words in ("material.poissons_ratio=0.3", "iterations=2.5", "iterations=0",
                  "iterations=a", "iterations=2,2", "time_step=-1"):  # fmt: skip
        with pytest.raises(VaryError):
            read_moves([words])
    with pytest.raises(VaryError, match="once"):
        read_moves(["iterations=2", "iterations=3"])
    with pytest.raises(InputError, match="say how many"):
        read_moves(["time_step=1e-3"])


@pytest.mark.dolfinx
def test_block_descent_converges_and_leaves_a_figure(let_go: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ["sweep", str(let_go), "--simulator", COMMAND, "-o", str(out)]
    words += ["--vary", "iterations=3,60", "--vary", "time_step=8e-3"]
    found = CliRunner().invoke(app, words)
    assert found.exit_code == 0, found.output
    rows = json.loads((out / "results.json").read_text("utf-8"))["tables"]["iterations"]
    assert [row["iterations"] for row in rows] == [3, 60]
    assert rows[0]["error [-]"] > 0.1 > 10.0 * rows[1]["error [-]"]
    for name in ("report.html", "error.svg", "error.pdf", "iterations.csv"):
        assert (out / name).is_file()


def test_what_does_not_go_together_is_refused(let_go: Path, tmp_path: Path) -> None:
    moved = ["--vary", "load[0].factor=1,2"]
    for words, message in (
        (["--simulator", COMMAND, *moved], "is varied by iterations and time_step"),
        (["--simulator", COMMAND, "--vary", "time_step=1e-3"], "say how many"),
        (["--simulator", COMMAND, "--vary", "iterations=1", "--with", "reference"], "takes no"),
        (["--integrator", "bdf2", *moved], "give --simulator"),
    ):
        given = ["sweep", str(let_go), "-o", str(tmp_path / "out"), *words]
        found = CliRunner().invoke(app, given)
        assert isinstance(found.exception, InputError)
        assert message in str(found.exception)
    assert not (tmp_path / "out").exists()
