"""Small cells where tools press: where, how small, and what cannot be refined so."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import palpate
from palpate.fastsim.grading import near_tools
from palpate.fastsim.grading.near_tools import GROWTH, refine_near_tools
from palpate.fastsim.grading.size_fields import TooManyCellsError, mean_edges
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.rigid_tool import ForceDrive, PlaneShape
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.case import load_case


@pytest.fixture(scope="module")
def press() -> Problem:
    return load_case("press").problem


def edges(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Mean edges of cells [m], and their middles' distance from the middle of the contact [m]."""
    middles = problem.mesh.points[problem.mesh.cells].mean(axis=1)
    end = np.array([0.026, 0.018, 0.020])  # below the ball at its end, on the slab's top
    return mean_edges(problem.mesh.points, problem.mesh.cells), np.linalg.norm(
        middles - end, axis=1
    )


def test_cells_are_small_where_the_ball_is_and_grow_away_from_it(press: Problem) -> None:
    fine = refine_near_tools(press, 0.004)
    lengths, away = edges(fine)
    # What is nearer than 4 mm / GROWTH = 8 mm to what is touched has edges of 4 mm.
    assert lengths[away < 0.008].max() <= 0.004 * (1.0 + 1e-9)
    assert (lengths <= np.maximum(0.004, GROWTH * away) * (1.0 + 1e-9)).all()
    assert edges(press)[0].max() > 0.0075
    given = press.mesh.num_points
    np.testing.assert_array_equal(fine.mesh.points[:given], press.mesh.points)
    whole = signed_volumes(fine.mesh.points, fine.mesh.cells).sum()
    assert whole == pytest.approx(press.mesh.volume, rel=1e-12)


def test_edges_follow_from_the_radius_and_the_depth(press: Problem) -> None:
    lengths, away = edges(refine_near_tools(press))
    # Half of (30 mm * 2 mm)^(1/2) = 3.87 mm; the depth is looked up at points of the facets, so
    # that it may be a little less than 2 mm.
    assert 0.0030 < lengths[away < 0.0077].max() <= 0.00388


def test_a_motion_takes_a_step_of_its_own() -> None:
    slide = load_case("slide").problem
    fine = refine_near_tools(slide, 0.006)
    assert slide.time is not None
    assert fine.time == dataclasses.replace(slide.time, time_step=None)
    # Along the whole way, from x = 21 to 27 mm, and not only at its end.
    middles = fine.mesh.points[fine.mesh.cells].mean(axis=1)
    near = (np.abs(middles[:, 1]) < 0.004) & (middles[:, 2] > 0.016)
    for x in (0.021, 0.024, 0.027):
        at = near & (np.abs(middles[:, 0] - x) < 0.003)
        assert mean_edges(fine.mesh.points, fine.mesh.cells[at]).max() <= 0.006 * (1.0 + 1e-9)


def test_what_cannot_be_refined_so_is_refused(
    press: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tool,) = press.tools
    without = dataclasses.replace(press, tools=())
    lifted = np.array(tool.path.positions)
    lifted[:, 2] += 0.1
    away = dataclasses.replace(tool.path, positions=lifted)
    plane = dataclasses.replace(tool, shape=PlaneShape())
    for problem, words in (
        (without, "the problem has none"),
        (dataclasses.replace(press, tools=(dataclasses.replace(tool, path=away),)), "no facet"),
        (dataclasses.replace(press, tools=(plane,)), "no radius|no facet"),
    ):
        with pytest.raises(InputError, match=words):
            refine_near_tools(problem)
    monkeypatch.setattr(near_tools, "MOST_CELLS", 20_000)
    with pytest.raises(TooManyCellsError):
        refine_near_tools(press, 1e-5)
    with pytest.raises(InputError, match="above 0"):
        refine_near_tools(press, 0.0)


def test_a_tool_driven_by_a_force_is_refused_as_nobody_knows_where_it_goes(press: Problem) -> None:
    (tool,) = press.tools
    rising = palpate.TabularAmplitude((0.0, 1.0), (0.0, 1.0))
    drive = ForceDrive((0.0, 0.0, -1.0), 0.1, rising, mass=0.02)
    start = palpate.ToolPath(np.zeros(1), np.array([[0.026, 0.018, 0.05]]))
    driven = dataclasses.replace(tool, drive=drive, path=start)
    with pytest.raises(InputError, match="driven by a force"):
        refine_near_tools(dataclasses.replace(press, tools=(driven,)), 0.005)


@pytest.mark.slow
def test_press_meets_its_needs_with_smoothed_tetrahedra_near_the_tool() -> None:
    case = palpate.load_case("press")
    forces = []

    def at_the_points_of_the_case(problem: Problem) -> np.ndarray:
        fine = palpate.solve(refine_near_tools(problem), element="smoothed")
        assert fine.tool_forces is not None
        forces.append(np.linalg.norm(fine.tool_forces[-1]))
        return fine.displacement[: problem.mesh.num_points]

    result = palpate.judge(case, at_the_points_of_the_case)
    (check,) = [c for c in result.checks if c.metric == "displacement_l2" and c.against == "truth"]
    assert check.verdict == "passed"
    # The truth's force, 0.1493 N (bar 0.28 %), and the case's need of 7 %.
    assert forces[0] == pytest.approx(0.1493, rel=0.07)
