"""The study of graded meshes: its arithmetic, its verdicts both ways, and its page."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.meshes.arrays import Points
from palpate.validation.report.study_page import study_page
from palpate.validation.states import Verdict
from palpate.validation.studies.grading import (
    Curves,
    Solved,
    cells_for_error,
    judge,
    judge_curves,
    present,
    remainder,
)

CELLS = (1000, 10_000, 20_000, 100_000)


def moved(distance: float) -> Points:
    return np.array([[distance, 0.0, 0.0]])


def curves(graded_constant: float, bar: float) -> Curves:
    """Errors constant * cells^-1/4, all too stiff; truths that leave a bar."""
    families = {
        kind: [
            Solved(n, moved(1.0 - constant * n**-0.25), 1.0 - constant * n**-0.25, 1e-5)
            for n in CELLS
        ]
        for kind, constant in (("uniform", 1.0), ("graded", graded_constant))
    }
    # After changes of c and c / 2, c / 2 is left; times 1.25.
    change = bar / (0.5 * 1.25) if bar else 0.0
    sizes = (1.0 - 1.5 * change, 1.0 - 0.5 * change, 1.0)
    truths = [Solved(k, moved(size), size) for k, size in enumerate(sizes, start=1)]
    return Curves("a body", "contact force", families, truths)


@pytest.mark.parametrize(
    ("part", "bar", "verdict"),
    [
        # With order 1/4 the graded mesh needs constant^4 of the uniform one's cells.
        (0.1, 1e-9, Verdict.PASSED),
        (0.5, 1e-9, Verdict.FAILED),
        (0.15, 0.06, Verdict.INCONCLUSIVE),
    ],
)
def test_verdicts_go_green_red_and_undecided(part: float, bar: float, verdict: Verdict) -> None:
    made = curves(part**0.25, bar)
    assert made.bars == pytest.approx((bar, bar))
    assert [solved.cells for solved in made.pair] == [100_000, 20_000]
    findings = judge_curves(made)
    assert [f.verdict for f in findings] == [verdict] * 2
    if part == 0.1:
        assert "10000 cells, 10.0 times fewer" in findings[0].found


def test_cells_for_an_error_lie_on_a_power_and_are_infinite_where_it_is_never_reached() -> None:
    cells = (100, 1000)
    errors = [n**-0.5 for n in cells]
    assert cells_for_error(cells, errors, 1e-3) == math.inf
    assert cells_for_error(cells, errors, 300**-0.5) == pytest.approx(300.0, rel=1e-9)


def test_the_remainder_of_a_geometric_series() -> None:
    # 1 + 1/2 + 1/4 + ...: after changes of 1/2 and 1/4, 1/4 is left; times 1.25.
    assert remainder(0.5, 0.25) == pytest.approx(1.25 * 0.25)
    assert remainder(0.25, 0.5) == math.inf


def test_the_page_stands_alone() -> None:
    found = {"push": curves(0.1**0.25, 0.01)}
    shown = present(found)
    assert set(shown.figures) == set(shown.tables) == {"push"}
    page = study_page("A <study>", ["Why."], judge(found), shown)
    assert "A &lt;study&gt;" in page
    assert page.count("<svg") == 1
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org", "")
