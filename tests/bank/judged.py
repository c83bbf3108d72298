"""Built-in cases and their stored references, each loaded once, and states to judge by them."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np
import pytest

from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.candidates.candidate import Candidate, fastsim_candidate
from palpate.validation.case import Case, load_case
from palpate.validation.judging.case_references import find_references
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.results import CaseResult, CheckResult
from palpate.validation.metrics import make_state
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.states import State, Trajectory, Verdict, in_silence

GREEN, LINEAR = Strain.GREEN, Strain.LINEAR


def large_by_night(names: Iterable[str], *large: str) -> list[Any]:
    """Names of built-in cases as parameters of a test, of which large ones run at night alone."""
    night, large = pytest.mark.nightly, large or ("silicone-bar",)
    return [pytest.param(name, marks=night) if name in large else name for name in names]


@cache
def case_of(name: str) -> Case:
    return load_case(name)


@cache
def references_of(name: str) -> ReferenceSet:
    return find_references(case_of(name), live=False, progress=in_silence)


def stored(name: str, label: str, strain: Strain = GREEN) -> State:
    """A stored reference of a built-in case."""
    return references_of(name).states[label, strain]


def state_of(problem: Problem, displacement, strain: Strain = GREEN, **more) -> State:
    """A candidate's state with these displacements [m]: the last one of a motion's."""
    moved = np.asarray(displacement)
    if moved.ndim == 3:
        assert problem.time is not None
        times = np.linspace(0.0, problem.time.end_time, len(moved))
        more, moved = {"trajectory": Trajectory(times, moved)} | more, moved[-1]
    about = {"label": "mine", "simulator": "mine"} | more
    return make_state(problem.mesh, moved, strain=strain, **about)


def solved(problem: Problem, strain: Strain = GREEN, **options) -> State:
    """fastsim's solution."""
    return fastsim_candidate(**options).solve(problem, strain, in_silence)


def sending(make, **options) -> Candidate:
    """A candidate that sends the displacements made of a problem and a strain measure."""

    def solve(problem, strain, _progress):
        return state_of(problem, make(problem, strain), strain, **options)

    return Candidate("mine", solve, element=options.get("element", Element.LINEAR))


def judge(case: Case, **options) -> CaseResult:
    """Verdicts alone: what explains a result that fails is not looked for unless asked."""
    return judge_case(case, **({"diagnoses": False} | options))


def judged_by(references: ReferenceSet, monkeypatch, case: Case, **options) -> CaseResult:
    """A case judged by these references, instead of those that are stored."""
    monkeypatch.setattr(
        "palpate.validation.judging.judge.find_references", lambda *_a, **_k: references
    )
    return judge(case, **options)


def on_same_mesh(result: CaseResult) -> list[CheckResult]:
    return [check for check in result.checks if check.against == "same_mesh"]


def failed(result: CaseResult) -> list[CheckResult]:
    return [check for check in result.checks if check.verdict is Verdict.FAILED]
