"""A tool's path without jolts, as straight pieces that every simulator reads."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.rigid_tool import ToolPath, smooth_path

HALF = np.sqrt(0.5)
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
