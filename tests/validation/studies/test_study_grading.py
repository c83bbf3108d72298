"""The study of graded meshes: its arithmetic, its verdicts both ways, and its page."""

from __future__ import annotations

import math

import pytest

from palpate.validation.report.study_page import study_page
from palpate.validation.states import Verdict
from palpate.validation.studies import grading
from palpate.validation.studies.grading import (
    Curves,
    Growth,
    Point,
    cells_for_error,
    count_cells,
    remainder,
)


def family(order: float, cells: tuple[int, ...], constant: float) -> list[Point]:
    return [Point(n, constant * n**-order, -constant * n**-order, 1e-5) for n in cells]


def curves(graded_constant: float, bar: float) -> Curves:
    cells = (1000, 10_000, 20_000, 100_000)
    uniform, graded = family(0.25, cells, 1.0), family(0.25, cells, graded_constant)
    # Both too stiff, so the answers are as far apart as their errors.
    gap = abs(uniform[-1].displacement_error - graded[2].displacement_error)
    return Curves(
        "a body",
        "contact force",
        {"uniform": uniform, "graded": graded},
        (uniform[-1], graded[2]),
        (gap, gap),
        (bar, bar),
        (1, 2, 3),
    )


def test_verdicts_go_green_red_and_undecided() -> None:
    # With order 1/4 the graded mesh needs constant^4 of the uniform one's cells.
    good = grading.judge_curves(curves(0.1**0.25, 0.0))
    assert [f.verdict for f in good] == [Verdict.PASSED] * 2
    assert "10000 cells, 10.0 times fewer" in good[0].found
    poor = grading.judge_curves(curves(0.5**0.25, 0.0))
    assert [f.verdict for f in poor] == [Verdict.FAILED] * 2
    unsure = grading.judge_curves(curves(0.15**0.25, 0.06))
    assert [f.verdict for f in unsure] == [Verdict.INCONCLUSIVE] * 2


def test_a_mesh_that_does_not_grade_fails_the_exponent() -> None:
    n = (8, 16, 32, 64, 128)
    right = Growth("a face", n, tuple(k**2 for k in n))
    wrong = Growth("a face", n, tuple(k**3 for k in n))
    assert [f.verdict for f in grading.judge_growth([right])] == [Verdict.PASSED]
    assert [f.verdict for f in grading.judge_growth([wrong])] == [Verdict.FAILED]


def test_uniform_cells_are_counted_and_continued_exactly() -> None:
    assert count_cells("uniform", (4, 8, 16)).cells == (6 * 64, 6 * 512, 6 * 4096)
    assert count_cells("uniform", (32, 64)).cells[1] == 6 * 64**3


def test_cells_for_an_error_that_is_never_reached_are_infinite() -> None:
    cells = (100, 1000)
    errors = [p.displacement_error for p in family(0.5, cells, 1.0)]
    assert cells_for_error(cells, errors, 1e-3) == math.inf
    found = cells_for_error(cells, errors, 300**-0.5)
    assert found == pytest.approx(300.0, rel=1e-9)


def test_the_remainder_of_a_geometric_series() -> None:
    # 1 + 1/2 + 1/4 + ...: after changes of 1/2 and 1/4, 1/4 is left; times 1.25.
    assert remainder(0.5, 0.25) == pytest.approx(1.25 * 0.25)
    assert remainder(0.25, 0.5) == math.inf


def test_the_page_stands_alone() -> None:
    growths = [count_cells(name, (4, 8, 16)) for name in ("uniform", "a face")]
    found = grading.Found(growths, {"push": curves(0.1**0.25, 0.01)})
    shown = grading.present(found)
    assert set(shown.figures) == set(shown.tables) == {"growth", "push"}
    page = study_page("A <study>", ["Why."], grading.judge(found), shown)
    assert "A &lt;study&gt;" in page
    assert page.count("<svg") == 2
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org", "")
