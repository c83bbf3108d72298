"""A candidate beside what was measured: the verdict of V&V 20, and red where it is perturbed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from measured_bars import MARKERS, exact_motions, measured_bar

import palpate
from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.candidates.candidate import (
    Candidate,
    fastsim_candidate,
    function_candidate,
    solution_candidate,
)
from palpate.validation.case import Case
from palpate.validation.case.measurements import read_measurements
from palpate.validation.judging.measured import (
    Validation,
    judge_measurements,
    predict_markers,
)
from palpate.validation.judging.measured_model import solve_measured
from palpate.validation.judging.results import MEASUREMENT, CheckResult, MeasuredValues, Scope
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.states import State, Verdict, in_silence

NOTHING = ReferenceSet({}, {}, "nothing is stored")
UNCERTAIN = """
[[uncertainty]]
inputs = ["material.youngs_modulus", "mass[0].mass"]
standard = [3e3, 0.2]
correlation = [[1.0, 0.5], [0.5, 1.0]]
source = "a test"
"""


@pytest.fixture(scope="module")
def bar(tmp_path_factory: pytest.TempPathFactory) -> Case:
    folder = tmp_path_factory.mktemp("bar")
    measured_bar(folder, more=UNCERTAIN)
    text = (folder / "bar.toml").read_text("utf-8").replace("= 100e3", "= 130e3")
    (folder / "right.toml").write_text(text, "utf-8")
    return palpate.load_case(folder / "right.toml")


def judged(
    case: Case, candidate: Candidate, *, failure: str = ""
) -> list[tuple[CheckResult, MeasuredValues | None]]:
    solutions, failures = {}, {}
    if failure:
        failures[Strain.GREEN] = failure
    else:
        solutions[Strain.GREEN] = candidate.solve(case.problem, Strain.GREEN, in_silence)
    return judge_measurements(case, candidate, solutions, failures, NOTHING, in_silence)


@pytest.mark.parametrize(
    ("error", "u", "verdict"),
    [(0.5, 0.2, "passed"), (0.5, 0.26, "inconclusive"), (-0.9, 0.04, "passed"),
     (0.0, 0.6, "inconclusive"), (-1.5, 0.2, "failed"), (1.5, 0.3, "inconclusive")],
)  # fmt: skip
def test_the_verdict_is_that_of_error_and_twice_its_uncertainty(
    error: float, u: float, verdict: str
) -> None:
    value = Validation(error, 0.0, 0.6 * u, 0.8 * u, 1.0)
    assert value.u_val == pytest.approx(u)
    assert value.verdict == verdict


def test_smoothed_tetrahedra_are_where_the_bar_was_measured(bar: Case) -> None:
    checks = judged(bar, fastsim_candidate(element=Element.SMOOTHED))
    assert [check.metric for check, _ in checks] == ["measured hung", "measured bare"]
    for check, values in checks:
        assert check.verdict is Verdict.PASSED, check.message
        assert check.against == MEASUREMENT
        assert check.scope is Scope.TRUTH
        assert (check.unit, check.limit) == ("mm", 2.0)
        assert values is not None
        worst = np.argmax(np.abs(values.computed - values.measured) + values.doubt)
        assert check.value == pytest.approx(abs(values.computed - values.measured)[worst])
        assert check.reference_error == pytest.approx(values.doubt[worst])
        assert values.positions == pytest.approx(np.array(list(MARKERS.values())))


def test_inputs_count_with_their_correlation(bar: Case) -> None:
    """By whole solutions: 3 kPa of E and 0.2 g, of which half is common."""
    (_, hung), (_, bare) = judged(bar, fastsim_candidate(element=Element.SMOOTHED))
    assert hung is not None and bare is not None  # noqa: PT018
    true = {"material.youngs_modulus": 130e3}
    slopes = {}
    for key, u in (("material.youngs_modulus", 3e3), ("mass[0].mass", 0.2)):
        here = 130e3 if key in true else 10.0
        pair = [exact_motions(bar, true={**true, key: here + s * u}) for s in (1.0, -1.0)]
        slopes[key] = {n: 0.5 * (pair[0][n] - pair[1][n]).ravel() for n in pair[0]}
    e, m = slopes.values()
    for values, by_mass in ((hung, m["hung"]), (bare, 0.0 * m["bare"])):
        by_modulus = e[values.name]
        variance = by_modulus**2 + by_mass**2 + by_modulus * by_mass
        data = 0.5 * values.doubt[np.argmin(np.abs(by_modulus))]
        expected = 2.0 * np.sqrt(variance + data**2)
        assert values.doubt == pytest.approx(expected, rel=0.01)


def test_linear_tetrahedra_and_a_perturbed_result_are_red(bar: Case) -> None:
    for check, _ in judged(bar, fastsim_candidate(element=Element.LINEAR)):
        assert check.verdict is Verdict.FAILED, check.message

    def perturbed(problem: Problem) -> np.ndarray:
        state = palpate.solve(problem, element="smoothed")
        return 0.7 * state.displacement

    for check, _ in judged(bar, function_candidate(perturbed)):
        assert check.verdict is Verdict.FAILED, check.message


def test_what_a_result_says_of_itself_does_not_widen_its_uncertainty(bar: Case) -> None:
    right = judged(bar, fastsim_candidate(element=Element.SMOOTHED))
    wild = judged(bar, function_candidate(lambda problem: 0.3 * problem.mesh.points))
    for (_, a), (_, b) in zip(right, wild, strict=True):
        assert a is not None and b is not None  # noqa: PT018
        assert b.doubt == pytest.approx(a.doubt)


def test_a_file_is_of_the_case_itself_only(bar: Case) -> None:
    state = palpate.solve(bar.problem, element="smoothed")
    hung, bare = judged(bar, solution_candidate(state.displacement, Element.SMOOTHED))
    assert hung[0].verdict is Verdict.PASSED
    assert bare[0].verdict is Verdict.SKIPPED
    assert "this experiment has others" in bare[0].message
    assert bare[1] is None


def test_a_candidate_that_gives_nothing_fails(bar: Case) -> None:
    def fails(_problem: Problem) -> np.ndarray:
        raise ValueError("out of luck")

    checks = judged(bar, function_candidate(fails), failure="it diverged")
    assert [check.verdict for check, _ in checks] == [Verdict.FAILED, Verdict.FAILED]
    assert checks[0][0].message == "it diverged"
    assert "out of luck" in checks[1][0].message


def test_the_gate_judges_by_measurements(bar: Case, palpate_run: Callable, tmp_path: Path) -> None:
    soon = bar.path.with_name("soon.toml")
    soon.write_text(bar.text + "\n[truth]\nminutes = 0.02\n", "utf-8")
    ended = palpate_run("report", soon, "--element", "smoothed", "-o", tmp_path / "out")
    assert ended.returncode in (0, 3), ended.stderr
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "Measured and computed" in page
    assert "above x" in page
    assert "measured hung" in ended.stdout


def test_markers_are_said_with_their_interval(
    bar: Case, palpate_run: Callable, tmp_path: Path
) -> None:
    ended = palpate_run(
        "solve", bar.path, "--element", "smoothed", "--set", "mass[0].mass=5",
        "-o", tmp_path / "half.vtu",
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    lines = [line for line in ended.stdout.splitlines() if "moves by [mm]" in line]
    assert [line.split()[0] for line in lines] == list(MARKERS)
    drops = [float(line.partition(" z ")[2].split()[0]) for line in lines]
    both = exact_motions(bar)
    for drop, less, more in zip(drops, both["bare"][:, 2], both["hung"][:, 2], strict=True):
        assert more < drop < less
    assert all("+- 0 " not in line for line in lines)


def test_another_number_of_a_solve_is_checked(
    bar: Case, palpate_run: Callable, tmp_path: Path
) -> None:
    for words, says in (
        (["--set", "mass[0].mas=5"], "did you mean"),
        (["--set", "mass[0].mass"], "write KEY=VALUE"),
        (["--set", "mass[0].mass=5", "--set", "mass[0].mass=6"], "given twice"),
    ):
        ended = palpate_run("solve", bar.path, *words, "-o", tmp_path / "x.vtu")
        assert ended.returncode == 2
        assert says in ended.stderr
    assert not list(tmp_path.iterdir())


def test_no_uncertain_input_is_no_uncertainty(tmp_path: Path) -> None:
    case = measured_bar(tmp_path)
    state: State = palpate.solve(case.problem, element="smoothed")
    for _, motion, uncertainty in predict_markers(case, state.displacement):
        assert np.abs(motion).max() > 1e-3
        assert np.all(uncertainty == 0.0)


PRESSED = """
[[tool]]
shape = "sphere"
radius = 10.0
region = { half_space = { point = [0.0, 0.0, 19.99], normal = [0.0, 0.0, 1.0] } }
pose = [
  { time = 0.0, position = [60.0, 10.0, 30.01] },
  { time = 1.0, position = [60.0, 10.0, 26.01] },
]
[[uncertainty]]
inputs = ["mass[0].mass"]
standard = [2.0]
source = "a test"
"""


def test_markers_of_a_body_under_a_tool_move_by_it(tmp_path: Path) -> None:
    """The experiment is solved with its tool, and so are its derivatives."""
    measured_bar(tmp_path)
    text = (tmp_path / "bar.toml").read_text("utf-8") + PRESSED
    (tmp_path / "pressed.toml").write_text(text.replace("-9.81", "-0.1"), "utf-8")
    case = palpate.load_case(tmp_path / "pressed.toml")
    measured = read_measurements(case, ["hung"])["hung"]
    found = solve_measured(measured, case, element=Element.SMOOTHED)
    state = palpate.solve(case.problem, element="smoothed")
    assert found.displacement == pytest.approx(state.displacement, abs=1e-8)
    assert 1e3 * found.values[2] < -2.0  # pressed down, which its weight does not do
    moved = predict_markers(case, state.displacement)
    assert max(np.abs(one.uncertainty).max() for one in moved) > 1e-7
