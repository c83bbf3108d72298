"""Constants that laws are written with: checked, and what they are at rest."""

from __future__ import annotations

import math
from collections.abc import Sequence

from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law

# Exponents in use are between -10 and 25 (soft tissue); beyond, powers overflow.
_LARGEST_EXPONENT = 50.0


def checked_terms(
    law: Law, given: Sequence[tuple[float, float]]
) -> tuple[tuple[float, float], ...]:
    """Ogden's terms, each a part of the shear modulus and an exponent; see `Material`."""
    terms = tuple((float(share), float(alpha)) for share, alpha in given)
    if (law is Law.OGDEN) != bool(terms) or len(terms) > 3:
        raise InputError(
            f"{len(terms)} terms of Ogden's with law = {law}: {Law.OGDEN} has one to three, "
            "others none"
        )
    for share, alpha in terms:
        if not (math.isfinite(share) and 0.0 < abs(alpha) <= _LARGEST_EXPONENT):
            raise InputError(
                f"Ogden's terms {terms}: needs finite numbers, and exponents that are not 0 and at "
                f"most {_LARGEST_EXPONENT:g} in size"
            )
    if terms and not abs(sum(share for share, _ in terms) - 1.0) < 1e-9:
        raise InputError(f"Ogden's terms {terms}: their parts of the shear modulus add up to 1")
    return terms


def moduli_of(mu: float, bulk_modulus: float) -> tuple[float, float]:
    """Young's modulus and Poisson's ratio of a shear and a bulk modulus, which has to be > 0."""
    if not (math.isfinite(bulk_modulus) and bulk_modulus > 0.0):
        raise InputError(f"bulk_modulus = {bulk_modulus:g} Pa: needs a finite value above 0")
    denominator = 3.0 * bulk_modulus + mu
    return (
        9.0 * bulk_modulus * mu / denominator,
        (3.0 * bulk_modulus - 2.0 * mu) / (2.0 * denominator),
    )
