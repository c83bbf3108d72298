"""A tetrahedron with one free component: an oscillator whose motion by each scheme is known."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Support
from palpate.meshes.problem import Material, Problem, TimeSpan
from palpate.meshes.tet_mesh import TetMesh

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
