"""Cases judged side by side in other processes are judged as they are one after the other."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.meshes.errors import InputError
from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.case import load_cases
from palpate.validation.judging.judge import judge_case, judge_cases

OWN = """schema = 1
title = "Nobody stored a reference of this one"

[geometry]
shape = "box"
size = [3.0, 1.0, 1.0]
edge_length = 1.0

[material]
youngs_modulus = 1000.0
poissons_ratio = 0.3

[[support]]
region = { half_space = { point = [0.1, 0.0, 0.0], normal = [-1.0, 0.0, 0.0] } }

[[load]]
kind = "traction"
traction = [0.0, 0.0, 1.0]
region = { half_space = { point = [2.9, 0.0, 0.0], normal = [1.0, 0.0, 0.0] } }

[[check]]
metric = "displacement_l2"
against = "same_mesh"
limit = 1e-8
reason = "same equations"
"""


def test_two_processes_find_what_one_does_in_the_order_of_the_cases() -> None:
    cases, mine, lines = load_cases(["column", "block"]), [fastsim_candidate()], []
    found = judge_cases(cases, mine, progress=lines.append, processes=2)
    alone: list[str] = []
    expected = [judge_case(case, candidate=mine, progress=alone.append) for case in cases]
    assert [result.name for result in found] == ["column", "block"]
    for one, other in zip(found, expected, strict=True):
        assert one.checks == other.checks
        assert one.metrics == other.metrics
    assert lines == alone


def test_a_case_that_cannot_be_judged_is_refused_as_ever(tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text(OWN)
    cases = load_cases(["column", str(file)])
    with pytest.raises(InputError, match="no reference is stored"):
        judge_cases(cases, [fastsim_candidate()], processes=2)
