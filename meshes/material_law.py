"""Elastic laws by name, and materials; under linear strain every law is Hooke's.

Written in F, C = F^T F, J = det F, I = tr C and II = (I^2 - tr C^2) / 2. The moduli of every law
are those at rest: Young's modulus and Poisson's ratio, or Lamé's lmbda and mu of them. For small
strains and rotations all laws agree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from palpate.meshes.arrays import Indices
from palpate.meshes.errors import InputError


class Law(StrEnum):
    """An isotropic elastic law: the strain energy W per volume at rest [J/m3].

    SAINT_VENANT_KIRCHHOFF: W = lmbda/2 tr(E)^2 + mu E : E, E = (C - I) / 2. Softens below a
        stretch of 1/sqrt(3) = 0.577 and lets cells turn inside out: for large turns, small strains.
    NEO_HOOKEAN_STABLE: W = mu/2 (I - 3) + L/2 (J - a)^2 less its value at rest, L = lmbda + mu,
        a = 1 + mu/L (B. Smith, F. De Goes, T. Kim, Stable Neo-Hookean Flesh Simulation, ACM Trans.
        Graph. 37(2), 2018, section 3, without the logarithm of their last form). Programs that are
        given this law's own two constants, as Newton's and SOFA's, call L lambda: give them
        lmbda + mu where E and nu are meant. W and its stress stay finite at J <= 0, so a solver may
        pass through an inverted cell; but crushing a body to nothing costs a finite energy too, so
        not for strong compression.
    NEO_HOOKEAN_STABLE_LOG: W = m/2 (I - 3) + l/2 (J - a)^2 - m/2 ln(I + 1) less its value at rest,
        m = 4/3 mu, l = lmbda + 5/6 mu, a = 1 + 3/4 m/l (the same paper, section 3.4: their last
        form, which Newton's semi-implicit solver has). Programs that are given its own two
        constants call them mu and lambda: give them m and l where E and nu are meant. Finite at
        J <= 0 like the one without the logarithm, and for the same range.
    NEO_HOOKEAN: W = mu/2 (I - 3) - mu ln J + lmbda/2 (ln J)^2 (J. Bonet, R. D. Wood, 2nd ed. 2008,
        section 6.4.3). W is infinite at J = 0. The pressure lmbda ln(J) / J falls from
        J = e = 2.718 upwards: not for swelling beyond.
    NEO_HOOKEAN_ISOCHORIC: W = mu/2 (J^(-2/3) I - 3) + kappa/2 (J - 1)^2, kappa = lmbda + 2/3 mu
        (J. C. Simo, R. L. Taylor, K. S. Pister, CMAME 51, 1985: shape and volume apart, with the
        simplest volumetric part). That part stays finite at J = 0: for kappa well above mu, where J
        stays near 1.
    MOONEY_RIVLIN: W = c10 (J^(-2/3) I - 3) + c01 (J^(-4/3) II - 3) + kappa/2 (J - 1)^2, with
        mu = 2 (c10 + c01). The same volumetric part. With c10 or c01 below 0, which some fits
        have, it is positive definite at rest but not at all stretches: stay where it was fitted.
    MOONEY_RIVLIN_LOG: the same with kappa/2 (ln J)^2, as FEBio has it. W is infinite at J = 0; the
        pressure kappa ln(J) / J falls from J = e = 2.718 upwards.
    OGDEN: W = sum over p of mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3)
        + kappa/2 (J - 1)^2, with l_i the principal stretches times J^(-1/3), one to three terms and
        mu = sum of mu_p alpha_p / 2 (R. W. Ogden, Proc. R. Soc. London A 328, 1972; Abaqus' mu_p is
        this mu_p alpha_p / 2). The same volumetric part; terms with mu_p alpha_p < 0 are stable
        only near where they were fitted.
    COROTATIONAL: W = mu |F - R|^2 + lmbda/2 (tr(R^T F) - 3)^2, F = R U, which is
        mu (U - I) : (U - I) + lmbda/2 tr(U - I)^2 (A. McAdams and others, Efficient Elasticity for
        Character Skinning, ACM Trans. Graph. 30(4), 2011, section 3; with the turn's derivative,
        which some codes leave out). Finite at J = 0, and R is that of U = root of C, which turns
        cells inside out for nothing: for large turns, stretches near 1. Under strong compression it
        loses its stability: dP/dF has a negative eigenvalue where l_i + l_j is below
        2 - lmbda/mu (l1 + l2 + l3 - 3) for two of the stretches.

    >>> import palpate
    >>> palpate.Law("neo-hookean")
    <Law.NEO_HOOKEAN: 'neo-hookean'>
    """

    SAINT_VENANT_KIRCHHOFF = "saint-venant-kirchhoff"
    NEO_HOOKEAN_STABLE = "neo-hookean-stable"
    NEO_HOOKEAN_STABLE_LOG = "neo-hookean-stable-log"
    NEO_HOOKEAN = "neo-hookean"
    NEO_HOOKEAN_ISOCHORIC = "neo-hookean-isochoric"
    MOONEY_RIVLIN = "mooney-rivlin"
    MOONEY_RIVLIN_LOG = "mooney-rivlin-log"
    OGDEN = "ogden"
    COROTATIONAL = "corotational"

    @property
    def is_of_stretches(self) -> bool:
        """Whether it is written in principal stretches."""
        return self in (Law.OGDEN, Law.COROTATIONAL)

    @property
    def has_c01(self) -> bool:
        """Whether it has a constant beside the moduli at rest, Mooney and Rivlin's c01."""
        return self in (Law.MOONEY_RIVLIN, Law.MOONEY_RIVLIN_LOG)

    @property
    def is_by_log_of_volume(self) -> bool:
        """Whether lmbda's part of W is lmbda/2 (ln J)^2."""
        return self in (Law.NEO_HOOKEAN, Law.MOONEY_RIVLIN_LOG)

    @property
    def is_finite_when_inverted(self) -> bool:
        """Whether W is finite, and smooth, at J <= 0."""
        return self in (
            Law.SAINT_VENANT_KIRCHHOFF,
            Law.NEO_HOOKEAN_STABLE,
            Law.NEO_HOOKEAN_STABLE_LOG,
        )

    @property
    def is_linear_in_strain(self) -> bool:
        """Whether S = lmbda tr(E) I + 2 mu E."""
        return self is Law.SAINT_VENANT_KIRCHHOFF


