"""Bodies that are held still: whether they rest, and how far they still have to go."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.validation.live.hand import Settling

TICK = 0.01


def at(u: float) -> list[np.ndarray]:
    return [np.array([[u, 0.0, 0.0], [0.0, 0.5 * u, 0.0]])]


def test_a_decay_is_waited_for_and_the_rest_of_its_way_is_told() -> None:
    """From 1 to 2 as 2 - exp(-rate t), of which exp(-rate t) is left."""
    settling, rate, ticks = Settling(TICK), 6.0, 0
    while not settling.is_over:
        ticks += 1
        u = 2.0 - math.exp(-rate * TICK * ticks)
        if settling.note(at(u)) and math.isfinite(settling.to_go):
            # Never too small, and not more than twice.
            assert 0.9 < settling.to_go * u / (2.0 - u) < 2.0
    assert settling.rests
    assert 0.7 < TICK * ticks < 1.5
    assert settling.says.startswith("settled")


def test_what_swings_on_is_not_at_rest() -> None:
    settling, time = Settling(TICK), 0.0
    while not settling.is_over:
        time += TICK
        settling.note(at(2.0 + math.sin(80.0 * time)))
    assert not settling.rests
    assert time == pytest.approx(10.0)
    assert "not at rest after 10 s" in settling.says


def test_rounding_and_bodies_that_nothing_acts_on_are_rest() -> None:
    for swing, size in ((1e-12, 1.0), (0.0, 0.0)):
        settling, time = Settling(TICK), 0.0
        while not settling.is_over:
            time += TICK
            settling.note(at(size + swing * math.sin(80.0 * time)))
        assert settling.rests
        assert time < 0.3
