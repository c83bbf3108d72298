"""The study of elements: findings go red on spoiled answers, and the page has its parts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Element, Problem
from palpate.meshes.quality import measure_quality
from palpate.reference.errors import ReferenceUnavailableError
from palpate.validation.peers import frontier
from palpate.validation.peers.registry import Peer
from palpate.validation.references.field_truth import STVK, time_fastsim
from palpate.validation.report.estimates import expected_error
from palpate.validation.states import Verdict
from palpate.validation.studies import elements, elements_bar
from palpate.validation.studies.elements import (
    Distortion,
    Found,
    Modes,
    Thin,
    follow_thin,
    judge_distortions,
    judge_modes,
    judge_thin,
    present,
    read_pressures,
)
from palpate.validation.studies.elements_bar import OURS, Bars, Run, follow_bars, judge_bars

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
    assert elements_bar.seconds_to(FAST, 0.05) == pytest.approx(math.sqrt(0.1))
    assert elements_bar.seconds_to(FAST, 0.5) == 0.1
    assert elements_bar.seconds_to(FAST, 0.001) is None
    assert elements_bar.orders(FAST) == [None, pytest.approx(2.0), pytest.approx(2.0)]


def sooner(who: str) -> str:
    claim = f"smoothed tetrahedra are quicker than {who} at every error from 10 to 1 %"
    return f"nu = 0.49: {claim}"


def test_who_is_quicker_is_told_error_by_error() -> None:
    same = curve(LINEAR, [0.4, 4.0, 40.0], [0.1, 0.025, 0.00625])
    assert list(elements_bar.quickness(same, FAST).values()) == pytest.approx([4.0] * 91)
    # Half a decade of error in a decade and a half of time: level at 1 s, slower before it.
    crossing = curve(LINEAR, [0.01, 1.0, 100.0], [0.1, 0.025, 0.00625])
    found = elements_bar.quickness(crossing, FAST)
    assert all((ratio > 1.0) == (level < 0.025) for level, ratio in found.items())
    told = elements_bar._in_words(found)
    assert told == "10 to 2.5 %: 1 to 10 times slower; 2.4 to 1 %: 1 to 4.6 times as quick"
    assert verdicts(crossing, FAST)[sooner(LINEAR)] is Verdict.FAILED
    # Who gets only so far is beaten from there on.
    short = curve(LINEAR, [0.4, 4.0, 5.0], [0.1, 0.025, 0.02])
    assert min(elements_bar.quickness(short, FAST).items())[1] == math.inf
    assert elements_bar._in_words(elements_bar.quickness(short, FAST)).endswith(
        "below 2 % the other never gets there"
    )


def test_what_gets_there_sooner_passes() -> None:
    found = verdicts(SLOW, FAST)
    assert len(found) == 2
    assert set(found.values()) == {Verdict.PASSED}


def test_a_smoothed_bar_that_locks_fails_its_limit() -> None:
    locked = [run._replace(error=0.06) if run.divisions == 8 else run for run in FAST]
    found = verdicts(SLOW, locked)
    assert list(found.values()) == [Verdict.FAILED, Verdict.PASSED]


def test_who_gets_there_sooner_makes_the_claim_fail() -> None:
    quick = curve(LINEAR, [0.01, 0.1, 1.0], [0.1, 0.025, 0.00625])
    assert verdicts(quick, FAST)[sooner(LINEAR)] is Verdict.FAILED


def test_where_nobody_gets_nothing_is_said() -> None:
    stiff = [run._replace(error=8.0 * run.error) for run in SLOW]
    locked = [run._replace(error=8.0 * run.error, who=SMOOTHED) for run in SLOW]
    assert verdicts(stiff, locked)[sooner(LINEAR)] is Verdict.INCONCLUSIVE


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


TRUE = np.linspace(1.0, 20.0, elements.NUM_MODES)


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
    assert len(page.tables["modes"].rows) == elements.NUM_MODES


@pytest.mark.dolfinx
@pytest.mark.once
def test_the_frequencies_of_a_small_bar_are_true_ones() -> None:
    free, clamped = elements.follow_modes(lambda _line: None, divisions=2, ratios=(0.3,))
    assert (free.num_zeros, clamped.num_zeros) == ((6, 6), (0, 0))
    for found in (free, clamped):
        # Two cells across: bending of linear tetrahedra is a third too stiff, of smoothed ones not.
        assert found.smoothed[:6] == pytest.approx(found.true[:6], rel=0.1)
        assert found.linear[0] > 1.2 * found.true[0]


def test_slivers_that_cost_more_than_smoothing_gains_fail() -> None:
    sound = Distortion(0.49, (45.0, 5.1), (0.4, 0.5), (0.01, 0.05))
    spoiled = sound._replace(smoothed=(0.01, 0.45))
    found = [finding.verdict for finding in judge_distortions([sound, spoiled])]
    assert found == [Verdict.PASSED, Verdict.FAILED]


def test_the_distorted_bar_has_slivers_and_the_same_body() -> None:
    regular, distorted = elements_bar.make_bar(4, 0.3), elements.distorted_bar(4, 0.3)
    assert distorted.mesh.volume == pytest.approx(regular.mesh.volume, rel=1e-12)
    # One step of moving less than what has 5 degrees.
    assert 5.0 <= measure_quality(distorted.mesh).smallest_dihedral_deg < 6.0


def test_pressures_of_a_uniform_field_do_not_scatter_and_waves_do() -> None:
    problem = elements_bar.make_bar(4, 0.49)
    points = problem.mesh.points
    # Swollen by one per cent: tr E = 3 (0.01 + 0.01^2 / 2); lmbda = E nu / ((1 + nu)(1 - 2 nu)).
    lmbda = 2e4 * 0.49 / (1.49 * 0.02)
    swollen = read_pressures(problem, 0.01 * points)
    assert swollen.at_nodes == pytest.approx(-lmbda * 0.03015, rel=1e-9)
    assert swollen.scatter < 1e-9
    assert len(swollen.places) == 17
    jumpy = np.random.default_rng(0).uniform(-1e-4, 1e-4, points.shape)
    rough = read_pressures(problem, jumpy)
    assert rough.scatter > 0.3
    sliver = Distortion(0.49, (45.0, 5.1), (0.4, 0.5), (0.01, 0.05))
    page = present(Found(Bars([*SLOW, *FAST], {0.49: 0.001}, ()), (), [sliver], [rough]))
    assert "averages of cells" in page.figures["pressures"].svg
    assert page.tables["distorted"].texts[1] == ["0.49", "distorted", "5.1", "0.5000", "0.0500"]
    assert len(page.tables["pressures"].rows) == 1


def test_without_the_reference_there_is_no_truth(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_args: object, **_named: object) -> None:
        raise ReferenceUnavailableError("FEniCSx (dolfinx) is not installed")

    monkeypatch.setattr(elements_bar, "solve_state", missing)
    with pytest.raises(ReferenceUnavailableError, match="FEniCSx"):
        elements.compute(lambda _line: None)


@pytest.mark.dolfinx
@pytest.mark.once
def test_tiny_bars_are_followed_and_a_spoiled_element_is_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    absent = Peer(name="none", title="none", module="no_such_module", install="soon", frontier=8)
    monkeypatch.setattr(frontier, "read_peers", lambda: (absent,))
    sizes = {Element.LINEAR: (2, 4), Element.SMOOTHED: (2, 4)}

    def follow(spoiled: bool) -> Bars:
        def solve(problem: Problem, element: Element) -> tuple[float, Points]:
            seconds, u = time_fastsim(problem, element)
            return seconds, 0.8 * u if spoiled and element is Element.SMOOTHED else u

        return follow_bars(
            lambda _line: None, ratios=(0.49,), divisions=sizes, truth_divisions=4, solve=solve
        )

    monkeypatch.setattr(elements_bar, "LIMIT_DIVISIONS", 4)
    monkeypatch.setattr(elements_bar, "LIMITS", {0.49: 0.1})
    bars = follow(spoiled=False)
    distortions, pressures = elements.follow_meshes(bars.truths, lambda _line: None, divisions=4)
    # The same solves on the regular mesh.
    assert distortions[0].smoothed[0] == pytest.approx(bars.of(0.49, SMOOTHED)[-1].error)
    assert judge_distortions(distortions)[0].verdict is Verdict.PASSED
    assert pressures[0].scatter > 0.1
    assert bars.left_out == [
        "none: not installed here: soon (PALPATE_BENCH_PYTHON names other interpreters)"
    ]
    assert min(run.error for run in bars.of(0.49, LINEAR)) > 0.5
    assert 0.0 < bars.truth_changes[0.49] < 0.03
    assert judge_bars(bars)[0].verdict is Verdict.PASSED
    assert judge_bars(follow(spoiled=True))[0].verdict is Verdict.FAILED


def test_the_rule_for_thin_bodies_is_put_to_the_test() -> None:
    # One bar of four cells at nu = 0.3: x = 1.5, k = (2 + 1.4 + 1.5) / 16, and smoothed
    # 0.5 / 64 + 1.4 * 1.5 / 29.5 / 16.
    k, smooth = 4.9 / 16, 0.5 / 64 + 1.4 * 1.5 / 29.5 / 16
    rules = [expected_error(4, 1, 0.3, element) for element in Element]
    assert rules == pytest.approx([k / (1 + k), smooth / (1 + smooth)])
    sound = Thin(0.3, 4, 1, 0.9 * rules[0], 0.7 * rules[1], *rules)
    assert [f.verdict for f in judge_thin([sound])] == [Verdict.PASSED] * 2
    for spoiled, which in (
        (sound._replace(linear=1.3 * rules[0]), 0),
        (sound._replace(linear=0.7 * rules[0]), 0),
        (sound._replace(smoothed=2.0 * rules[1]), 1),
        (sound._replace(smoothed=0.2 * rules[1]), 1),
    ):
        assert judge_thin([sound, spoiled])[which].verdict is Verdict.FAILED
    page = present(Found(Bars([*SLOW, *FAST], {0.49: 0.001}, ()), thin=[sound]))
    assert "smoothed, rule" in page.figures["thin"].svg
    assert page.tables["thin"].texts[0][:3] == ["0.3", "4", "1"]


@pytest.mark.dolfinx
@pytest.mark.once
def test_thin_bars_miss_what_the_rule_says() -> None:
    truth = elements_bar.solve_truth(elements_bar.make_bar(4, 0.3), lambda _line: None)
    found = follow_thin({0.3: truth}, lambda _line: None, through=(1, 2), slenderness=(1, 4))
    assert [(one.num_cells, one.slenderness) for one in found] == [(1, 1), (2, 1), (1, 4), (2, 4)]
    assert {finding.verdict for finding in judge_thin(found)} == {Verdict.PASSED}
    # Cells four times as long as high are worse than half as many that are not.
    by = {(one.num_cells, one.slenderness): one for one in found}
    assert by[2, 4].linear > by[1, 1].linear
    assert by[2, 4].smoothed > by[1, 1].smoothed > 5.0 * by[2, 1].smoothed
