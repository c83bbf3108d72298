"""A check that the null answer passes is no support of a verdict; what is left out is told."""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.problem import Problem, Strain
from palpate.validation.candidates.candidate import Candidate, fastsim_candidate
from palpate.validation.case import builtin_cases, load_case
from palpate.validation.judging import outputs
from palpate.validation.judging.case_references import find_references
from palpate.validation.judging.checks import CaseJudge, decide
from palpate.validation.judging.judge import exit_code, judge_case
from palpate.validation.judging.outputs import github_annotations
from palpate.validation.judging.results import CaseResult
from palpate.validation.judging.wrong_results import null_result, wrong_results
from palpate.validation.metrics import make_state, measure
from palpate.validation.references.reference_set import SAME_MESH, ReferenceSet
from palpate.validation.states import Verdict

WriteCase = Callable[..., Path]
LOAD = "force = [60.0, 20.0, -10.0]"
LIMIT = "limit = 1e-8"


def judge_with_own_reference(path: Path, monkeypatch: pytest.MonkeyPatch) -> CaseResult:
    """fastsim judged against its own answers: a reference that cannot be more friendly."""
    case = load_case(path)
    solve = fastsim_candidate().solve
    states = {
        (SAME_MESH, strain): solve(case.problem, strain, lambda _line: None) for strain in Strain
    }
    known = ReferenceSet(states, {}, "fastsim itself")
    monkeypatch.setattr("palpate.validation.judging.judge.find_references", lambda *_a, **_k: known)
    return judge_case(case)


def test_a_bar_below_zero_or_nan_allows_no_verdict() -> None:
    for bar in (-1.0, -1e-300, math.nan, math.inf, -math.inf):
        assert decide(0.5, bar, 1.0) is Verdict.INCONCLUSIVE
        assert decide(5.0, bar, 1.0) is Verdict.INCONCLUSIVE
    assert decide(0.5, 0.0, 1.0) is Verdict.PASSED


def test_an_error_below_zero_or_nan_is_no_error_that_could_pass() -> None:
    for error in (-1e-300, -1.0, math.nan, math.inf, -math.inf):
        assert decide(error, 0.0, 1.0) is Verdict.FAILED


def test_a_limit_that_the_null_answer_meets_is_vacuous_and_the_case_inconclusive(
    write_case: WriteCase, monkeypatch: pytest.MonkeyPatch
) -> None:
    for limit in ("limit = 1.0", "limit = 1e300"):
        result = judge_with_own_reference(write_case((LIMIT, limit)), monkeypatch)
        assert [c.verdict for c in result.checks] == [Verdict.PASSED, Verdict.PASSED]
        assert all(c.is_vacuous for c in result.checks)
        assert result.verdict is Verdict.INCONCLUSIVE
        assert exit_code([result]) == 3
        assert "nothing moves" in result.notes[-1]
    sharp = judge_with_own_reference(write_case((LIMIT, "limit = 0.999")), monkeypatch)
    assert sharp.verdict is Verdict.PASSED


@pytest.mark.parametrize("force", ["[0.0, 0.0, 0.0]", "[1e-310, 0.0, 0.0]", "[1e-20, 0.0, 0.0]"])
def test_a_body_that_nobody_pushes_proves_nothing(
    write_case: WriteCase, monkeypatch: pytest.MonkeyPatch, force: str
) -> None:
    path = write_case((LOAD, f"force = {force}"))
    result = judge_with_own_reference(path, monkeypatch)
    assert result.verdict is not Verdict.PASSED, result.checks
    assert all(c.is_vacuous for c in result.checks)


@pytest.mark.parametrize("metric", ["displacement_max", "surface_hausdorff", "strain_energy"])
def test_what_is_lost_in_rounding_where_nothing_moves_is_no_failure(
    problem: Problem, metric: str
) -> None:
    still = null_result(problem, Strain.GREEN, None)
    # Of a body of 2 m, 4e-16 m is the last digit.
    shift = np.full_like(problem.mesh.points, 1e-16)
    shift[::2] = 0.0
    hardly = make_state(problem.mesh, shift, label="x", simulator="x", strain=Strain.GREEN)
    assert measure(metric, problem, hardly, still).value == 0.0
    assert measure(metric, problem, still, hardly).value == 0.0


def test_a_body_that_moves_where_the_reference_does_not_has_failed(problem: Problem) -> None:
    still = null_result(problem, Strain.GREEN, None)
    moved = make_state(
        problem.mesh,
        np.full_like(problem.mesh.points, 1e-9),
        label="x",
        simulator="x",
        strain=Strain.GREEN,
    )
    assert measure("displacement_l2", problem, moved, still).value == math.inf
    assert measure("displacement_l2", problem, still, still).value == 0.0


