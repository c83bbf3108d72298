"""The study of sensitivity: its arithmetic, a small case, and findings that go red."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.fastsim.statics import solve_static
from palpate.meshes.problem import Problem
from palpate.validation.case import load_case
from palpate.validation.metrics.grid_convergence import assess_grid_convergence
from palpate.validation.states import Verdict, in_silence
from palpate.validation.studies.convergence import QUANTITIES, Response, StoredTruth
from palpate.validation.studies.sensitivity import (
    ASKED,
    COVERAGE,
    INPUTS,
    STEP,
    Found,
    InputResponses,
    changed,
    follow_inputs,
    judge,
    make_budget,
    present,
)

WriteCase = Callable[..., Path]
GRIDS = assess_grid_convergence([1.98, 1.96, 1.92], [1.0, 2.0, 4.0], expected_order=1.0)
TRUTH = StoredTruth(2.0, 0.01)


@pytest.fixture
def block(write_case: WriteCase) -> Problem:
    """Loads of a hundredth: the block responds almost linearly."""
    case = write_case(("[60.0, 20.0, -10.0]", "[0.6, 0.2, -0.1]"))
    return load_case(str(case)).problem


def response(value: float) -> Response:
    """A response whose numbers are all `value`, each in its unit."""
    return dict.fromkeys(QUANTITIES, value)


def power_law(exponents: dict[str, float]) -> InputResponses:
    """Q = 2 X^n for each input."""
    moved = {
        name: (response(2.0 * 0.9 ** exponents[name]), response(2.0 * 1.1 ** exponents[name]))
        for name in INPUTS
    }
    return InputResponses(response(2.0), moved, response(2.4))


GOOD = {"Young's modulus": -1.0, "Poisson's ratio": 0.5, "load": 1.0}


def found_of(responses: InputResponses, truth: StoredTruth = TRUTH) -> Found:
    return Found([make_budget(q, responses, GRIDS, truth) for q in ASKED], responses)


def test_parts_add_up_as_they_should() -> None:
    budget = make_budget("volume change", power_law(GOOD), GRIDS, TRUTH)
    # Central difference of 1/x over 10 %: (1/1.1 - 1/0.9) / 0.2 = -1/0.99.
    assert budget.sensitivities["Young's modulus"] == pytest.approx(-1.0 / 0.99, rel=1e-12)
    assert budget.sensitivities["load"] == pytest.approx(1.0, rel=1e-12)
    assert budget.input_parts["load"] == pytest.approx(STEP / math.sqrt(3.0), rel=1e-12)
    assert budget.input_uncertainty**2 == pytest.approx(
        sum(part**2 for part in budget.input_parts.values()), rel=1e-12
    )
    # 1.25 * 0.02 / (2 - 1) over 1.15 and 1.98.
    assert budget.finest_uncertainty == pytest.approx(1.25 * 0.02 / COVERAGE / 1.98, rel=1e-9)
    assert budget.validation_uncertainty == pytest.approx(
        math.hypot(budget.finest_uncertainty or 0.0, budget.input_uncertainty), rel=1e-12
    )
    assert budget.model_error == pytest.approx(0.2, rel=1e-12)
    assert budget.mesh_error == 0.0


def test_only_force_over_modulus_counts_for_a_block(block: Problem) -> None:
    # Two solutions to 1e-10 of the forces.
    rest = solve_static(block).displacement
    both = changed(changed(block, "load", 1.5), "Young's modulus", 1.5)
    gap = np.abs(solve_static(both).displacement - rest).max()
    assert gap <= 1e-7 * np.abs(rest).max()
    found = found_of(follow_inputs(block, in_silence))
    for b in found.budgets:
        load, modulus = b.sensitivities["load"], b.sensitivities["Young's modulus"]
        assert abs(modulus + load) <= 2.0 * STEP**2 * abs(load)
    # Nearly linear: as much load, as much displacement.
    largest = next(b for b in found.budgets if b.quantity == "largest displacement")
    assert largest.sensitivities["load"] == pytest.approx(1.0, abs=0.02)
    assert judge(found)[0].verdict is Verdict.PASSED
    page = present(found)
    assert len(page.tables["sensitivities"].rows) == len(page.tables["uncertainty"].rows) == 3
    assert len(page.tables["responses"].rows) == 1 + 2 * len(INPUTS) + 1
    assert page.figures["uncertainty"].svg.startswith("<svg")


@pytest.mark.parametrize(
    ("responses", "truth", "failed"),
    [
        (power_law(GOOD), TRUTH, []),
        (power_law({**GOOD, "Poisson's ratio": 6.0}), TRUTH, [0]),
        (power_law(GOOD), StoredTruth(2.5, 0.01), [1, 2, 3]),
    ],
)
def test_findings_go_red(responses: InputResponses, truth: StoredTruth, failed: list[int]) -> None:
    verdicts = [f.verdict for f in judge(found_of(responses, truth))]
    assert len(verdicts) == 1 + len(ASKED)
    assert [k for k, v in enumerate(verdicts) if v is Verdict.FAILED] == failed


def test_one_input_at_a_time_is_changed(block: Problem) -> None:
    harder = changed(block, "Young's modulus", 1.1)
    assert harder.material.youngs_modulus == pytest.approx(1.1 * block.material.youngs_modulus)
    assert harder.loads == block.loads
    assert changed(block, "Poisson's ratio", 0.9).material.poissons_ratio == pytest.approx(0.27)
    assert changed(block, "load", 1.1).material == block.material
