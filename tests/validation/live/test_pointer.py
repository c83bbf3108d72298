"""The pointer's way: exact times, no faster than allowed, back out; whether bodies are at rest."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.validation.live.pointer import Clock, Pointer, Settling


def pointer(way: float = 0.5) -> Pointer:
    return Pointer(np.array([0.0, 0.0, 10.0]), np.array([0.0, 0.0, 1.0]), way, digits=6)


@pytest.mark.parametrize("largest", [9.562e-4, 1.7e-5, 3.3e-3, 0.02])
def test_times_of_ticks_are_exact(largest: float) -> None:
    clock = Clock.of(largest, 1.0 / 120.0)
    assert largest * (1 - 2e-6) < clock.time_step <= largest
    assert clock.tick == pytest.approx(1.0 / 120.0, rel=0.5, abs=largest)
    for ticks in (1, 3, 1201, 3599):
        steps = ticks * clock.steps
        # As a run of a case finds its step again.
        assert ticks * clock.tick / steps == clock.time_step
        assert ticks * clock.tick == steps * clock.time_step


def test_the_tool_goes_no_faster_than_it_may_and_arrives() -> None:
    one = pointer()
    goal = np.array([3.0, 0.0, 6.123456789])
    one.send(goal)
    last = one.position
    for _ in range(20):
        position = one.next_position()
        assert np.linalg.norm(position - last) <= 0.5 + 1e-6
        last = position
    np.testing.assert_array_equal(one.position, np.round(goal, 6))


def test_the_tool_slows_down_where_there_is_little_room() -> None:
    one = pointer()
    one.send(np.array([0.0, 0.0, 0.0]))
    ways = -np.diff([one.next_position(room)[2] for room in (1.0, 1.0, 0.5, 0.2, 0.01, 7.0)])
    np.testing.assert_allclose(ways, [0.5, 0.25, 0.1, 0.05, 0.5], atol=1e-6)
    assert not one.is_held_back


def test_the_tool_goes_back_on_its_way_while_a_body_takes_no_more() -> None:
    one = pointer()
    one.send(np.array([0.0, 0.0, 0.0]))
    way = [one.next_position().copy() for _ in range(9)]
    back = [one.next_position(0.0).copy() for _ in range(2)]
    # Five times as fast as it came, and not beyond where it began.
    np.testing.assert_array_equal(back, [way[3], [0.0, 0.0, 10.0]])
    # Where it stands, away from the hand, it says so until it is moved again.
    one.next_position()
    assert one.is_held_back
    one.send(np.array([0.0, 0.0, 5.0]))
    one.next_position()
    assert not one.is_held_back


def test_a_tool_that_is_withdrawn_leaves_along_the_way_out_before_it_goes_aside() -> None:
    one = pointer()
    one.send(np.array([4.0, 0.0, 2.0]))
    for _ in range(40):
        one.next_position()
    one.withdraw()
    positions = np.array([one.next_position().copy() for _ in range(40)])
    assert (np.abs(positions[:16, 0] - 4.0) < 1e-6).all()
    np.testing.assert_array_equal(positions[-1], [0.0, 0.0, 10.0])


def test_a_tool_that_is_withdrawn_goes_on_after_a_body_has_pushed_it_back() -> None:
    """Pressed so deep that it retreats just then, it stayed in the body for ever."""
    one = pointer()
    one.send(np.array([0.0, 0.0, 0.0]))
    for _ in range(15):
        one.next_position()
    one.withdraw()
    one.next_position(0.0)
    assert one.is_held_back
    for _ in range(40):
        one.next_position()
    np.testing.assert_array_equal(one.position, [0.0, 0.0, 10.0])


TICK = 0.01


def at(u: float) -> list[np.ndarray]:
    return [np.array([[u, 0.0, 0.0], [0.0, 0.5 * u, 0.0]])]


def test_a_decay_is_waited_for_and_the_rest_of_its_motion_is_stated() -> None:
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
