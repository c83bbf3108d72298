"""The grid convergence index against NASA's example and sequences known in closed form."""

from __future__ import annotations

import math

import pytest

from palpate.validation.metrics.grid_convergence import Convergence, assess_grid_convergence


def test_the_nasa_example_is_reproduced_to_eight_digits():
    # Double-precision arithmetic of the published formulas; the published digits (1.78618,
    # 0.9713003, 0.103080 %, 0.356244 %) are single-precision ones.
    result = assess_grid_convergence(
        [0.97050, 0.96854, 0.96178], [1.0, 2.0, 4.0], expected_order=2.0
    )
    assert result.behaviour is Convergence.MONOTONE
    assert result.order == pytest.approx(1.78616959, abs=5e-9)
    assert result.extrapolated == pytest.approx(0.971300333, abs=5e-10)
    assert 100 * result.index_fine == pytest.approx(0.1030826, abs=5e-8)
    assert 100 * result.index_coarse == pytest.approx(0.3562493, abs=5e-8)
    assert result.asymptotic_ratio == pytest.approx(0.99798, abs=5e-6)
    assert result.error_bar == pytest.approx(1.25 * (0.971300333 - 0.97050), abs=1e-9)


@pytest.mark.parametrize("order", [0.8, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("ratios", [(2.0, 2.0), (1.5, 2.0), (2.0, 1.3)])
@pytest.mark.parametrize("coefficient", [0.3, -4.0])
def test_an_exact_power_law_is_recovered(order, ratios, coefficient):
    sizes = [0.1, 0.1 * ratios[0], 0.1 * ratios[0] * ratios[1]]
    limit = 7.0
    values = [limit + coefficient * h**order for h in sizes]
    result = assess_grid_convergence(values, sizes, expected_order=order)
    assert result.order == pytest.approx(order, rel=1e-9)
    assert result.extrapolated == pytest.approx(limit, rel=1e-11)
    # Fs times the true error, so the bar holds the limit.
    assert result.error_bar == pytest.approx(1.25 * abs(values[0] - limit), rel=1e-8)


@pytest.mark.parametrize(
    ("values", "behaviour"),
    [
        ([1.0, 1.1, 1.0], Convergence.OSCILLATING),
        ([1.0, 0.9, 1.3], Convergence.OSCILLATING),
        ([1.0, 1.0, 1.3], Convergence.OSCILLATING),
        ([1.0, 1.2, 1.3], Convergence.DIVERGING),
        ([1.0, 1.125, 1.25], Convergence.DIVERGING),
        ([1.0, 1.001, 1.2], Convergence.ORDER_OUT_OF_RANGE),
        ([1.0, 1.1, 1.21], Convergence.ORDER_OUT_OF_RANGE),
    ],
)
def test_a_bad_sequence_has_no_error_bar(values, behaviour):
    result = assess_grid_convergence(values, [1.0, 2.0, 4.0], expected_order=2.0)
    assert result.behaviour is behaviour
    assert result.error_bar is None
    assert result.value == values[0]


def test_differences_below_the_noise_give_the_noise():
    result = assess_grid_convergence(
        [5.0, 5.0 + 1e-12, 5.0 - 1e-12], [1.0, 2.0, 4.0], expected_order=2.0, noise=1e-11
    )
    assert result.behaviour is Convergence.BELOW_NOISE
    assert result.order is None
    assert result.error_bar == pytest.approx(1.25e-11)


def test_a_value_of_zero_keeps_its_absolute_bar():
    result = assess_grid_convergence([0.0, 0.3, 1.5], [1.0, 2.0, 4.0], expected_order=2.0)
    assert result.order == pytest.approx(2.0)
    assert result.index_fine is None
    assert result.error_bar == pytest.approx(1.25 * 0.1)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"values": [1.0, 2.0]}, "3 values"),
        ({"values": [1.0, 1.1, 1.5, 2.7]}, "3 values"),
        ({"sizes": [1.0, 2.0, 4.0, 8.0]}, "3 values"),
        ({"values": [1.0, math.nan, 2.0]}, "finite"),
        ({"sizes": [1.0, 1.2, 2.4]}, "1.3"),
        ({"sizes": [4.0, 2.0, 1.0]}, "finest first"),
        ({"expected_order": 0.0}, "expected_order"),
        ({"noise": -1.0}, "noise"),
        ({"safety_factor": 0.5}, "safety_factor"),
    ],
)
def test_unusable_sequences_are_refused(change, words):
    given = {"values": [1.0, 1.1, 1.5], "sizes": [1.0, 2.0, 4.0], "expected_order": 2.0} | change
    values, sizes = given.pop("values"), given.pop("sizes")
    with pytest.raises(ValueError, match=words):
        assess_grid_convergence(values, sizes, **given)
