"""Judged cases that many tests of the report show."""

from __future__ import annotations

import pytest

from palpate.meshes.problem import Element, Strain
from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.case import Case, load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.results import CaseResult, Judged
from palpate.validation.report import html
from palpate.validation.states import Verdict, in_silence


@pytest.fixture(scope="session")
def kidney() -> CaseResult:
    return judge_case(load_case("kidney"))


@pytest.fixture(scope="session")
def block() -> CaseResult:
    return judge_case(load_case("block"))


@pytest.fixture(scope="session")
def both() -> CaseResult:
    """The block by linear and by smoothed tetrahedra."""
    candidates = [fastsim_candidate(element=element) for element in Element]
    return judge_case(load_case("block"), candidate=candidates)


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages without still pictures, which take most of their time."""
    monkeypatch.setattr(html, "draw_pictures", lambda _result, _folder: {})


LUMP = """schema = 1
title = "A slab with a lump"
description = "A ball of stiffer tissue inside, and a softer end."
strain = "green"

[units]
length = "mm"
stress = "kPa"

[geometry]
shape = "box"
size = [60.0, 40.0, 30.0]
edge_length = 8.0

[material]
youngs_modulus = 10.0
poissons_ratio = 0.4
density = 1000.0

[[inclusion]]
region = { ball = { center = [26.0, 20.0, 15.0], radius = 11.0 } }
material = { youngs_modulus = 40.0, poissons_ratio = 0.4, density = 1000.0 }

[[inclusion]]
region = { half_space = { point = [48.0, 0.0, 0.0], normal = [1.0, 0.0, 0.0] } }
material = { youngs_modulus = 5.0, poissons_ratio = 0.4, density = 1000.0 }

[[support]]
region = { half_space = { point = [0.001, 0.0, 0.0], normal = [-1.0, 0.0, 0.0] } }

[[load]]
kind = "force"
force = [0.3, 0.1, 0.0]
region = { half_space = { point = [59.999, 0.0, 0.0], normal = [1.0, 0.0, 0.0] } }

[[check]]
metric = "inverted_cells"
against = "candidate"
limit = 0.0
reason = "none may be"
"""


@pytest.fixture(scope="session")
def lump(tmp_path_factory: pytest.TempPathFactory) -> Case:
    path = tmp_path_factory.mktemp("lump") / "lump.toml"
    path.write_text(LUMP, "utf-8")
    return load_case(path)


@pytest.fixture(scope="session")
def lump_result(lump: Case) -> CaseResult:
    state = fastsim_candidate().solve(lump.problem, Strain.GREEN, in_silence)
    return CaseResult(
        name="lump", title="A slab with a lump", verdict=Verdict.PASSED, checks=(),
        problem=lump.problem, candidates=(Judged("fastsim", Verdict.PASSED, Element.LINEAR),),
        states=(state,), case_text=lump.text, units=lump.spec.units,
        provenance={"palpate": "0", "time": "2026-01-01"},
    )  # fmt: skip
