"""Each scheme on an oscillator whose motion by it is known."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.availability import is_available
from palpate.reference.schemes import (
    Integrator,
    Steps,
    amplification,
    frequency_ratio,
    numerical_damping_ratio,
    read_integrator,
)

if is_available():
    from palpate.reference.stepping import simulate_by, simulate_explicit


MATERIAL = Material(1.0, 0.3, 1.0)


@dataclass(frozen=True)
class Oscillator:
    """One component of the last point is free: m u'' + lambda m u' + k u = 0."""

    problem: Callable[[TimeSpan], Problem]
    displacement: np.ndarray
    omega: float

    def exact(self, times, damping=0.0):
        """Let go at 1, still."""
        damped = math.sqrt(self.omega**2 - 0.25 * damping**2)
        swing = np.cos(damped * times) + 0.5 * damping / damped * np.sin(damped * times)
        return np.exp(-0.5 * damping * times) * swing


@pytest.fixture
def oscillator() -> Oscillator:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    mesh = TetMesh(points, np.array([[0, 1, 2, 3]], dtype=np.int32))
    none = np.zeros((0, 3), dtype=np.int32)
    supports = (
        Support(np.array([0, 1, 2], dtype=np.int32), none),
        Support(np.array([3], dtype=np.int32), none, (True, True, False)),
    )
    displacement = np.zeros((4, 3))
    displacement[3, 2] = 1e-3
    # k = V (lmbda + 2 mu) / height^2, m a quarter of rho V; E = 1, nu = 0.3, rho = 1.
    modulus = 0.7 / (1.3 * 0.4)
    omega = math.sqrt(4.0 * modulus)
    return Oscillator(lambda span: Problem(mesh, MATERIAL, supports, (), span), displacement, omega)


STEPPED = [i for i in Integrator if i is not Integrator.CENTRAL_DIFFERENCES]


def height_of(oscillator, integrator, steps, *, periods=1.0, damping=0.0, outputs=1):
    """The free component over where it was let go, at the outputs."""
    end = periods * 2.0 * math.pi / oscillator.omega
    problem = oscillator.problem(TimeSpan(end, end / steps, damping, outputs))
    options = {"strain": Strain.LINEAR, "displacement": oscillator.displacement}
    if integrator is Integrator.CENTRAL_DIFFERENCES:
        result = simulate_explicit(problem, **options)
    else:
        result = simulate_by(problem, integrator, **options)
    return result.times, result.displacements[:, 3, 2] / oscillator.displacement[3, 2], result


@pytest.mark.dolfinx
@pytest.mark.parametrize("damping", [0.0, 0.8])
@pytest.mark.parametrize("integrator", list(Integrator))
def test_the_error_falls_with_the_order_of_the_scheme(oscillator, integrator, damping):
    errors = []
    for steps in (200, 400):
        times, heights, _ = height_of(
            oscillator, integrator, steps, periods=1.2, damping=damping, outputs=10
        )
        errors.append(np.abs(heights - oscillator.exact(times, damping)).max())
    assert math.log2(errors[0] / errors[1]) == pytest.approx(integrator.order, abs=0.1)
    assert errors[1] > 1e-6  # of its own: nothing but rounding would have no order


@pytest.mark.dolfinx
@pytest.mark.parametrize("integrator", STEPPED)
def test_every_step_multiplies_by_the_factor_of_the_formula(oscillator, integrator):
    steps = 40
    _, heights, result = height_of(oscillator, integrator, steps, periods=2.0, outputs=steps)
    z = amplification(integrator, oscillator.omega * result.time_step)
    # u_n = Re(c z^n), c by the second and third state; BDF2's other factors are soon gone.
    first = 20 if integrator is Integrator.BDF2 else 1
    powers = z ** np.arange(steps + 1)
    rows = np.column_stack([powers.real, -powers.imag])
    c = np.linalg.solve(rows[first : first + 2], heights[first : first + 2])
    late = (rows @ c - heights)[first:]
    assert np.abs(late).max() < (1e-6 if integrator is Integrator.BDF2 else 1e-9)
    assert result.largest_residual <= 1e-10


@pytest.mark.parametrize(
    ("integrator", "leading"),
    [
        (Integrator.BACKWARD_EULER, lambda w: 0.5 * w),
        (Integrator.BDF2, lambda w: 0.25 * w**3),
        (Integrator.TRAPEZOIDAL, lambda _w: 0.0),
        (Integrator.IMPLICIT_MIDPOINT, lambda _w: 0.0),
        (Integrator.SEMI_IMPLICIT_EULER, lambda _w: 0.0),
        (Integrator.CENTRAL_DIFFERENCES, lambda _w: 0.0),
    ],
)
def test_numerical_damping_is_that_of_the_books(integrator, leading):
    for w in (0.05, 0.1):
        assert numerical_damping_ratio(integrator, w) == pytest.approx(
            leading(w), rel=0.03, abs=1e-12
        )


def test_implicit_schemes_are_slow_and_explicit_ones_quick():
    for w in (0.1, 0.5):
        # Leading terms: -w^2/12 of the trapezoidal rule, +w^2/24 of central differences.
        assert frequency_ratio(Integrator.TRAPEZOIDAL, w) == pytest.approx(1 - w**2 / 12, rel=1e-3)
        quick = frequency_ratio(Integrator.CENTRAL_DIFFERENCES, w)
        assert quick == pytest.approx(1 + w**2 / 24, rel=1e-3)


def test_what_cannot_be_asked_is_refused():
    with pytest.raises(InputError, match="stable below 2"):
        amplification(Integrator.SEMI_IMPLICIT_EULER, 2.0)
    with pytest.raises(InputError, match="above 0"):
        amplification(Integrator.BDF2, 0.0)
    with pytest.raises(InputError, match="known are central-differences"):
        read_integrator("euler")
    with pytest.raises(InputError, match="time_step"):
        Steps(Integrator.BDF2, math.nan)
