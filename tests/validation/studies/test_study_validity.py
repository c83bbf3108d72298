"""The validity map: closed forms, small maps, and findings that go red."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from palpate.fastsim.statics import StaticResult, solve_static
from palpate.meshes.problem import Problem
from palpate.validation.report.study_page import Finding, Page, judged, leave
from palpate.validation.states import Verdict
from palpate.validation.studies.closed_forms import (
    COMPRESSION_LIMIT,
    elastica_error,
    elastica_shape,
    stretch_under,
)
from palpate.validation.studies.validity import (
    Found,
    bending_table,
    draw_map,
    draw_modes,
    draw_rotation,
    judge,
    judge_bending,
    judge_checks,
    judge_modes,
    mode_table,
    present,
)
from palpate.validation.studies.validity_loads import (
    HOMOGENEOUS,
    MOST,
    BendingLimit,
    BendingPoint,
    DegreeCheck,
    Mode,
    border,
    check_by_quadratic,
    closed_form,
    find_limit,
    find_mode_limit,
    follow_bar,
    follow_mode,
)

SLENDERNESSES, POISSONS_RATIOS = (4.0, 8.0), (0.0, 0.3)
DEFLECTIONS = (0.015, 0.03, 0.06, 0.12, 0.24)


@pytest.fixture(scope="module")
def bars() -> list[BendingPoint]:
    return [
        p
        for length in SLENDERNESSES
        for nu in POISSONS_RATIOS
        for p in follow_bar(length, nu, 3, DEFLECTIONS)
    ]


@pytest.fixture(scope="module")
def ends() -> list[BendingLimit]:
    return [find_limit(L, nu, 3) for L in SLENDERNESSES for nu in POISSONS_RATIOS]


def verdicts(findings: list[Finding]) -> list[Verdict]:
    return [f.verdict for f in findings]


# Bisshopp and Drucker's elastica, alpha -> (-u/L, w/L): TARGETS section 2.
@pytest.mark.parametrize(
    ("load", "back", "down"),
    [
        (1.0, 0.05643324, 0.30172077),
        (2.0, 0.16064172, 0.49345748),
        (4.0, 0.32894124, 0.66996418),
        (10.0, 0.55499560, 0.81060902),
    ],
)
def test_the_elastica_is_the_published_one(load: float, back: float, down: float) -> None:
    _, u, w = elastica_shape(load)
    assert -u[-1] == pytest.approx(back, abs=2e-8)
    assert w[-1] == pytest.approx(down, abs=2e-8)


def test_a_small_load_bends_linearly_but_for_the_shortening() -> None:
    # u is quadratic in the load: the error is of first order.
    assert elastica_error(0.02) == pytest.approx(2.0 * elastica_error(0.01), rel=1e-3)


# TARGETS section 2: P / E = l (l^2 - 1) / 2.
@pytest.mark.parametrize(
    ("stretch", "stress"), [(0.8, -0.144), (0.9, -0.0855), (1.1, 0.1155), (1.5, 0.9375)]
)
def test_the_stretch_under_a_stress(stretch: float, stress: float) -> None:
    assert stretch_under(stress) == pytest.approx(stretch, rel=1e-12)
    with pytest.raises(ValueError, match="no equilibrium"):
        stretch_under(-1.001 * COMPRESSION_LIMIT)


def test_closed_forms_of_a_state_worked_out_by_hand() -> None:
    # l = 1.1, nu = 0.3: lateral 0.9679876; linear: 1.1155 and 1 - 0.3 * 0.1155 = 0.96535.
    found = closed_form(Mode.STRETCH, 0.3, 0.1155)
    assert found is not None
    error, linear, green = found
    assert green == pytest.approx(1.1 * 0.9679876**2 - 1.0, abs=2e-7)
    assert linear == pytest.approx(1.1155 * 0.96535**2 - 1.0, abs=1e-12)
    difference = math.hypot(0.0155, *[0.96535 - 0.9679876] * 2)
    assert error == pytest.approx(difference / math.hypot(0.1, *[1 - 0.9679876] * 2), rel=1e-5)


def test_modes_go_green_and_a_softer_simulator_red() -> None:
    points = [p for mode in Mode for p in follow_mode(mode, 0.3, cells_across=2)]
    ends = {(mode, 0.3): find_mode_limit(mode, 0.3) for mode in Mode}
    assert verdicts(judge_modes(points, ends)) == [Verdict.PASSED] * 2
    assert len(mode_table(points, ends).rows) == len(Mode)
    assert "<svg" in draw_modes(points, 0.3).svg

    def softer(problem: Problem, **given: Any) -> StaticResult:
        found = solve_static(problem, **given)
        return dataclasses.replace(found, displacement=1.02 * found.displacement)

    soft = [p for mode in HOMOGENEOUS for p in follow_mode(mode, 0.3, solve=softer)]
    assert verdicts(judge_modes(soft, ends))[0] is Verdict.FAILED
    early: dict[tuple[Mode, float], tuple[float, float] | None] = {
        **ends,
        (Mode.COMPRESSION, 0.3): (0.19, 0.62),
    }
    assert verdicts(judge_modes(points, early))[1] is Verdict.FAILED
    never: dict[tuple[Mode, float], tuple[float, float] | None] = {
        **ends,
        (Mode.COMPRESSION, 0.3): None,
    }
    assert verdicts(judge_modes(points, never))[1] is Verdict.FAILED


def test_a_limit_is_told_in_what_linear_strain_predicts(monkeypatch: pytest.MonkeyPatch) -> None:
    # Whatever is tried at most, the limit is the same, to the steps of the load.
    first = find_mode_limit(Mode.CONFINED_COMPRESSION, 0.3)
    monkeypatch.setitem(MOST, Mode.CONFINED_COMPRESSION, 0.5)
    second = find_mode_limit(Mode.CONFINED_COMPRESSION, 0.3)
    assert first is not None
    assert second is not None
    assert first[0] == pytest.approx(second[0], abs=2.0 * 0.5 / 8192.0)
    assert find_mode_limit(Mode.STRETCH, 0.3) is None


def test_a_small_map_shows_what_the_whole_one_claims(
    bars: list[BendingPoint], ends: list[BendingLimit]
) -> None:
    assert verdicts(judge_bending(bars, ends)) == [Verdict.PASSED] * 4
    table = bending_table(bars, ends)
    assert len(table.rows) == 4
    assert all(row[2] < row[3] < row[4] < row[-2] for row in table.rows)


def test_a_bent_bar_that_is_spoiled_turns_the_findings_red(
    bars: list[BendingPoint], ends: list[BendingLimit]
) -> None:
    # Stiffer than it should be where Poisson's ratio is 0.3.
    wrong = [
        dataclasses.replace(p, displacement_error=p.displacement_error * (1 + p.poissons_ratio))
        for p in bars
    ]
    assert verdicts(judge_bending(wrong, ends))[0] is Verdict.FAILED
    assert verdicts(judge_bending(wrong, ends))[2] is Verdict.FAILED
    kept = [dataclasses.replace(p, linear_volume_change=p.green_volume_change) for p in bars]
    assert verdicts(judge_bending(kept, ends))[1] is Verdict.FAILED
    early = [m._replace(deflection=0.1) for m in ends]
    assert verdicts(judge_bending(bars, early))[3] is Verdict.FAILED


def test_a_border_is_where_a_power_law_crosses_it() -> None:
    loads = (0.01, 0.05, 0.25)
    errors = [0.5 * x for x in loads]
    assert border(errors, loads, 0.1) == pytest.approx(0.2, rel=1e-12)
    assert border(errors, loads, 0.2) is None


def test_quadratic_tetrahedra_that_disagree_are_seen(bars: list[BendingPoint]) -> None:
    p = bars[0]
    good = DegreeCheck(p, 1.02 * p.displacement_error, 0.97 * p.volume_error, 1.2)
    bad = good._replace(volume_error=1.08 * p.volume_error)
    assert verdicts(judge_checks([good])) == [Verdict.PASSED]
    assert verdicts(judge_checks([good, bad])) == [Verdict.FAILED]
    assert judge_checks([]) == []


@pytest.mark.dolfinx
def test_quadratic_tetrahedra_agree_on_a_small_bar() -> None:
    (point,) = follow_bar(2.0, 0.3, 4, (0.1,))
    check = check_by_quadratic(point, 2, lambda _line: None)
    # P1 is too stiff in bending, and yet the error of linear strain is the same.
    assert check.load_ratio > 1.05
    assert check.displacement_ratio == pytest.approx(1.0, abs=0.05)
    assert check.volume_ratio == pytest.approx(1.0, abs=0.05)


def test_the_page_stands_alone(
    bars: list[BendingPoint], ends: list[BendingLimit], tmp_path: Path
) -> None:
    page = Page(
        figures={
            "map": draw_map(bars, ends, 0.3, slenderness=4.0),
            "rotation": draw_rotation(bars, 0.3),
        },
        tables={"bending": bending_table(bars, ends)},
        numbers={"points": [dataclasses.asdict(p) for p in bars]},
    )
    code = leave(
        tmp_path,
        Console(record=True, width=200),
        name="validity",
        title="A <map>",
        about=["Why."],
        findings=[judged("a claim", "a, b", True), judged("another", "c", False)],
        page=page,
    )
    assert code == 1
    names = {"report.html", "map.svg", "rotation.svg", "bending.csv", "results.json"}
    assert {f.name for f in tmp_path.iterdir()} == names
    html = (tmp_path / "report.html").read_text("utf-8")
    assert "A &lt;map&gt;" in html
    assert "http" not in html.replace("http-equiv", "").replace("http://www.w3.org", "")
    rows = np.genfromtxt(tmp_path / "bending.csv", delimiter=",", skip_header=1)
    assert rows.shape == (4, 13)


def test_what_was_found_is_judged_and_shown_whole(
    bars: list[BendingPoint], ends: list[BendingLimit]
) -> None:
    modes = [p for mode in Mode for p in follow_mode(mode, 0.3, cells_across=2)]
    mode_ends = {(mode, 0.3): find_mode_limit(mode, 0.3) for mode in Mode}
    check = DegreeCheck(bars[0], bars[0].displacement_error, bars[0].volume_error, 1.2)
    finer = find_limit(4.0, 0.3, 4)
    found = Found(bars, ends, finer, modes, mode_ends, [check])
    assert verdicts(judge(found)) == [Verdict.PASSED] * 7
    page = present(found)
    assert set(page.figures) == {"map", "rotation", "modes"}
    assert len(page.tables["points"].rows) == len(bars)
    assert page.tables["quadratic"].texts[0][-1] == "1.200"
    assert len(page.remarks) == 1
    assert "with 3 bricks across" in page.remarks[0]
    assert "FEniCSx is not here" in present(found._replace(checks=[])).remarks[0]
