"""What a body is made of: its material, and cells of another one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from palpate.meshes.arrays import Indices
from palpate.meshes.errors import InputError
from palpate.meshes.material_constants import checked_terms, moduli_of
from palpate.meshes.material_law import Law


@dataclass(frozen=True)
class Material:
    """Isotropic elastic solid: its moduli at rest, and the law it follows under finite strain.

    Args:
        youngs_modulus: At rest [Pa], > 0.
        poissons_ratio: At rest [-], between -1 and 0.5, both excluded.
        density: At rest [kg/m3], > 0.
        law: With Green strain; with linear strain every law is Hooke's.
        c01: Of the second invariant [Pa], for laws that have it alone; `mooney_rivlin` takes the
            three constants that the law is written with.
        ogden_terms: Of Law.OGDEN alone, one to three: the term's part of mu, mu_p alpha_p / (2 mu),
            all of which add up to 1, and its exponent alpha_p; `ogden` takes what the law is
            written with.

    Raises:
        InputError: A value outside its range.

    Note:
        Linear tetrahedra lock as Poisson's ratio nears 0.5. What each law is good for: see `Law`.

    >>> import palpate
    >>> palpate.Material(youngs_modulus=10e3, poissons_ratio=0.4).density
    1000.0
    """

    youngs_modulus: float
    poissons_ratio: float
    density: float = 1000.0
    law: Law = Law.SAINT_VENANT_KIRCHHOFF
    c01: float = 0.0
    ogden_terms: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        E, nu, rho = self.youngs_modulus, self.poissons_ratio, self.density
        if not (math.isfinite(E) and E > 0.0):
            raise InputError(f"youngs_modulus = {E:g} Pa: needs a finite value above 0")
        if not -1.0 < nu < 0.5:
            raise InputError(
                f"poissons_ratio = {nu:g}: needs a value between -1 and 0.5, both excluded; "
                "for nearly incompressible tissue use 0.45 to 0.49"
            )
        if not (math.isfinite(rho) and rho > 0.0):
            raise InputError(f"density = {rho:g} kg/m3: needs a finite value above 0")
        try:
            object.__setattr__(self, "law", Law(self.law))
        except ValueError:
            raise InputError(
                f"law = {self.law!r} is not known; known are {', '.join(Law)}"
            ) from None
        if not math.isfinite(self.c01):
            raise InputError(f"c01 = {self.c01:g} Pa: needs a finite value")
        if self.c01 and not self.law.has_c01:
            known = " or ".join(law for law in Law if law.has_c01)
            raise InputError(f"c01 goes with law = {known}, not with {self.law}")
        object.__setattr__(self, "ogden_terms", checked_terms(self.law, self.ogden_terms))

    @classmethod
    def mooney_rivlin(
        cls,
        *,
        c10: float,
        c01: float,
        bulk_modulus: float,
        density: float = 1000.0,
        law: Law = Law.MOONEY_RIVLIN,
    ) -> Material:
        """W = c10 (J^(-2/3) I - 3) + c01 (J^(-4/3) II - 3) + bulk_modulus/2 (J - 1)^2.

        Args:
            c10: [Pa].
            c01: [Pa]; with mu = 2 (c10 + c01) > 0.
            bulk_modulus: kappa [Pa], > 0.
            density: [kg/m3], > 0.
            law: Or Law.MOONEY_RIVLIN_LOG, with bulk_modulus/2 (ln J)^2.

        Raises:
            InputError: Constants that are not positive definite at rest.

        >>> import palpate
        >>> tissue = palpate.Material.mooney_rivlin(c10=1e3, c01=500.0, bulk_modulus=50e3)
        >>> round(tissue.youngs_modulus), round(tissue.poissons_ratio, 3)
        (8824, 0.471)
        """
        mu = 2.0 * (c10 + c01)
        if not (math.isfinite(mu) and mu > 0.0):
            raise InputError(
                f"c10 = {c10:g} Pa and c01 = {c01:g} Pa: the shear modulus 2 (c10 + c01) must be "
                "above 0, or the body has no stable rest"
            )
        modulus, ratio = moduli_of(mu, bulk_modulus)
        return cls(modulus, ratio, density, Law(law), c01)

    @classmethod
    def ogden(
        cls, terms: Sequence[tuple[float, float]], *, bulk_modulus: float, density: float = 1000.0
    ) -> Material:
        """W = sum of mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3) + kappa/2 (J - 1)^2.

        Args:
            terms: mu_p [Pa] and alpha_p [-], one to three pairs; mu = sum of mu_p alpha_p / 2 > 0.
            bulk_modulus: kappa [Pa], > 0.
            density: [kg/m3], > 0.

        Raises:
            InputError: Constants that are not positive definite at rest.

        >>> import palpate
        >>> rubber = palpate.Material.ogden([(630.0, 1.3), (1.2, 5.0)], bulk_modulus=50e3)
        >>> round(rubber.youngs_modulus)
        1234
        """
        mu = 0.5 * sum(m * alpha for m, alpha in terms)
        if not (math.isfinite(mu) and mu > 0.0):
            raise InputError(
                f"Ogden's terms {list(terms)}: the shear modulus, half the sum of mu_p alpha_p, "
                "must be above 0, or the body has no stable rest"
            )
        modulus, ratio = moduli_of(mu, bulk_modulus)
        shares = tuple((0.5 * m * alpha / mu, alpha) for m, alpha in terms)
        return cls(modulus, ratio, density, Law.OGDEN, ogden_terms=shares)


@dataclass(frozen=True, eq=False)
class Inclusion:
    """Cells of another material than the rest of the body; cells shape (n,), each once.

    >>> import palpate
    >>> tumour = palpate.Inclusion([0, 1], palpate.Material(60e3, 0.45))
    >>> tumour.material.youngs_modulus
    60000.0
    """

    cells: Indices
    material: Material
