"""The exact predicates against rational arithmetic, where rounding decides everything."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.fastsim import _core

Row = list[float]


def _determinant(rows: list[list[Fraction]]) -> Fraction:
    if len(rows) == 1:
        return rows[0][0]
    return sum(
        (
            (-1) ** k * rows[0][k] * _determinant([row[:k] + row[k + 1 :] for row in rows[1:]])
            for k in range(len(rows))
        ),
        Fraction(0),
    )


def _sign(value: Fraction) -> int:
    return (value > 0) - (value < 0)


def _orient3d(a: Row, b: Row, c: Row, d: Row) -> int:
    return _sign(
        _determinant(
            [[Fraction(x) - Fraction(o) for x, o in zip(p, a, strict=True)] for p in (b, c, d)]
        )
    )


def _in_sphere(a: Row, b: Row, c: Row, d: Row, e: Row) -> int:
    rows = []
    for p in (a, b, c, d):
        arm = [Fraction(x) - Fraction(o) for x, o in zip(p, e, strict=True)]
        rows.append([*arm, sum((x * x for x in arm), Fraction(0))])
    # Positive cell: the lifted determinant is negative for an inner point.
    return -_sign(_determinant(rows))


# Few distinct values and near-equal ones: most draws are coplanar, cospherical or almost so.
tricky = st.sampled_from(
    [0.0, 1.0, -1.0, 0.5, 0.1, 0.3, 1.0 + 2.0**-52, 1.0 - 2.0**-53, 1e-20, 1e12, 1e-300]
)
points = st.lists(tricky, min_size=3, max_size=3)


@given(points, points, points, points)
@settings(max_examples=300, deadline=None)
def test_orientation_is_exact(a: Row, b: Row, c: Row, d: Row) -> None:
    assert _core.orient3d(a, b, c, d) == _orient3d(a, b, c, d)


@given(points, points, points, points, points)
@settings(max_examples=300, deadline=None)
def test_in_sphere_is_exact(a: Row, b: Row, c: Row, d: Row, e: Row) -> None:
    sign = _orient3d(a, b, c, d)
    if sign < 0:
        a, b = b, a
    if sign != 0:
        assert _core.in_sphere(a, b, c, d, e) == _in_sphere(a, b, c, d, e)


@pytest.mark.parametrize("steps", range(-3, 4))
def test_one_rounding_step_off_the_plane_is_seen(steps: int) -> None:
    # d moves by single last digits through the plane x + y + z = 1.
    a, b, c = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]
    d = [0.25, 0.25, 0.5 + steps * 2.0**-53]
    # det(b - a, c - a, d - a) grows with x + y + z - 1.
    assert _core.orient3d(a, b, c, d) == np.sign(steps)


def test_cube_corners_lie_on_one_sphere_until_one_is_moved() -> None:
    a, b, c, d = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]
    assert _core.in_sphere(a, b, c, d, [1.0, 1.0, 1.0]) == 0
    assert _core.in_sphere(a, b, c, d, [1.0, 1.0, 1.0 - 2.0**-53]) == 1
    assert _core.in_sphere(a, b, c, d, [1.0, 1.0, 1.0 + 2.0**-52]) == -1
