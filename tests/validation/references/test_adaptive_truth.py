"""Adaptive truths: what a case asks of them, and what a file's record of meshes says."""

from __future__ import annotations

import dataclasses
import math

import pytest

from palpate.meshes.problem import Material, Problem, Strain
from palpate.reference.adaptivity.error_bars import SAFETY
from palpate.reference.result import Formulation, formulation_for
from palpate.validation.case import load_case
from palpate.validation.judging.case_references import truth_request
from palpate.validation.references.adaptive_truth import TruthRequest, most_apart, recorded_bars
from palpate.validation.references.reference_set import QUADRATIC, TRUTH
from palpate.validation.references.runs import solve_state
from palpate.validation.references.soundness import find_contradictions
from palpate.validation.references.statics import solve_for_storing

HALVING = {
    "estimates": [0.04, 0.02, 0.01, 0.005],
    "differences": [0.04, 0.02, 0.01],
    "bars": [None, None, 0.03, 0.015],
}


def test_the_bar_of_a_record_is_made_again():
    # A geometric series goes on to as much as its last difference.
    assert recorded_bars({"volume": HALVING})["volume"] == pytest.approx(SAFETY * 0.01)


@pytest.mark.parametrize(
    "table",
    [
        {},
        {**HALVING, "differences": [0.04, None, 0.01]},
        {**HALVING, "differences": "many"},
        "none",
        {**HALVING, "estimates": 3.0},
        {**HALVING, "differences": [0.01]},
    ],
)
def test_a_record_that_shows_nothing_makes_an_infinite_bar(table):
    found = recorded_bars({"volume": table, "displacement_l2": HALVING})
    assert found == {"volume": math.inf, "displacement_l2": pytest.approx(SAFETY * 0.01)}


def test_the_first_mesh_is_at_most_all_differences_from_the_last():
    assert most_apart(HALVING) == pytest.approx(0.01 + 0.02 * 1.01 + 0.04 * 1.01 * 1.02, rel=1e-6)
    assert most_apart({"differences": [0.1, None]}) == math.inf
    assert most_apart({}) == math.inf


def test_small_bars_are_asked_of_what_is_checked():
    # A published displacement leans on the bar of the largest error.
    request = truth_request(load_case("csm1"))
    for metric in ("displacement_l2", "displacement_max"):
        assert request.tolerance(metric, Strain.GREEN) == 0.005
    assert request.tolerance("volume", Strain.GREEN) == math.inf
    # Nothing is checked against the linear truth, which the report shows all the same.
    assert request.tolerance("displacement_l2", Strain.LINEAR) == 0.01
    assert request.tolerance("volume", Strain.LINEAR) == math.inf


def test_small_bars_are_asked_of_the_parts_that_are_checked():
    case = load_case("beam")
    parts = truth_request(case).named_parts(Strain.GREEN)
    assert [name.split("@")[0] for name in parts] == ["stress_l2", "traction_resultant"]
    inside, cut = parts.values()
    assert 0 < len(inside.cells) < case.problem.mesh.num_cells
    assert len(cut.cells) == 0
    assert 0.0 < cut.weights.sum() < cut.weights.size
    assert truth_request(case).named_parts(Strain.LINEAR) == {}


def test_a_case_may_ask_for_another_bar_and_budget(write_case):
    path = write_case(
        ("[material]", "[truth]\nbar = 0.02\nminutes = 1.5\nmemory = 2.0\n\n[material]")
    )
    request = truth_request(load_case(str(path)))
    assert (request.bar, request.seconds, request.memory) == (0.02, 90.0, 2.0)


def test_near_incompressibility_the_mixed_form_is_taken_by_itself():
    problem = load_case("block").problem

    def at(ratio: float) -> Problem:
        return Problem(problem.mesh, Material(1e4, ratio), problem.supports, problem.loads)

    assert formulation_for(at(0.48), 2) is Formulation.DISPLACEMENT
    assert formulation_for(at(0.49), 2) is Formulation.MIXED
    assert formulation_for(at(0.49), 3) is Formulation.MIXED
    # Linear tetrahedra lock in that form as well.
    assert formulation_for(at(0.49), 1) is Formulation.DISPLACEMENT
    pressed = dataclasses.replace(load_case("press").problem, material=Material(1e4, 0.49))
    assert formulation_for(pressed, 2) is Formulation.MIXED


@pytest.mark.dolfinx
@pytest.mark.long
@pytest.mark.nightly
def test_a_stored_truth_has_its_bars_and_their_record(write_case):
    case = load_case(str(write_case()))
    request = TruthRequest(0.1, 120.0, 4.0, {Strain.GREEN: {"displacement_l2", "volume"}})
    found = solve_for_storing(case.problem, lambda _line: None, request=request)
    assert found.bars["displacement_l2", Strain.GREEN] <= 0.1
    assert found.bars["volume", Strain.GREEN] <= 0.1
    assert find_contradictions(case.problem, found) == []
    kept = found.provenance["adaptive"]["green"]
    assert kept["ended"] == "every bar is met"
    assert len(kept["cells"]) == len(kept["seconds"]) >= 3
    for metric, bar in recorded_bars(kept["metrics"]).items():
        assert bar == pytest.approx(found.bars[metric, Strain.GREEN])
    # Its first mesh is the case's: quadratic tetrahedra there are not solved once more.
    first = found.states[QUADRATIC, Strain.GREEN]
    alone = solve_state(case.problem, Strain.GREEN, 2, lambda _line: None)
    assert first.displacement == pytest.approx(
        alone.displacement, abs=1e-8 * alone.max_displacement
    )
    assert first.volume == pytest.approx(alone.volume, rel=1e-10)
    assert first.max_displacement == pytest.approx(alone.max_displacement, rel=1e-8)
    # From the answer of smoothed tetrahedra there, which is near.
    assert first.details["newton_iterations"] < alone.details["newton_iterations"]


@pytest.mark.dolfinx
@pytest.mark.long
def test_the_truth_is_of_the_strain_measures_that_are_asked_for(write_case):
    case = load_case(str(write_case()))
    request = TruthRequest(0.1, 120.0, 4.0, {Strain.LINEAR: {"displacement_l2"}})
    found = solve_for_storing(
        case.problem, lambda _line: None, truth_strains=[Strain.LINEAR], request=request
    )
    assert find_contradictions(case.problem, found) == []
    assert found.truth(Strain.LINEAR) is found.states[TRUTH, Strain.LINEAR]
    assert found.bars["displacement_l2", Strain.LINEAR] <= 0.1
    # Of the other one there is P2 on the case's mesh, without bars.
    assert found.truth(Strain.GREEN) is found.states[QUADRATIC, Strain.GREEN]
    assert {strain for _, strain in found.bars} == {Strain.LINEAR}
