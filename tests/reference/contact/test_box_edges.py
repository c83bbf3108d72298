"""Nodes beside the edges of a box: they leave by the face they came in by, and slide off it."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.reference.contact.tool_distance import ContactFaces, entered_faces, seen_at

HALF = np.array([0.3, 0.4, 0.5])
# How far inside a side of the box a row of nodes lies, over its half width.
MARGINS = [0.0, 1e-9, 1e-6, 1e-4, 1e-3, 5e-3, 1e-2]


def test_places_enter_by_the_face_that_small_steps_meet_first() -> None:
    rng = np.random.default_rng(11)
    before, inside = rng.uniform(-1.0, 1.0, (300, 3)), HALF * rng.uniform(-0.99, 0.99, (300, 3))
    before = before[(np.abs(before) > HALF + 0.01).any(axis=1)]
    inside = inside[: len(before)]
    axes, sides = entered_faces(inside, HALF, before)
    for start, end, axis, side in zip(before, inside, axes, sides, strict=True):
        way = start + np.linspace(0.0, 1.0, 20_001)[:, None] * (end - start)
        first = way[np.argmax((np.abs(way) <= HALF).all(axis=1))]
        # One step behind the face: deeper in every other way, but at an edge, for one in 300.
        assert np.abs(side * first[axis] - HALF[axis]) <= np.abs(end - start).max() / 20_000
        assert side == np.sign(start[axis])


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("margin", MARGINS)
def test_a_place_just_inside_an_edge_keeps_to_the_face_it_touched(
    axis: int, side: float, margin: float
) -> None:
    """However deep it then is, and however near to the other face."""
    across = (axis + 1) % 3
    face = np.zeros(3)
    face[axis] = side * HALF[axis]
    face[across] = (1.0 - margin) * HALF[across]
    normal = side * np.eye(3)[axis]
    came_from = seen_at((face + 0.1 * normal)[None], HALF, None)
    for depth in (0.0, 1e-12, 1e-4, 0.05):
        local = (face - depth * normal)[None]
        assert entered_faces(local, HALF, came_from) == (axis, side)
        came_from = seen_at(local, HALF, came_from)


def test_who_slides_off_a_face_goes_to_the_one_round_the_edge_and_only_once() -> None:
    faces = ContactFaces((0.3, 0.4, 0.5))
    faces.keep(np.array([[0.29, 0.0, -0.51], [0.0, 0.0, -0.51], [0.29, 0.0, -0.51]]))
    beyond = np.array([[0.31, 0.0, -0.5], [0.0, 0.0, -0.5], [0.31, 0.0, -0.5]])
    pressed = np.array([True, True, False])
    # Before, all are held against the bottom, those beyond its edge too.
    is_fixed, gap, normal = faces.planes(beyond)
    assert is_fixed.all()
    np.testing.assert_allclose(gap, 0.0, atol=1e-15)
    np.testing.assert_array_equal(normal, np.tile([0.0, 0.0, -1.0], (3, 1)))
    off, again = faces.let_go(beyond, pressed)
    assert (off.tolist(), again) == ([True, False, False], False)
    is_fixed, gap, normal = faces.planes(beyond)
    np.testing.assert_array_equal(normal[:, 0], [1.0, 0.0, 0.0])
    assert gap[0] == pytest.approx(0.01)
    off, again = faces.let_go(beyond, pressed)
    assert not off.any()
    below = beyond - [[0.02, 0.0, 0.1]]
    off, again = faces.let_go(below, pressed)
    assert (off.tolist(), again) == ([True, False, False], True)
    faces.go_back()
    np.testing.assert_array_equal(faces.planes(beyond)[2][:, 2], -1.0)
