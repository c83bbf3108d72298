"""Which law a stress is of, where it is not of the one that was stated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material
from palpate.validation.diagnosis.law_slips import lame_of
from palpate.validation.metrics.finite_laws import finite_stress
from palpate.validation.metrics.laws import Array, linear

# Of the stress: a law that fits so well is it.
_FITS = 1e-6


def name_of_stress(
    P: Array, material: Material, F: Array, known: NDArray[np.bool_] | None = None
) -> str:
    """What explains a stress: another law, or the same with other moduli; else how far off it is.

    Args:
        P: First Piola-Kirchhoff stress [Pa], (n, 3, 3).
        material: What was stated.
        F: Where, (n, 3, 3).
        known: Which components count, (3, 3); None is all.
    """
    weights = np.ones((3, 3)) if known is None else known.astype(float)
    P = np.where(weights > 0.0, P, 0.0)
    if not np.isfinite(P).all():
        return "the stress is no finite number"
    H, count = F - np.eye(3), len(F)
    lmbda, mu = (np.full(count, of) for of in lame_of(material))
    c01, none = np.full(count, material.c01), np.zeros(count)
    candidates = {
        f"the stress is that of {law}": finite_stress(law, H, lmbda, mu, c01)
        for law in Law
        # Ogden's has constants of its own.
        if law not in (material.law, Law.OGDEN)
    }
    candidates["the stress is that of linear elasticity"] = linear(H, lmbda, mu)
    terms = material.ogden_terms
    right = finite_stress(material.law, H, lmbda, mu, c01, terms)
    transposed = finite_stress(material.law, H.transpose(0, 2, 1), lmbda, mu, c01, terms)
    candidates["the stress is that of the transposed gradient"] = transposed
    for words, found in candidates.items():
        if _misses(P, weights * found) < _FITS:
            return words
    # Linear in the moduli, all of them: parts of lmbda and of mu by least squares.
    parts = np.stack(
        [
            (weights * finite_stress(material.law, H, lmbda, none, none, terms)).ravel(),
            (weights * finite_stress(material.law, H, none, mu, c01, terms)).ravel(),
        ],
        axis=1,
    )
    shares = np.linalg.lstsq(parts, P.ravel(), rcond=None)[0]
    if _misses(P, (parts @ shares).reshape(P.shape)) < _FITS:
        return (
            f"the stress is that of the stated law with lmbda times {shares[0]:.6g} and mu times "
            f"{shares[1]:.6g}"
        )
    right = weights * right
    off = np.abs(P - right)
    cell, i, j = np.unravel_index(int(off.argmax()), off.shape)
    return (
        f"the stress is of no law known here: P{i + 1}{j + 1} = {P[cell, i, j]:.6g} Pa where "
        f"{right[cell, i, j]:.6g} Pa was stated"
    )


def _misses(P: Array, found: Array) -> float:
    return float(np.linalg.norm(P - found) / max(float(np.linalg.norm(P)), 1e-300))
