"""Stresses of the truth beside accepted references: kept, checked, asked for, not invented."""

from __future__ import annotations

import dataclasses
import shutil

import numpy as np
import pytest

from palpate.meshes.problem import Element, Strain
from palpate.validation.case import load_case
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.checks import CaseJudge, name_of_bar
from palpate.validation.references.reference_set import TRUTH
from palpate.validation.references.soundness import find_contradictions
from palpate.validation.references.stored import (
    UnsoundReferenceError,
    load_stored,
    read_reference,
    references_folder,
    store,
)
from palpate.validation.states import Verdict

CASE = load_case("beam")
PLACE = (TRUTH, Strain.GREEN)
EVERYWHERE = {"half_space": {"point": (0.0, 0.0, 0.0), "normal": (1.0, 0.0, 0.0)}}


def spec(**more: object) -> CheckSpec:
    reported = {"metric": "stress_l2", "against": "truth", "limit": 1.5, "reason": "r", **more}
    if "support" not in more:
        reported["region"] = EVERYWHERE
    return CheckSpec.model_validate(reported)


def without_stress(references):
    states = {
        key: dataclasses.replace(state, integrals=None) for key, state in references.states.items()
    }
    provenance = {**references.provenance, "added": {}}
    return dataclasses.replace(references, states=states, provenance=provenance)


@pytest.fixture
def whole(tmp_path, monkeypatch):
    """The beam's references; the accepted ones are a copy without stresses."""
    shutil.copy(references_folder() / "beam.npz", tmp_path)
    found = load_stored("beam", CASE.problem)
    monkeypatch.setenv("PALPATE_REFERENCES", str(tmp_path))
    bare = without_stress(found)
    store("beam", CASE.problem, bare, dict(bare.provenance))
    return found


def test_a_file_keeps_them_to_seven_digits(whole):
    path = store("beam", CASE.problem, whole, dict(whole.provenance))
    again = read_reference(path)[0]
    one, other = whole.states[PLACE].integrals, again.states[PLACE].integrals
    assert np.array_equal(one.cauchy, other.cauchy)
    assert np.array_equal(one.internal_force, other.internal_force)
    assert np.array_equal(one.cauchy, one.cauchy.transpose(0, 2, 1))
    fine = dataclasses.replace(one, cauchy=one.cauchy / 3.0)
    changed = {PLACE: dataclasses.replace(whole.states[PLACE], integrals=fine)}
    store("beam", CASE.problem, dataclasses.replace(whole, states={**whole.states, **changed}), {})
    read = read_reference(path)[0].states[PLACE].integrals.cauchy
    assert 0.0 < np.abs(read - fine.cauchy).max() <= 6e-8 * np.abs(fine.cauchy).max()


def test_a_truth_without_them_is_inconclusive_and_says_what_to_do(whole):
    bare = load_stored("beam", CASE.problem)
    asked = [spec(), spec(metric="traction_resultant", support=1)]
    names = [name_of_bar(each, CASE.problem, CASE.spec.units) for each in asked]
    bars = {**whole.bars, **{(name, Strain.GREEN): 0.01 for name in names}}
    for element in Element:
        judge = CaseJudge(CASE, bare.of_element(element))
        answer = judge.references.same_mesh(Strain.GREEN)
        # Without stresses, and with those of other parts.
        for known in (judge, CaseJudge(CASE, whole.of_element(element))):
            for each in asked:
                found = known.check(each, answer)
                assert found.verdict is Verdict.INCONCLUSIVE
                assert "anew with `palpate reference build beam`" in found.message
        # On the same mesh the displacement tells it.
        assert judge.check(spec(against="same_mesh"), answer).verdict is Verdict.PASSED
        with_bars = dataclasses.replace(whole, bars=bars)
        found = CaseJudge(CASE, with_bars.of_element(element)).check(spec(), answer)
        assert found.verdict is Verdict.PASSED
        assert 0.05 < found.value < 1.0
        number = CASE.problem.mesh.num_cells
        assert f"in {number} of {number} cells" in found.message
        assert found.reference_error == pytest.approx(0.01, rel=1e-4)


def test_stresses_that_do_not_balance_the_loads_are_refused(whole):
    def with_change(key, **change):
        state = whole.states[key]
        kept = dataclasses.replace(state.integrals, **change)
        changed = {**whole.states, key: dataclasses.replace(state, integrals=kept)}
        return dataclasses.replace(whole, states=changed)

    assert find_contradictions(CASE.problem, whole) == []
    kept = whole.states[PLACE].integrals
    for change, word in (
        ({"internal_force": 0.999 * kept.internal_force}, "at a free point"),
        ({"internal_force": kept.internal_force[1:]}, "do not fit the mesh"),
        ({"cauchy": np.full_like(kept.cauchy, np.nan)}, "do not fit the mesh"),
        ({"cauchy": kept.cauchy[:, :2]}, "do not fit the mesh"),
    ):
        (line,) = find_contradictions(CASE.problem, with_change(PLACE, **change))
        assert line.startswith("reference P2, refined, green strain: ")
        assert word in line
    with pytest.raises(UnsoundReferenceError):
        store(
            "beam",
            CASE.problem,
            with_change(PLACE, internal_force=0.999 * kept.internal_force),
            {},
        )
