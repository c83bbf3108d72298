"""The validity map: small maps, findings that go red, and closed forms that its numbers equal."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.integrate import solve_ivp, trapezoid
from scipy.optimize import brentq

from palpate.meshes.arrays import Floats
from palpate.meshes.field_norms import l2_norm
from palpate.meshes.problem import Problem, Strain
from palpate.validation.report.study_page import study_page
from palpate.validation.states import Verdict
from palpate.validation.studies import validity
from palpate.validation.studies.validity import (
    End,
    Found,
    Point,
    Series,
    deflection,
    find_end,
    follow,
    judge,
    make_bar,
    present,
)

DEFLECTIONS = (0.015, 0.03, 0.06, 0.12, 0.24)


@pytest.fixture(scope="module")
def found() -> Found:
    which = list(product((4.0, 8.0), (0.0, 0.3)))
    return Found(
        [follow(L, nu, DEFLECTIONS, cells_across=3) for L, nu in which],
        [find_end(L, nu, 3) for L, nu in which],
        find_end(4.0, 0.3, 4),
    )


def with_errors(bar: Series, factor: float) -> Series:
    points = [p._replace(displacement_error=factor * p.displacement_error) for p in bar.points]
    return bar._replace(points=tuple(points))


def test_a_small_map_shows_what_the_whole_one_claims(found: Found) -> None:
    assert [f.verdict for f in judge(found)] == [Verdict.PASSED] * 2
    page = present(found)
    assert set(page.figures) == {"map", "rotation"}
    assert all(row[2] < row[3] < row[4] < row[-2] for row in page.tables["bending"].rows)
    assert len(page.tables["points"].rows) == 4 * len(DEFLECTIONS)
    assert "is lost at P L^2/(E I)" in page.remarks[0]
    assert "was not reached" in present(found._replace(finer=None)).remarks[0]
    html = study_page("A <map>", [], judge(found), page)
    assert "A &lt;map&gt;" in html
    assert "http" not in html.replace("http-equiv", "").replace("http://www.w3.org", "")


def test_findings_go_red(found: Found) -> None:
    # Stiffer than it should be where Poisson's ratio is 0.3.
    bars = [with_errors(bar, 1.0 + bar.poissons_ratio) for bar in found.bars]
    assert judge(found._replace(bars=bars))[0].verdict is Verdict.FAILED
    early = [End(0.1, 1.0)] * len(found.bars)
    assert judge(found._replace(ends=early))[1].verdict is Verdict.FAILED


def test_a_border_is_where_a_power_law_crosses_it() -> None:
    points = [Point(x, x, 0.5 * x, 0.0, 0.0, 2.0 * x, 0.0) for x in (0.01, 0.05, 0.25)]
    bar = Series(1.0, 0.3, tuple(points))
    assert bar.border(0.1) == pytest.approx(0.2, rel=1e-12)
    assert bar.border(0.1, measure="rotation") == pytest.approx(0.4, rel=1e-12)
    assert bar.border(0.2) is None


def elastica(load: float) -> tuple[Floats, Floats, Floats]:
    """Arc length s, u = x - s and w (towards the load) over the length of a bar that only bends.

    E I theta'' = -P cos theta, theta(0) = 0, theta'(L) = 0; x' = cos theta, w' = sin theta
    (Bisshopp and Drucker, Quart. Appl. Math. 3 (1945) 272-275), load P L^2 / (E I), by shooting.
    """

    def rate(_s: float, y: Floats) -> Floats:
        return np.array([y[1], -load * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    def shoot(curvature: float) -> Floats:
        start, s = [0.0, curvature, 0.0, 0.0], np.linspace(0.0, 1.0, 121)
        path: Floats = solve_ivp(rate, (0, 1), start, t_eval=s, rtol=1e-11, atol=1e-12).y
        return path

    _, _, x, w = shoot(brentq(lambda curvature: shoot(curvature)[1, -1], 0.0, load, xtol=1e-13))
    s = np.linspace(0.0, 1.0, 121)
    return s, x - s, w


@pytest.mark.parametrize(
    ("slenderness", "cells_across", "ratios", "deflections"),
    [
        (8.0, 3, (0.0, 0.3), DEFLECTIONS),
        pytest.param(
            16.0, validity.CELLS_ACROSS, validity.POISSONS_RATIOS,
            # Beyond, the shooting has more than one root.
            [d for d in validity.DEFLECTIONS if d <= 1.0], marks=pytest.mark.nightly,
        ),
    ],
)  # fmt: skip
def test_a_slender_bar_errs_as_the_elastica(
    slenderness: float, cells_across: int, ratios: list[float], deflections: list[float]
) -> None:
    _, back, down = elastica(4.0)
    # Published: TARGETS section 2.
    assert (-back[-1], down[-1]) == pytest.approx((0.32894124, 0.66996418), abs=2e-8)
    for nu in ratios:
        bar = follow(slenderness, nu, deflections, cells_across=cells_across)
        for p in bar.points:
            load = 3.0 * p.nominal
            s, u, w = elastica(load)
            # Linear bending: w = load (s^2 / 2 - s^3 / 6), u = 0. The rule is the trapezoidal one.
            linear = load * (s**2 / 2.0 - s**3 / 6.0)
            off, size = trapezoid(u**2 + (linear - w) ** 2), trapezoid(u**2 + w**2)
            assert p.displacement_error == pytest.approx(np.sqrt(off / size), rel=0.05)
            # Linear strain invents the volume of its rotations, the mean of theta^2 along the bar:
            # 2/15 load^2 of the body.
            if p.nominal >= 0.05:
                assert p.linear_volume_change == pytest.approx(1.2 * p.nominal**2, rel=0.05)


# The volume of stubby bars is mostly that of the clamp's corner, which linear tetrahedra blur.
@pytest.mark.dolfinx
@pytest.mark.parametrize(
    ("slenderness", "nu", "sinks", "across", "quadratic_across", "within"),
    [
        (2.0, 0.3, 0.1, 4, 2, 0.05),
        *(
            pytest.param(*bar, 6, 4, within, marks=pytest.mark.nightly)
            for *bar, within in (
                (1.0, 0.45, 0.16, 0.15), (4.0, 0.3, 0.16, 0.05),
                (4.0, 0.45, 0.08, 0.05), (8.0, 0.3, 0.08, 0.05),
            )
        ),
    ],
)  # fmt: skip
def test_quadratic_tetrahedra_find_the_same_errors_at_the_same_deflection(
    slenderness: float, nu: float, sinks: float, across: int, quadratic_across: int,
    within: float,
) -> None:  # fmt: skip
    from palpate.reference.statics import solve_static

    def bar(load: float) -> Problem:
        return make_bar(slenderness, nu, load, quadratic_across)

    (point,) = follow(slenderness, nu, (sinks,), cells_across=across).points
    unit = bar(1.0)
    bent = solve_static(unit, strain=Strain.LINEAR, degree=2).displacement
    load = sinks / deflection(unit.mesh, bent)
    linear, green = (solve_static(bar(load), strain=s, degree=2) for s in Strain)
    mesh = unit.mesh
    difference = l2_norm(mesh, linear.displacement - green.displacement)
    error = difference / l2_norm(mesh, green.displacement)
    assert error == pytest.approx(point.displacement_error, rel=0.05)
    volume_error = abs(linear.volume - green.volume) / mesh.volume
    assert volume_error == pytest.approx(point.volume_error, rel=within)
    assert point.load > 1.05 * load  # linear tetrahedra are too stiff, and yet
