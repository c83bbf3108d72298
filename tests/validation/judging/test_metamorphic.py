"""Relations hold for fastsim, break for the faults that break them, and maps are undone exactly."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.fastsim.statics import solve_static
from palpate.meshes import transforms
from palpate.meshes.problem import Problem, Strain
from palpate.validation.candidates.candidate import Candidate, fastsim_candidate
from palpate.validation.candidates.faults import Fault, with_fault
from palpate.validation.case import Case, load_case
from palpate.validation.judging.metamorphic import LEAST_BROKEN, judge_relations
from palpate.validation.metrics import make_state
from palpate.validation.states import Progress, State


def broken(fault: Fault, name: str = "block") -> set[str]:
    result = judge_relations(
        load_case(name), with_fault(fastsim_candidate(), fault), lambda _line: None
    )
    assert len(result.checks) == 7
    return {check.metric for check in result.checks if check.verdict != "passed"}


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (Fault.NONE, set()),
        # A finite rotation cannot be had with linear strain.
        (Fault.LINEAR_INSTEAD_OF_GREEN, {"rigid turn"}),
        (Fault.MIRRORED, {"turned", "rigid turn", "patch", "patch, diagonals swapped"}),
        (Fault.SHIFTED_NUMBERS, {"renumbered", "rigid turn", "patch", "patch, diagonals swapped"}),
        # What only a reference can tell.
        (Fault.SOFTER, set()),
    ],
)
def test_relations_are_broken_by_what_breaks_them(fault: Fault, expected: set[str]) -> None:
    assert broken(fault) == expected


@pytest.mark.parametrize("name", ["stretch", "confined", "shear", "csm1", "csm2", "cantilever"])
def test_the_benchmarks_keep_them_too(name: str) -> None:
    assert broken(Fault.NONE, name) == set()
    # Held in single components or not: the body is turned, and more is free than held.
    assert "rigid turn" in broken(Fault.LINEAR_INSTEAD_OF_GREEN, name)
    assert "turned" in broken(Fault.MIRRORED, name)


def test_single_components_turn_with_their_axes_or_become_normals() -> None:
    problem = load_case("stretch").problem
    quarter = transforms.rotation((0.0, 0.0, 1.0), 90.0)
    turned, back = transforms.turn(problem, quarter)
    assert [s.components for s in problem.supports][:2] == [
        (True, False, False),
        (False, True, False),
    ]
    assert [s.components for s in turned.supports][:2] == [
        (False, True, False),
        (True, False, False),
    ]
    np.testing.assert_allclose(back(turned.mesh.points), problem.mesh.points, atol=1e-15)
    slanted, back = transforms.turn(problem, transforms.rotation((0.0, 0.0, 1.0), 45.0))
    normals = [s.normal for s in slanted.supports][:2]
    half = np.sqrt(0.5)
    np.testing.assert_allclose(np.array(normals), [[half, half, 0.0], [-half, half, 0.0]])
    straight = solve_static(problem).displacement
    found = back(slanted.mesh.points + solve_static(slanted).displacement) - problem.mesh.points
    assert np.abs(found - straight).max() <= 1e-9 * np.abs(straight).max()


def test_maps_are_undone_and_problems_are_really_changed(
    problem: Problem, answer: NDArray[np.float64]
) -> None:
    matrix = transforms.rotation((1.0, 2.0, 3.0), 50.0)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    for changed, back in (
        transforms.turn(problem, matrix),
        transforms.turn(problem, np.diag([1.0, -1.0, 1.0])),
        transforms.renumber(problem),
        transforms.change_units(problem),
    ):
        assert not np.allclose(changed.mesh.points, problem.mesh.points)
        # Positions go the way displacements go (no shifts here): the map must undo both.
        np.testing.assert_allclose(back(changed.mesh.points), problem.mesh.points, atol=1e-12)
        assert len(changed.loads) == len(problem.loads)
    assert answer.shape == problem.mesh.points.shape


def told_linear(name: str) -> Case:
    case = load_case(name)
    return dataclasses.replace(case, spec=case.spec.model_copy(update={"strain": Strain.LINEAR}))


@pytest.mark.parametrize("name", ["block", "confined", "shear", "press"])
def test_linear_strain_passes_by_breaking_the_turn_that_it_cannot_keep(name: str) -> None:
    result = judge_relations(told_linear(name), fastsim_candidate(), lambda _line: None)
    assert result.verdict == "passed", [check.message for check in result.checks]
    turn = next(check for check in result.checks if check.metric == "rigid turn")
    # Linear strain takes a turn by 40 degrees for a shrinking by 1 - cos 40 = 23 %.
    assert turn.value is not None
    assert turn.value > 0.1
    assert turn.limit == LEAST_BROKEN
    assert "broken, as linear strain must" in turn.message


def test_who_keeps_the_turn_does_not_use_the_linear_strain_it_was_asked_for() -> None:
    honest = fastsim_candidate()

    def solve(problem: Problem, _strain: Strain, progress: Progress) -> State:
        return honest.solve(problem, Strain.GREEN, progress)

    result = judge_relations(told_linear("block"), Candidate("other", solve), lambda _line: None)
    failed = [check for check in result.checks if check.verdict != "passed"]
    assert [check.metric for check in failed] == ["rigid turn"]
    assert "satisfied, so this is not linear strain" in failed[0].message


def test_a_tool_is_told_in_the_other_way_too() -> None:
    assert broken(Fault.NONE, "press") == set()


def test_who_never_moves_is_told_so_by_the_motions_prescribed() -> None:
    def solve(problem: Problem, strain: Strain, _progress: Progress) -> State:
        nothing = np.zeros_like(problem.mesh.points)
        return make_state(
            problem.mesh, nothing, label="none", simulator="none", strain=strain, seconds=0.0
        )

    result = judge_relations(load_case("block"), Candidate("none", solve), lambda _line: None)
    assert result.verdict == "failed"
    failed = {check.metric for check in result.checks if check.verdict == "failed"}
    assert failed == {"rigid turn", "patch", "patch, diagonals swapped"}