# Exponents in use are between -10 and 25 (soft tissue); beyond, powers overflow.
_LARGEST_EXPONENT = 50.0


def checked_terms(
    law: Law, given: Sequence[tuple[float, float]]
) -> tuple[tuple[float, float], ...]:
    """Ogden's terms, each a fraction of the shear modulus and an exponent; see `Material`."""
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
    """Young's modulus [Pa] and Poisson's ratio from the shear and the bulk modulus [Pa], > 0."""
    if not (math.isfinite(bulk_modulus) and bulk_modulus > 0.0):
        raise InputError(f"bulk_modulus = {bulk_modulus:g} Pa: needs a finite value above 0")
    denominator = 3.0 * bulk_modulus + mu
    return (
        9.0 * bulk_modulus * mu / denominator,
        (3.0 * bulk_modulus - 2.0 * mu) / (2.0 * denominator),
    )


# Of Young's modulus [Pa] and the density [kg/m3]: squares and cubes of them, and what is built of
# them, are within the range of a float. No material is near either.
LEAST_CONSTANT, LARGEST_CONSTANT = 1e-30, 1e30


@dataclass(frozen=True)
class Material:
    """Isotropic elastic solid: its moduli at rest, and the law it follows under finite strain.

    Args:
        youngs_modulus: At rest [Pa], > 0.
        poissons_ratio: At rest [-], between -1 and 0.5, both excluded.
        density: At rest [kg/m3], > 0.
        law: Law under finite strain; under linear strain every law is Hooke's.
        c01: Constant of the second invariant [Pa], only for laws that have one; `mooney_rivlin`
            takes the three constants that the law is written with.
        ogden_terms: Only for Law.OGDEN, one to three: the term's fraction of mu,
            mu_p alpha_p / (2 mu), all of which add up to 1, and its exponent alpha_p; `ogden`
            takes the constants that the law is written with.

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
        if not LEAST_CONSTANT <= E <= LARGEST_CONSTANT:
            raise InputError(
                f"youngs_modulus = {E:g} Pa: needs a value from {LEAST_CONSTANT:g} to "
                f"{LARGEST_CONSTANT:g}, above 0 and of some material"
            )
        if not -1.0 < nu < 0.5:
            raise InputError(
                f"poissons_ratio = {nu:g}: needs a value between -1 and 0.5, both excluded; "
                "for nearly incompressible tissue use 0.45 to 0.49"
            )
        if not LEAST_CONSTANT <= rho <= LARGEST_CONSTANT:
            raise InputError(
                f"density = {rho:g} kg/m3: needs a value from {LEAST_CONSTANT:g} to "
                f"{LARGEST_CONSTANT:g}, above 0 and of some material"
            )
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
        fractions = tuple((0.5 * m * alpha / mu, alpha) for m, alpha in terms)
        return cls(modulus, ratio, density, Law.OGDEN, ogden_terms=fractions)


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
