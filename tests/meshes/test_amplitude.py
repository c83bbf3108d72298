"""Factors over time: knots, ends, smoothness, and what is refused."""

from __future__ import annotations

import pytest

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.errors import InputError


def test_knots_are_met_and_ends_are_held() -> None:
    for is_smooth in (False, True):
        amplitude = TabularAmplitude((0.0, 1.0, 3.0), (0.0, 2.0, -1.0), is_smooth)
        assert [amplitude(t) for t in (-1.0, 0.0, 1.0, 3.0, 9.0)] == [0.0, 0.0, 2.0, -1.0, -1.0]
        assert amplitude(2.0) == pytest.approx(0.5, abs=1e-15)  # halfway in both
    assert TabularAmplitude((0.0, 1.0), (0.0, 4.0))(0.25) == 1.0


def test_a_smooth_step_starts_and_ends_without_a_jump_of_two_rates() -> None:
    step = TabularAmplitude((0.0, 1.0), (0.0, 1.0), is_smooth=True)
    # 10 s^3 - 15 s^4 + 6 s^5 at a quarter: 0.103515625 exactly.
    assert step(0.25) == 0.103515625
    h = 1e-3  # the first two rates vanish: what is left is 10 h^3
    assert step(h) == pytest.approx(10 * h**3, rel=2e-3)
    assert 1.0 - step(1.0 - h) == pytest.approx(10 * h**3, rel=2e-3)


@pytest.mark.parametrize(
    ("times", "factors", "word"),
    [
        ((), (), "at least one"),
        ((0.0, 1.0), (1.0,), "2 times and 1 factors"),
        ((0.0, 0.0), (0.0, 1.0), "must increase"),
        ((1.0, 0.0), (0.0, 1.0), "must increase"),
        ((0.0, float("nan")), (0.0, 1.0), "not finite"),
        ((0.0,), (float("inf"),), "not finite"),
    ],
)
def test_senseless_amplitudes_are_refused(
    times: tuple[float, ...], factors: tuple[float, ...], word: str
) -> None:
    with pytest.raises(InputError, match=word):
        TabularAmplitude(times, factors)