def test_a_change_of_volume_below_its_floor_is_vacuous(
    write_case: WriteCase, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Strains of 60 N / 1 m2 / 1e8 Pa = 6e-7: far below the floor of 0.1 % of the rest volume.
    path = write_case(
        ("youngs_modulus = 1000.0", "youngs_modulus = 1e8"),
        ('metric = "displacement_l2"\n' + LIMIT, 'metric = "volume"\nlimit = 0.02'),
    )
    result = judge_with_own_reference(path, monkeypatch)
    assert result.verdict is Verdict.INCONCLUSIVE


def test_a_tool_that_never_touches_proves_nothing(
    write_case: WriteCase, monkeypatch: pytest.MonkeyPatch
) -> None:
    tool = (
        '[tool]\nshape = "sphere"\nradius = 0.1\npose = [{ time = 0.0, position = [1.0, 0.5, 2.0] '
        "}, { time = 1.0, position = [1.0, 0.5, 1.5] }]\n\n[[support]]"
    )
    path = write_case(
        (LOAD, "force = [0.0, 0.0, 0.0]"),
        ("[[support]]", tool),
        ('metric = "displacement_l2"', 'metric = "tool_force"'),
    )
    result = judge_with_own_reference(path, monkeypatch)
    assert result.verdict is Verdict.INCONCLUSIVE
    assert all(c.is_vacuous for c in result.checks)


def test_checks_left_out_stand_in_every_output(
    write_case: WriteCase, monkeypatch: pytest.MonkeyPatch
) -> None:
    healthy = fastsim_candidate()
    one_strain = Candidate("one strain", healthy.solve)
    path = write_case((LIMIT, LIMIT + '\nstrain = "linear"'))
    case = load_case(path)
    states = {(SAME_MESH, s): healthy.solve(case.problem, s, lambda _line: None) for s in Strain}
    known = ReferenceSet(states, {}, "fastsim itself")
    monkeypatch.setattr("palpate.validation.judging.judge.find_references", lambda *_a, **_k: known)
    result = judge_case(case, candidate=one_strain)
    left_out, own = result.checks
    assert left_out.verdict is Verdict.SKIPPED
    assert "green strain only" in left_out.message
    # Nothing but the trivial is left.
    assert own.is_vacuous
    assert result.verdict is Verdict.INCONCLUSIVE
    suite = ET.fromstring(outputs.junit_xml([result])).find("testsuite")
    assert suite is not None
    assert suite.get("skipped") == "1"
    assert "green strain only" in str(suite.find(".//skipped").attrib)  # type: ignore[union-attr]
    # JUnit has no third colour: the case itself stands there as an error.
    assert suite.get("errors") == "1"
    assert suite.get("tests") == "3"
    document = json.loads(outputs.results_json([result], "1"))["cases"][0]
    assert document["checks"][0]["verdict"] == "skipped"
    assert document["checks"][1]["is_vacuous"] is True
    assert "| skipped |" in outputs.summary_markdown([result])
    assert any("nothing moves" in line for line in github_annotations([result]))


@pytest.mark.parametrize("name", builtin_cases())
def test_no_built_in_case_lets_a_plainly_wrong_answer_pass(name: str) -> None:
    case = load_case(name)
    judge = CaseJudge(case, find_references(case, live=False, progress=lambda _line: None))
    assert judge.unseen() == ()
    assert any(not judge.is_vacuous(spec) for spec in case.checks)


def test_what_a_case_cannot_see_is_told(
    write_case: WriteCase, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_case(('metric = "displacement_l2"', 'metric = "max_displacement"'))
    result = judge_with_own_reference(path, monkeypatch)
    assert result.unseen == ("turned round", "axes exchanged")
    assert any("turned round" in note for note in result.notes)


def test_the_null_answer_has_the_times_and_tools_of_the_reference(problem: Problem) -> None:
    case = load_case("slide")
    references = find_references(case, live=False, progress=lambda _line: None)
    reference = references.states[SAME_MESH, Strain.GREEN]
    null = null_result(case.problem, Strain.GREEN, reference)
    assert null.trajectory is not None
    assert null.tool_forces is not None
    assert reference.trajectory is not None
    assert null.trajectory.displacements.shape == reference.trajectory.displacements.shape
    assert null.max_displacement == 0.0
    assert null_result(problem, Strain.GREEN, None).displacement.shape == problem.mesh.points.shape
    labels = [answer.label for answer in wrong_results(case.problem, reference)]
    assert labels == [
        "nothing moves", "turned round", "twice as large", "axes exchanged",
        "last state repeated", "every second state still",
    ]  # fmt: skip


def test_spoiled_motions_are_spoiled_as_they_say() -> None:
    case = load_case("block-motion")
    references = find_references(case, live=False, progress=lambda _line: None)
    right = references.states[SAME_MESH, Strain.GREEN].trajectory
    assert right is not None
    spoiled = {
        answer.label: answer.trajectory
        for answer in wrong_results(case.problem, references.states[SAME_MESH, Strain.GREEN])
    }
    repeated, halted = spoiled["last state repeated"], spoiled["every second state still"]
    assert repeated is not None
    assert halted is not None
    assert (repeated.displacements == right.displacements[-1]).all()
    assert (halted.displacements[1:-1:2] == 0.0).all()
    np.testing.assert_array_equal(halted.displacements[0::2], right.displacements[0::2])
    assert np.abs(halted.displacements[2::2]).max(axis=(1, 2)).min() > 0.0


def test_the_report_shows_the_case_as_it_was_when_read(
    write_case: WriteCase, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_case()
    before = path.read_text("utf-8")
    monkeypatch.setattr(
        "palpate.validation.judging.judge.CaseJudge.unseen",
        lambda _self: path.write_text("changed by the simulator", "utf-8") and (),
    )
    assert judge_with_own_reference(path, monkeypatch).case_text == before
    assert path.read_text("utf-8") == "changed by the simulator"
