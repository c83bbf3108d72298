"""Relations hold for fastsim, break for the faults that break them, and maps are undone exactly."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.meshes.problem import Problem
from palpate.validation.case import load_case
from palpate.validation.evidence import relations
from palpate.validation.evidence.metamorphic import judge_relations
from palpate.validation.simulators.candidate import fastsim_candidate
from palpate.validation.simulators.faults import Fault


def broken(fault: Fault) -> set[str]:
    result = judge_relations(load_case("block"), fastsim_candidate(fault), lambda _line: None)
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


def test_maps_are_undone_and_problems_are_really_changed(
    problem: Problem, answer: NDArray[np.float64]
) -> None:
    matrix = relations.rotation((1.0, 2.0, 3.0), 50.0)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    for changed, back in (
        relations.turn(problem, matrix),
        relations.turn(problem, np.diag([1.0, -1.0, 1.0])),
        relations.renumber(problem),
        relations.change_units(problem),
    ):
        assert not np.allclose(changed.mesh.points, problem.mesh.points)
        # Positions go the way displacements go (no shifts here): the map must undo both.
        np.testing.assert_allclose(back(changed.mesh.points), problem.mesh.points, atol=1e-12)
        assert len(changed.loads) == len(problem.loads)
    assert answer.shape == problem.mesh.points.shape
