"""No honest motion is out of reach, garbage between outputs is; rotations and linear strain."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from bank import made_state
from numpy.typing import NDArray

from palpate.fastsim.dynamics import simulate
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce, Load, Pressure, Support, Traction
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import rotation_matrix
from palpate.validation.exchange.time_reading import read_at
from palpate.validation.metrics import validity
from palpate.validation.metrics.validity import (
    BORDERS,
    cell_rotations,
    describe_rotation,
    largest_acceleration,
    largest_rotation,
    state_out_of_reach,
    unmeasurable_state,
)
from palpate.validation.states import State, Trajectory
from palpate.validation.studies.validity import follow

BLOCK = brick_box((3, 2, 2), (0.03, 0.02, 0.02))
Field = NDArray[np.float64]

MESH = brick_box((6, 2, 2), (0.06, 0.02, 0.02), ragged=0.2)
FACETS = MESH.boundary_facets
X = MESH.points[FACETS][:, :, 0]
CLAMP, TIP = FACETS[(X < 1e-9).all(axis=1)], FACETS[(X > 0.06 - 1e-9).all(axis=1)]
SIDE = FACETS[(MESH.points[FACETS][:, :, 2] > 0.02 - 1e-9).all(axis=1)]
HELD = Support(np.unique(CLAMP).astype(np.int32), CLAMP)
SPAN = TimeSpan(0.5, None, 1.0, 50)
PULSE = TabularAmplitude((0.0, 0.05, 0.1, 0.15), (0.0, 1.0, 1.0, 0.0))
SHAKE = TabularAmplitude(
    tuple(np.linspace(0.0, 0.5, 51)), tuple(np.sin(12.0 * math.pi * np.linspace(0.0, 0.5, 51)))
)
BODY = Problem(MESH, Material(2e4, 0.4), (HELD,), (), SPAN)
MOTIONS: dict[str, tuple[tuple[Load, ...], tuple[Support, ...]]] = {
    "weight": ((BodyForce((0.0, 0.0, -4000.0)),), ()),
    "pull": ((Traction(TIP, (0.0, 100.0, 0.0)),), ()),
    "pulse": ((Traction(TIP, (0.0, 200.0, 0.0), PULSE),), ()),
    "pressure": ((Pressure(SIDE, 60.0),), ()),
    "shaken": (
        (),
        (Support(HELD.points, CLAMP, (False, True, False), (0.0, 0.002, 0.0), SHAKE),),
    ),
}


def moving(name: str, num_outputs: int) -> Problem:
    loads, supports = MOTIONS[name]
    fixed = Support(HELD.points, CLAMP, (True, not supports, True))
    span = dataclasses.replace(SPAN, num_outputs=num_outputs)
    return dataclasses.replace(BODY, loads=loads, supports=(fixed, *supports), time=span)


def sent(
    problem: Problem,
    num_sent: int,
    perturb: Callable[[Field, Field], None] | None = None,
) -> State:
    """fastsim's own motion sent at another rate; `perturb` may change what is between outputs."""
    assert problem.time is not None
    span = dataclasses.replace(problem.time, num_outputs=num_sent)
    found = simulate(dataclasses.replace(problem, time=span))
    times, states = found.times, found.displacements.copy()
    wanted = np.linspace(0.0, span.end_time, problem.time.num_outputs + 1)
    apart = np.abs(times[:, None] - wanted).min(axis=1)
    if perturb is not None:
        perturb(states, np.flatnonzero(apart > 1e-9))
    read = read_at(times, states, wanted, slack=1e-9)
    state = made_state(MESH, states[-1], trajectory=Trajectory(wanted, read.states))
    return dataclasses.replace(state, sent=Trajectory(times, states))


@pytest.mark.parametrize("num_outputs", [50, 10, 4, 1])
@pytest.mark.parametrize("name", MOTIONS)
def test_an_honest_motion_is_within_reach_at_every_rate(name: str, num_outputs: int) -> None:
    problem = moving(name, num_outputs)
    for num_sent in (7, 50, 100, 330):
        assert state_out_of_reach(problem, sent(problem, num_sent)) == "", num_sent


def perturbed(kind: str) -> Callable[[Field, Field], None]:
    def perturb(states: Field, between: Field) -> None:
        match kind:
            case "last state":
                states[between] = states[-1]
            case "still":
                states[between] = 0.0
            case "one of them turned round":
                k = between[np.abs(states[between]).max(axis=(1, 2)).argmax()]
                states[k] *= -1.0

    return perturb


@pytest.mark.parametrize("kind", ["last state", "still", "one of them turned round"])
@pytest.mark.parametrize("name", MOTIONS)
def test_garbage_between_the_outputs_is_out_of_reach(name: str, kind: str) -> None:
    problem = moving(name, 50)
    for num_sent in (100, 250):
        reported = state_out_of_reach(problem, sent(problem, num_sent, perturbed(kind)))
        assert "out of the body's reach" in reported


def test_a_smooth_excursion_between_two_outputs_is_out_of_reach() -> None:
    """Neighbours in time follow each other closely, and still nothing brings the body there."""
    problem = moving("weight", 50)

    def excursion(states: Field, _between: Field) -> None:
        size = np.abs(states).max()
        inside = np.arange(401, 420)  # between the outputs 20 and 21 of 20 states each
        states[inside, :, 2] += size * np.sin(math.pi * (inside - 400) / 20.0)[:, None] ** 2

    assert state_out_of_reach(problem, sent(problem, 1000)) == ""
    assert "out of the body's reach" in state_out_of_reach(problem, sent(problem, 1000, excursion))


