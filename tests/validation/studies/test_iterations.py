"""A simulator with more iterations and shorter steps: figure, table, and the finding."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import palpate.validation
from palpate.meshes.errors import InputError
from palpate.reference.schemes import Integrator, Steps
from palpate.validation.case import load_case
from palpate.validation.case.variants import VaryError
from palpate.validation.cli import app
from palpate.validation.references.runs import solve_by_steps
from palpate.validation.states import Verdict, in_silence
from palpate.validation.studies.sweep_iterations import (
    Trial,
    judge,
    judge_taken,
    read_moves,
    remarks_on,
    table,
)

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


def test_no_solution_is_a_failure_and_stands_in_the_table() -> None:
    lost = [Trial(4, 1e-3, trouble="it blew up")]
    assert judge(lost, 0.01).verdict is Verdict.FAILED
    assert "it blew up" in judge(lost, 0.01).found
    assert "it blew up" in table(lost, 0.01).csv
    assert remarks_on(lost, 0.01) == []


def test_remarks_say_where_more_iterations_are_not_what_is_wanted() -> None:
    (first, second) = remarks_on(
        trials({(4e-3, 4): 0.5, (4e-3, 8): 0.4, (1e-3, 4): 0.5, (1e-3, 8): 0.01}), 0.01
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
    words += ["--integrator", "backward-euler"]
    found = CliRunner().invoke(app, words)
    assert found.exit_code == 0, found.output
    rows = json.loads((out / "results.json").read_text("utf-8"))["tables"]["iterations"]
    assert [row["iterations"] for row in rows] == [3, 60]
    assert rows[0]["error [-]"] > 0.1 > 10.0 * rows[1]["error [-]"]
    for name in ("report.html", "error.svg", "error.pdf", "iterations.csv"):
        assert (out / name).is_file()


# Somebody's program: by a module beside it, what it sends for {iterations} and {time_step}.
CANNED = """
import json, sys
from pathlib import Path
import numpy as np
case, result, iterations, step = Path(sys.argv[1]), *sys.argv[2:]
iterations, step = int(iterations), float(step)
given = json.loads((case / "case.json").read_text("utf-8"))
times = np.array(given["time"]["output_times"])
right = np.load({right!r})
about = {{"integrator": "backward-euler", "time_step": step}}
{body}
np.savez(result, displacement=u, times=times, case_key=given["case_key"], about=json.dumps(about))
"""
ASKED = ["--vary", "iterations=5,20", "--vary", "time_step=8e-3,4e-3"]
_solved: dict[str, np.ndarray] = {}


@pytest.fixture
def sweep_of(let_go: Path, tmp_path: Path) -> Callable[..., tuple[int, str, Path]]:
    """Exit code, what it said and its folder, of a sweep over a program that sends what is said."""
    if "right" not in _solved:
        case = load_case(let_go)
        steps = Steps(Integrator.BACKWARD_EULER, 4e-3)
        right = solve_by_steps(case.problem, case.strain, steps, in_silence)
        _solved["right"] = right.displacements
    np.save(tmp_path / "right.npy", _solved["right"])

    def run(body: str, *asked: str) -> tuple[int, str, Path]:
        program, out = tmp_path / "canned.py", tmp_path / "out"
        text = CANNED.format(right=str(tmp_path / "right.npy"), body=body)
        program.write_text(text, "utf-8")
        command = f"{sys.executable} {program} {{case}} {{result}} {{iterations}} {{time_step}}"
        words = ["sweep", str(let_go), "--simulator", command, "-o", str(out)]
        words += [*(asked or ASKED), "--integrator", "backward-euler"]
        found = CliRunner().invoke(app, words)
        assert isinstance(found.exception, SystemExit | None), found.exception
        return found.exit_code, found.output, out

    return run


@pytest.mark.dolfinx
@pytest.mark.parametrize(
    ("body", "code", "words"),
    [
        # It sends the reference's own result whatever it is asked for.
        ("u = right", 1, "it ignores what it is asked for: the same result with 5 iterations"),
        (
            "u = right * (1 + 1e-6 * step * iterations)",
            3,
            "it ignores them, or had come to its result",
        ),
        # Some of the values only: it takes no fewer than 20, or no more.
        pytest.param(
            "u = right * (1 + 1 / max(iterations, 20))",
            1,
            "it ignores what it is asked for",
            marks=pytest.mark.nightly,
        ),
        ("u = right * (1 + 1e-2 * step / min(iterations, 20))", 3, "the same result to 1e-05"),
        # It says itself that it took other steps, or another scheme.
        ("u = right * (1 + step / iterations); about['time_step'] = 4e-3", 1, "steps of 0.004 s"),
        (
            "u = right * (1 + step / iterations); about['iterations'] = 7",
            1,
            'states "7" iterations',
        ),
        pytest.param(
            "u = right * (1 + step / iterations); about['integrator'] = 'bdf2'",
            1,
            "states bdf2",
            marks=pytest.mark.nightly,
        ),
        pytest.param(
            "u = right * (1 + step / iterations); about['element'] = 'smoothed'",
            1,
            "smoothed",
            marks=pytest.mark.nightly,
        ),
    ],
)
def test_a_simulator_that_ignores_what_it_is_asked_for_shows_nothing(
    sweep_of: Callable[..., tuple[int, str, Path]], body: str, code: int, words: str
) -> None:
    found, said, _ = sweep_of(body)
    assert words in said.replace("\n", " ")
    assert found == code
    if "/" not in body:
        assert "least error" not in said
        assert "falling" not in said


@pytest.mark.dolfinx
def test_one_result_shows_no_convergence_and_what_shows_nothing_is_marked(
    sweep_of: Callable[..., tuple[int, str, Path]],
) -> None:
    code, said, _ = sweep_of("u = right", "--vary", "iterations=5", "--vary", "time_step=4e-3")
    assert code == 3
    assert "two are needed to see it" in said
    code, said, out = sweep_of("u = right")
    rows = json.loads((out / "results.json").read_text("utf-8"))["tables"]["iterations"]
    assert all(row["shows nothing because"].startswith("the same result as") for row in rows)
    assert "which shows nothing" in (out / "report.html").read_text("utf-8")
    assert "more iterations are not" not in said


def of_motion(many: int, error: float, motion: float, *, step: float = 4e-3) -> Trial:
    """A trial whose motion is one number, and its reference's another for each step."""
    size = np.ones((2, 3, 3))
    return Trial(many, step, error, motion=motion * size, reference=(1.0 + step) * size)


