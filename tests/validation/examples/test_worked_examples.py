"""The worked examples run, and show what they say they show."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

import palpate

EXAMPLES = Path(__file__).parents[3] / "validation" / "examples"


def test_a_simulator_that_is_too_soft_is_found_and_explained() -> None:
    shown = runpy.run_path(str(EXAMPLES / "judge_my_simulator.py"))
    assert shown["result"].verdict is palpate.Verdict.FAILED
    # 1 / 1.02 = 0.980392...
    assert any("stiffness 0.980392 times" in str(found) for found in shown["result"].diagnoses)


def test_linear_strain_gets_worse_with_the_load() -> None:
    errors = runpy.run_path(str(EXAMPLES / "linear_or_nonlinear.py"))["errors"]
    small, medium, large = errors.values()
    assert small < medium < large
    # To first order the error grows as the load: 4 times from 0.05 to 0.2.
    assert medium / small == pytest.approx(4.0, rel=0.3)


def test_a_right_simulator_passes_its_gate() -> None:
    assert runpy.run_path(str(EXAMPLES / "gate_in_my_repository.py"))["is_green"]


def test_a_probe_finds_the_inclusion_wherever_it_is() -> None:
    shown = runpy.run_path(str(EXAMPLES / "palpate_by_force.py"))
    assert shown["found"] == pytest.approx((0.052, 0.024), abs=0.003)
    elsewhere = shown["find_inclusion"](shown["block_with_inclusion"]((0.024, 0.014, 0.012), 0.007))
    assert elsewhere == pytest.approx((0.024, 0.014), abs=0.005)


def test_every_example_is_run_here_and_is_in_percent_format() -> None:
    names = {path.name for path in EXAMPLES.glob("*.py")}
    assert names == {
        "judge_my_simulator.py", "linear_or_nonlinear.py", "gate_in_my_repository.py",
        "palpate_by_force.py",
    }  # fmt: skip
    for name in names:
        text = (EXAMPLES / name).read_text("utf-8")
        assert text.startswith("# %% [markdown]\n# # ")
        assert "\n# %%\n" in text
