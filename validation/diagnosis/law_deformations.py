"""Deformations at which a law is looked at."""

from __future__ import annotations

import numpy as np

from palpate.meshes.material_law import Law
from palpate.validation.metrics.laws import Array

_ONE = np.eye(3)
# Random deformations, and how far their det F may be from 1.
_NUM_RANDOM, _DETERMINANTS = 24, (0.3, 3.0)
# Those that a body is asked for in equilibrium: no larger ones, which a solver may not find.
_NUM_MODERATE, _MODERATE = 6, (0.8, 1.25)


def deformations(law: Law) -> dict[str, Array]:
    """Deformation gradients F [-] by kind, each (n, 3, 3); det F > 0 but for `inverted`.

    Inverted ones are there only for a law that is finite at them.
    """
    found = {
        "uniaxial": np.array([np.diag([a, 1.0, 1.0]) for a in (0.3, 0.5, 0.8, 1.2, 2.0, 3.0)]),
        "biaxial": np.array([np.diag([a, a, 1.0]) for a in (0.5, 0.8, 1.2, 1.7)]),
        "shear": np.array([_sheared(g) for g in (0.1, 0.5, 1.0, 2.0)]),
        "volumetric": np.array([np.cbrt(J) * _ONE for J in (0.3, 0.6, 0.9, 1.1, 1.7, 3.0)]),
        "random": _random(_NUM_RANDOM, 0.4, _DETERMINANTS),
        "near-degenerate": np.array(
            [np.diag([0.02, 1.0, 1.0]), np.diag([1.5, 0.05, 0.8]), _sheared(10.0)]
        ),
    }
    if law in (Law.SAINT_VENANT_KIRCHHOFF, Law.NEO_HOOKEAN_STABLE, Law.NEO_HOOKEAN_STABLE_LOG):
        found["inverted"] = np.array([np.diag([-0.5, 1.0, 1.0]), np.diag([1.2, -0.2, 0.9])])
    return found


def moderate_deformations() -> dict[str, Array]:
    """Upper triangular F of moderate size: all that a cell can do but to turn."""
    found = {
        "uniaxial": np.array([np.diag([a, 1.0, 1.0]) for a in (0.85, 1.2, 1.5)]),
        "biaxial": np.array([np.diag([a, a, 1.0]) for a in (0.9, 1.2)]),
        "shear": np.array([_sheared(g) for g in (0.2, 0.5)]),
        "volumetric": np.array([np.cbrt(J) * _ONE for J in (0.8, 1.25)]),
        # F = Q R: the same stretch without the turn.
        "random": np.array(
            [
                np.linalg.qr(F)[1] * np.sign(np.diag(np.linalg.qr(F)[1]))[:, None]
                for F in _random(_NUM_MODERATE, 0.15, _MODERATE)
            ]
        ),
    }
    return found


def rotations(count: int) -> Array:
    """Random turns, (count, 3, 3); the same each time."""
    Q, R = np.linalg.qr(np.random.default_rng(2).standard_normal((count, 3, 3)))
    Q = Q * np.sign(np.einsum("cii->ci", R))[:, None, :]
    turns: Array = Q * np.sign(np.linalg.det(Q))[:, None, None]
    return turns


def _sheared(amount: float) -> Array:
    F = _ONE.copy()
    F[0, 1] = amount
    return F


def _random(count: int, size: float, determinants: tuple[float, float]) -> Array:
    """Of a random direction, with det F spread evenly over its logarithm."""
    rng = np.random.default_rng(1)
    wanted = np.geomspace(*determinants, count)
    found: list[Array] = []
    while len(found) < count:
        F = _ONE + size * rng.standard_normal((3, 3))
        J = float(np.linalg.det(F))
        if J > 0.2:
            found.append(F * np.cbrt(wanted[len(found)] / J))
    return np.array(found)
