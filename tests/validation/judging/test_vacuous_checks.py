"""A check that the null solution passes supports no verdict; what is left out is reported."""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from judged import GREEN, case_of, judged_by, references_of, solved, state_of, stored

from palpate.meshes.problem import Strain
from palpate.validation.candidates.candidate import Candidate, fastsim_candidate
from palpate.validation.case import builtin_cases, load_case
from palpate.validation.judging import outputs
from palpate.validation.judging.checks import CaseJudge, decide
from palpate.validation.judging.judge import exit_code
from palpate.validation.judging.wrong_results import null_result, wrong_results
from palpate.validation.metrics import measure
from palpate.validation.references.reference_set import SAME_MESH, ReferenceSet
from palpate.validation.states import Verdict

LOAD = "force = [60.0, 20.0, -10.0]"
LIMIT = "limit = 1e-8"
METRIC = 'metric = "displacement_l2"'
TOOL = """[tool]
shape = "sphere"
radius = 0.1
pose = [{ time = 0.0, position = [1.0, 0.5, 2.0] }, { time = 1.0, position = [1.0, 0.5, 1.5] }]

[[support]]"""


@pytest.fixture
def judged(write_case, monkeypatch):
    """fastsim on the block with some text replaced, judged by its own solutions."""

    def judge(*changes, **options):
        case = load_case(write_case(*changes))
        states = {(SAME_MESH, strain): solved(case.problem, strain) for strain in Strain}
        references = ReferenceSet(states, {}, "fastsim itself")
        return judged_by(references, monkeypatch, case, **options)

    return judge


@pytest.mark.parametrize("value", [-1.0, -1e-300, math.nan, math.inf, -math.inf])
def test_what_is_no_number_above_zero_is_no_bar_and_no_error_that_could_pass(value):
    assert decide(0.5, value, 1.0) is decide(5.0, value, 1.0) is Verdict.INCONCLUSIVE
    assert decide(value, 0.0, 1.0) is Verdict.FAILED
    assert decide(0.5, 0.0, 1.0) is Verdict.PASSED


@pytest.mark.parametrize(
    "changes",
    [
        [(LIMIT, "limit = 1.0")],
        [(LIMIT, "limit = 1e300")],
        # A body that nobody pushes.
        *([(LOAD, f"force = [{force}, 0.0, 0.0]")] for force in ("0.0", "1e-310", "1e-20")),
        # Strains of 60 N / 1 m2 / 1e8 Pa = 6e-7: far below the floor of 0.1 % of the rest volume.
        [
            ("youngs_modulus = 1000.0", "youngs_modulus = 1e8"),
            (f"{METRIC}\n{LIMIT}", 'metric = "volume"\nlimit = 0.02'),
        ],
        # A tool that never touches.
        [
            (LOAD, "force = [0.0, 0.0, 0.0]"),
            ("[[support]]", TOOL),
            (METRIC, 'metric = "tool_force"'),
        ],
    ],
)
def test_a_check_that_the_null_solution_passes_is_vacuous_and_the_case_inconclusive(
    judged, changes
):
    result = judged(*changes)
    assert all(c.is_vacuous for c in result.checks)
    assert result.verdict is Verdict.INCONCLUSIVE
    assert exit_code([result]) == 3
    assert "nothing moves" in result.notes[-1]


def test_a_limit_just_below_the_null_solutions_error_is_not_vacuous(judged):
    assert judged((LIMIT, "limit = 0.999")).verdict is Verdict.PASSED


@pytest.mark.parametrize("metric", ["displacement_max", "surface_hausdorff", "strain_energy"])
def test_what_is_lost_in_rounding_where_nothing_moves_is_no_failure(problem, metric):
    still = null_result(problem, GREEN, None)
    # Of a body of 2 m, 4e-16 m is the last digit.
    shift = np.full_like(problem.mesh.points, 1e-16)
    shift[::2] = 0.0
    hardly = state_of(problem, shift)
    assert measure(metric, problem, hardly, still).value == 0.0
    assert measure(metric, problem, still, hardly).value == 0.0


