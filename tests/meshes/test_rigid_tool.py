"""Rigid tools: paths and their poses, smooth paths, and forces that drive them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    ForceDrive,
    RigidTool,
    SphereShape,
    ToolError,
    ToolPath,
    require_drive_of_statics,
    rotation_matrix,
    smooth_path,
)

STRAIGHT = ToolPath([0.0, 2.0], [[0.0, 0.0, 1.0], [4.0, 0.0, 0.0]])
HALF = math.sqrt(0.5)
EPS = float(np.finfo(float).eps)


def test_positions_are_straight_between_knots_and_held_outside() -> None:
    for time, position in [(-1, [0, 0, 1]), (0, [0, 0, 1]), (0.5, [1, 0, 0.75]), (5, [4, 0, 0])]:
        found, turned = STRAIGHT.pose_at(time)
        assert found.tolist() == position
        assert np.array_equal(turned, np.eye(3))


def test_turns_are_at_constant_rate_the_shorter_way_round() -> None:
    quarter = [HALF, 0.0, 0.0, HALF]  # a quarter turn about z
    for end in (quarter, [-q for q in quarter]):
        path = ToolPath([0.0, 1.0], np.zeros((2, 3)), [[1.0, 0.0, 0.0, 0.0], end])
        for s in (0.0, 0.25, 0.5, 1.0):
            angle = s * math.pi / 2
            expected = [
                [math.cos(angle), -math.sin(angle), 0.0],
                [math.sin(angle), math.cos(angle), 0.0],
                [0.0, 0.0, 1.0],
            ]
            np.testing.assert_allclose(path.pose_at(s)[1], expected, rtol=0, atol=2 * EPS)


def test_a_quaternion_gives_a_rotation() -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        quaternion = rng.normal(size=4)
        turned = rotation_matrix(quaternion / np.linalg.norm(quaternion))
        np.testing.assert_allclose(turned @ turned.T, np.eye(3), rtol=0, atol=8 * EPS)
        assert np.linalg.det(turned) == pytest.approx(1.0, abs=8 * EPS)


@pytest.mark.parametrize(
    ("times", "positions", "rotations", "word"),
    [
        ([], np.zeros((0, 3)), np.zeros((0, 4)), "n >= 1"),
        ([0.0], np.zeros((2, 3)), np.zeros((0, 4)), "needs times"),
        ([0.0, 1.0], [[0, 0, 0], [0, 0, float("nan")]], np.zeros((0, 4)), "position at knot 1"),
        ([0.0, float("inf")], np.zeros((2, 3)), np.zeros((0, 4)), "time at knot 1"),
        ([1.0, 0.5], np.zeros((2, 3)), np.zeros((0, 4)), "backwards at knot 1"),
        ([0.0], np.zeros((1, 3)), [[2.0, 0.0, 0.0, 0.0]], "unit quaternion"),
    ],
)
def test_senseless_paths_are_refused(
    times: list[float], positions: object, rotations: object, word: str
) -> None:
    with pytest.raises(ToolError, match=word):
        ToolPath(np.array(times), np.array(positions), np.array(rotations))


def test_tools_without_size_and_odd_drives_are_refused() -> None:
    for make in (
        lambda: SphereShape(0.0),
        lambda: CapsuleShape(1.0, -1.0),
        lambda: BoxShape((1.0, 0.0, 1.0)),
        lambda: SphereShape(float("nan")),
    ):
        with pytest.raises(ToolError, match="above 0"):
            make()
    with pytest.raises(ToolError, match="friction"):
        RigidTool(SphereShape(1.0), STRAIGHT, friction_coefficient=-0.1)
    always = TabularAmplitude((0.0,), (1.0,))
    with pytest.raises(ToolError, match="unit vector"):
        ForceDrive((0.0, 0.0, 2.0), 1.0, always, 1.0)
    drive = ForceDrive((0.0, 0.0, 1.0), 1.0, always, 1.0)
    with pytest.raises(ToolError, match="one pose"):
        RigidTool(SphereShape(1.0), STRAIGHT, drive=drive)


PATH = ToolPath(
    np.array([0.0, 0.2, 1.0]),
    np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.0], [0.3, 0.0, 0.0]]),
    np.array([[1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [HALF, 0.0, 0.0, HALF]]),
)


def test_the_poses_are_met_at_their_times() -> None:
    smooth = smooth_path(PATH)
    for time in PATH.times:
        for found, given in zip(smooth.pose_at(time), PATH.pose_at(time), strict=True):
            assert np.abs(found - given).max() < 1e-15


def test_it_rests_at_every_pose_and_is_fastest_between() -> None:
    smooth = smooth_path(PATH)
    speed = np.linalg.norm(np.diff(smooth.positions, axis=0), axis=1) / np.diff(smooth.times)
    # 10 s^3 - 15 s^4 + 6 s^5 has a rate of 15/8 in the middle.
    assert speed.max() == pytest.approx(15.0 / 8.0 * 0.1 / 0.2, rel=1e-3)
    slow = [0, 63, 64, 127]
    assert speed[slow].max() < 5e-3 * speed.max()
    assert np.abs(np.diff(speed)).max() < 0.05 * speed.max()


def test_it_turns_with_the_way() -> None:
    position, rotation = smooth_path(PATH).pose_at(0.6)
    assert position == pytest.approx([0.15, 0.0, 0.0], abs=1e-15)
    eighth = np.pi / 4.0
    assert rotation[:, 0] == pytest.approx([np.cos(eighth), np.sin(eighth), 0.0], abs=1e-12)


def test_a_path_of_one_pose_stays() -> None:
    one = ToolPath(np.zeros(1), np.array([[1.0, 2.0, 3.0]]))
    assert smooth_path(one).positions.tolist() == [[1.0, 2.0, 3.0]]


ALWAYS = TabularAmplitude((0.0,), (1.0,))
ON_A_PATH = RigidTool(SphereShape(1.0), ToolPath([0.0], [[0.0, 0.0, 0.0]]))


def driven(force: float, friction: float = 0.0) -> RigidTool:
    drive = ForceDrive((0.0, 0.0, -1.0), force, ALWAYS, mass=1.0)
    return dataclasses.replace(ON_A_PATH, drive=drive, friction_coefficient=friction)


def test_one_that_pushes_alone_and_tools_on_paths_are_taken() -> None:
    require_drive_of_statics(())
    require_drive_of_statics((ON_A_PATH, ON_A_PATH))
    require_drive_of_statics((driven(0.1),))


@pytest.mark.parametrize(
    ("tools", "words"),
    [
        ((driven(-0.1),), "tool 1 is driven by -0.1 N.* above 0"),
        ((driven(0.0),), "above 0"),
        ((ON_A_PATH, driven(0.1)), "tool 2 is driven by a force, beside others"),
        ((driven(0.1, friction=0.2),), "friction, whose drag depends on the way"),
    ],
)
def test_others_are_refused(tools: tuple[RigidTool, ...], words: str) -> None:
    with pytest.raises(ToolError, match=words):
        require_drive_of_statics(tools)
