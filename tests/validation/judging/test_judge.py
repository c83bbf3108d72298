"""One case after the other or many side by side: the same results, with what made them."""

from __future__ import annotations

import dataclasses
import threading
from typing import Any

import numpy as np
import pytest
from judged import case_of

from palpate.meshes.problem import Problem, Strain
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.validation.candidates.candidate import fastsim_candidate, function_candidate
from palpate.validation.case import load_cases
from palpate.validation.judging.judge import (
    exit_code,
    judge_case,
    judge_cases,
    judge_or_say_why,
)
from palpate.validation.states import CandidateFailedError, State, Verdict
from palpate.validation.versions import version_of


def test_the_provenance_of_a_result_names_versions_and_the_command(monkeypatch) -> None:
    assert version_of("numpy") == np.__version__
    assert version_of("no-such-package") == "sources in place"
    monkeypatch.setattr("sys.argv", ["/usr/bin/palpate", "gate", "confined"])
    provenance = judge_case(case_of("confined")).provenance
    assert provenance["palpate"] == version_of("palpate")
    assert provenance["numpy"] == np.__version__
    assert provenance["command"] == "palpate gate confined"


FASTSIM = fastsim_candidate()


def test_both_strain_measures_are_asked_for_before_either_has_answered() -> None:
    meeting = threading.Barrier(2, timeout=60.0)

    def solve(problem: Problem, strain: Strain, say: Any) -> State:
        meeting.wait()  # breaks, and raises, where one is asked after the other
        return FASTSIM.solve(problem, strain, say)

    case = case_of("flight")
    found = judge_case(case, candidate=dataclasses.replace(FASTSIM, solve=solve))
    alone = judge_case(case, candidate=dataclasses.replace(FASTSIM, steps_without_lock=False))
    assert [(c.metric, c.value, c.verdict) for c in found.checks] == [
        (c.metric, c.value, c.verdict) for c in alone.checks
    ]


def test_one_strain_measure_that_fails_leaves_the_other_its_solution() -> None:
    def solve(problem: Problem, strain: Strain, say: Any) -> State:
        if strain is Strain.LINEAR:
            raise CandidateFailedError("it diverged")
        return FASTSIM.solve(problem, strain, say)

    found = judge_case(case_of("flight"), candidate=dataclasses.replace(FASTSIM, solve=solve))
    by_strain = {
        strain: {c.verdict for c in found.checks if c.strain is strain} for strain in Strain
    }
    assert by_strain[Strain.GREEN] == {"passed"}
    assert by_strain[Strain.LINEAR] <= {"failed"}


@pytest.mark.long
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


def test_a_case_that_cannot_be_judged_says_why_and_leaves_the_others_theirs(write_case) -> None:
    cases = load_cases([str(write_case()), "column"])
    mine, column = judge_cases(cases, [fastsim_candidate()], processes=2)
    assert "no reference is stored" in mine.not_judged
    assert column.checks


def test_a_reference_that_fails_is_inconclusive_and_one_that_is_missing_unusable() -> None:
    for error, code in ((ReferenceFailedError("lost"), 3), (ReferenceUnavailableError("none"), 2)):

        def fails(_case, error=error):
            raise error

        result = judge_or_say_why(fails, case_of("block"), [fastsim_candidate()])
        assert result.verdict is Verdict.INCONCLUSIVE
        assert result.notes == (str(error),)
        assert exit_code([result]) == code


def test_a_simulator_without_a_result_is_judged_before_any_reference_is_solved(
    monkeypatch,
) -> None:
    from palpate.validation.judging import judge

    solved = []

    def find(case, **options):
        solved.append(case.name)
        return find_references(case, **{**options, "live": False})

    find_references = judge.find_references
    monkeypatch.setattr(judge, "find_references", find)
    case = case_of("block")

    def refuses(_problem):
        raise RuntimeError("no gravity")

    result = judge.judge_case(case, live=True, candidate=function_candidate(refuses))
    assert solved == []
    assert result.verdict is Verdict.FAILED
    assert "no gravity" in result.checks[0].message
    # One that has a result is compared.
    still = function_candidate(lambda problem: 0.0 * problem.mesh.points)
    assert judge.judge_case(case, live=True, candidate=still).verdict is Verdict.FAILED
    assert solved == ["block"]
