"""A file of references says its own hash; whatever was altered is refused."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain
from palpate.validation.case import load_case
from palpate.validation.references.changes import describe_changes
from palpate.validation.references.errors import (
    MissingReferenceError,
    UnsoundReferenceError,
    UntrustedReferenceError,
)
from palpate.validation.references.reference_files import content_hash, read_reference
from palpate.validation.references.renewal import renew_reference
from palpate.validation.references.sets import SAME_MESH
from palpate.validation.references.stored import load_checked, load_stored, references_folder


@pytest.fixture
def path(tmp_path):
    shutil.copy(references_folder() / "block.npz", tmp_path)
    return tmp_path / "block.npz"


def rewrite(path, *, change=None, drops_hash=False):
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    header = json.loads(str(arrays["header"]))
    if change is not None:
        change(arrays, header)
    arrays["header"] = np.array(json.dumps(header, sort_keys=True))
    if drops_hash:
        del arrays["sha256"]
    np.savez(path, **arrays)


def halve_all(arrays, _header):
    for name in arrays:
        if name.startswith("displacement"):
            arrays[name] = 0.5 * arrays[name]


def negate_bars(_arrays, header):
    header["bars"] = dict.fromkeys(header["bars"], -1.0)
    del header["provenance"]["adaptive"]  # from which renewing would make them anew


def swell(_arrays, header):
    for state in header["states"]:
        state["volume"] *= 1.5


def accept_again(_arrays, header):
    header["provenance"]["accepted"]["by"] = "somebody else"


@pytest.mark.parametrize("change", [halve_all, negate_bars, swell, accept_again])
def test_an_altered_file_is_refused_by_its_hash(path, change):
    rewrite(path)
    problem = load_case("block").problem
    assert load_stored("block", problem, folder=path.parent).states
    rewrite(path, change=change)
    with pytest.raises(UntrustedReferenceError, match=r"was altered: .*reference build block"):
        load_stored("block", problem, folder=path.parent)


@pytest.mark.parametrize("change", [halve_all, negate_bars, swell])
def test_a_wrong_file_without_a_hash_is_not_renewed(path, change):
    rewrite(path, change=change, drops_hash=True)
    before = path.read_bytes()
    with pytest.raises(UnsoundReferenceError):
        renew_reference(path, "block", load_case("block").problem)
    assert path.read_bytes() == before


def test_a_file_without_a_hash_is_refused_until_it_is_renewed(path):
    rewrite(path, drops_hash=True)
    problem = load_case("block").problem
    before = read_reference(path)[0]
    with pytest.raises(UntrustedReferenceError, match="palpate reference renew block"):
        load_stored("block", problem, folder=path.parent)
    told = "\n".join(renew_reference(path, "block", problem))
    assert "added: its hash" in told
    assert "kept: accepted 2026-11-23 by the palpate developers" in told
    after = load_stored("block", problem, folder=path.parent)
    assert after.provenance["accepted"] == before.provenance["accepted"]
    assert "hash added" in after.provenance["renewed"]["changes"]
    assert after.bars == before.bars
    for place, state in before.states.items():
        assert np.array_equal(state.displacement, after.states[place].displacement)
    whole = path.read_bytes()
    assert "nothing to renew" in renew_reference(path, "block", problem)[0]
    assert path.read_bytes() == whole


def halve_bars(_arrays, header):
    header["bars"] = {name: 0.5 * bar for name, bar in header["bars"].items() if bar is not None}
    del header["provenance"]["bar_parts"]


def test_bars_that_no_longer_follow_from_their_record_do_when_renewed(tmp_path):
    path = tmp_path / "turned.npz"
    shutil.copy(references_folder() / "turned.npz", path)
    problem = load_case("turned").problem
    before = read_reference(path)[0]
    assert renew_reference(path, "turned", problem)[0].startswith("nothing to renew")
    rewrite(path, change=halve_bars, drops_hash=True)
    with pytest.raises(UnsoundReferenceError, match="palpate reference renew"):
        load_checked(path, "turned", problem, needs_hash=False)
    told = "\n".join(renew_reference(path, "turned", problem))
    assert "renewed: bar of displacement_l2, linear strain" in told
    after = load_stored("turned", problem, folder=path.parent)
    assert "error bars as the record of meshes" in after.provenance["renewed"]["changes"]
    recorded = before.provenance["adaptive"]["linear"]["metrics"]
    for metric in recorded:
        place = metric, Strain.LINEAR
        assert after.bars[place] == pytest.approx(before.bars[place], rel=1e-12)


def test_the_hash_hangs_on_name_type_shape_and_every_byte():
    array = np.arange(6, dtype=np.int32)
    of = content_hash({"a": array})
    others = (
        {"b": array},
        {"a": array.astype(np.uint32)},
        {"a": array.reshape(2, 3)},
        {"a": array[::-1]},
        {"a": array, "b": array[:0]},
    )
    assert len({of, *(content_hash(other) for other in others)}) == 6
    assert of == content_hash({"a": np.repeat(array, 2)[::2]})


@pytest.mark.parametrize(
    "change",
    [
        lambda _arrays, header: header.update(provenance=[1, 2]),
        lambda _arrays, header: header.update(bars={"volume": 0.1}),
        lambda _arrays, header: header.update(states="six"),
        lambda arrays, _header: arrays.update(displacement_0=np.array(["far", "away"])),
    ],
)
def test_a_header_of_the_wrong_kind_is_damage(path, change):
    rewrite(path, change=change, drops_hash=True)
    with pytest.raises(MissingReferenceError, match="damaged"):
        renew_reference(path, "block", load_case("block").problem)


def test_the_states_come_back_as_they_were_written(path):
    references, key, is_hashed = read_reference(path)
    assert is_hashed
    assert key.startswith("5ddd43083f32")
    assert references.states[SAME_MESH, Strain.GREEN].degree == 1


@pytest.mark.parametrize("key", ["provenance", "states", "bars", "schema", "key", "origin"])
@pytest.mark.parametrize("value", [None, 7, "text", [], [1], {"versions": [1]}, {"a": {}}])
def test_a_header_of_the_wrong_types_with_its_right_hash_is_an_input_error(path, key, value):
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files if name != "sha256"}
    header = json.loads(str(arrays["header"]))
    arrays["header"] = np.array(json.dumps({**header, key: value}))
    np.savez(path, **arrays, sha256=np.array(content_hash(arrays)))
    try:
        found = load_stored("block", load_case("block").problem, folder=path.parent)
    except InputError:
        return
    # What came through is of the right kind.
    assert isinstance(found.provenance, dict)
    assert isinstance(found.provenance.get("versions", {}), dict)
    assert key not in ("schema", "key")


def test_a_motion_that_was_altered_late_is_not_renewed(tmp_path):
    path = tmp_path / "block-motion.npz"
    shutil.copy(references_folder() / "block-motion.npz", path)

    def bend(arrays, header):
        number = [state["label"] for state in header["states"]].index(SAME_MESH)
        arrays[f"displacements_{number}"][40] *= 1.02

    rewrite(path, change=bend, drops_hash=True)
    with pytest.raises(UnsoundReferenceError):
        renew_reference(path, "block-motion", load_case("block-motion").problem)


def test_a_change_from_nothing_at_all_is_all_of_it(path, tmp_path):
    still = tmp_path / "still.npz"
    shutil.copy(path, still)

    def stop(arrays, _header):
        for name in arrays:
            if name.startswith("displacement"):
                arrays[name] = 0.0 * arrays[name]

    rewrite(still, change=stop, drops_hash=True)
    lines = [line for line in describe_changes(still, path) if "displacement: at most" in line]
    assert lines
    assert all(line.endswith(" 1 of the largest") for line in lines)
    nothing = [line for line in describe_changes(still, still) if "displacement: at most" in line]
    assert all(line.endswith(" 0 of the largest") for line in nothing)
