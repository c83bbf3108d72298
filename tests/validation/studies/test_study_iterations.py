"""The study of eq. 10: what its curves must show, and that a wrong answer is a fault."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from palpate.fastsim.newton import Iteration
from palpate.validation.case import load_case
from palpate.validation.states import Verdict
from palpate.validation.studies import iterations
from palpate.validation.studies.iterations import Curve, follow, judge

WriteCase = Callable[..., Path]


@pytest.fixture
def curves(write_case: WriteCase) -> dict[tuple[float, str], Curve]:
    problem = load_case(str(write_case())).problem
    found = [c for factor in (0.25, 1.0) for c in follow("block", problem, factor)]
    return {(c.load_factor, c.method): c for c in found}


def test_the_secant_iteration_gains_the_same_part_of_a_digit_each_time_and_newton_doubles_them(
    curves: dict[tuple[float, str], Curve],
) -> None:
    for factor in (0.25, 1.0):
        secant = np.array(curves[factor, "secant"].residuals)
        ratios = secant[4:-2] / secant[3:-3]
        assert ratios.std() < 0.1 * ratios.mean()
        newton = -np.log10(curves[factor, "newton"].residuals)
        near = np.flatnonzero((newton > 1.0) & (newton < 5.0))
        assert (newton[near + 1] > 1.7 * newton[near]).all()
        assert len(newton) < len(secant)
    # The larger the displacement, the less each step gains.
    assert curves[1.0, "secant"].contraction > 1.5 * curves[0.25, "secant"].contraction


def test_all_three_find_the_same_equilibrium(curves: dict[tuple[float, str], Curve]) -> None:
    assert (1.0, "relaxation") in curves
    assert all(c.converged for c in curves.values())
    assert [f.verdict for f in judge(list(curves.values()))] == [Verdict.PASSED] * 2


@pytest.mark.parametrize("method", ["newton", "secant", "relaxation"])
def test_another_answer_is_a_fault(curves: dict[tuple[float, str], Curve], method: str) -> None:
    for difference in (1e-6, float("nan"), None):
        wrong = dataclasses.replace(curves[1.0, method], difference=difference)
        assert [f.verdict for f in judge([wrong])] == [Verdict.PASSED, Verdict.FAILED]
    lost = dataclasses.replace(curves[1.0, method], converged=False, end="gave up")
    # As printed the iteration may fail: that is what the study shows.
    answers = Verdict.PASSED if method == "secant" else Verdict.FAILED
    assert judge([lost])[0].verdict is answers
    assert ("gave up" in judge([lost])[0].found) is (method != "secant")


def test_the_study_leaves_its_page_figure_and_numbers(
    write_case: WriteCase, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = str(write_case())
    folder = tmp_path / "out"
    folder.mkdir()
    monkeypatch.setattr(iterations, "CASES", ("block",))
    monkeypatch.setattr(iterations, "load_case", lambda _name: load_case(path))
    console = Console(record=True, width=40)
    assert iterations.STUDY.run("iterations", folder, lambda _line: None, console) == 0
    assert "passed: Newton's method" in console.export_text()
    names = {"ends.csv", "iterations.csv", "iterations.svg", "report.html", "results.json"}
    assert {f.name for f in folder.iterdir()} == names
    result = json.loads((folder / "results.json").read_text("utf-8"))
    ends = result["tables"]["ends"]
    assert len(ends) == 2 * len(iterations.FACTORS) + 1
    page = (folder / "report.html").read_text("utf-8")
    assert "<svg" in page
    assert "cpu [s]" in page
    assert "Every residual" not in page
    rows = (folder / "iterations.csv").read_text("utf-8").splitlines()
    assert len(rows) == 1 + len(result["tables"]["iterations"])
    # Newton and the secant iteration are counted one by one.
    assert len(rows) > 1 + sum(row["count"] for row in ends if row["method"] != "relaxation")


def test_the_methods_are_named_as_the_solver_names_them(
    curves: dict[tuple[float, str], Curve],
) -> None:
    assert {m for _, m in curves} == {*(i.value for i in Iteration), "relaxation"}
