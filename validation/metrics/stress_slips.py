"""What a simulator may have sent for Cauchy's stress: another stress, sign or unit."""

from __future__ import annotations

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.problem import Strain
from palpate.validation.metrics.body import Body

# Relative to the largest component: seven digits, and sums.
_SAME = 1e-4


def slip_in_stress(body: Body, displacement: Points, sent: Floats, cells: Indices) -> str:
    """What would explain a stress that is not that of the displacement sent with it; else "".

    Args:
        body: The case's, with the element that was said.
        displacement: As it was sent [m].
        sent: Taken for Cauchy's stress [Pa], (num_cells, 3, 3).
        cells: Where it is looked at.
    """
    sigma, P = body.stresses(displacement)
    known = {
        "with compression positive": -sigma,
        "in kPa": 1e-3 * sigma,
        "in MPa": 1e-6 * sigma,
        "without its mean (the deviator)": sigma
        - np.trace(sigma, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3),
    }
    known = {f"Cauchy's stress {how}": stress for how, stress in known.items()}
    if body.strain is Strain.GREEN:
        F = np.eye(3) + body.gradient(displacement)
        J = np.linalg.det(F)[:, None, None]
        known["the second Piola-Kirchhoff stress"] = _solved(F, P)
        known["the Kirchhoff stress, det F times Cauchy's"] = J * sigma
    if _are_same(sent[cells], sigma[cells]):
        return ""
    for name, stress in known.items():
        if _are_same(sent[cells], stress[cells]):
            return f"what was sent is {name}, by the displacement sent with it"
    return ""


def _solved(F: Floats, P: Floats) -> Floats:
    """S = F^-1 P; NaN where a cell is flat."""
    S: Floats = np.full_like(P, np.nan)
    is_solid = np.abs(np.linalg.det(F)) > 0.0
    S[is_solid] = np.linalg.solve(F[is_solid], P[is_solid])
    return S


def _are_same(one: Floats, other: Floats) -> bool:
    scale = float(np.abs(other).max(initial=0.0))
    return bool(np.abs(one - other).max(initial=0.0) <= _SAME * scale)
