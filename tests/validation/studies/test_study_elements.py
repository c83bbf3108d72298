"""The study of elements: findings go red on spoiled answers, and the page has its parts."""

from __future__ import annotations

import math

import pytest

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Element, Problem
from palpate.reference.errors import ReferenceUnavailableError
from palpate.validation.states import Verdict
from palpate.validation.studies import elements, frontier
from palpate.validation.studies.elements import Found, bar, present
from palpate.validation.studies.elements.bar import OURS, Bars, Run, follow_bars, judge_bars
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


def test_what_is_nearer_in_the_same_time_passes() -> None:
    found = verdicts(SLOW, FAST)
    assert len(found) == 2
    assert set(found.values()) == {Verdict.PASSED}


def test_a_smoothed_bar_that_locks_fails_its_limit_and_the_comparison() -> None:
    locked = [run._replace(error=0.06) if run.divisions == 8 else run for run in FAST]
    assert list(verdicts(SLOW, locked).values()).count(Verdict.FAILED) == 1
    quick = curve(LINEAR, [0.001, 0.01, 0.1], [0.1, 0.025, 0.00625])
    by_claim = verdicts(quick, FAST)
    claim = "nu = 0.49: smoothed tetrahedra reach 10 % to 1 % sooner than linear ones"
    assert by_claim[claim] is Verdict.FAILED


def test_who_was_stopped_before_is_neither_beaten_nor_ahead() -> None:
    brief = curve(LINEAR, [0.0001, 0.001, 0.01], [0.8, 0.4, 0.2])
    assert Verdict.INCONCLUSIVE in verdicts(brief, FAST).values()
    coarse = [run._replace(error=10 * run.error) for run in FAST]
    assert Verdict.INCONCLUSIVE in verdicts(SLOW, coarse).values()


def test_a_faster_rival_is_a_failed_finding_and_on_the_figure() -> None:
    rival = curve("Rival 1", [0.01, 0.1, 1.0], [0.1, 0.025, 0.00625], "neo-Hookean")
    found = verdicts(SLOW, FAST, rival)
    assert found["nu = 0.49: smoothed tetrahedra reach 10 % to 1 % sooner than Rival 1"] is (
        Verdict.FAILED
    )
    page = present(Found(Bars([*SLOW, *FAST, *rival], {0.49: 0.001}, ["other: not here"])))
    svg = page.figures["bar"].svg
    for word in (LINEAR, SMOOTHED, "Rival 1, neo-Hookean", "Poisson's ratio 0.49"):
        assert word in svg
    assert "Left out: other: not here" in page.remarks
    assert [row[-1] for row in page.tables["bar"].texts] == [
        "-", "1.00", "1.00", "-", "2.00", "2.00", "-", "2.00", "2.00"
    ]  # fmt: skip


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
    assert [run.error for run in bars.of(0.49, LINEAR)] > [0.5, 0.5]
    assert 0.0 < bars.truth_changes[0.49] < 0.03
    assert judge_bars(bars)[0].verdict is Verdict.PASSED
    assert judge_bars(follow(spoiled=True))[0].verdict is Verdict.FAILED
