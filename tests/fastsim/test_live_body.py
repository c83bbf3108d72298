"""A body that a controller drives: tools, springs, what is read, what is recorded."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.fastsim.contact.errors import ToolTooFastError
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.errors import SpringTooStiffError, UnstableStepError
from palpate.fastsim.live_body import LiveBody
from palpate.fastsim.springs import PatchSprings
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import BoxShape, RigidTool, SphereShape, ToolPath
from palpate.meshes.spring import AnchorPath, Spring

TOP = (0.02, 0.015, 0.02)
DAMPED = TimeSpan(1.0, None, mass_damping=60.0)


def block(*, tools: bool = True) -> Problem:
    mesh = brick_box((4, 3, 2), (0.04, 0.03, 0.02), ragged=0.1)
    low = side(mesh, 2, 0.0)
    places = (
        (SphereShape(0.012), (0.02, 0.015, 0.033)),
        (BoxShape((0.01, 0.02, 0.01)), (0.055, 0.015, 0.01)),
    )
    probes = tuple(
        RigidTool(shape, ToolPath(np.zeros(1), np.array([place]))) for shape, place in places
    )
    return Problem(
        mesh,
        Material(1e4, 0.3),
        (Support(np.unique(low), low),),
        (),
        time=DAMPED,
        tools=probes if tools else (),
    )


def test_a_hand_pulls_as_in_statics() -> None:
    problem = block(tools=False)
    body = LiveBody(problem)
    hand = body.hold(TOP, radius=0.012, stiffness=30.0)
    assert hand.anchor == pytest.approx(TOP)
    hand.move_to(np.add(TOP, [0.002, 0.0, 0.005]))
    for _ in range(5):
        body.step(round(0.1 / body.time_step))
    path = AnchorPath([0.0], [[0.002, 0.0, 0.005]])
    spring = Spring.on(problem.mesh, TOP, 0.012, 30.0, path)
    still = Problem(problem.mesh, problem.material, problem.supports, (), springs=(spring,))
    found = solve_static(still).displacement
    pulled = PatchSprings(problem.mesh.points, (spring,)).resultants(
        found, path.displacements, np.ones(1)
    )[0]
    assert hand.force == pytest.approx(-pulled, rel=1e-4)
    assert hand.force[2] < -0.01
    assert body.displacement == pytest.approx(found, abs=1e-4 * np.abs(found).max())
    hand.let_go()
    assert not hand.is_attached
    for _ in range(5):
        body.step(round(0.1 / body.time_step))
    assert np.abs(body.displacement).max() < 1e-3 * np.abs(found).max()
    with pytest.raises(InputError, match="was let go"):
        hand.move_to(TOP)


def test_taking_hold_of_a_moved_body_pulls_with_no_force_in_all() -> None:
    body = LiveBody(block(tools=False))
    first = body.hold(TOP, radius=0.012, stiffness=30.0)
    first.move_to(np.add(TOP, [0.002, 0.0, 0.005]))
    body.step(300)
    second = body.hold((0.03, 0.015, 0.02), radius=0.012, stiffness=30.0)
    assert np.linalg.norm(first.force) > 0.01
    assert np.linalg.norm(second.force) < 1e-9 * np.linalg.norm(first.force)
    with pytest.raises(SpringTooStiffError, match="use at most") as found:
        body.hold(TOP, radius=0.012, stiffness=1e6)
    allowed = 0.99 * found.value.largest_stiffness
    body.hold(TOP, radius=0.012, stiffness=allowed)
    body.step(200)


def test_arrays_are_the_same_ones_and_read_only() -> None:
    body = LiveBody(block(tools=False))
    places, moved = body.positions, body.displacement
    hand = body.hold(TOP, radius=0.012, stiffness=30.0)
    hand.move_to(np.add(TOP, [0.0, 0.0, 0.005]))
    body.step(50)
    assert body.positions is places
    assert body.displacement is moved
    assert np.abs(moved).max() > 0.0
    assert np.array_equal(places, body.problem.mesh.points + moved)
    with pytest.raises(ValueError, match="read-only"):
        places[0] = 0.0


def test_tools_press_where_they_are_sent() -> None:
    body = LiveBody(block())
    ball, plate = body.tools
    assert not ball.force.any()
    ball.move_to((0.02, 0.015, 0.030))
    half = np.radians(15.0)
    plate.move_to((0.055, 0.015, 0.01), (np.cos(half), 0.0, np.sin(half), 0.0))
    body.step(round(0.2 / body.time_step))
    body.step(round(0.1 / body.time_step))
    assert ball.position == pytest.approx([0.02, 0.015, 0.030])
    assert plate.rotation[0, 2] == pytest.approx(0.5)
    force = ball.force
    assert force[2] > 0.02  # the body pushes back
    assert force[2] > 5.0 * np.abs(force[:2]).max()
    assert np.array_equal(ball.force, force)  # read twice
    body.step(round(0.1 / body.time_step))  # of the last steps alone
    assert ball.force == pytest.approx(force, rel=0.02, abs=1e-3 * force[2])
    assert not plate.force.any()
    ball.move_to((0.02, 0.015, 0.0))
    with pytest.raises(ToolTooFastError):
        body.step(1)


@pytest.mark.parametrize(
    ("strain", "element"), [(Strain.GREEN, Element.LINEAR), (Strain.LINEAR, Element.SMOOTHED)]
)
def test_what_was_recorded_goes_the_same_way_bit_for_bit(strain: Strain, element: Element) -> None:
    body = LiveBody(block(), strain=strain, element=element)
    ball, plate = body.tools
    half = np.radians(5.0)
    body.step(7)
    ball.move_to((0.021, 0.0153, 0.0321))
    body.step(60)
    hand = body.hold((0.03, 0.0151, 0.02), radius=0.012, stiffness=30.0)
    hand.move_to((0.0307, 0.0151, 0.0213))
    plate.move_to((0.0537, 0.0151, 0.0101), (np.cos(half), 0.0, np.sin(half), 0.0))
    body.step(60)
    body.step(13)
    ball.move_to((0.0211, 0.0152, 0.031))
    hand.move_to((0.03, 0.017, 0.0221))
    body.step(40)
    other = body.hold((0.01, 0.015, 0.02), radius=0.012, stiffness=10.0)
    hand.let_go()
    other.move_to((0.01, 0.015, 0.024))
    body.step(30)
    end = body.displacement.copy()
    assert np.abs(end).max() > 1e-4
    recording = body.recording()
    again = simulate(recording, strain=strain, element=element)
    assert again.num_steps == 210
    assert np.array_equal(again.displacements[-1], end)
    body.reset()
    assert body.tools[0].position == pytest.approx([0.02, 0.015, 0.033])
    assert body.time == 0.0
    assert not body.displacement.any()
    with pytest.raises(InputError, match="nothing was recorded"):
        body.recording()


def test_what_cannot_be_recorded_is_refused() -> None:
    problem = block(tools=False)
    step = 1.1e-4
    rounded = next(n for n in range(1, 200) if n * step / n != step)
    body = LiveBody(problem, time_step=step)
    body.step(rounded)
    with pytest.raises(InputError, match="rounded"):
        body.recording()
    path = AnchorPath([0.0, 0.1], [[0.0, 0.0, 0.0], [0.0, 0.0, 0.005]])
    spring = Spring.on(problem.mesh, TOP, 0.012, 30.0, path)
    driven = LiveBody(dataclasses.replace(problem, springs=(spring,)))
    driven.step(10)
    driven.springs[0].move_to(TOP)
    driven.step(10)
    assert driven.springs[0].anchor == pytest.approx(TOP)
    with pytest.raises(InputError, match="a path of its own"):
        driven.recording()
    driven.reset()
    driven.step(10)
    again = simulate(driven.recording())
    assert np.array_equal(again.displacements[-1], driven.displacement)


def test_springs_that_follow_each_other_are_not_stiff_together() -> None:
    """A recording of many holds, each as stiff as the step allows, can be repeated."""
    body = LiveBody(block(tools=False))
    with pytest.raises(SpringTooStiffError) as found:
        body.hold(TOP, radius=0.012, stiffness=1e6)
    for _ in range(4):
        hand = body.hold(TOP, radius=0.012, stiffness=0.99 * found.value.largest_stiffness)
        hand.move_to(np.add(hand.anchor, [0.0, 0.0, 1e-3]))
        body.step(20)
        hand.let_go()
        body.step(5)
    recording = body.recording()
    assert np.array_equal(simulate(recording).displacements[-1], body.displacement)
    held_on = tuple(dataclasses.replace(s, amplitude=None) for s in recording.springs)
    with pytest.raises(UnstableStepError):
        simulate(dataclasses.replace(recording, springs=held_on))