@pytest.mark.parametrize(
    ("given", "claim", "taken"),
    [
        # Real convergence, to rounding in the end: fewer iterations would show it.
        ([(2, 0.3, 1.3), (8, 5e-3, 1.005), (32, 0.0, 1.0), (128, 0.0, 1.0)],
         Verdict.PASSED, Verdict.INCONCLUSIVE),
        ([(2, 0.3, 1.3), (8, 0.02, 1.02), (32, 5e-3, 1.005)], Verdict.PASSED, Verdict.PASSED),
        # It has come to another law: what is the same there may fail it.
        ([(2, 0.5, 1.5), (8, 0.25, 1.25), (32, 0.2, 1.2), (128, 0.2, 1.2)],
         Verdict.FAILED, Verdict.INCONCLUSIVE),
        # One result for all.
        ([(2, 0.0, 1.0), (8, 0.0, 1.0)], Verdict.INCONCLUSIVE, Verdict.INCONCLUSIVE),
        ([(2, 0.2, 1.2), (8, 0.2, 1.2)], Verdict.FAILED, Verdict.INCONCLUSIVE),
        # It takes no fewer than 8.
        ([(2, 0.3, 1.3), (8, 0.3, 1.3), (32, 5e-3, 1.005)], Verdict.PASSED, Verdict.FAILED),
    ],
)  # fmt: skip
def test_what_is_read_from_results_that_are_the_same(
    given: list[tuple[int, float, float]], claim: Verdict, taken: Verdict
) -> None:
    run = [of_motion(*each) for each in given]
    assert judge(run, 0.01).verdict is claim
    assert judge_taken(run, 0.01).verdict is taken
    if claim is Verdict.INCONCLUSIVE:
        assert "least error" not in judge(run, 0.01).found


def test_the_same_motion_in_two_steps_is_no_fall_of_the_error() -> None:
    # One motion, which is the reference's own in the shorter step.
    run = [of_motion(8, 0.05, 1.004, step=8e-3), of_motion(8, 0.02, 1.004, step=4e-3)]
    assert judge_taken(run, 0.01).verdict is Verdict.FAILED
    assert judge(run, 0.01).verdict is Verdict.FAILED
    assert "falling" not in judge(run, 0.01).found
    # Where steps make no difference to the motion it may be right.
    still = [dataclasses.replace(each, reference=np.ones((2, 3, 3))) for each in run]
    assert judge_taken(still, 0.01).verdict is Verdict.INCONCLUSIVE


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
