"""A file of references says its own hash; whatever was altered is refused."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain
from palpate.validation.case import load_case
from palpate.validation.references.reference_set import SAME_MESH
from palpate.validation.references.stored import (
    MissingReferenceError,
    UnsoundReferenceError,
    UntrustedReferenceError,
    accepted_path,
    content_hash,
    describe_changes,
    load_checked,
    load_stored,
    read_reference,
)


@pytest.fixture
def path(copy_of):
    return copy_of("block")


def halve_all(arrays, _header):
    for name in arrays:
        if name.startswith("displacement"):
            arrays[name] = 0.5 * arrays[name]


def negate_bars(_arrays, header):
    header["bars"] = dict.fromkeys(header["bars"], -1.0)


def swell(_arrays, header):
    for state in header["states"]:
        state["volume"] *= 1.5


def accept_again(_arrays, header):
    header["provenance"]["accepted"]["by"] = "somebody else"


@pytest.mark.parametrize("change", [halve_all, negate_bars, swell, accept_again])
def test_an_altered_file_is_refused_by_its_hash(path, rewrite, change):
    rewrite(path)
    problem = load_case("block").problem
    assert load_stored("block", problem, folder=path.parent).states
    rewrite(path, change=change)
    with pytest.raises(UntrustedReferenceError, match=r"was altered: .*reference build block"):
        load_stored("block", problem, folder=path.parent)


@pytest.mark.parametrize("change", [halve_all, negate_bars, swell])
def test_a_wrong_file_with_its_right_hash_is_refused_by_its_contents(path, rewrite, change):
    rewrite(path, change=change, hashed="new")
    with pytest.raises(UnsoundReferenceError):
        load_stored("block", load_case("block").problem, folder=path.parent)


def test_a_file_without_a_hash_is_refused(path, rewrite):
    rewrite(path, hashed=None)
    with pytest.raises(UntrustedReferenceError, match=r"has no hash.*reference build block"):
        load_stored("block", load_case("block").problem, folder=path.parent)


def test_bars_that_no_longer_follow_from_their_record_are_refused(copy_of, rewrite):
    def halve_bars(_arrays, header):
        bars = header["bars"].items()
        header["bars"] = {name: 0.5 * bar for name, bar in bars if bar is not None}
        del header["provenance"]["bar_parts"]

    path = copy_of("turned")
    rewrite(path, change=halve_bars, hashed="new")
    with pytest.raises(UnsoundReferenceError, match="the file's own record of meshes"):
        load_checked(path, "turned", load_case("turned").problem)


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
def test_a_header_of_the_wrong_kind_is_damage(path, rewrite, change):
    rewrite(path, change=change, hashed="new")
    with pytest.raises(MissingReferenceError, match="damaged"):
        read_reference(path)


def test_the_states_come_back_as_they_were_written(path):
    references, key = read_reference(path)
    assert key.startswith("5ddd43083f32")
    assert references.states[SAME_MESH, Strain.GREEN].degree == 1


@pytest.mark.parametrize("key", ["provenance", "states", "bars", "schema", "key", "origin"])
@pytest.mark.parametrize("value", [None, 7, "text", [], [1], {"versions": [1]}, {"a": {}}])
def test_a_header_of_the_wrong_types_with_its_right_hash_is_an_input_error(
    path, rewrite, key, value
):
    rewrite(path, change=lambda _arrays, header: header.update({key: value}), hashed="new")
    try:
        found = load_stored("block", load_case("block").problem, folder=path.parent)
    except InputError:
        return
    # What came through is of the right kind.
    assert isinstance(found.provenance, dict)
    assert isinstance(found.provenance.get("versions", {}), dict)
    assert key not in ("schema", "key")


def test_a_motion_that_was_altered_late_is_found_by_a_thorough_check(copy_of, rewrite):
    def bend(arrays, header):
        number = [state["label"] for state in header["states"]].index(SAME_MESH)
        arrays[f"displacements_{number}"][40] *= 1.02

    path = copy_of("block-motion")
    rewrite(path, change=bend, hashed="new")
    with pytest.raises(UnsoundReferenceError):
        load_checked(path, "block-motion", load_case("block-motion").problem, thoroughly=True)


def test_states_that_are_the_same_are_reported_in_a_word(path):
    lines = describe_changes(accepted_path("block"), path)
    assert lines == sorted(lines)
    assert {line.rsplit(": ", 1)[1] for line in lines} == {"unchanged"}


def test_a_change_from_nothing_at_all_is_all_of_it(path, tmp_path, rewrite):
    still = tmp_path / "still.npz"
    shutil.copy(path, still)

    def stop(arrays, _header):
        for name in arrays:
            if name.startswith("displacement"):
                arrays[name] = 0.0 * arrays[name]

    rewrite(still, change=stop, hashed="new")
    lines = [line for line in describe_changes(still, path) if "displacement: at most" in line]
    assert lines
    assert all(line.endswith(" 1 of the largest") for line in lines)
    nothing = [line for line in describe_changes(still, still) if "displacement: at most" in line]
    assert all(line.endswith(" 0 of the largest") for line in nothing)
