"""A closed form stands in a case file: fastsim keeps it, faults do not, mistakes are named."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from palpate.meshes.errors import InputError
from palpate.validation.case import builtin_folder, load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.results import Verdict
from palpate.validation.simulators.candidate import fastsim_candidate
from palpate.validation.simulators.faults import Fault

STRETCH = builtin_folder() / "stretch.toml"


def published(fault: Fault) -> Verdict:
    result = judge_case(load_case("stretch"), candidate=fastsim_candidate(fault))
    (check,) = (c for c in result.checks if c.metric == "published_displacement")
    return check.verdict


def test_the_number_in_the_case_is_the_closed_form() -> None:
    (check,) = (c for c in load_case("stretch").checks if c.metric == "published_displacement")
    # Lateral stretch sqrt(1 - nu (l^2 - 1)) of a 10 mm side at l = 1.25, nu = 0.3.
    assert check.expected == pytest.approx(10.0 * (math.sqrt(1 - 0.3 * 0.5625) - 1), rel=1e-15)


def test_fastsim_keeps_it_and_faults_do_not() -> None:
    assert published(Fault.NONE) is Verdict.PASSED
    assert published(Fault.LINEAR_INSTEAD_OF_GREEN) is Verdict.FAILED
    assert published(Fault.SWAPPED_LAME) is Verdict.FAILED
    assert published(Fault.UNIT_ERROR) is Verdict.FAILED


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('component = "y"\n', "", "all three"),
        ("expected = -0.88", "expected = 0.0 #", "no scale"),
        ("at = [20.0, 10.0, 10.0]", "at = [20.0, 10.0, 9.0]", "no point of the mesh"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = STRETCH.read_text("utf-8")
    assert old in text
    (tmp_path / "stretch.toml").write_text(text.replace(old, new), encoding="utf-8")
    (tmp_path / "stretch.vtu").write_bytes((builtin_folder() / "stretch.vtu").read_bytes())
    references = tmp_path / "references"
    references.mkdir()
    stored = builtin_folder().parent / "references" / "stretch.npz"
    (references / "stretch.npz").write_bytes(stored.read_bytes())
    with pytest.raises(InputError, match=message):
        judge_case(load_case(tmp_path / "stretch.toml"))
