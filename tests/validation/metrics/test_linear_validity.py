"""Rotations of cells, and the borders of linear strain that they are held against."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.meshes.bricks import brick_box
from palpate.meshes.rigid_tool import rotation_matrix
from palpate.validation.metrics.validity import (
    BORDERS,
    cell_rotations,
    describe_rotation,
    largest_rotation,
)
from palpate.validation.studies.validity import Mode, follow

MESH = brick_box((3, 2, 2), (0.03, 0.02, 0.02))


@pytest.mark.parametrize("angle", [0.0, 0.3, 2.0, 3.1])
def test_a_turned_and_stretched_body_is_turned_by_that_angle(angle: float) -> None:
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    turn = rotation_matrix(np.array([math.cos(angle / 2), *(math.sin(angle / 2) * axis)]))
    stretch = np.array([[1.2, 0.1, 0.0], [0.1, 0.9, 0.0], [0.0, 0.0, 1.0]])
    displacement = MESH.points @ (turn @ stretch).T - MESH.points
    assert np.abs(cell_rotations(MESH, displacement) - angle).max() < 1e-7
    assert largest_rotation(MESH, displacement) == pytest.approx(angle, abs=1e-7)


def test_the_borders_are_those_of_a_bent_bar() -> None:
    deflections = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
    bar = follow(Mode.BENDING, 0.3, deflections, slenderness=4.0)
    for error, degrees in BORDERS.items():
        found = bar.border(error, measure="rotation")
        assert found is not None
        assert math.degrees(found) == pytest.approx(degrees, rel=0.03)


def test_the_line_says_which_border_is_left() -> None:
    for degrees, words in ((0.5, "within the 1% border"), (9.0, "beyond the 5% border")):
        angle = math.radians(degrees)
        turn = rotation_matrix(np.array([math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)]))
        assert words in describe_rotation(MESH, MESH.points @ turn.T - MESH.points)
