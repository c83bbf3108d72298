"""A stated hash covers all that decides a verdict: limits, evidence, [truth], files, the truth."""

from __future__ import annotations

import dataclasses
import shutil

import pytest
from judged import case_of, references_of

from palpate.validation.case import load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.provenance import input_key
from palpate.validation.states import Precision

LIMIT = "limit = 1e-8"


@pytest.fixture
def block(tmp_path):
    """The block's case file with changes, beside its mesh."""
    source = case_of("block")
    shutil.copy(source.folder / "block.vtu", tmp_path)

    def write(old="", new=""):
        assert old in source.text
        path = tmp_path / "block.toml"
        path.write_text(source.text.replace(old, new, 1) if old else source.text + new, "utf-8")
        return load_case(path)

    return write


def key_of(case, **more):
    return input_key(case, references_of("block"), **more)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (LIMIT, "limit = 1e-7"),
        ("[evidence]", "[evidence]\napplicability = 'as near as can be'"),
        ("minutes = 5.0", "minutes = 6.0"),
        ("youngs_modulus = 10.0", "youngs_modulus = 10.1"),
    ],
)
def test_what_decides_a_verdict_changes_the_hash(block, old, new):
    assert key_of(block(old, new)) != key_of(block())


def test_a_comment_decides_nothing(block):
    assert key_of(block("", "# A word more.\n")) == key_of(block())


def test_the_granted_precision_and_the_stored_truth_are_in_it():
    case, references = case_of("block"), references_of("block")
    about = {**references.provenance, "sha256": "0" * 64}
    other = dataclasses.replace(references, provenance=about)
    keys = {
        key_of(case),
        key_of(case, precision=Precision.SINGLE),
        input_key(case, other),
    }
    assert len(keys) == 3
    assert len(references.provenance["sha256"]) == 64


def test_a_file_that_only_the_truth_uses_is_in_it(tmp_path):
    source = case_of("kidney")
    text = source.text.replace('"kidney.vtu"', '"body.vtu"', 1)
    shutil.copy(source.folder / "kidney.vtu", tmp_path / "body.vtu")
    (tmp_path / "mine.toml").write_text(text + '\n[truth]\nsurface = "fine.ply"\n', "utf-8")
    keys = set()
    for content in ("one", "two"):
        (tmp_path / "fine.ply").write_text(content)
        keys.add(input_key(load_case(tmp_path / "mine.toml"), references_of("kidney")))
    assert len(keys) == 2


def test_results_state_it_beside_the_problem_s_key():
    about = judge_case(case_of("block")).provenance
    assert about["input_key"] == key_of(case_of("block"))
    assert about["input_key"] != about["case_key"]
