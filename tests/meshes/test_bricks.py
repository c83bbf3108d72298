"""Boxes of bricks: their volume, and how many cells fill it."""

from __future__ import annotations

import pytest

from palpate.meshes.bricks import brick_box, rollers, side, support_of


def test_boxes_fill_their_volume_with_good_cells():
    mesh = brick_box((4, 3, 3), (2.0, 1.0, 1.0), ragged=0.15)
    assert mesh.num_cells == 6 * 4 * 3 * 3
    assert mesh.volume == pytest.approx(2.0, rel=1e-13)


def test_a_side_is_held_with_its_corners_and_rollers_slide_in_their_plane():
    mesh = brick_box((2, 3, 4), (2.0, 1.0, 1.0))
    bottom = side(mesh, 2, 0.0)
    # Two triangles on each of 2 x 3 bricks, on 3 x 4 points.
    assert bottom.shape == (12, 3)
    support = support_of(bottom, displacement=(0.0, 0.0, -0.1))
    assert len(support.points) == 12
    assert (mesh.points[support.points, 2] == 0.0).all()
    assert support.displacement == (0.0, 0.0, -0.1)
    first, second = rollers(mesh, ((0, 2.0), (1, 0.0)))
    assert (first.components, second.components) == ((True, False, False), (False, True, False))
    assert (mesh.points[first.points, 0] == 2.0).all()
    assert len(side(mesh, 0, 0.9)) == 0
