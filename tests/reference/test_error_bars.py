"""Error bars of sequences of meshes: the formula, without a reference."""

from __future__ import annotations

import itertools
import math

import pytest

from palpate.reference.adaptivity.error_bars import (
    AREA_OF_ESTIMATE,
    AREA_WIDER,
    LEAST_RATIO,
    LEAST_RATIO_OF_NUMBERS,
    NOISE,
    PART_OF_ESTIMATE,
    SAFETY,
    error_bar,
    error_bars,
    goes_towards_inversion,
)
from palpate.reference.adaptivity.goals import Quantity


def test_the_bar_of_a_geometric_sequence_covers_what_is_left():
    for rate in (0.1, 0.3, 0.5, 0.7, 0.85):
        values = [1.0 - rate**k for k in range(6)]
        apart = [b - a for a, b in itertools.pairwise(values)]
        bar = error_bar(apart, [rate**k for k in range(6)])
        assert bar >= SAFETY * (1.0 - values[-1]) * (1.0 - 1e-12)
        # Faster than of a smooth displacement is not believed.
        believed = max(rate, LEAST_RATIO)
        slowest = SAFETY * apart[-1] * believed / (1.0 - believed) * believed / rate
        assert bar <= slowest * (1.0 + 1e-12)


def test_the_slower_of_differences_and_estimates_is_believed():
    halves, quarters = [0.08, 0.04, 0.02, 0.01], [0.16, 0.04, 0.01, 0.0025]
    # 0.02 / 0.04 of either: what is left is as much as the last difference.
    assert error_bar(halves[:3], quarters) == pytest.approx(SAFETY * 0.02)
    assert error_bar(quarters[:3], halves) == pytest.approx(SAFETY * max(0.01, 0.5 * 0.04))
    # A quarter of both: a third of it.
    assert error_bar(quarters[:3], quarters) == pytest.approx(SAFETY * 0.01 / 3.0)


def test_a_difference_that_is_small_by_chance_makes_no_small_bar():
    estimates = [0.08, 0.04, 0.02, 0.01]
    assert error_bar([0.04, 0.02, 1e-7], estimates) >= SAFETY * 0.01
    # The one before by chance: the rate is that over two meshes.
    assert error_bar([0.04, 1e-7, 0.01], estimates) == pytest.approx(SAFETY * 0.01)


def test_a_norm_falls_no_faster_than_its_estimates_without_being_asked_why():
    # Estimates and differences of one rate: the last difference says it all.
    thirds = [0.27, 0.09, 0.03, 0.01]
    plain = SAFETY * 0.01 * 0.5
    assert error_bar([0.09, 0.03, 0.01], thirds, is_norm=True) == pytest.approx(plain)
    # A bent plate of long cells, nu = 0.49, whose last cuts were elsewhere: 0.6 % off, by its exact
    # cubic; 0.18 % by the last difference alone.
    bar = error_bar([0.0199, 0.0119, 0.00181], [0.0548, 0.0241, 0.0103, 0.00379], is_norm=True)
    assert bar > 0.00598 / 1.5


def test_the_largest_displacement_has_the_worst_points():
    estimates = [0.08, 0.04, 0.02, 0.01]
    kept = {
        Quantity.DISPLACEMENT_L2: ([0.08, 0.04, 0.008], estimates),
        "stress_l2@waist": ([0.08, 0.04, 0.004], estimates),
        Quantity.VOLUME: ([0.08, 0.04, 1e-7], estimates),
        Quantity.DISPLACEMENT_MAX: ([0.08, 0.04, 0.002], estimates),
        Quantity.MAX_DISPLACEMENT: ([0.16, 0.08, 0.03], estimates),
    }
    bars = error_bars(kept)
    # Estimates fell to a half.
    assert bars[Quantity.DISPLACEMENT_L2] == pytest.approx(SAFETY * 0.02)
    assert bars["stress_l2@waist"] == pytest.approx(SAFETY * 0.02)
    assert bars[Quantity.VOLUME] == pytest.approx(SAFETY * 0.02)
    # The worst point may lie where nothing was cut.
    assert bars[Quantity.DISPLACEMENT_MAX] == pytest.approx(SAFETY * 0.02)
    # No farther off than the worst point, where that is told.
    assert bars[Quantity.MAX_DISPLACEMENT] == pytest.approx(SAFETY * 0.02)
    alone = error_bars({"max_displacement": kept[Quantity.MAX_DISPLACEMENT]})
    assert alone["max_displacement"] == pytest.approx(SAFETY * 0.04)
    with pytest.raises(ValueError, match="swing"):
        error_bars({"swing": kept[Quantity.VOLUME]})


