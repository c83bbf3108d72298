"""Shells are classed by nesting, and those that face the wrong way are named."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.shells import (
    ShellKind,
    find_shells,
    require_nested,
    turn_bodies,
    winding_numbers,
)
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import OrientationError, TriSurface

BALL = shape_sphere(1.0, edge_length=0.5)


def ball(radius: float, *, at: tuple[float, float, float] = (0, 0, 0), inward: bool = False):  # type: ignore[no-untyped-def]
    facets = BALL.facets[:, ::-1] if inward else BALL.facets
    return TriSurface(radius * BALL.points + np.array(at), facets)


def together(*parts: TriSurface) -> TriSurface:
    shift = np.cumsum([0, *(len(p.points) for p in parts)])
    return TriSurface(
        np.vstack([p.points for p in parts]),
        np.vstack([p.facets + s for p, s in zip(parts, shift, strict=False)]),
    )


def test_a_body_in_a_cavity_in_a_body_beside_another() -> None:
    surface = together(ball(4.0), ball(2.0, inward=True), ball(1.0), ball(1.0, at=(6, 0, 0)))
    shells = require_nested(surface)
    assert [s.kind for s in shells] == [
        ShellKind.OUTSIDE,
        ShellKind.CAVITY,
        ShellKind.BODY_WITHIN_A_CAVITY,
        ShellKind.OUTSIDE,
    ]
    assert [s.around for s in shells] == [(), (0,), (0, 1), ()]
    assert sum(s.volume for s in shells) == pytest.approx(surface.volume, rel=1e-13)
    require_closed(surface)


@pytest.mark.parametrize("wrong", range(3))
def test_the_shell_that_faces_the_wrong_way_is_named(wrong: int) -> None:
    parts = [ball(4.0), ball(2.0, inward=True), ball(1.0, at=(6, 0, 0))]
    parts[wrong] = TriSurface(parts[wrong].points, parts[wrong].facets[:, ::-1])
    surface = together(*parts)
    with pytest.raises(OrientationError, match=f"shell {wrong}") as caught:
        require_closed(surface)
    count = len(BALL.facets)
    assert caught.value.facets == list(range(wrong * count, (wrong + 1) * count))


def test_shells_are_found_whatever_the_order_of_facets() -> None:
    surface = together(ball(3.0), ball(1.0, inward=True), ball(0.5, at=(9, 9, 9)))
    rows = np.random.default_rng(3).permutation(surface.num_facets)
    shells = find_shells(TriSurface(surface.points, surface.facets[rows]))
    assert sorted(len(s.facets) for s in shells) == [len(BALL.facets)] * 3
    assert sorted(s.kind for s in shells) == [
        ShellKind.CAVITY,
        ShellKind.OUTSIDE,
        ShellKind.OUTSIDE,
    ]


def test_bodies_that_face_inwards_are_turned_with_what_lies_in_them() -> None:
    right = together(ball(4.0), ball(2.0, inward=True), ball(1.0, at=(6, 0, 0)))
    same, count = turn_bodies(right)
    assert count == 0
    assert np.array_equal(same.facets, right.facets)
    beside = ball(1.0, at=(6, 0, 0))
    turned, count = turn_bodies(together(ball(4.0, inward=True), ball(2.0), beside))
    assert count == 2 * len(BALL.facets)
    assert len(require_nested(turned)) == 3
    assert turned.volume == pytest.approx(right.volume, rel=1e-12)
    # A ball within that faces outwards may be meant as a cavity or as a body: that is not guessed.
    unclear, count = turn_bodies(together(ball(4.0), ball(2.0)))
    assert count == 0
    with pytest.raises(OrientationError, match="cavity"):
        require_nested(unclear)


def test_winding_numbers_are_whole_inside_and_out_also_close_to_the_surface() -> None:
    box = shape_box(edge_length=0.5)
    positions = np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 1e-9], [0.5, 0.5, -1e-9], [3.0, 0.0, 0.0]])
    # Each of the facets' angles is good to a few roundings of pi.
    tolerance = 8 * box.num_facets * np.finfo(float).eps + 1e-8  # 1e-9 off a side of 0.5: 4e-9
    assert np.abs(winding_numbers(box, positions) - [1.0, 1.0, 0.0, 0.0]).max() < tolerance
