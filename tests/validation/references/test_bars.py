"""What error bars are made of: one rule, kept in files, told in verdicts."""

from __future__ import annotations

import dataclasses
import json
import math

import pytest
from judged import judge

from palpate.meshes.problem import Strain
from palpate.validation.case import load_case
from palpate.validation.judging.outputs import results_json
from palpate.validation.references.bars import (
    PARTS,
    BarParts,
    as_record,
    of_statics,
    read_row,
    with_bar,
)
from palpate.validation.references.soundness import find_contradictions
from palpate.validation.references.stored import load_stored, read_reference, store
from palpate.validation.states import Verdict

PLACE = ("displacement_l2", Strain.GREEN)


def test_parts_add_and_geometry_stands_beside():
    parts = BarParts(discretisation=0.3, algebra=0.02, time=0.1, geometry=9.0, stated=0.05)
    assert parts.whole == pytest.approx(0.47)
    assert parts.times(2.0).whole == pytest.approx(0.94)
    assert list(parts.reported()) == ["discretisation", "time", "stated", "algebra"]
    assert parts.says() == "mesh 0.3, time 0.1, stated 0.05, algebra 0.02"
    assert parts.says(with_geometry=True).startswith("geometry 9, mesh 0.3")
    # One part is the whole, and what is below a hundredth is not told.
    assert BarParts(time=0.2, algebra=1e-8).says() == ""


def test_nothing_stays_nothing_in_any_unit():
    assert BarParts(time=0.1).times(math.inf) == BarParts(time=math.inf)
    assert BarParts(discretisation=math.inf).whole == math.inf


def test_what_solving_leaves_is_distinguished_from_what_meshes_leave():
    assert of_statics(0.01).whole == pytest.approx(0.01)
    assert of_statics(0.01).algebra == 1e-8
    assert of_statics(1e-9) == BarParts(algebra=1e-9)
    assert of_statics(math.inf).whole == math.inf
    lost = with_bar(BarParts(time=0.1), math.inf)
    assert lost == BarParts(time=0.1, discretisation=math.inf)
    assert with_bar(BarParts(time=0.1), 0.1) == BarParts(time=0.1)


def test_a_record_shows_the_same():
    parts = BarParts(discretisation=math.inf, time=0.1)
    (row,) = json.loads(json.dumps(as_record({PLACE: parts}))).values()
    assert read_row(row) == parts


@pytest.mark.parametrize(
    "row", [None, "many", {"time": "x"}, {"time": -1.0}, {"luck": 0.1}, {"time": True}]
)
def test_what_is_no_record_of_parts_is_none(row):
    assert read_row(row) is None


@pytest.fixture
def block():
    case = load_case("block-fine")
    return case, load_stored(case.name, case.problem)


def with_record(references, record):
    return dataclasses.replace(references, provenance={**references.provenance, PARTS: record})


def test_a_file_without_parts_is_all_discretisation(block):
    _, references = block
    assert PARTS not in references.provenance
    bar = references.bars[PLACE]
    assert references.bar_parts(*PLACE) == BarParts(discretisation=bar)
    assert references.bar_parts("displacement_h1", Strain.GREEN).whole == math.inf


def test_parts_that_contradict_their_bar_are_refused(block):
    case, references = block
    bar = references.bars[PLACE]
    good = with_record(
        references, as_record({PLACE: BarParts(discretisation=0.75 * bar, time=0.25 * bar)})
    )
    assert find_contradictions(case.problem, good) == []
    less = with_record(references, as_record({PLACE: BarParts(discretisation=0.5 * bar)}))
    assert "add up to" in find_contradictions(case.problem, less)[0]
    for record in ({"displacement_l2|green": {"luck": bar}}, {"luck|green": {"time": bar}}, "x"):
        wrong = find_contradictions(case.problem, with_record(references, record))
        assert PARTS in wrong[0]


def test_parts_are_kept_in_the_file_and_reported_in_the_verdict(block, tmp_path, monkeypatch):
    case, references = block
    bar = references.bars[PLACE]
    parts = BarParts(discretisation=0.75 * bar, time=0.25 * bar, geometry=0.3)
    told = with_record(references, as_record({PLACE: parts}))
    path = tmp_path / "block-fine.npz"
    store(case.name, case.problem, told, dict(told.provenance), path=path)
    again, _ = read_reference(path)
    assert again.bar_parts(*PLACE) == parts
    monkeypatch.setenv("PALPATE_REFERENCES", str(tmp_path))
    result = judge(case)
    (check,) = (c for c in result.checks if c.metric == "displacement_l2" and c.against == "truth")
    # The bar is what it was: geometry stands beside it, in words.
    assert check.reference_error == bar
    assert check.verdict is Verdict.FAILED
    assert check.bar_parts == {
        "geometry": 0.3,
        "discretisation": pytest.approx(0.75 * bar),
        "time": pytest.approx(0.25 * bar),
    }
    assert f"(+- {bar:.2g}: mesh {0.75 * bar:.2g}, time {0.25 * bar:.2g})" in check.message
    assert "its geometry adds up to 0.3, beside the bar" in check.message
    assert check.bar_says.startswith("mesh ")
    assert check.bar_says.endswith("; beside it: geometry 0.3")
    counted = dataclasses.replace(check, reference_error=bar + 0.3)
    assert counted.bar_says.startswith("geometry 0.3, mesh ")
    written = json.loads(results_json([result], "0"))["cases"][0]["checks"]
    assert any(row["bar_parts"].get("geometry") == 0.3 for row in written)
