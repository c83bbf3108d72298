"""Linear and smoothed tetrahedra: each is held against its own element on the same mesh."""

from __future__ import annotations

import dataclasses
import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from palpate.meshes.problem import Element, Strain
from palpate.validation.candidates.candidate import (
    fastsim_candidate,
    result_candidate,
)
from palpate.validation.case import load_case
from palpate.validation.judging import case_references, outputs
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.run_comparison import compare_runs
from palpate.validation.references.reference_set import SAME_MESH, SMOOTHED
from palpate.validation.references.stored import load_stored
from palpate.validation.report.html import write_report
from palpate.validation.states import Verdict


@pytest.fixture(scope="module")
def block():
    return load_case("block")


@pytest.fixture(scope="module")
def stored(block):
    return load_stored("block", block.problem)


def answer(tmp_path, displacement, element=None):
    """A result file that says what its element is, or nothing."""
    path = tmp_path / "mine.npz"
    about = {} if element is None else {"about": json.dumps({"element": element})}
    np.savez(path, displacement=displacement, **about)
    return result_candidate(path)


def same_mesh(result):
    return [c for c in result.checks if c.against == "same_mesh"]


@pytest.mark.parametrize(
    ("label", "said", "verdict"),
    [
        (SMOOTHED, "smoothed", Verdict.PASSED),
        (SMOOTHED, "linear", Verdict.FAILED),
        (SMOOTHED, None, Verdict.FAILED),
        (SAME_MESH, "smoothed", Verdict.FAILED),
        (SAME_MESH, "linear", Verdict.PASSED),
        (SAME_MESH, "of my own making", Verdict.PASSED),
        (SAME_MESH, None, Verdict.PASSED),
    ],
)
def test_an_answer_is_held_against_the_element_that_it_says(
    block, stored, tmp_path, label, said, verdict
):
    given = answer(tmp_path, stored.states[label, Strain.GREEN].displacement, said)
    result = judge_case(block, candidate=given, diagnoses=False)
    is_smoothed = said == "smoothed"
    for check in same_mesh(result):
        if check.strain is Strain.GREEN:
            assert check.verdict is verdict, check.name
            assert (check.element is Element.SMOOTHED) == is_smoothed
            assert ("smoothed" in check.name) == is_smoothed
    other = SAME_MESH if is_smoothed else SMOOTHED
    assert not any(state.label == other for state in result.states)
    assert any(name.endswith(f"- {SMOOTHED if is_smoothed else SAME_MESH}, green")
               for name in result.error_fields)  # fmt: skip


def test_without_a_reference_of_its_element_an_answer_is_inconclusive(
    block, stored, tmp_path, monkeypatch
):
    states = {place: s for place, s in stored.states.items() if place[0] != SMOOTHED}
    without = dataclasses.replace(stored, states=states)
    monkeypatch.setattr(case_references, "load_stored", lambda *_given, **_options: without)
    given = answer(tmp_path, stored.states[SMOOTHED, Strain.GREEN].displacement, "smoothed")
    result = judge_case(block, candidate=given, diagnoses=False)
    checks = [check for check in same_mesh(result) if check.strain is Strain.GREEN]
    assert {check.verdict for check in checks} == {Verdict.INCONCLUSIVE}
    assert "palpate reference build block`" in checks[0].message
    assert result.verdict is Verdict.INCONCLUSIVE


@pytest.fixture(scope="module")
def both(block, stored):
    """fastsim beside a candidate that sends the reference's smoothed answers, 1 % too large."""

    def solve(_problem, strain, _progress):
        state = stored.states[SMOOTHED, strain]
        return dataclasses.replace(
            state,
            label="mine",
            simulator="mine",
            displacement=1.01 * state.displacement,
            versions={},
        )

    mine = dataclasses.replace(
        fastsim_candidate(), name="mine", solve=solve, element=Element.SMOOTHED
    )
    return judge_case(block, candidate=[fastsim_candidate(), mine])


def test_two_candidates_stand_beside_one_another(both, block):
    assert [(one.name, one.verdict) for one in both.candidates] == [
        ("fastsim", Verdict.PASSED),
        ("mine", Verdict.FAILED),
    ]
    assert both.verdict is Verdict.FAILED
    assert len(both.checks) == 2 * len(block.checks)
    names = [check.name for check in both.checks]
    assert len(set(names)) == len(names)
    labels = {state.label for state in both.states}
    assert {"fastsim", "mine", SAME_MESH, SMOOTHED} <= labels
    keys = [key for key in both.metrics if key.endswith("displacement_l2")]
    assert {"error.same_mesh.green.displacement_l2",
            "error.same_mesh.green.smoothed.displacement_l2"} <= set(keys)  # fmt: skip
    # The slip is found in the smoothed answer, by the equations and the reference of its element.
    assert {found.element for found in both.diagnoses} == {Element.SMOOTHED}


def test_every_output_keeps_the_two_apart(both, tmp_path):
    document = json.loads(outputs.results_json([both], "1"))["cases"][0]
    assert [(c["name"], c["element"], c["verdict"]) for c in document["candidates"]] == [
        ("fastsim", "linear", "passed"),
        ("mine", "smoothed", "failed"),
    ]
    assert {check["element"] for check in document["checks"]} == {"linear", "smoothed"}
    suite = ET.fromstring(outputs.junit_xml([both])).find("testsuite")
    names = [test.get("name") for test in suite.iter("testcase")]
    assert len(set(names)) == len(names)
    summary = outputs.summary_markdown([both])
    assert "  - fastsim: passed" in summary
    assert "  - mine: failed" in summary
    path = tmp_path / "results.json"
    path.write_text(outputs.results_json([both], "1"), encoding="utf-8")
    pairs = compare_runs(path, path).pairs
    assert len(pairs) == len(both.checks)
    assert {pair.change for pair in pairs} == {"same"}


def test_the_page_shows_both_beside_the_reference(both, tmp_path):
    page = write_report([both], tmp_path).read_text("utf-8")
    for text in (
        "Can fastsim and mine be trusted for this?",
        "Green strain: fastsim and mine with reference P2, refined",
        "Green strain: fastsim with reference P1, mine with reference smoothed",
    ):
        assert text in page
    assert "mine with reference P1" not in page
    table = (tmp_path / "block-states.csv").read_text("utf-8").splitlines()[0]
    assert "fastsim" in table
    assert "mine" in table
