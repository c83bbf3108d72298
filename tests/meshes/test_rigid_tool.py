"""Tools as data: poses over time, and what is refused."""

from __future__ import annotations

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
    rotation_matrix,
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