def test_an_area_is_no_better_known_than_its_edges_allow():
    plain = SAFETY * 0.002

    def bars(last):
        reported = [0.004, 0.002], [4.0 * last, 2.0 * last, last]
        return error_bars({Quantity.VOLUME: reported, Quantity.SURFACE_AREA: reported})

    for last, wanted in (
        (0.1, AREA_WIDER * plain),
        (0.01, AREA_OF_ESTIMATE * 0.01),
        (0.004, plain),
    ):
        assert bars(last)[Quantity.VOLUME] == pytest.approx(max(plain, PART_OF_ESTIMATE * last))
        assert bars(last)[Quantity.SURFACE_AREA] == pytest.approx(wanted)
    lost = error_bars({"surface_area": ([0.1, 0.1], [0.4, 0.2, 0.1])})
    assert lost["surface_area"] == math.inf
    # Differences grew, all smaller than what the estimates, which fall, leave.
    reported = [0.005, 0.009], [0.2, 0.1, 0.04]
    grown = error_bars({Quantity.VOLUME: reported, Quantity.SURFACE_AREA: reported})
    assert grown[Quantity.VOLUME] == math.inf
    assert grown[Quantity.SURFACE_AREA] == pytest.approx(AREA_OF_ESTIMATE * 0.04)
    stuck = error_bars({"surface_area": ([0.005, 0.009], [0.2, 0.042, 0.04])})
    assert stuck["surface_area"] == math.inf


def test_two_differences_that_are_small_by_chance_make_no_small_bar():
    reported = [0.02, 1e-6, 1e-8], [0.08, 0.04, 0.01, 0.0025]
    bars = error_bars(dict.fromkeys(("max_displacement", "volume", "displacement_l2"), reported))
    assert bars["max_displacement"] == bars["volume"] == pytest.approx(PART_OF_ESTIMATE * 0.0025)
    # A norm is not small by chance: a quarter of the difference before, and no more.
    assert bars["displacement_l2"] < 2e-7


def test_numbers_of_smooth_displacements_are_believed_to_converge_faster_than_norms():
    reported = [0.1, 0.01], [0.1, 0.01, 0.001]
    bars = error_bars(dict.fromkeys(("volume", "displacement_l2", "strain_energy"), reported))
    rate = LEAST_RATIO_OF_NUMBERS
    assert bars["volume"] == pytest.approx(SAFETY * rate * 0.1 * rate / (1.0 - rate))
    rate = LEAST_RATIO
    assert bars["displacement_l2"] == pytest.approx(SAFETY * 0.01 * rate / (1.0 - rate))
    # Its estimates are by the dual of another quantity.
    assert bars["strain_energy"] == pytest.approx(SAFETY * rate * 0.1 * rate / (1.0 - rate))


def test_nothing_is_concluded_from_two_meshes_or_from_what_does_not_settle():
    assert error_bar([0.01], [0.02, 0.01]) == math.inf
    assert error_bar([0.01, 0.0099], [0.04, 0.02, 0.01]) == math.inf
    assert error_bar([0.01, 0.005], [0.01, 0.01, 0.0099]) == math.inf
    assert error_bar([0.01, math.inf], [0.04, 0.02, 0.01]) == math.inf
    assert error_bar([1e-12, 1e-12], [1e-12] * 3) == SAFETY * NOISE


def test_a_trend_towards_inversion_needs_two_refinements_that_are_not_settling():
    # 1 - det F grows by 2^(1/2) a mesh, as strain at a clamp: 0.3, 0.42, then 0.6 and 0.85.
    assert goes_towards_inversion([0.9, 0.788, 0.7, 0.576])
    # The same from 0.1 on is 0.2 after two more meshes, far above softening at 0.577.
    assert not goes_towards_inversion([0.95, 0.929, 0.9])
    # Settling at 0.6: 1 - det F grows by 1.03 alone, to 0.41 < 0.4226.
    assert not goes_towards_inversion([0.7, 0.63, 0.62])
    assert not goes_towards_inversion([0.7, 0.5])
    assert not goes_towards_inversion([0.5, 0.6, 0.4])
    assert not goes_towards_inversion([1.2, 1.1, 1.05])
