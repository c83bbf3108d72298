"""The study of elements: findings go red on spoiled answers, and the page has its parts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Element, Problem
from palpate.reference.errors import ReferenceUnavailableError
from palpate.validation.states import Verdict
from palpate.validation.studies import elements, frontier
from palpate.validation.studies.elements import Found, bar, modes, present
from palpate.validation.studies.elements.bar import OURS, Bars, Run, follow_bars, judge_bars
from palpate.validation.studies.elements.modes import Modes, judge_modes
from palpate.validation.studies.frontier import STVK, time_fastsim

LINEAR, SMOOTHED = OURS[Element.LINEAR], OURS[Element.SMOOTHED]


def curve(who: str, times: list[float], errors: list[float], law: str = STVK) -> list[Run]:
    runs = zip((4, 8, 16), times, errors, strict=True)
    return [Run(0.49, who, law, n, 24 * n**3, seconds, error) for n, seconds, error in runs]


FAST = curve(SMOOTHED, [0.1, 1.0, 10.0], [0.1, 0.025, 0.00625])
SLOW = curve(LINEAR, [0.1, 1.0, 10.0], [0.8, 0.4, 0.2])


def verdicts(*curves: list[Run]) -> dict[str, Verdict]:
    bars = Bars([run for runs in curves for run in runs], {0.49: 0.001}, ())
    return {finding.claim: finding.verdict for finding in judge_bars(bars)}


def test_a_time_to_an_error_lies_between_meshes_on_a_power() -> None:
    # From 0.1 to 0.025 in one decade of time: 0.05 is half way in both logarithms.
    assert bar.seconds_to(FAST, 0.05) == pytest.approx(math.sqrt(0.1))
    assert bar.seconds_to(FAST, 0.5) == 0.1
    assert bar.seconds_to(FAST, 0.001) is None
    assert bar.orders(FAST) == [None, pytest.approx(2.0), pytest.approx(2.0)]


def test_an_error_after_a_time_likewise() -> None:
    assert bar.error_after(FAST, math.sqrt(0.1)) == pytest.approx(0.05)
    assert bar.error_after(FAST, 0.05) is None
    assert bar.error_after(FAST, 100.0) == pytest.approx(0.00625)


def sooner(who: str) -> str:
    return f"nu = 0.49: smoothed tetrahedra are nearer the truth than {who} in the same time"


def test_what_is_nearer_in_the_same_time_passes() -> None:
    found = verdicts(SLOW, FAST)
    assert len(found) == 2
    assert set(found.values()) == {Verdict.PASSED}


def test_a_smoothed_bar_that_locks_fails_its_limit() -> None:
    locked = [run._replace(error=0.06) if run.divisions == 8 else run for run in FAST]
    found = verdicts(SLOW, locked)
    assert list(found.values()) == [Verdict.FAILED, Verdict.PASSED]


def test_who_is_nearer_in_the_same_time_makes_the_claim_fail() -> None:
    quick = curve(LINEAR, [0.01, 0.1, 1.0], [0.1, 0.025, 0.00625])
    assert verdicts(quick, FAST)[sooner(LINEAR)] is Verdict.FAILED


def test_who_has_no_run_of_comparable_time_is_neither_beaten_nor_ahead() -> None:
    brief = curve(LINEAR, [0.0001, 0.001, 0.01], [0.8, 0.4, 0.2])
    assert verdicts(brief, FAST)[sooner(LINEAR)] is Verdict.INCONCLUSIVE


def test_a_faster_rival_is_a_failed_finding_and_on_the_figure() -> None:
    rival = curve("Rival 1", [0.01, 0.1, 1.0], [0.1, 0.025, 0.00625], "neo-Hookean")
    assert verdicts(SLOW, FAST, rival)[sooner("Rival 1")] is Verdict.FAILED
    page = present(Found(Bars([*SLOW, *FAST, *rival], {0.49: 0.001}, ["other: not here"])))
    svg = page.figures["bar"].svg
    for word in (LINEAR, SMOOTHED, "Rival 1, neo-Hookean", "Poisson's ratio 0.49"):
        assert word in svg
    assert "Left out: other: not here" in page.remarks
    assert [row[-1] for row in page.tables["bar"].texts] == [
        "-", "1.00", "1.00", "-", "2.00", "2.00", "-", "2.00", "2.00"
    ]  # fmt: skip
    # Linear ones never come to 10 %, smoothed ones at once.
    assert [row[2] for row in page.tables["times"].texts] == ["-", "0.1", "0.01"]


TRUE = np.linspace(1.0, 20.0, modes.NUM_MODES)


def modes_verdicts(bar_modes: Modes) -> list[Verdict]:
    return [finding.verdict for finding in judge_modes([bar_modes])]


def test_spurious_modes_and_lost_zeros_are_seen_and_drawn() -> None:
    sound = Modes(True, 0.3, TRUE, 1.2 * TRUE, 1.01 * TRUE, (6, 6))
    assert modes_verdicts(sound) == [Verdict.PASSED] * 2
    assert modes_verdicts(sound._replace(num_zeros=(6, 7)))[0] is Verdict.FAILED
    # One frequency that is not there moves all above it down by a place.
    spurious = np.sort(np.append(TRUE, 3.5))[:-1]
    assert modes_verdicts(sound._replace(smoothed=spurious))[1] is Verdict.FAILED
    page = present(Found(Bars([*SLOW, *FAST], {0.49: 0.001}, ()), [sound]))
    assert "free bar, nu = 0.3" in page.figures["modes"].svg
    assert len(page.tables["modes"].rows) == modes.NUM_MODES


@pytest.mark.dolfinx
def test_the_frequencies_of_a_small_bar_are_true_ones() -> None:
    free, clamped = modes.follow_modes(lambda _line: None, divisions=2, ratios=(0.3,))
    assert (free.num_zeros, clamped.num_zeros) == ((6, 6), (0, 0))
    for found in (free, clamped):
        # Two cells across: bending of linear tetrahedra is a third too stiff, of smoothed ones not.
        assert found.smoothed[:6] == pytest.approx(found.true[:6], rel=0.1)
        assert found.linear[0] > 1.2 * found.true[0]


def test_without_the_reference_there_is_no_truth(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_args: object, **_named: object) -> None:
        raise ReferenceUnavailableError("FEniCSx (dolfinx) is not installed")

    monkeypatch.setattr(bar, "solve_state", missing)
    with pytest.raises(ReferenceUnavailableError, match="FEniCSx"):
        elements.compute(lambda _line: None)


@pytest.mark.dolfinx
def test_tiny_bars_are_followed_and_a_spoiled_element_is_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(frontier, "_ADAPTERS", (("none", "no_such_module", 8),))
    sizes = {Element.LINEAR: (2, 4), Element.SMOOTHED: (2, 4)}

    def follow(spoiled: bool) -> Bars:
        def solve(problem: Problem, element: Element) -> tuple[float, Points]:
            seconds, u = time_fastsim(problem, element)
            return seconds, 0.8 * u if spoiled and element is Element.SMOOTHED else u

        return follow_bars(
            lambda _line: None, ratios=(0.49,), divisions=sizes, truth_divisions=4, solve=solve
        )

    monkeypatch.setattr(bar, "LIMIT_DIVISIONS", 4)
    monkeypatch.setattr(bar, "LIMITS", {0.49: 0.1})
    bars = follow(spoiled=False)
    assert bars.left_out == [
        "none: no_such_module is not installed (PALPATE_BENCH_PYTHON names others)"
    ]
    assert min(run.error for run in bars.of(0.49, LINEAR)) > 0.5
    assert 0.0 < bars.truth_changes[0.49] < 0.03
    assert judge_bars(bars)[0].verdict is Verdict.PASSED
    assert judge_bars(follow(spoiled=True))[0].verdict is Verdict.FAILED
