"""Relations hold for fastsim, break for the faults that break them, and maps are undone exactly."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from judged import GREEN, LINEAR, case_of, sending, solved

from palpate.fastsim.statics import solve_static
from palpate.meshes import transforms
from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.candidates.faults import Fault, with_fault
from palpate.validation.judging.metamorphic import LEAST_BROKEN, judge_relations
from palpate.validation.states import in_silence

PRESCRIBED = {"rigid turn", "patch", "patch, diagonals swapped"}


def judged(name, candidate=None, *, is_linear=False):
    case = case_of(name)
    if is_linear:
        case = dataclasses.replace(case, spec=case.spec.model_copy(update={"strain": LINEAR}))
    return judge_relations(case, candidate or fastsim_candidate(), in_silence)


def broken(result):
    assert len(result.checks) == 7
    return {check.metric for check in result.checks if check.verdict != "passed"}


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        # A finite rotation cannot be had with linear strain.
        (Fault.LINEAR_INSTEAD_OF_GREEN, {"rigid turn"}),
        (Fault.MIRRORED, {"turned", *PRESCRIBED}),
        (Fault.SHIFTED_NUMBERS, {"renumbered", *PRESCRIBED}),
        # What only a reference can show.
        (Fault.SOFTER, set()),
    ],
)
def test_relations_are_broken_by_what_breaks_them(fault, expected):
    assert broken(judged("block", with_fault(fastsim_candidate(), fault))) == expected


@pytest.mark.parametrize(
    "name", ["block", "stretch", "confined", "shear", "csm1", "csm2", "cantilever", "press"]
)
def test_fastsim_satisfies_them_and_faults_do_not(name):
    assert broken(judged(name)) == set()
    if name == "press":
        return
    # Fixed in single components or not: the body is turned, and more is free than fixed.
    for fault, relation in (
        (Fault.LINEAR_INSTEAD_OF_GREEN, "rigid turn"),
        (Fault.MIRRORED, "turned"),
    ):
        assert relation in broken(judged(name, with_fault(fastsim_candidate(), fault)))


def test_single_components_turn_with_their_axes_or_become_normals():
    problem = case_of("stretch").problem

    def turned_by(angle_deg):
        return transforms.turn(problem, transforms.rotation((0.0, 0.0, 1.0), angle_deg))

    turned, back = turned_by(90.0)
    x, y = (True, False, False), (False, True, False)
    assert [s.components for s in problem.supports][:2] == [x, y]
    assert [s.components for s in turned.supports][:2] == [y, x]
    np.testing.assert_allclose(back(turned.mesh.points), problem.mesh.points, atol=1e-15)
    slanted, back = turned_by(45.0)
    half = np.sqrt(0.5)
    normals = np.array([s.normal for s in slanted.supports][:2])
    np.testing.assert_allclose(normals, [[half, half, 0.0], [-half, half, 0.0]])
    straight = solve_static(problem).displacement
    found = back(slanted.mesh.points + solve_static(slanted).displacement) - problem.mesh.points
    assert np.abs(found - straight).max() <= 1e-9 * np.abs(straight).max()


def test_maps_are_undone_and_problems_are_really_changed(problem):
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


@pytest.mark.parametrize("name", ["block", "confined", "shear", "press"])
def test_linear_strain_passes_by_breaking_the_turn_that_it_cannot_satisfy(name):
    result = judged(name, is_linear=True)
    assert result.verdict == "passed", [check.message for check in result.checks]
    turn = next(check for check in result.checks if check.metric == "rigid turn")
    # Linear strain takes a turn by 40 degrees for a shrinking by 1 - cos 40 = 23 %.
    assert turn.value > 0.1
    assert turn.limit == LEAST_BROKEN
    assert "broken, as linear strain must" in turn.message


def test_who_satisfies_the_turn_does_not_use_the_linear_strain_it_was_asked_for():
    other = sending(lambda problem, _strain: solved(problem, GREEN).displacement)
    result = judged("block", other, is_linear=True)
    assert broken(result) == {"rigid turn"}
    assert any("satisfied, so this is not linear" in check.message for check in result.checks)


def test_who_never_moves_fails_the_motions_that_are_prescribed():
    result = judged("block", sending(lambda problem, _strain: np.zeros_like(problem.mesh.points)))
    assert result.verdict == "failed"
    assert broken(result) == PRESCRIBED
