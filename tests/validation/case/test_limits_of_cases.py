"""Limits of the built-in cases come from need: no measured numbers, and what reasons say is so."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from palpate.meshes.arrays import Points
from palpate.validation.case import builtin_cases, load_case

CLOSED_FORM = "Verification alone, against a closed form"
# In a bar of length 1 under 1e-3 per mass: E = 1, nu = 0.3, density 1.
SPEED_SQUARED = 0.7 / (1.3 * 0.4)


@pytest.mark.parametrize("name", builtin_cases())
def test_a_reason_says_what_is_needed_not_what_was_measured(name: str) -> None:
    for check in load_case(name).checks:
        assert not re.search(r"[0-9%] measured|slack", check.reason), check.reason


@pytest.mark.parametrize("name", builtin_cases())
def test_a_built_in_case_says_what_it_is_for(name: str) -> None:
    spec = load_case(name).spec
    said = spec.evidence
    assert said.question.endswith("?")
    assert said.context_of_use.endswith(".")
    assert said.model_influence
    assert said.decision_consequence
    is_verification = said.context_of_use.startswith("Verification alone")
    # What is for a use says what is read from it, and how near it is to that use.
    assert is_verification != bool(said.quantities_of_interest and said.applicability)
    if is_verification:
        assert said.context_of_use.endswith("nothing about tissue or a device is decided by it.")
    if said.context_of_use.startswith(CLOSED_FORM):
        assert any(check.about.is_published for check in spec.check)


def swing_along(stiffness: float, damping: float) -> Points:
    """Displacement of the bar of wave and decay over five periods, by its series; (times, x)."""
    x, times = np.linspace(0.0, 1.0, 21), np.linspace(0.0, 20.0 / math.sqrt(SPEED_SQUARED), 401)
    moved = np.zeros((len(times), len(x)))
    for k in range(40):
        number = 0.5 * math.pi * (2 * k + 1)
        squared = stiffness * SPEED_SQUARED * number**2
        rate = math.sqrt(squared - damping**2 / 4.0)
        fading = np.exp(-damping * times / 2.0)
        fading *= np.cos(rate * times) + damping / (2.0 * rate) * np.sin(rate * times)
        moved += np.outer(2e-3 / (number * squared) * (1.0 - fading), np.sin(number * x))
    return moved


@pytest.mark.parametrize(("name", "damping", "told"), [("wave", 0.0, 0.08), ("decay", 0.2, 0.024)])
def test_one_per_cent_of_stiffness_is_seen_in_a_motion(
    name: str, damping: float, told: float
) -> None:
    right, wrong = swing_along(1.0, damping), swing_along(1.01, damping)
    off = np.linalg.norm(wrong - right, axis=1).max() / np.linalg.norm(right, axis=1).max()
    assert off == pytest.approx(told, rel=0.03)
    (check,) = (
        c for c in load_case(name).checks if (c.metric, c.against) == ("trajectory_l2", "truth")
    )
    assert f"{100.0 * told:.2g} %" in check.reason
    assert check.limit <= 0.5 * told


def test_what_tells_the_strain_measures_apart_in_table_one() -> None:
    published = load_case("kidney").spec.published
    reasons = {c.metric: c.reason for c in load_case("kidney").checks if c.against == "truth"}
    for what, metric in (("volume", "volume"), ("area", "surface_area")):
        original, linear, green = (
            published[f"{state}_{what}"] for state in ("original", "linear", "green")
        )
        apart = (linear - green) / (green - original)
        assert f"{100.0 * apart:.0f} %" in reasons[metric]
