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


@pytest.mark.parametrize("scale", [2.0**-300, 2.0**-20, 1.0, 2.0**40, 2.0**200])
def test_points_on_a_fine_grid_far_off_are_judged_exactly(scale: float) -> None:
    # Offsets of up to 18, 19 and 20 bits: below and above what whole numbers of 64 bits carry.
    rng = np.random.default_rng(5)
    for bits in (2, 18, 19, 20):
        for _ in range(20):
            rows = scale * (2.0**30 + rng.integers(-(2 ** (bits - 1)), 2 ** (bits - 1), (5, 3)))
            a, b, c, d, e = rows.tolist()
            assert _core.orient3d(a, b, c, d) == _orient3d(a, b, c, d)
            if _orient3d(a, b, c, d) < 0:
                a, b = b, a
            if _orient3d(a, b, c, d) != 0:
                assert _core.in_sphere(a, b, c, d, e) == _in_sphere(a, b, c, d, e)


def test_rounded_points_of_a_sphere_are_judged_exactly() -> None:
    # All five lie on the unit sphere but for rounding: only the last digits decide.
    rng = np.random.default_rng(6)
    for _ in range(100):
        rows = rng.normal(size=(5, 3))
        rows /= np.linalg.norm(rows, axis=1)[:, None]
        a, b, c, d, e = rows.tolist()
        if _orient3d(a, b, c, d) < 0:
            a, b = b, a
        assert _core.in_sphere(a, b, c, d, e) == _in_sphere(a, b, c, d, e) != 0
