"""A result never chooses its own equations: what it states is compared with what was asked.

The case and the caller say by which scheme, step, element, law, precision and contact a result is
judged; a result that states others fails, with words, and is judged by what was asked all the same.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from judged import GREEN, case_of, failed, judged_by, on_same_mesh, references_of, state_of, stored
from numpy.typing import ArrayLike

from palpate.meshes.problem import Strain
from palpate.reference.schemes import Integrator, Steps
from palpate.validation.candidates.candidate import result_candidate
from palpate.validation.case import Case, load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.results import CaseResult, CheckResult
from palpate.validation.references import runs
from palpate.validation.references.reference_set import SAME_MESH, SMOOTHED, ReferenceSet
from palpate.validation.references.runs import solve_by_steps
from palpate.validation.states import State, Verdict, in_silence

STATED = "stated_equations"
COARSE = 0.02


@pytest.fixture
def case(let_go: Path) -> Case:
    """A bar let go, with outputs 40 of its steps apart, and a check on the same mesh alone."""
    text = let_go.read_text("utf-8").replace("num_outputs = 5", "num_outputs = 4")
    let_go.write_text(text.replace("end_time = 0.04", "end_time = 0.08"), "utf-8")
    return load_case(let_go)


def sent(folder: Path, displacement: ArrayLike, **about: Any) -> Path:
    """A result file; of a motion its states are at even times to the end."""
    moved = np.asarray(displacement)
    times = {} if moved.ndim == 2 else {"times": np.linspace(0.0, 0.08, len(moved))}
    np.savez(folder / "theirs.npz", displacement=moved, about=json.dumps(about), **times)
    return folder / "theirs.npz"


def solved(case: Case, steps: Steps | None = None) -> State:
    """The reference on the case's mesh, by the case's steps or these."""
    return solve_by_steps(case.problem, Strain.GREEN, steps, in_silence)


def known(case: Case, moved: np.ndarray) -> ReferenceSet:
    """A reference of the bar's motion, as if it were stored."""
    state = state_of(case.problem, moved, label=SAME_MESH, simulator="reference")
    return ReferenceSet({(SAME_MESH, GREEN): state}, {}, "known")


def swing(case: Case, size: float = 1.0) -> np.ndarray:
    """A motion of the bar: its points sink as x^2 and the square of the time."""
    points = case.problem.mesh.points
    sinks = np.zeros_like(points)
    sinks[:, 2] = -size * points[:, 0] ** 2
    return (np.linspace(0.0, 1.0, 5) ** 2)[:, None, None] * sinks


def stated(result: CaseResult) -> list[CheckResult]:
    return [check for check in result.checks if check.metric == STATED]


# --------------------------------------------------------- what used to pass, or to be inconclusive
@pytest.mark.dolfinx
def test_stating_coarse_steps_does_not_make_another_motion_right(case: Case) -> None:
    coarse = Steps(Integrator.BACKWARD_EULER, COARSE)
    own, other = solved(case), solved(case, coarse)
    apart = np.linalg.norm(own.displacements - other.displacements, axis=(1, 2)).max()
    assert apart > 0.3 * np.linalg.norm(own.displacements, axis=(1, 2)).max()
    path = sent(
        case.path.parent, other.displacements, integrator="backward-euler", time_step=COARSE
    )
    result = judge_case(case, live=True, candidate=result_candidate(path))
    assert result.verdict is Verdict.FAILED
    (check,) = on_same_mesh(result)
    assert check.verdict is Verdict.FAILED
    assert check.value is not None
    assert check.value > 0.3


def test_half_the_motion_fails_whatever_step_it_states(case: Case, monkeypatch: Any) -> None:
    # 0.01 s is far beyond the stable step: a reference by central differences blows up.
    path = sent(
        case.path.parent, 0.5 * swing(case), integrator="central-differences", time_step=0.01
    )
    result = judged_by(
        known(case, swing(case)), monkeypatch, case, candidate=result_candidate(path)
    )
    assert result.verdict is Verdict.FAILED
    assert on_same_mesh(result)[0].verdict is Verdict.FAILED


def test_nothing_moved_fails_whatever_element_it_states(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    references = references_of("block")
    states = {key: state for key, state in references.states.items() if key[0] != SMOOTHED}
    without = dataclasses.replace(references, states=states)
    path = sent(tmp_path, 0.0 * stored("block", SAME_MESH).displacement, element="smoothed")
    given = result_candidate(path)
    result = judged_by(without, monkeypatch, case_of("block"), candidate=given, diagnoses=False)
    for check in on_same_mesh(result):
        if check.strain is GREEN:
            assert check.verdict is Verdict.FAILED, check.name


def test_no_reference_is_stepped_because_a_result_says_so(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_args: Any, **_more: Any) -> State:
        raise AssertionError("5e7 steps of the reference, past every time limit")

    monkeypatch.setattr(runs, "solve_by_steps", never)
    path = sent(case.path.parent, swing(case), integrator="central-differences", time_step=1e-8)
    result = judged_by(
        known(case, swing(case)), monkeypatch, case, candidate=result_candidate(path)
    )
    assert [check.metric for check in failed(result)] == [STATED]
