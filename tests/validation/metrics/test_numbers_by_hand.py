"""Small parts of the metrics whose number, or whose words, are known by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from bank import loaded_bar

from palpate.meshes.problem import TimeSpan
from palpate.reference.schemes import Integrator
from palpate.validation.metrics.body import relative_to
from palpate.validation.metrics.motion import NumericalDamping
from palpate.validation.metrics.stepping import steps_per_output
from palpate.validation.states import Steps


@pytest.mark.parametrize(
    ("value", "scale", "expected"),
    [
        (3.0, 2.0, 1.5),
        (0.0, 0.0, 0.0),
        (1.0, 0.0, math.inf),
        (-1.0, 0.0, math.inf),
        (math.nan, 1.0, math.inf),
        (1.0, math.inf, math.inf),
    ],
)
def test_a_part_of_nothing_is_infinite_unless_it_is_nothing(value, scale, expected) -> None:
    assert relative_to(value, scale) == expected


def test_whole_steps_to_an_output() -> None:
    problem = loaded_bar((2, 1, 1))
    span = TimeSpan(0.4, time_step=0.01, num_outputs=8)
    assert steps_per_output(replace(problem, time=span)) == 5
    assert steps_per_output(replace(problem, time=replace(span, time_step=None))) == 0
    assert steps_per_output(problem) == 0


def test_numerical_damping_is_shown_in_per_cent() -> None:
    shown = str(NumericalDamping(Steps(Integrator.BDF2, 0.01), 12.0, 0.01, 0.02, 0.0099))
    assert "1 % of critical by the scheme, 2 +- 0.99 % measured" in shown
