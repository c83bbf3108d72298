"""A pose that is judged is at rest, or is brought to rest, or has no verdict and says why."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.fastsim.explicit_body import ExplicitBody
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Element, Problem, Strain
from palpate.validation.case import load_case
from palpate.validation.live.live_case import LiveCase, Touch, live_case
from palpate.validation.live.pointer import Settling
from palpate.validation.live.poses import PoseOfPane, at_rest
from palpate.validation.live.verdict import SAME_MESH, judge_panes
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.states import Verdict

# Where the ball of the page stops in the kidney that takes no more, from above and aside [mm].
DEEP = np.array([12.125638, -7.466209, 64.50006])


@pytest.fixture(scope="module")
def kidney() -> LiveCase:
    return live_case(load_case("kidney"), Touch(), (Element.LINEAR,))


def pressed(live: LiveCase, strain: Strain, seconds: float) -> tuple[ExplicitBody, Floats]:
    """The kidney with the ball in half a second pressed deep into it, and the force [N] since."""
    body = ExplicitBody(live.problem, strain=strain)
    begin, end, clock = live.metres(live.start), live.metres(DEEP), live.clock
    moving = round(0.5 / clock.tick)
    forces = []
    for tick in range(round((0.5 + seconds) / clock.tick)):
        body.move_tool(0, begin + min((tick + 1) / moving, 1.0) * (end - begin))
        body.step(clock.steps)
        forces.append(body.take_tool_records()[0]["impulse"] / clock.tick)
    return body, np.linalg.norm(forces, axis=1)


def held(live: LiveCase) -> Problem:
    """The same as a static problem: the ball comes from outside and stays."""
    data = live.with_path([live.start, DEEP])
    data.pop("time")
    from palpate.validation.live.live_case import problem_of

    return problem_of(live.case, data)


def as_pose(strain: Strain, moved: Points, force: float = 0.0) -> PoseOfPane:
    up = np.array([0.0, 0.0, force])
    return PoseOfPane(strain.value, strain, Element.LINEAR, moved.copy(), up, math.inf)


@pytest.mark.parametrize("strain", list(Strain))
def test_a_ball_pressed_deep_does_not_make_a_body_chatter(kidney: LiveCase, strain: Strain) -> None:
    """Vertices that slip to and fro on the ball come to rest; the force was 0.698 to 0.750 N."""
    _, forces = pressed(kidney, strain, 8.0)
    last = forces[-round(1.0 / kidney.clock.tick) :]
    assert np.ptp(last) < 1e-4 * last.mean()


@pytest.mark.parametrize("strain", list(Strain))
def test_a_pose_that_still_moves_is_brought_to_rest(kidney: LiveCase, strain: Strain) -> None:
    problem = held(kidney)
    moving, _ = pressed(kidney, strain, 0.1)
    resting, forces = pressed(kidney, strain, 8.0)
    size = np.abs(resting.displacement).max()
    assert np.abs(moving.displacement - resting.displacement).max() > 1e-3 * size
    pose, done = at_rest(problem, as_pose(strain, moving.displacement), lambda _: None)
    assert "brought to rest" in done
    assert np.abs(pose.displacement - resting.displacement).max() < 1e-4 * size
    assert np.linalg.norm(pose.force) == pytest.approx(forces[-1], rel=1e-3)
    # What rests already stays as it is.
    assert at_rest(problem, pose, lambda _: None) == (pose, "")


def test_a_pose_without_equilibrium_is_inconclusive_with_the_reason(kidney: LiveCase) -> None:
    """As it is when the ball has crushed cells that it reaches."""
    problem, case = held(kidney), kidney.case
    moved = 4.0 * pressed(kidney, Strain.LINEAR, 0.1)[0].displacement
    pose, done = at_rest(problem, as_pose(Strain.GREEN, moved), lambda _: None)
    assert pose.why
    assert pose.why in done
    (found,) = judge_panes(SAME_MESH, case, [pose], ReferenceSet({}, {}, "", {}))
    assert found.verdict is Verdict.INCONCLUSIVE
    assert found.checks == [pose.why]
    assert np.isnan(found.error).all()


def test_what_is_left_of_the_motion_is_said_of_each_body() -> None:
    """One swings on, the other rests; more than all of it is not said to be to go."""
    settling, swing = Settling(0.01), 0
    while not settling.is_over:
        swing += 1
        settling.note([np.full((2, 3), 1e-3), np.full((2, 3), 1e-3 * math.sin(0.9 * swing))])
    assert settling.each_to_go[0] == 0.0
    assert settling.each_to_go[1] > 1e-3
    assert "the static solver goes on from here" in settling.says
    assert not settling.rests
    settling.each_to_go = np.array([0.0, 1.341])
    assert "134" not in settling.says
    assert "does not die away" in settling.says
