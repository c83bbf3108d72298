"""Boxes of bricks: their volume, and how many cells fill it."""

from __future__ import annotations

import pytest

from palpate.meshes.bricks import brick_box


def test_boxes_fill_their_volume_with_good_cells():
    mesh = brick_box((4, 3, 3), (2.0, 1.0, 1.0), ragged=0.15)
    assert mesh.num_cells == 6 * 4 * 3 * 3
    assert mesh.volume == pytest.approx(2.0, rel=1e-13)
