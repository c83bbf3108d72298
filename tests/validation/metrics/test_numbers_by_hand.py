"""Small parts of the metrics whose number, or whose words, are known by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from bank import loaded_bar

from palpate.meshes.material_law import Law
from palpate.meshes.problem import Strain, TimeSpan
from palpate.reference.schemes import Integrator
from palpate.validation.metrics.body import body_of, relative_to
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


@pytest.mark.parametrize("part", [0.9, 0.7, 0.5])
def test_the_least_modulus_of_confined_compression(part) -> None:
    """S_x + (lmbda + 2 mu) l^2 is 0 at l = 1 / sqrt(3)."""
    problem = loaded_bar((2, 1, 1))
    displacement = (part - 1.0) * problem.mesh.points * [1.0, 0.0, 0.0]
    body = body_of(problem, Strain.GREEN)
    # Along x over lmbda + 2 mu; across a shear S_y + mu l^2 over mu.
    l2, lmbda, mu = part**2, body.lmbda, body.mu
    e = 0.5 * (l2 - 1.0)
    least = np.minimum(e + l2, lmbda / mu * e + l2)
    assert body.least_moduli(displacement) == pytest.approx(least, rel=1e-12)
    stiff = replace(problem, material=replace(problem.material, law=Law.NEO_HOOKEAN))
    for other in (body_of(problem, Strain.LINEAR), body_of(stiff, Strain.GREEN)):
        assert other.least_moduli(displacement).tolist() == [1.0] * problem.mesh.num_cells
