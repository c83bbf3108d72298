"""Turek-Hron CSM3: the published swing of a bar, by implicit dynamics of degree 2."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.validation.states import Verdict
from palpate.validation.studies.csm3 import (
    COARSE,
    CONVERGED,
    RUNS,
    Period,
    Swing,
    bar_problem,
    farthest,
    fit,
    judge,
    present,
    swing,
)


def test_the_fit_finds_a_swing_beside_a_second_mode():
    times = np.arange(0.0, 10.0, 0.02)
    values = -64.0 + 65.0 * np.cos(2.0 * math.pi * 1.0955 * times + 0.3)
    values += 0.8 * np.sin(2.0 * math.pi * 6.9 * times)
    frequency, level, harmonic = fit(times, values)
    assert frequency == pytest.approx(1.0955, abs=5e-5)
    assert level == pytest.approx(-64.0, abs=0.05)
    assert harmonic == pytest.approx(65.0, abs=0.05)


def test_the_bar_is_the_published_one():
    problem, place = bar_problem(2, 0.02)
    assert problem.mesh.points[place] == pytest.approx([0.6, 0.2, 0.0], abs=1e-12)
    clamped = problem.mesh.points[problem.supports[0].points]
    assert np.hypot(*(clamped[:, :2] - 0.2).T) == pytest.approx(0.05, abs=1e-12)
    material = problem.material
    assert material.youngs_modulus / 2.0 / (1.0 + material.poissons_ratio) == pytest.approx(0.5e6)


def published_swings(factor: float = 1.0, order: int = 2) -> list[Swing]:
    """Frequencies that converge to the published one, on the fine mesh; a path of no interest."""
    swings = []
    for layers, dt in RUNS:
        off = 1.0 - 10.0 * dt**order
        mean, amplitude, frequency = COARSE if dt == 0.02 else CONVERGED
        frequency = factor * (frequency if dt == 0.02 else CONVERGED.frequency * off)
        path = np.zeros((round(10.0 / dt) + 1, 2))
        harmonic = factor * CONVERGED.amplitude[1]
        last = Period(mean, amplitude, frequency)
        swings.append(Swing(layers, dt, last, mean[1], harmonic, 1e-3, path))
    return swings


def test_the_published_swing_passes_and_others_fail():
    assert [f.verdict for f in judge(published_swings())] == [Verdict.PASSED] * 4
    faster = [f.verdict for f in judge(published_swings(1.02))]
    assert faster[:3] == [Verdict.FAILED] * 3
    assert judge(published_swings(order=1))[3].verdict is Verdict.FAILED


def test_the_page_has_every_run_and_four_seconds_of_each():
    page = present(published_swings())
    assert len(page.tables["swing"].rows) == len(RUNS)
    assert "4 layers, 0.01 s" in page.figures["swing"].svg
    assert page.numbers["frequency"] == pytest.approx(CONVERGED.frequency, rel=0.005)


@pytest.mark.nightly
@pytest.mark.dolfinx
@pytest.mark.slow
def test_the_published_row_of_this_time_step_is_met_within_one_per_cent():
    found = swing(2, 0.02)
    assert farthest(found.last, COARSE) < 0.01
    # Converged figures: the time step alone is worth 0.2 % of the frequency.
    assert found.last.frequency == pytest.approx(CONVERGED.frequency, rel=0.006)
    assert found.first_harmonic == pytest.approx(CONVERGED.amplitude[1], rel=0.005)
