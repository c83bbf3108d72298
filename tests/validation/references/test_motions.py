"""The stored truth of a motion: where its meshes are refined, and what its bars are made of."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from bank import made_state

from palpate.meshes.problem import Problem, Strain, TimeSpan
from palpate.validation.case import load_case
from palpate.validation.metrics import measure
from palpate.validation.references import motions, runs
from palpate.validation.references.motions import rough_cells, solve_motion_truth
from palpate.validation.references.reference_set import QUADRATIC, SAME_MESH, TRUTH
from palpate.validation.references.statics import estimate_bars
from palpate.validation.states import State, Trajectory

SLIDE = load_case("slide")
PROBLEM = SLIDE.problem


def motion(problem: Problem, displacements: np.ndarray, force: float) -> State:  # type: ignore[type-arg]
    times = np.linspace(0.0, 0.4, len(displacements))
    felt = np.zeros((1, len(displacements), 3))
    felt[0, 1:, 2] = force
    way = Trajectory(times, displacements)
    return made_state(problem.mesh, displacements[-1], tool_forces=felt, trajectory=way)


def test_the_cells_where_the_gradient_changes_are_marked() -> None:
    points = PROBLEM.mesh.points
    fold = points[:, 0].mean()
    bent = np.zeros((3, *points.shape))
    bent[2, :, 2] = np.maximum(0.0, points[:, 0] - fold)
    straight = np.zeros_like(bent)
    straight[1:] = points @ np.array([[0.1, 0.2, 0.0], [0.0, 0.1, 0.3], [0.0, 0.0, -0.1]])
    state = motion(PROBLEM, straight + bent, 1.0)
    marked = rough_cells(PROBLEM.mesh, state, 0.7)
    x = points[PROBLEM.mesh.cells, 0]
    size = np.ptp(x, axis=1).max()
    assert 0 < marked.sum() < 0.5 * len(marked)
    # A gradient that changes nowhere marks nothing beyond; rounding aside, all is at the fold.
    assert np.all(np.abs(x[marked] - fold).min(axis=1) < 1.5 * size)


def test_a_bar_has_the_parts_of_mesh_and_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs that err by c h^2 + b dt^2: the truth's distance from the limit is within the bar."""
    reported = []

    def solve_implicit(problem: Problem, strain: Strain, steps: int, _say: object) -> State:
        reported.append((problem.mesh.num_cells, steps))
        level = len({cells for cells, _ in reported if cells < problem.mesh.num_cells})
        error = 0.08 * 0.25**level + 0.02 * 0.25 ** np.log2(steps)
        way = problem.mesh.points[:, [2, 2, 2]] * np.linspace(0.0, 1.0, 41)[:, None, None]
        kinked = way * np.where(problem.mesh.points[:, :1] > 0.03, 1.0, 1.2)
        state = motion(problem, (1.0 + error) * 1e-2 * kinked, 1.0 + error)
        return dataclasses.replace(state, strain=strain)

    monkeypatch.setattr(motions, "solve_implicit", solve_implicit)
    truth, bars, details = solve_motion_truth(PROBLEM, Strain.GREEN, lambda _line: None)
    first, middle, finest = details["cells"]
    long, shorter = [(n, 2) for n in (first, middle, finest)], [(middle, 4), (middle, 8)]
    # The finest mesh takes the shortest step itself.
    assert reported == [*long, *shorter, (finest, 8)]
    assert first == PROBLEM.mesh.num_cells < middle < finest
    assert truth.label == TRUTH
    assert truth.displacement.shape == PROBLEM.mesh.points.shape
    limit = motion(PROBLEM, truth.trajectory.displacements, 1.0)  # type: ignore[union-attr]
    apart = measure("tool_force", PROBLEM, truth, limit).value
    assert apart == pytest.approx(0.08 / 16 + 0.02 / 64, rel=1e-6)
    assert apart <= bars["tool_force"].whole <= 5.0 * apart
    assert bars["tool_force"].time > 0.0
    assert set(details) == {"time", "mesh", "cells", "steps_per_output"}


@pytest.mark.parametrize(("steps", "every"), [(10.0, 10), (10.3, 11)])
def test_outputs_between_steps_become_the_steps(steps: float, every: int) -> None:
    span = TimeSpan(1.0, time_step=1.0 / steps, num_outputs=3)
    freely = dataclasses.replace(PROBLEM, time=span, tools=())
    found = runs.at_every_step(freely).time
    assert found is not None
    assert (found.num_outputs, found.end_time) == (every, pytest.approx(every / steps))


def test_a_live_static_truth_has_a_bar_for_the_force_on_a_tool() -> None:
    problem = load_case("press").problem
    displacement = 0.01 * problem.mesh.points
    states = {
        (label, Strain.GREEN): made_state(
            problem.mesh, displacement, tool_forces=np.array([[0.0, 0.0, force]])
        )
        for label, force in ((SAME_MESH, 1.2), (QUADRATIC, 1.0))
    }
    bars = estimate_bars(problem, states)
    assert bars["tool_force", Strain.GREEN] == pytest.approx(0.2)


def test_bars_that_shrink_with_no_mesh_allow_no_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    forces = iter((1.0, 1.1, 1.3, 1.0, 1.0, 1.0))

    def solve_implicit(problem: Problem, _strain: Strain, _steps: int, _say: object) -> State:
        way = problem.mesh.points * np.linspace(0.0, 1.0, 41)[:, None, None]
        return motion(problem, way * np.abs(problem.mesh.points[:, :1]), next(forces))

    monkeypatch.setattr(motions, "solve_implicit", solve_implicit)
    _, bars, _ = solve_motion_truth(PROBLEM, Strain.GREEN, lambda _line: None)
    assert bars["tool_force"].whole == np.inf


def test_a_body_without_tools_has_its_truth_the_same_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem = load_case("block-motion").problem
    reported = []

    def solve_implicit(finer: Problem, _strain: Strain, steps: int, _say: object) -> State:
        reported.append((finer.mesh.num_cells, steps))
        points = finer.mesh.points
        way = points * np.sin(np.linspace(0.0, 12.0, 51))[:, None, None]
        size = 1.0 + 0.1 / finer.mesh.num_cells + 0.01 / steps**2
        swung = motion(finer, size * way * points[:, :1], 1.0)
        return dataclasses.replace(swung, tool_forces=None)

    monkeypatch.setattr(motions, "solve_implicit", solve_implicit)
    truth, bars, details = solve_motion_truth(problem, Strain.GREEN, lambda _line: None)
    # The finest mesh takes the shortest step itself.
    assert reported[-1] == (details["cells"][-1], 8)
    assert details["cells"] == sorted({cells for cells, _ in reported})
    assert truth.tool_forces is None
    assert truth.displacement.shape == problem.mesh.points.shape
    assert "tool_force" not in bars
    assert 0.0 < bars["trajectory_l2"].whole < 0.01


@pytest.mark.dolfinx
def test_tools_press_where_everything_else_is_balanced() -> None:
    """Elsewhere a tool that slides would push the body by a part of its way in a step."""
    from palpate.reference.schemes import AlphaMethod

    assert AlphaMethod(runs._WITH_TOOLS).alpha_f == 0.0
