"""Motions with both strain measures are stepped side by side where a candidate can."""

from __future__ import annotations

import dataclasses
import threading
from typing import Any

from palpate.meshes.problem import Problem, Strain
from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.case import load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.states import CandidateFailedError, State

FASTSIM = fastsim_candidate()


def test_both_strain_measures_are_asked_for_before_either_has_answered() -> None:
    meeting = threading.Barrier(2, timeout=60.0)

    def solve(problem: Problem, strain: Strain, say: Any) -> State:
        meeting.wait()  # breaks, and raises, where one is asked after the other
        return FASTSIM.solve(problem, strain, say)

    case = load_case("flight")
    found = judge_case(case, candidate=dataclasses.replace(FASTSIM, solve=solve))
    alone = judge_case(case, candidate=dataclasses.replace(FASTSIM, steps_without_lock=False))
    assert [(c.metric, c.value, c.verdict) for c in found.checks] == [
        (c.metric, c.value, c.verdict) for c in alone.checks
    ]


def test_one_strain_measure_that_fails_leaves_the_other_its_answer() -> None:
    def solve(problem: Problem, strain: Strain, say: Any) -> State:
        if strain is Strain.LINEAR:
            raise CandidateFailedError("it diverged")
        return FASTSIM.solve(problem, strain, say)

    found = judge_case(load_case("flight"), candidate=dataclasses.replace(FASTSIM, solve=solve))
    by_strain = {
        strain: {c.verdict for c in found.checks if c.strain is strain} for strain in Strain
    }
    assert by_strain[Strain.GREEN] == {"passed"}
    assert by_strain[Strain.LINEAR] <= {"failed"}
