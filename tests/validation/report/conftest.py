"""Judged cases that many tests of the report show."""

from __future__ import annotations

import pytest

from palpate.meshes.problem import Element
from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.case import load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.results import CaseResult
from palpate.validation.report import html


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