def test_a_body_that_moves_where_the_reference_does_not_has_failed(problem):
    still = null_result(problem, GREEN, None)
    moved = state_of(problem, np.full_like(problem.mesh.points, 1e-9))
    assert measure("displacement_l2", problem, moved, still).value == math.inf
    assert measure("displacement_l2", problem, still, still).value == 0.0


def test_checks_left_out_stand_in_every_output(judged):
    one_strain = Candidate("one strain", fastsim_candidate().solve)
    result = judged((LIMIT, LIMIT + '\nstrain = "linear"'), candidate=one_strain)
    left_out, own = result.checks
    assert left_out.verdict is Verdict.SKIPPED
    assert "green strain only" in left_out.message
    # Nothing but the trivial is left.
    assert own.is_vacuous
    assert result.verdict is Verdict.INCONCLUSIVE
    suite = ET.fromstring(outputs.junit_xml([result])).find("testsuite")
    assert "green strain only" in str(suite.find(".//skipped").attrib)
    # JUnit has no third colour: the case itself stands there as an error.
    assert [suite.get(key) for key in ("tests", "skipped", "errors")] == ["3", "1", "1"]
    document = json.loads(outputs.results_json([result], "1"))["cases"][0]
    assert document["checks"][0]["verdict"] == "skipped"
    assert document["checks"][1]["is_vacuous"] is True
    assert "| skipped |" in outputs.summary_markdown([result])
    assert any("nothing moves" in line for line in outputs.github_annotations([result]))


@pytest.mark.parametrize("name", builtin_cases())
def test_no_built_in_case_lets_a_plainly_wrong_solution_pass(name):
    judge = CaseJudge(case_of(name), references_of(name))
    assert judge.unseen() == ()
    assert any(not judge.is_vacuous(spec) for spec in judge.checks)


def test_what_a_case_cannot_see_is_named(judged):
    result = judged((METRIC, 'metric = "max_displacement"'))
    assert result.unseen == ("turned round", "axes exchanged")
    assert any("turned round" in note for note in result.notes)


def test_the_null_solution_has_the_times_and_tools_of_the_reference(problem):
    reference = stored("slide", SAME_MESH)
    null = null_result(case_of("slide").problem, GREEN, reference)
    assert null.displacements.shape == reference.displacements.shape
    assert null.trajectory is not None
    assert null.tool_forces is not None
    assert null.max_displacement == 0.0
    assert null_result(problem, GREEN, None).displacement.shape == problem.mesh.points.shape


def test_wrong_motions_are_wrong_as_they_say():
    reference = stored("block-motion", SAME_MESH)
    wrong = {
        solution.label: solution.displacements
        for solution in wrong_results(case_of("block-motion").problem, reference)
    }
    repeated, halted = "last state repeated", "every second state still"
    plain = ["nothing moves", "turned round", "twice as large", "axes exchanged"]
    assert list(wrong) == [*plain, repeated, halted]
    right = reference.displacements
    assert (wrong[repeated] == right[-1]).all()
    assert (wrong[halted][1:-1:2] == 0.0).all()
    np.testing.assert_array_equal(wrong[halted][0::2], right[0::2])
    assert np.abs(wrong[halted][2::2]).max(axis=(1, 2)).min() > 0.0


def test_the_report_shows_the_case_as_it_was_when_read(write_case, monkeypatch):
    path = write_case()
    case, before = load_case(path), path.read_text("utf-8")

    def solve(problem, strain, progress):
        path.write_text("changed by the simulator", "utf-8")
        return fastsim_candidate().solve(problem, strain, progress)

    states = {(SAME_MESH, GREEN): solved(case.problem)}
    references = ReferenceSet(states, {}, "fastsim itself")
    result = judged_by(references, monkeypatch, case, candidate=Candidate("mine", solve))
    assert result.case_text == before
    assert path.read_text("utf-8") == "changed by the simulator"
