"""Elastic laws by name, for finite strain; under linear strain all of them are Hooke's.

Written in F, C = F^T F, J = det F, I = tr C and II = (I^2 - tr C^2) / 2. Every law is named with
the moduli that it has at rest: Young's modulus and Poisson's ratio, or Lamé's lmbda and mu of
them. For small strains and turns all agree.
"""

from __future__ import annotations

from enum import StrEnum


class Law(StrEnum):
    """An isotropic elastic law: what a body's energy W is made of, by volume at rest [J/m3].

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
    def is_linear_in_strain(self) -> bool:
        """Whether S = lmbda tr(E) I + 2 mu E."""
        return self is Law.SAINT_VENANT_KIRCHHOFF
