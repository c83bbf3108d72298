"""Oscillations are taken apart exactly, and their errors are those that were put in."""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np
import pytest

from palpate.meshes.errors import InputError
from palpate.validation.metrics.time_series import (
    OscillationError,
    _first_guess,
    _misfit,
    fit_oscillation,
    fit_uncertainty,
    oscillation_error,
)

TIMES = np.linspace(0.3, 2.3, 101)
WORDS = [field.name for field in fields(OscillationError)]


def cosine(
    mean: float = 0.5, amplitude: float = 2.0, frequency: float = 3.3,
    phase: float = 0.4, damping: float = 0.7,
) -> np.ndarray:  # type: ignore[type-arg]  # fmt: skip
    t = TIMES - TIMES[0]
    wave = np.cos(2 * math.pi * frequency * t + phase)
    return mean + amplitude * np.exp(-damping * t) * wave


@pytest.mark.parametrize("phase", [-3.0, -1.0, 0.4, 2.9])
@pytest.mark.parametrize("damping", [0.0, 0.7, 3.0])
@pytest.mark.parametrize("frequency", [0.9, 3.3, 17.0])
def test_a_damped_cosine_is_recovered(phase: float, damping: float, frequency: float) -> None:
    found = fit_oscillation(TIMES, cosine(phase=phase, damping=damping, frequency=frequency))
    assert found.mean == pytest.approx(0.5, abs=1e-8)
    assert found.amplitude == pytest.approx(2.0, rel=1e-7)
    assert found.frequency == pytest.approx(frequency, rel=1e-8)
    assert found.phase == pytest.approx(phase, abs=1e-7)
    assert found.damping == pytest.approx(damping, abs=1e-7)
    assert found.misfit < 1e-9


def test_errors_are_those_put_in() -> None:
    reference = fit_oscillation(TIMES, cosine())
    candidate = fit_oscillation(TIMES, cosine(mean=0.6, amplitude=2.1, frequency=3.33, damping=0.9))
    error = oscillation_error(candidate, reference, 2.0)
    assert error.amplitude == pytest.approx(0.05, rel=1e-6)
    assert error.frequency == pytest.approx(0.03 / 3.3, rel=1e-6)
    # 0.03 Hz over 2 s is 0.06 periods behind.
    assert error.phase == pytest.approx(0.06, rel=1e-5)
    assert error.damping == pytest.approx(0.2 / 3.3, rel=1e-5)
    assert error.mean == pytest.approx(0.1 / 2.0, rel=1e-6)


def test_phase_does_not_jump_by_a_turn() -> None:
    early, late = (
        fit_oscillation(TIMES, cosine(phase=p)) for p in (-math.pi + 0.01, math.pi - 0.01)
    )
    assert oscillation_error(early, late, 2.0).phase == pytest.approx(
        0.02 / (2 * math.pi), rel=1e-5
    )


def test_noise_and_a_second_mode_move_the_fit_little_and_show_in_the_misfit() -> None:
    noisy = cosine() + 0.05 * cosine(mean=0.0, amplitude=2.0, frequency=11.0)
    found = fit_oscillation(TIMES, noisy)
    assert found.frequency == pytest.approx(3.3, rel=5e-3)
    assert 0.01 < found.misfit < 0.1


@pytest.mark.parametrize(
    ("times", "values", "message"),
    [
        (TIMES, np.ones(101), "does not oscillate"),
        (TIMES[:5], np.arange(5.0), "12 samples"),
        (TIMES, np.full(101, np.nan), "finite"),
        (TIMES[::-1], cosine(), "increasing"),
        (TIMES, cosine(frequency=0.4, damping=0.0), "periods"),
    ],
)
def test_what_shows_nothing_is_refused(times: object, values: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        fit_oscillation(times, values)  # type: ignore[arg-type]


@pytest.mark.parametrize("ratio", [2.7, 4.3, 6.27])
def test_another_mode_makes_the_fit_uncertain_by_about_what_it_does(ratio: float) -> None:
    """A second mode a tenth as large, at every phase: errors stay near what is told."""
    exact = fit_oscillation(TIMES, cosine())
    worst = dict.fromkeys(WORDS, 0.0)
    reported = dict.fromkeys(WORDS, 0.0)
    for phase in np.linspace(0.0, 2.0 * math.pi, 8, endpoint=False):
        second = cosine(0.0, 0.2, 3.3 * ratio, float(phase))
        series = cosine() + second
        error = oscillation_error(fit_oscillation(TIMES, series), exact, 2.0)
        uncertainty = fit_uncertainty(TIMES, series)
        for word in WORDS:
            worst[word] = max(worst[word], getattr(error, word))
            reported[word] = max(reported[word], getattr(uncertainty, word))
    for word in WORDS:
        assert worst[word] <= 1.5 * reported[word], word
        assert reported[word] <= 10.0 * worst[word], word
    # Of one cosine alone there is nothing to be uncertain of.
    alone = fit_uncertainty(TIMES, cosine())
    assert all(getattr(alone, word) < 1e-7 for word in WORDS)


@pytest.mark.parametrize("count", [12, 15, 30])
@pytest.mark.parametrize("periods", [1.6, 2.0, 4.0])
def test_a_short_series_is_uncertain_and_never_a_crash(count: int, periods: float) -> None:
    times = np.linspace(0.0, 1.0, count)
    wave = 1.0 + np.exp(-times) * np.cos(2.0 * math.pi * periods * times + 0.3)
    rough = wave + 0.05 * np.sin(37.0 * np.arange(count) ** 2)
    clean, noisy = fit_uncertainty(times, wave), fit_uncertainty(times, rough)
    for word in WORDS:
        assert getattr(clean, word) < 1e-6
        assert np.isfinite(getattr(noisy, word))
    assert noisy.amplitude > 1e-3


@pytest.mark.parametrize("are_even", [True, False])
@pytest.mark.parametrize("damping", [0.0, 1.5, 6.0])
def test_the_first_guess_is_the_best_of_the_whole_grid(damping: float, are_even: bool) -> None:
    # Every fit of the grid by itself, by least squares: what the quick choice must not miss.
    random = np.random.default_rng(12)
    t = TIMES - TIMES[0] if are_even else np.sort(random.uniform(0.0, 2.0, 60))
    t = t - t[0]
    for frequency in random.uniform(0.8, 14.0, 4):
        swing = np.exp(-damping * t) * np.cos(2 * math.pi * frequency * t + 1.0)
        x = 3.0 + swing + 0.2 * np.cos(31.0 * t) + 0.05 * random.standard_normal(len(t))
        grid = [
            (float(np.sum(_misfit(t, x, w, g) ** 2)), float(w), float(g))
            for w in 0.5 * math.pi / t[-1] * np.arange(2, 2 * (len(t) - 1))
            for g in np.array([0.0, 1.0, 3.0, 6.0]) / t[-1]
        ]
        assert _first_guess(t, x) == min(grid)[1:]
