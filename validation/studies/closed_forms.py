"""Answers in closed form, or by quadrature of one, that simulators are held against.

The elastica, a thin bar that bends without stretching under a dead load at its tip:
E I theta'' = -P cos theta, theta(0) = 0, theta'(L) = 0; x' = cos theta, w' = sin theta
(Bisshopp and Drucker, Quart. Appl. Math. 3 (1945) 272-275).

Stretch of Saint-Venant-Kirchhoff, free or confined: P / stiffness = l (l^2 - 1) / 2, with its
extreme -1 / (3 sqrt 3) = -0.19245 at l = 1 / sqrt 3.

A rigid sphere on a half space (Hertz): contact radius a = sqrt(R d), for small a / R (Johnson 1985,
"Contact Mechanics", section 4.2).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from palpate.fastsim.statics import StaticResult
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Material, Problem
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.meshes.transforms import scale_loads

# What several studies ask of a body, and the inputs of a problem changed.

# fastsim's statics, or what is put to the test in its place.
Solve = Callable[..., StaticResult]


def volume_change(mesh: TetMesh, displacement: Points) -> float:
    """Over the rest volume [-]."""
    return float(signed_volumes(mesh.points + displacement, mesh.cells).sum()) / mesh.volume - 1.0


def changed(problem: Problem, name: str, factor: float) -> Problem:
    """The problem with one input multiplied: "load", "Young's modulus" or "Poisson's ratio"."""
    if name == "load":
        return scale_loads(problem, factor)
    field = {"Young's modulus": "youngs_modulus", "Poisson's ratio": "poissons_ratio"}[name]
    value = factor * getattr(problem.material, field)
    material = dataclasses.replace(problem.material, **{field: value})
    return dataclasses.replace(problem, material=material)


# Largest nominal compression that Saint-Venant-Kirchhoff bears, of E or of lmbda + 2 mu.
COMPRESSION_LIMIT = 1.0 / (3.0 * math.sqrt(3.0))
# Runge-Kutta's error is then below 1e-9 at load 10.
_STEPS = 120


def elastica_shape(load: float) -> tuple[Points, Points, Points]:
    """Positions along the bar.

    Args:
        load: P L^2 / (E I) [-], > 0, to about 15.

    Returns:
        Arc length s, and u = x - s and w (towards the load) over the length [-], each of shape
        (121,).
    """
    # Shooting: the curvature at the clamp lies between 0 and the linear one, and the curvature
    # left at the tip grows with it.
    low, high = 0.0, load
    for _ in range(45):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _integrate(load, middle)[-1, 1] < 0.0 else (low, middle)
    states = _integrate(load, 0.5 * (low + high))
    s = np.linspace(0.0, 1.0, _STEPS + 1)
    return s, states[:, 2] - s, states[:, 3]


def elastica_error(load: float) -> float:
    """L2 norm of linear bending less the elastica, over that of the elastica [-].

    Linear bending: w = alpha (s^2 / 2 - s^3 / 6), u = 0.
    """
    s, u, w = elastica_shape(load)
    linear = load * (s**2 / 2.0 - s**3 / 6.0)
    weights = np.full(len(s), 1.0)
    # The trapezoidal rule; its step cancels.
    weights[[0, -1]] = 0.5
    return float(np.sqrt(weights @ (u**2 + (linear - w) ** 2) / (weights @ (u**2 + w**2))))


def _integrate(load: float, curvature: float) -> Points:
    """Classical Runge-Kutta from the clamp; rows (theta, theta', x, w)."""

    def rate(y: Points) -> Points:
        cosine = np.cos(y[0])
        return np.array([y[1], -load * cosine, cosine, np.sin(y[0])])

    h = 1.0 / _STEPS
    states = np.zeros((_STEPS + 1, 4))
    states[0, 1] = curvature
    for k in range(_STEPS):
        y = states[k]
        k1 = rate(y)
        k2 = rate(y + 0.5 * h * k1)
        k3 = rate(y + 0.5 * h * k2)
        k4 = rate(y + h * k3)
        states[k + 1] = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return states


def confined_modulus(material: Material) -> float:
    """Return lmbda + 2 mu [Pa]."""
    E, nu = material.youngs_modulus, material.poissons_ratio
    return E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))


def stretch_under(stress: float) -> float:
    """The stable root l of l (l^2 - 1) / 2 = stress [-], for stress >= -1 / (3 sqrt 3)."""
    if stress < -COMPRESSION_LIMIT:
        raise ValueError(f"stress = {stress:g}: no equilibrium below -{COMPRESSION_LIMIT:.5f}")
    low, high = 1.0 / math.sqrt(3.0), 2.0 + 2.0 * abs(stress)
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if middle * (middle**2 - 1.0) < 2.0 * stress else (low, middle)
    return 0.5 * (low + high)


def contact_radius(depth: float, radius: float) -> float:
    """Contact radius of Hertz [m]."""
    return math.sqrt(radius * depth)
