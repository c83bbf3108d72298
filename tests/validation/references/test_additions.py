"""An element's states beside accepted references: what was accepted stays, word for word."""

from __future__ import annotations

import dataclasses
import shutil

import numpy as np
import pytest

from palpate.meshes.problem import Element, Strain
from palpate.validation.case import load_case
from palpate.validation.cli import main
from palpate.validation.references import additions
from palpate.validation.references.changes import describe_changes
from palpate.validation.references.reference_files import read_reference
from palpate.validation.references.sets import OF_ELEMENT, SAME_MESH, SMOOTHED
from palpate.validation.references.soundness import find_contradictions
from palpate.validation.references.stored import (
    accepted_path,
    load_stored,
    pending_path,
    references_folder,
    store,
)

SMOOTHED_TOO = ("block", "block-motion", "press")


@pytest.fixture
def before(tmp_path, monkeypatch):
    """The block's references without smoothed tetrahedra, as they once were accepted."""
    shutil.copy(references_folder() / "block.npz", tmp_path)
    whole = read_reference(accepted_path("block"))[0]
    monkeypatch.setenv("PALPATE_REFERENCES", str(tmp_path))
    solved = {s: whole.states[SMOOTHED, s] for s in Strain}
    monkeypatch.setattr(
        additions, "solve_reference", lambda _problem, strain, *_given, **_options: solved[strain]
    )
    without = dataclasses.replace(
        whole,
        states={place: s for place, s in whole.states.items() if place[0] != SMOOTHED},
        origin="as it was",
        provenance={k: v for k, v in whole.provenance.items() if k != "added"},
    )
    store("block", load_case("block").problem, without, dict(without.provenance))
    return read_reference(accepted_path("block"))[0]


def palpate(monkeypatch, *arguments):
    monkeypatch.setattr("sys.argv", ["palpate", *arguments])
    with pytest.raises(SystemExit) as caught:
        main()
    return caught.value.code


def test_what_was_accepted_stays_with_who_accepted_it(before, monkeypatch, capsys):
    assert palpate(monkeypatch, "reference", "build", "block", "--element", "smoothed") == 0
    shown = capsys.readouterr().out
    assert "reference smoothed, green strain: new" in shown
    assert "reference P1, green strain: unchanged" in shown
    # Not used before somebody lets it in.
    assert (SMOOTHED, Strain.GREEN) not in read_reference(accepted_path("block"))[0].states
    arguments = ("--reason", "another element", "--by", "a tester")
    assert palpate(monkeypatch, "reference", "accept", "block", *arguments) == 0
    after = load_stored("block", load_case("block").problem)
    assert set(after.states) == {*before.states, *((SMOOTHED, strain) for strain in Strain)}
    assert {**after.bars} == {**before.bars}
    for key, value in before.provenance.items():
        assert after.provenance[key] == value
    told = after.provenance["added"]["smoothed"]
    assert told["command"] == "palpate reference build block --element smoothed"
    assert (told["accepted"]["by"], told["accepted"]["reason"]) == ("a tester", "another element")
    assert after.origin == "as it was; smoothed tetrahedra on the case's mesh beside them"
    for place, state in before.states.items():
        assert np.array_equal(after.states[place].displacement, state.displacement)
    capsys.readouterr()
    assert palpate(monkeypatch, "reference", "check", "block") == 0
    shown = capsys.readouterr().out
    assert before.provenance["accepted"]["reason"] in shown
    assert "by a tester: another element" in shown


def test_an_addition_to_something_else_is_not_accepted(before, monkeypatch, capsys):
    assert palpate(monkeypatch, "reference", "build", "block", "--element", "smoothed") == 0
    place = ("volume", Strain.GREEN)
    bars = {**before.bars, place: 2.0 * before.bars[place]}
    # Without the records that bars follow from.
    others = {k: v for k, v in before.provenance.items() if k not in ("adaptive", "bar_parts")}
    wider = dataclasses.replace(before, bars=bars, provenance=others)
    store("block", load_case("block").problem, wider, others)
    assert palpate(monkeypatch, "reference", "accept", "block", "--reason", "why not") == 2
    assert "has changed since something was built beside it (error bars)" in capsys.readouterr().err
    assert pending_path("block").is_file()


@pytest.mark.usefixtures("before")
def test_a_case_without_checks_on_the_same_mesh_has_nothing_to_add(monkeypatch, capsys):
    assert palpate(monkeypatch, "reference", "build", "strip", "--element", "smoothed") == 0
    assert "nothing to build" in capsys.readouterr().out
    assert not pending_path("strip").exists()


@pytest.mark.parametrize("strain", Strain)
@pytest.mark.parametrize("name", SMOOTHED_TOO)
def test_another_elements_state_under_its_name_is_refused(name, strain):
    problem = load_case(name).problem
    stored = load_stored(name, problem)
    assert find_contradictions(problem, stored) == []
    for label, other in ((SMOOTHED, SAME_MESH), (SAME_MESH, SMOOTHED)):
        swapped = dataclasses.replace(
            stored.states[other, strain],
            label=label,
            element=stored.states[label, strain].element,
        )
        spoiled = dataclasses.replace(stored, states={**stored.states, (label, strain): swapped})
        found = "; ".join(find_contradictions(problem, spoiled))
        words = "not in equilibrium" if problem.time is None else "from the case's own steps"
        assert f"{label}, {strain} strain" in found
        assert words in found


def test_a_state_whose_name_stands_for_another_element_is_refused():
    problem = load_case("block").problem
    stored = load_stored("block", problem)
    place = (SMOOTHED, Strain.GREEN)
    wrong = dataclasses.replace(stored.states[place], element=Element.LINEAR)
    spoiled = dataclasses.replace(stored, states={**stored.states, place: wrong})
    assert "its name stands for smoothed ones" in "; ".join(find_contradictions(problem, spoiled))


@pytest.mark.dolfinx
def test_it_is_solved_by_the_reference(before, monkeypatch):
    del before
    monkeypatch.undo()  # the reference itself, and the file as it is
    from palpate.validation.references.motion_runs import solve_reference

    problem = load_case("block").problem
    kept = load_stored("block", problem).states[SMOOTHED, Strain.GREEN]
    solved = solve_reference(problem, Strain.GREEN, 1, lambda _line: None, element=Element.SMOOTHED)
    assert (solved.label, solved.element) == (OF_ELEMENT[Element.SMOOTHED], Element.SMOOTHED)
    largest = np.abs(kept.displacement).max()
    assert np.abs(solved.displacement - kept.displacement).max() < 1e-9 * largest


def test_states_that_are_the_same_are_told_in_a_word(tmp_path):
    path = shutil.copy(references_folder() / "block.npz", tmp_path)
    lines = describe_changes(accepted_path("block"), path)
    assert lines == sorted(lines)
    assert {line.rsplit(": ", 1)[1] for line in lines} == {"unchanged"}
