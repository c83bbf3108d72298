"""Case strip asks for no step: other integrators pass it, and their mistakes do not."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from judged import judge

from palpate.validation.candidates.candidate import outside_candidate
from palpate.validation.candidates.outside import OutsideSimulator
from palpate.validation.case import load_case
from palpate.validation.states import Verdict

PROGRAM = Path(__file__).parent / "other_integrators.py"
METHODS = ("euler", "newmark")


def judged(method: str, mistake: str = "none") -> tuple[Verdict, set[str]]:
    """The verdict, and what failed."""
    command = f"{sys.executable} {PROGRAM} {{case}} {{result}} {method} {mistake}"
    result = judge(load_case("strip"), candidate=outside_candidate(OutsideSimulator(command, 300)))
    failed = {check.metric for check in result.checks if check.verdict is Verdict.FAILED}
    return result.verdict, failed


def test_the_case_holds_nobody_to_steps_of_the_reference() -> None:
    case = load_case("strip")
    assert case.problem.time is not None
    assert case.problem.time.time_step is None
    assert {check.against for check in case.checks} == {"truth", "candidate"}


@pytest.mark.parametrize("method", METHODS)
def test_another_integrator_passes(method: str) -> None:
    assert judged(method) == (Verdict.PASSED, set())


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("mistake", "shown_by"),
    [
        ("damping", "oscillation_damping"),
        ("density", "oscillation_frequency"),
        ("stiffness", "oscillation_frequency"),
        ("load", "oscillation_mean"),
        ("law", "oscillation_frequency"),
        ("pull", "trajectory_l2"),
    ],
)
def test_a_mistake_beside_another_integrator_fails(
    method: str, mistake: str, shown_by: str
) -> None:
    """Damping left out; 10 % of density, stiffness or load; lmbda = 0; the load's sign."""
    verdict, failed = judged(method, mistake)
    assert verdict is Verdict.FAILED
    assert shown_by in failed