def test_the_bound_of_a_weight_is_gravity_on_what_is_free() -> None:
    problem = moving("weight", 50)
    assert problem.time is not None
    rest = Trajectory(np.array([0.0, 0.5]), np.zeros((2, *MESH.points.shape)))
    bound = largest_acceleration(problem, Strain.GREEN, rest)
    # 4000 N/m3 on 1000 kg/m3: 4 m/s2 on 24 cm3 less what hangs at the clamp.
    assert bound < 4.0 * math.sqrt(0.024)
    assert bound > 0.9 * 4.0 * math.sqrt(0.024)


def test_supports_pull_smoothed_tetrahedra_no_harder_than_they_are_stiff() -> None:
    problem = moving("shaken", 1)
    rest = Trajectory(np.array([0.0, 0.5]), np.zeros((2, *MESH.points.shape)))
    plain, smoothed = (
        largest_acceleration(problem, Strain.LINEAR, rest, element) for element in Element
    )
    assert smoothed < 0.9 * plain
    found = simulate(problem, element=Element.SMOOTHED)
    motion = Trajectory(found.times, found.displacements)
    state = made_state(MESH, motion.displacements[-1], trajectory=motion, element=Element.SMOOTHED)
    assert state_out_of_reach(problem, state) == ""


def test_a_pressure_that_follows_has_room_and_one_that_does_not_has_none() -> None:
    problem = moving("pressure", 50)
    rest = Trajectory(np.array([0.0, 0.5]), np.zeros((2, *MESH.points.shape)))
    bounds = [
        largest_acceleration(problem, strain, rest) for strain in (Strain.GREEN, Strain.LINEAR)
    ]
    assert bounds[0] == pytest.approx(validity._FOLLOWING * bounds[1], rel=1e-12)
    assert bounds[1] > 0.0


def test_a_state_is_looked_at_with_the_next_ones_and_with_those_far_enough() -> None:
    found = list(validity._neighbours(np.linspace(0.0, 1.0, 11), 0.25))
    assert [pair for pair in found if pair[1] == 5] == [(4, 5, 6), (2, 5, 8)]
    assert [pair for pair in found if pair[1] == 1] == [(0, 1, 2)]
    near = list(validity._neighbours(np.linspace(0.0, 1.0, 11), 0.1))
    assert near == [(k - 1, k, k + 1) for k in range(1, 10)]


def test_a_load_that_ramps_up_starts_from_nothing() -> None:
    ramp = TabularAmplitude((0.0, 0.1), (0.0, 1.0))
    assert validity._variation(Traction(TIP, (0.0, 1.0, 0.0), ramp), 0.5) == (0.0, 1.0)
    assert validity._variation(Traction(TIP, (0.0, 1.0, 0.0), PULSE), 0.5) == (0.0, 2.0)
    assert validity._variation(Traction(TIP, (0.0, 1.0, 0.0)), 0.5) == (1.0, 0.0)


def test_a_number_that_cannot_be_measured_is_reported_with_its_time() -> None:
    problem = moving("pull", 50)
    good = sent(problem, 100)
    assert unmeasurable_state(good) == ""
    for number in (math.nan, 1e308):

        def perturb(states: Field, _between: Field, number: float = number) -> None:
            states[31, 3, 1] = number

        reported = unmeasurable_state(sent(problem, 100, perturb))
        assert reported.startswith("its state at 0.155 s")


@pytest.mark.parametrize("angle", [0.0, 0.3, 2.0, 3.1])
def test_a_turned_and_stretched_body_is_turned_by_that_angle(angle: float) -> None:
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    turn = rotation_matrix(np.array([math.cos(angle / 2), *(math.sin(angle / 2) * axis)]))
    stretch = np.array([[1.2, 0.1, 0.0], [0.1, 0.9, 0.0], [0.0, 0.0, 1.0]])
    displacement = BLOCK.points @ (turn @ stretch).T - BLOCK.points
    assert np.abs(cell_rotations(BLOCK, displacement) - angle).max() < 1e-7
    assert largest_rotation(BLOCK, displacement) == pytest.approx(angle, abs=1e-7)


def test_the_borders_are_those_of_a_bent_bar() -> None:
    deflections = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
    bar = follow(4.0, 0.3, deflections)
    for error, degrees in BORDERS.items():
        found = bar.border(error, measure="rotation")
        assert found is not None
        assert math.degrees(found) == pytest.approx(degrees, rel=0.03)


def test_the_line_says_which_border_is_left() -> None:
    for degrees, words in ((0.5, "within the 1% border"), (9.0, "beyond the 5% border")):
        angle = math.radians(degrees)
        turn = rotation_matrix(np.array([math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)]))
        assert words in describe_rotation(BLOCK, BLOCK.points @ turn.T - BLOCK.points)


def test_a_hundredth_of_the_volume_may_turn_further():
    """Of a fine bar that is turned by 0.2 everywhere, one corner is turned by far more."""
    mesh = brick_box((9, 6, 6), (0.09, 0.06, 0.06))
    turn = rotation_matrix(np.array([np.cos(0.1), 0.0, 0.0, np.sin(0.1)]))
    displacement = mesh.points @ turn.T - mesh.points
    assert largest_rotation(mesh, displacement) == pytest.approx(0.2, abs=1e-12)
    displacement[0] += [0.0, 0.004, -0.004]
    assert cell_rotations(mesh, displacement).max() > 0.25
    assert largest_rotation(mesh, displacement) == pytest.approx(0.2, abs=1e-12)
