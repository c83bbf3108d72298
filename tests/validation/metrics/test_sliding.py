"""Ripple and false lateral force, of forces made by hand."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from bank import made_state

from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, TimeSpan
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.validation.metrics import CATALOGUE, measure
from palpate.validation.metrics.difference import Difference
from palpate.validation.metrics.sliding import slides, unfit
from palpate.validation.references.motions import assess_sequence
from palpate.validation.states import State, Trajectory

MESH = brick_box((2, 1, 1), (2.0, 1.0, 1.0))
# Down by 0.1 until 2 s, then 0.4 along x until 6 s: outputs 3 to 6 end intervals of the slide.
DOWN_AND_ALONG = [[0.5, 0.5, 2.0], [0.5, 0.5, 1.9], [0.9, 0.5, 1.9]]
PROBLEM = Problem(
    MESH,
    Material(1000.0, 0.3),
    (),
    (),
    TimeSpan(6.0, num_outputs=6),
    tools=(RigidTool(SphereShape(1.0), ToolPath([0.0, 2.0, 6.0], DOWN_AND_ALONG)),),
)
# Whatever the press does is not looked at.
PRESS = [[0.0, 0.0, 0.0], [9.0, 0.0, 1.0], [9.0, 0.0, 3.0]]


def felt(slide: list[list[float]]) -> State:
    """A state with forces over the slide."""
    still = np.zeros((7, *MESH.points.shape))
    still[:, 0, 2] = -0.1
    motion = Trajectory(np.linspace(0.0, 6.0, 7), still)
    return made_state(MESH, still[-1], trajectory=motion, tool_forces=np.array([PRESS + slide]))


def error(metric: str, ours: State, theirs: State, problem: Problem = PROBLEM) -> Difference:
    return measure(metric, problem, ours, theirs)


EVEN = felt([[0.0, 0.3, 4.0]] * 4)


def test_a_slide_is_what_follows_the_press_at_right_angles() -> None:
    (slide,) = slides(PROBLEM)
    assert slide.outputs.tolist() == [3, 4, 5, 6]
    assert slide.outward == pytest.approx([0.0, 0.0, 1.0])
    assert slide.ways == pytest.approx(np.tile([1.0, 0.0, 0.0], (4, 1)))
    assert unfit(PROBLEM) == ""


def test_ripple_is_range_over_mean() -> None:
    # Mean 4, largest 4.4, smallest 3.7: 0.7 / 4.
    waves = felt([[0.0, 0.3, z] for z in (4.1, 3.7, 4.4, 3.8)])
    found = error("force_ripple", waves, EVEN)
    assert found.value == pytest.approx(0.7 / 4.0)
    assert found.scale == pytest.approx(4.0)
    # A quarter less throughout is an error of the force and no ripple.
    low = felt([[0.0, 0.3, 0.75 * z] for z in (4.1, 3.7, 4.4, 3.8)])
    assert error("force_ripple", low, EVEN).value == pytest.approx(0.7 / 4.0)
    assert error("force_ripple", felt([[0.0, 0.3, 3.0]] * 4), EVEN).value == pytest.approx(0.0)


def test_what_the_body_itself_does_to_the_force_does_not_count() -> None:
    rising = [[0.1 * k, 0.0, 4.0 + k] for k in range(4)]
    assert error("force_ripple", felt(rising), felt(rising)).value == 0.0
    assert error("false_lateral_force", felt(rising), felt(rising)).value == 0.0
    # Mean 5.5 on both sides, errors 1.5, 0.5, -0.5, -1.5: a range of 3.
    assert error("force_ripple", felt([[0.0, 0.0, 5.5]] * 4), felt(rising)).value == pytest.approx(
        3.0 / 5.5
    )


def test_lateral_force_is_along_the_way() -> None:
    # -0.2 of 4 along x; forces across the way do not count.
    held_back = felt([[0.1, 0.9, 4.0], [-0.2, 0.3, 4.0], [0.0, 0.3, 4.0], [0.0, 0.3, 4.0]])
    assert error("false_lateral_force", held_back, EVEN).value == pytest.approx(0.2 / 4.0)
    # Half of all forces is the same part of the mean.
    half = dataclasses.replace(held_back, tool_forces=0.5 * np.array(held_back.tool_forces))
    assert error("false_lateral_force", half, EVEN).value == pytest.approx(0.2 / 4.0)


def test_bars_of_what_settles_slowly_are_three_times_its_range() -> None:
    def bars(*sizes: float) -> list[float | None]:
        runs = [
            felt([[s, 0.0, 4.0 + s], [0.0, 0.0, 4.0 - s], *[[0.0, 0.0, 4.0]] * 2]) for s in sizes
        ]
        found = assess_sequence(PROBLEM, runs)
        return [found[name].error_bar for name in ("force_ripple", "false_lateral_force")]

    # As of every norm of a difference: ranges of 2 s of a mean of 4, forces of s along the way.
    assert bars(0.0, 2e-3, 4.2e-3) == pytest.approx([3.0 * 2.1e-3, 3.0 * 1.05e-3], rel=0.01)
    assert bars(0.0, 2e-3, 3e-3) == [None, None]


@pytest.mark.parametrize("metric", ["force_ripple", "false_lateral_force"])
def test_a_force_that_is_not_there_or_pulls_fails(metric: str) -> None:
    none = dataclasses.replace(EVEN, tool_forces=None)
    last = dataclasses.replace(EVEN, tool_forces=np.array([[0.0, 0.0, 4.0]]))
    short = dataclasses.replace(EVEN, tool_forces=np.array(EVEN.tool_forces)[:, 1:])
    for wrong in (none, last, short, felt([[0.0, 0.0, 0.0]] * 4), felt([[0.0, 0.0, -4.0]] * 4)):
        assert error(metric, wrong, EVEN).value == math.inf
    bad = felt([[0.0, 0.3, 4.0]] * 3 + [[math.nan, 0.3, math.nan]])
    assert error(metric, bad, EVEN).value == math.inf
    # Nor is a reference that pulls, or has no force, met by anything.
    for wrong in (none, felt([[0.0, 0.0, -4.0]] * 4)):
        assert error(metric, EVEN, wrong).value == math.inf
        assert error(metric, wrong, wrong).value == math.inf


def test_two_tools_have_the_worst_of_both() -> None:
    problem = dataclasses.replace(PROBLEM, tools=PROBLEM.tools * 2)
    waves = felt([[0.0, 0.3, z] for z in (4.1, 3.7, 4.4, 3.8)])
    even, one = np.array(EVEN.tool_forces), np.array(waves.tool_forces)
    both = dataclasses.replace(EVEN, tool_forces=np.concatenate([even, one]))
    theirs = dataclasses.replace(EVEN, tool_forces=np.concatenate([even, even]))
    assert error("force_ripple", both, theirs, problem).value == pytest.approx(0.7 / 4.0)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_a_force_of_fewer_tools_than_there_are_fails(count: int) -> None:
    still = RigidTool(SphereShape(1.0), ToolPath([0.0], [DOWN_AND_ALONG[0]]))
    problem = dataclasses.replace(PROBLEM, tools=(still, still, *PROBLEM.tools))
    whole = np.repeat(np.array(EVEN.tool_forces), 3, axis=0)
    theirs = dataclasses.replace(EVEN, tool_forces=whole)
    assert error("force_ripple", theirs, theirs, problem).value == 0.0
    fewer = dataclasses.replace(EVEN, tool_forces=whole[:count])
    assert error("force_ripple", fewer, theirs, problem).value == math.inf


@pytest.mark.parametrize(
    "path",
    [
        ToolPath([0.0], [DOWN_AND_ALONG[0]]),
        ToolPath([0.0, 6.0], DOWN_AND_ALONG[:2]),
        # Deeper by 0.1 on a way of 0.4.
        ToolPath([0.0, 2.0, 6.0], [*DOWN_AND_ALONG[:2], [0.9, 0.5, 1.8]]),
        # Over two outputs only.
        ToolPath([0.0, 4.0, 6.0], DOWN_AND_ALONG),
    ],
)
def test_a_tool_that_does_not_slide_is_refused(path: ToolPath) -> None:
    problem = dataclasses.replace(PROBLEM, tools=(RigidTool(SphereShape(1.0), path),))
    assert not CATALOGUE["force_ripple"].fits(problem)
    assert CATALOGUE["tool_force"].fits(problem)
    for metric in ("force_ripple", "false_lateral_force"):
        with pytest.raises(InputError, match="slides at right angles"):
            error(metric, EVEN, EVEN, problem)
