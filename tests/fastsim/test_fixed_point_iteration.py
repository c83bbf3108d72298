"""Eq. 10 as printed, K + P(a), beside Newton's tangent and dynamic relaxation.

K + P(a) is the secant matrix of R(a) = (K + P(a)) a, not its derivative, so eq. 9-10 as printed
are a fixed-point iteration: each step gains the same part of a digit, fewer the larger the
displacement, and in large bending none. P(a) is not unique. Here it is the symmetric one,
12 (K + P(a)) = 8 T(0) + 5 T(a) - T(-a) with T = dR/da, so that conjugate gradients apply as the
paper asks; the natural (B_L + B_NL)^T D (B_L + B_NL / 2) is not symmetric.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.fastsim.dynamic_relaxation import relax
from palpate.fastsim.newton import Iteration, Newton
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.transforms import scale_loads
from palpate.validation.case import load_case

TOLERANCE = 1e-10
# Two solutions to 1e-10 of the forces.
AGREEMENT = 1e-8


BLOCK = """
schema = 1
title = "A block pulled sideways"
[geometry]
shape = "box"
size = [2.0, 1.0, 1.0]
edge_length = 0.5
[material]
youngs_modulus = 1000.0
poissons_ratio = 0.3
[[support]]
region = { half_space = { point = [0.001, 0.0, 0.0], normal = [-1.0, 0.0, 0.0] } }
[[load]]
kind = "force"
force = [60.0, 20.0, -10.0]
region = { half_space = { point = [1.999, 0.0, 0.0], normal = [1.0, 0.0, 0.0] } }
[[check]]
metric = "displacement_l2"
limit = 1e-8
reason = "same equations"
"""


def iterate(problem: Problem, method: Iteration) -> tuple[Points | None, Floats]:
    """The solution, None where it is lost, and the relative residuals."""
    # Eq. 9-10 as printed have no line search: neither has the secant iteration here.
    is_guarded = method is Iteration.NEWTON
    solver = Newton(problem, Strain.GREEN, TOLERANCE, 80, method, is_guarded=is_guarded)
    found = solver.solve(np.zeros_like(problem.mesh.points), 1.0)
    return found.displacement, np.array([1.0, *found.history])


def contraction(residuals: Floats) -> float:
    """Mean factor of the residual over the last five iterations [-]."""
    return float((residuals[-1] / residuals[-6]) ** 0.2)


def test_the_secant_gains_the_same_part_of_a_digit_each_time_and_newton_doubles_them(
    tmp_path: Path,
) -> None:
    path = tmp_path / "block.toml"
    path.write_text(BLOCK, encoding="utf-8")
    block = load_case(path).problem
    rates = []
    for factor in (0.25, 1.0):
        problem = scale_loads(block, factor)
        exact, newton = iterate(problem, Iteration.NEWTON)
        found, secant = iterate(problem, Iteration.SECANT)
        ratios = secant[4:-2] / secant[3:-3]
        assert ratios.std() < 0.1 * ratios.mean()
        digits = -np.log10(newton)
        near = np.flatnonzero((digits > 1.0) & (digits < 5.0))
        assert (digits[near + 1] > 1.7 * digits[near]).all()
        assert len(newton) < len(secant)
        assert exact is not None
        assert found is not None
        assert np.linalg.norm(found - exact) <= AGREEMENT * np.linalg.norm(exact)
        rates.append(contraction(secant))
    # The larger the displacement, the less each step gains.
    assert rates[1] > 1.5 * rates[0]


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["kidney", "beam"])
def test_whoever_converges_finds_newtons_equilibrium(name: str) -> None:
    """As printed the iteration may fail; Newton's method and relaxation may not."""
    for factor in (0.1, 0.25, 0.5, 1.0):
        problem = scale_loads(load_case(name).problem, factor)
        exact, _ = iterate(problem, Iteration.NEWTON)
        assert exact is not None
        others = [iterate(problem, Iteration.SECANT)[0]]
        if factor == 1.0:
            others.append(relax(problem, relative_tolerance=TOLERANCE).displacement)
        for found in others:
            if found is not None:
                assert np.linalg.norm(found - exact) <= AGREEMENT * np.linalg.norm(exact)
