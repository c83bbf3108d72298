"""Small cells near tools, judged by the truth that is stored for the case itself."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
from bank import made_state
from judged import case_of, judge, on_same_mesh

from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference import availability
from palpate.validation.candidates.candidate import Candidate, fastsim_candidate
from palpate.validation.case import Case
from palpate.validation.judging.near_tools import _cut
from palpate.validation.judging.results import CaseResult
from palpate.validation.references.stored import MissingReferenceError
from palpate.validation.states import CandidateFailedError, Progress, State, Trajectory, Verdict

SMOOTHED = fastsim_candidate(element=Element.SMOOTHED)
# Between the case's 7.5 mm and the 3.9 mm with which its needs are met, and of fewer cells [m].
EDGE, COARSE = 0.005, 0.007


@cache
def near_tools(edge: float) -> Case:
    return case_of("press").near_tools(edge)


def judged(candidate: Candidate | list[Candidate], edge: float = EDGE) -> CaseResult:
    return judge(near_tools(edge), candidate=candidate)


def of_truth(result: CaseResult) -> dict[str, float]:
    return {
        check.metric: check.value
        for check in result.checks
        if check.against == "truth" and check.value is not None
    }


@pytest.fixture
def without_fenicsx(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(availability, "is_available", lambda: False)


@pytest.mark.usefixtures("without_fenicsx")
def test_the_stored_truth_is_nearer_on_small_cells_than_on_the_case_s() -> None:
    near, plain = judged(SMOOTHED), judge(case_of("press"), candidate=SMOOTHED)
    assert near.name == "press-near-tool"
    # 6.7 and 1.2 % on these cells, 24 and 1.9 % on the case's (write_a_case.md).
    assert of_truth(near)["displacement_l2"] < 0.5 * of_truth(plain)["displacement_l2"]
    assert of_truth(near)["tool_force"] < of_truth(plain)["tool_force"]
    assert any("Solved on 4433 cells" in note for note in near.notes)
    assert any("needs FEniCSx" in note and "smallest_det_f" in note for note in near.notes)
    assert all(check.against != "same_mesh" for check in near.checks)


@pytest.mark.usefixtures("without_fenicsx")
def test_a_wrong_or_failed_result_on_small_cells_is_seen() -> None:
    def softer(problem: Problem, strain: Strain, progress: Progress) -> State:
        wrong = dataclasses.replace(problem.material, poissons_ratio=0.0)
        return SMOOTHED.solve(dataclasses.replace(problem, material=wrong), strain, progress)

    found = of_truth(judged(dataclasses.replace(SMOOTHED, solve=softer)))
    assert found["displacement_l2"] > 0.1
    calls: list[Strain] = []

    def breaks(_problem: Problem, strain: Strain, _progress: Progress) -> State:
        calls.append(strain)
        raise CandidateFailedError("it broke")

    result = judged(dataclasses.replace(SMOOTHED, solve=breaks))
    assert result.verdict is Verdict.FAILED
    assert len(calls) == len(set(calls))


@pytest.mark.usefixtures("without_fenicsx")
def test_a_case_without_a_check_against_the_truth_is_refused_without_fenicsx() -> None:
    case = case_of("press")
    own = tuple(spec for spec in case.checks if spec.against != "truth")
    case = dataclasses.replace(case, spec=case.spec.model_copy(update={"check": own}))
    with pytest.raises(MissingReferenceError, match="FEniCSx"):
        judge(case.near_tools(COARSE), candidate=SMOOTHED)


def test_a_motion_on_small_cells_is_read_at_the_points_of_the_case_s_mesh() -> None:
    mesh, finer = case_of("press").problem.mesh, near_tools(COARSE).problem.mesh
    moves = 1e-3 * np.random.default_rng(7).normal(size=(3, finer.num_points, 3))
    motion = Trajectory(np.arange(3.0), moves)
    cut = _cut(made_state(finer, moves[-1], trajectory=motion), mesh, finer)
    assert cut.trajectory is not None
    assert mesh.num_points < finer.num_points
    assert np.array_equal(cut.displacements, moves[:, : mesh.num_points])
    assert np.array_equal(cut.displacement, moves[-1, : mesh.num_points])


@pytest.mark.dolfinx
@pytest.mark.long
def test_the_same_mesh_is_the_fine_one_and_solved_here() -> None:
    def perturbed(problem: Problem, strain: Strain, progress: Progress) -> State:
        state = SMOOTHED.solve(problem, strain, progress)
        moved = state.displacement.copy()
        # A point that the case's mesh has not.
        moved[-1] += 1e-3 * np.abs(moved).max()
        return dataclasses.replace(state, displacement=moved)

    wrong = dataclasses.replace(SMOOTHED, name="perturbed", solve=perturbed)
    result = judged([SMOOTHED, wrong], COARSE)
    checks = on_same_mesh(result)  # candidate by candidate
    same, of_wrong = checks[: len(checks) // 2], checks[len(checks) // 2 :]
    assert {"displacement_l2", "tool_force", "volume"} <= {check.metric for check in same}
    assert all(check.verdict is Verdict.PASSED for check in same)
    assert not any("needs FEniCSx" in note for note in result.notes)
    assert {c.metric for c in of_wrong if c.verdict is Verdict.FAILED} >= {"displacement_l2"}
