"""A NaN or a number too large to measure fails every metric, wherever in a solution it stands."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from bank import made_state

from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.validation.case.schema import CheckSpec
from palpate.validation.case.units import Units
from palpate.validation.judging.checks import judge_check, number_of
from palpate.validation.metrics import CATALOGUE, Difference, balance
from palpate.validation.metrics.difference import are_measurable, largest, smallest
from palpate.validation.metrics.grid_convergence import assess_grid_convergence
from palpate.validation.states import State, Trajectory, Verdict

MESH = brick_box((2, 1, 1), (2.0, 1.0, 1.0))
HELD = np.flatnonzero(MESH.points[:, 0] == 0.0).astype(np.int32)
PROBLEM = Problem(
    MESH,
    Material(1000.0, 0.3),
    (Support(HELD),),
    (Traction(MESH.boundary_facets[:1], (1.0, 0.0, 0.0)),),
    TimeSpan(2.0, num_outputs=40),
)
TIMES = np.linspace(0.0, 2.0, 41)
END = int(np.argmax(MESH.points.sum(axis=1)))
# Those of an impact have states of their own in test_balance.py.
METRICS = {name: m for name, m in CATALOGUE.items() if m.unfit is not balance.unfit}


def swinging(number: float | None = None, states: slice = slice(None)) -> State:
    """A swing of the free end, with one number put in at its corner in some states."""
    shape = np.zeros_like(MESH.points)
    shape[:, 1] = MESH.points[:, 0] ** 2
    shape[:, 0] = 0.3 * MESH.points[:, 0]
    fields = 0.05 * np.cos(2.0 * math.pi * TIMES)[:, None, None] * shape
    forces = np.ones((1, 41, 3))
    if number is not None:
        fields[states, END, 1] = number
        forces[0, 5, 1] = number
    motion = Trajectory(TIMES, fields)
    return made_state(MESH, fields[-1], trajectory=motion, tool_forces=forces)


def verdict_of(name: str, candidate: State) -> Verdict:
    metric = CATALOGUE[name]
    reported = {"metric": name, "limit": 0.9, "reason": "r"}
    right = {
        "at": list(MESH.points[END]),
        "component": metric.components[1] if metric.components else "",
        "quantity": "amplitude",
        "support": 1,
        "tool": 1,
        "region": {"half_space": {"point": (0.0, 0.0, 0.0), "normal": (1.0, 0.0, 0.0)}},
        "expected": 0.2,
    }
    if metric.is_of_surface:
        reported["support"] = 1
    elif metric.of_part is not None:
        reported["region"] = right["region"]
    elif not metric.is_of_whole:
        reported["against"] = "candidate"
    if name in ("inverted_cells", "smallest_det_f"):
        reported["limit"] = 0.0
    if metric.is_published:
        reported |= {key: right[key] for key in metric.asks} | {"limit": 0.1}
    spec = CheckSpec.model_validate(reported)
    problem = PROBLEM
    if metric.needs_tools:
        # Down, then along x: output 5, where the number is, is of the slide.
        away = ToolPath([0.0, 0.1, 2.0], [[0.0, 9.0, 0.1], [0.0, 9.0, 0.0], [1.0, 9.0, 0.0]])
        problem = dataclasses.replace(PROBLEM, tools=(RigidTool(SphereShape(1.0), away),))
    if metric.read is not None:
        number = number_of(spec, problem, swinging(), Units())
        assert number is not None
        spec = spec.model_copy(update={"expected": number.value})
    check = judge_check(spec, Strain.GREEN, problem, candidate, swinging(), 0.0, "")
    assert check.value is None or math.isfinite(check.value)
    return check.verdict


@pytest.mark.parametrize("name", METRICS)
def test_every_metric_passes_the_right_solution_and_fails_nan_and_what_cannot_be_measured(
    name: str,
) -> None:
    assert verdict_of(name, swinging()) is Verdict.PASSED
    for number in (math.nan, math.inf, -math.inf, 1e308, -1e308):
        assert verdict_of(name, swinging(number)) is Verdict.FAILED, number


@pytest.mark.parametrize(
    "name", [n for n, m in METRICS.items() if m.is_compared or m.is_own or m.is_fitted]
)
def test_a_single_state_that_is_no_number_fails_every_metric_that_sees_the_motion(
    name: str,
) -> None:
    for number in (math.nan, 1e308):
        assert verdict_of(name, swinging(number, slice(20, 21))) is Verdict.FAILED, number


def test_what_cannot_be_measured_is_never_nan_in_a_state() -> None:
    for number in (math.nan, 1e308):
        state = swinging(number)
        assert state.volume == math.inf
        assert state.surface_area == math.inf
        assert state.max_displacement == math.inf
        assert state.smallest_det_f == -math.inf


def test_a_difference_never_holds_nan() -> None:
    for value, scale in ((math.nan, 1.0), (0.0, math.nan), (0.0, math.inf), (-math.inf, 1.0)):
        assert Difference(value, scale, "x").value == math.inf
    for uncertainty in (math.nan, -1.0):
        assert Difference(0.1, 1.0, "x", uncertainty).uncertainty == math.inf
    kept = Difference(0.1, 2.0, "x", 0.3)
    assert (kept.value, kept.scale, kept.uncertainty) == (0.1, 2.0, 0.3)


def test_the_largest_and_the_smallest_of_numbers_show_a_nan_wherever_it_stands() -> None:
    for values in ([math.nan, 1.0, 2.0], [1.0, math.nan, 2.0], [1.0, 2.0, math.nan]):
        assert largest(values) == math.inf
        assert smallest(values) == -math.inf
    assert largest([-3.0, -2.0]) == -2.0
    assert smallest([3.0, 2.0]) == 2.0
    assert (largest([]), smallest([])) == (0.0, 0.0)
    assert are_measurable(np.array([1e99]), np.zeros(0))
    assert not are_measurable(np.zeros(3), np.array([0.0, 1e101]))


def test_the_noise_of_a_sequence_that_is_no_number_leaves_no_error_bar_to_believe() -> None:
    found = assess_grid_convergence(
        [1.0, 1.1, 1.5], (1.0, 2.0, 4.0), expected_order=2.0, noise=1e-6
    )
    assert found.error_bar is not None
    with pytest.raises(ValueError, match="noise"):
        assess_grid_convergence(
            [1.0, 1.1, 1.5], (1.0, 2.0, 4.0), expected_order=2.0, noise=math.nan
        )


def test_a_candidate_that_was_read_in_two_ways_is_as_uncertain_as_they_are_apart() -> None:
    state = swinging()
    # 3 % larger everywhere: of every state, so of the largest too.
    assert state.trajectory is not None
    motion = Trajectory(TIMES, 1.03 * state.trajectory.displacements)
    larger = made_state(MESH, 1.03 * state.displacement, trajectory=motion)
    both = dataclasses.replace(state, other_reading=larger)
    for name in ("trajectory_l2", "displacement_l2", "displacement_max", "displacement_h1"):
        spec = CheckSpec(metric=name, limit=0.02, reason="r")
        check = judge_check(spec, Strain.GREEN, PROBLEM, both, state, 0.0, "")
        assert check.value == 0.0
        assert check.reference_error == pytest.approx(0.03, rel=1e-9)
        assert check.verdict is Verdict.INCONCLUSIVE
