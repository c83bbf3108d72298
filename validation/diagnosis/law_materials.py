"""A material to look at each law by, with constants that leave no part of the law out."""

from __future__ import annotations

import dataclasses

from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material

# Parts like those of Ogden's rubber, 1972: three terms, one of them of a negative exponent.
OGDEN_TERMS = ((0.7, 1.3), (0.2, 5.0), (0.1, -2.0))
# Of Mooney and Rivlin's law, over mu.
C01 = 0.2


def example_material(
    law: Law, poissons_ratio: float = 0.4, youngs_modulus: float = 1e4
) -> Material:
    """Of these moduli at rest [-], [Pa]; c01 is a fifth of mu, Ogden's law has three terms."""
    return following(Material(youngs_modulus, poissons_ratio), law)


def following(material: Material, law: Law) -> Material:
    """The same moduli at rest and density, by another law."""
    mu = material.youngs_modulus / (2.0 * (1.0 + material.poissons_ratio))
    return dataclasses.replace(
        material,
        law=law,
        c01=C01 * mu if law.has_c01 else 0.0,
        ogden_terms=OGDEN_TERMS if law is Law.OGDEN else (),
    )
