"""Case strip asks for no step: other integrators pass it, and their mistakes do not."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest
from judged import case_of, judge

from palpate.validation.candidates.candidate import result_candidate
from palpate.validation.exchange.case_folder import write_case_folder
from palpate.validation.states import Verdict

PROGRAM = Path(__file__).parent / "other_integrators.py"
METHODS = ("euler", "newmark")


def judged(folder: Path, method: str, mistake: str = "none") -> tuple[Verdict, set[str]]:
    """The verdict, and what failed, of the program as run in this process."""
    case = case_of("strip")
    write_case_folder(folder / "case", case.problem, case.strain, name=case.name)
    words = [str(PROGRAM), str(folder / "case"), str(folder / "result.npz"), method, mistake]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", words)
        runpy.run_path(str(PROGRAM))
    result = judge(case, candidate=result_candidate(folder / "result.npz"))
    failed = {check.metric for check in result.checks if check.verdict is Verdict.FAILED}
    return result.verdict, failed


def test_the_case_holds_nobody_to_steps_of_the_reference() -> None:
    case = case_of("strip")
    assert case.problem.time is not None
    assert case.problem.time.time_step is None
    assert {check.against for check in case.checks} == {"truth", "candidate"}


@pytest.mark.parametrize("method", METHODS)
def test_another_integrator_passes(method: str, tmp_path: Path) -> None:
    assert judged(tmp_path, method) == (Verdict.PASSED, set())


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
    method: str, mistake: str, shown_by: str, tmp_path: Path
) -> None:
    """Damping left out; 10 % of density, stiffness or load; lmbda = 0; the load's sign."""
    if (method, mistake) == ("newmark", "pull"):  # which has no equilibrium in a step
        with pytest.raises(SystemExit, match="no equilibrium"):
            judged(tmp_path, method, mistake)
        return
    verdict, failed = judged(tmp_path, method, mistake)
    assert verdict is Verdict.FAILED
    assert shown_by in failed
