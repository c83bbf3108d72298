"""Motions are read between the states that were sent, with how far that may be off."""

import math

import numpy as np
import pytest

from palpate.validation.exchange.time_reading import read_at

WANTED = np.linspace(0.0, 1.0, 21)


def field(values):
    """One number at one point over time, (num_times, 1, 3)."""
    return np.asarray(values)[:, None, None] * np.array([1.0, -2.0, 0.5])


def test_states_sent_at_the_times_are_taken_as_they_are():
    times = np.sort(np.append(WANTED, 0.0311)) * (1.0 + 1e-12)
    states = field(np.random.default_rng(1).standard_normal(len(times)))
    read = read_at(times, states, WANTED, slack=1e-9)
    assert read.were_sent.all()
    np.testing.assert_array_equal(read.states, states[times != times[1]])
    np.testing.assert_array_equal(read.others, read.states)


def test_cubics_are_read_exactly_between_uneven_states_and_at_the_ends():
    times = np.array([0.0, 0.11, 0.19, 0.42, 0.5, 0.77, 0.83, 1.0])
    read = read_at(times, field(times**3 - times), WANTED, slack=1e-9)
    np.testing.assert_allclose(read.states, field(WANTED**3 - WANTED), rtol=0.0, atol=1e-14)
    # A parabola is off by a product of three distances to the times: 0 at them alone.
    assert (np.abs(read.others - read.states).max(axis=(1, 2)) > 1e-6).sum() == (
        ~read.were_sent
    ).sum()


def test_the_other_reading_is_the_farther_of_two_parabolas():
    # Between four states the cubic parts from a parabola through three of them by its third
    # difference times the distances to those three: 1.3 * 0.3 * 0.7 early, 0.3 * 0.7 * 1.7 late.
    states = field(np.arange(4.0) ** 3)
    for time, farther in ((1.3, 0.3 * 0.7 * 1.7), (1.7, 1.7 * 0.7 * 0.3)):
        read = read_at(np.arange(4.0), states, np.array([time]), slack=1e-9)
        off = abs(read.others[0, 0, 0] - read.states[0, 0, 0])
        assert off == pytest.approx(farther, rel=1e-12)


@pytest.mark.parametrize("per_period", [6.5, 9.3, 21.0])
def test_the_other_reading_is_farther_off_than_the_error(per_period):
    times = np.append(np.arange(0.0, 1.0, 1.0 / (4.0 * per_period)), 1.0)
    exact = field(np.cos(8.0 * math.pi * WANTED))
    read = read_at(times, field(np.cos(8.0 * math.pi * times)), WANTED, slack=1e-9)
    error = np.abs(read.states - exact).max()
    estimate = np.abs(read.others - read.states).max()
    assert 0.0 < error < estimate
    # Of second order less one: 8 points a period leave it a few per cent of the swing.
    assert estimate < 2.0 * 0.5 * (2.0 * math.pi / per_period) ** 3


def test_two_or_three_states_are_read_with_what_they_have():
    for count in (2, 3):
        times = np.linspace(0.0, 1.0, count)
        read = read_at(times, field(times), WANTED, slack=1e-9)
        np.testing.assert_allclose(read.states, field(WANTED), rtol=0.0, atol=1e-15)
    apart = np.abs(read_at(np.array([0.0, 1.0]), field([0.0, 1.0]), WANTED, slack=0.0).others)
    assert set(np.unique(apart[:, 0, 0])) == {0.0, 1.0}


def test_numbers_that_overflow_are_no_numbers_and_no_crash():
    times = np.array([0.0, 0.3, 0.6, 1.0])
    read = read_at(times, field([0.0, 8e307, -8e307, 8e307]), WANTED, slack=1e-9)
    assert not np.isfinite(read.states).all()
