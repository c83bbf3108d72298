"""Energy and stress of the laws for finite strain, by cell, as the judge writes them himself.

In terms of F, C = F^T F and J as in `palpate.meshes.material_law.Law`, apart from fastsim and the
reference. Stresses are written so that they take complex numbers: a derivative along dH is the
imaginary part of a step i h dH, without a difference and to rounding (W. Squire, G. Trapp, SIAM
Review 40, 1998).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from palpate.meshes.material_law import Law
from palpate.meshes.problem import Strain
from palpate.validation.metrics.laws import (
    OTHER_STRAIN,
    Array,
    hooke,
    laws_instead_of,
    strain_of,
    transposed,
)
from palpate.validation.metrics.laws import Law as LawOfCells
from palpate.validation.metrics.matrix_powers import power, root

OgdenTerms = Sequence[tuple[float, float]]

_STEP = 1e-100
# Of simulators for graphics and robots, which take Saint-Venant-Kirchhoff's parameters.
_STABLE = (Law.NEO_HOOKEAN_STABLE, Law.NEO_HOOKEAN_STABLE_LOG, Law.NEO_HOOKEAN_ISOCHORIC)
_ONE = np.eye(3)


def energy_density(
    law: Law, H: Array, lmbda: Array, mu: Array, c01: Array, terms: OgdenTerms = ()
) -> Array:
    """W of displacement gradients [J/m3], (num_cells,); NaN where the law has none.

    Args:
        law: Any.
        H: F - I, (num_cells, 3, 3).
        lmbda: Lamé's first parameter at rest [Pa], (num_cells,).
        mu: The second.
        c01: Of Mooney and Rivlin's law [Pa]; read by no other.
        terms: Of Ogden's law (see `Material`); read by no other.
    """
    if law is Law.SAINT_VENANT_KIRCHHOFF:
        E = strain_of(H, Strain.GREEN)
        density: Array = 0.5 * np.einsum("cij,cij->c", E, hooke(E, lmbda, mu))
        return density
    F = _ONE + H
    C = transposed(F) @ F
    J, first = np.linalg.det(F), np.trace(C, axis1=1, axis2=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        match law:
            case Law.NEO_HOOKEAN_STABLE:
                own = lmbda + mu
                alpha = 1.0 + mu / own
                found = mu / 2 * (first - 3) + own / 2 * ((J - alpha) ** 2 - (1 - alpha) ** 2)
            case Law.NEO_HOOKEAN_STABLE_LOG:
                m, own = _with_logarithm(lmbda, mu)
                volume = own / 2 * (J - 1) ** 2 - 0.75 * m * (J - 1)
                found = m / 2 * (first - 3 - np.log((first + 1) / 4)) + volume
            case Law.NEO_HOOKEAN:
                found = mu / 2 * (first - 3) - mu * np.log(J) + lmbda / 2 * np.log(J) ** 2
            case Law.COROTATIONAL | Law.OGDEN:
                stretches = np.sqrt(np.maximum(np.linalg.eigvalsh(C), 0.0))
                return _energy_of_stretches(law, stretches, lmbda, mu, terms)
            case _:
                c01 = c01 if law.has_c01 else np.zeros_like(c01)
                change = np.log(J) if law.is_by_log_of_volume else J - 1
                second = (first**2 - np.einsum("cij,cij->c", C, C)) / 2
                kappa = lmbda + 2 * mu / 3
                found = (mu / 2 - c01) * (J ** (-2 / 3) * first - 3)
                found = found + c01 * (J ** (-4 / 3) * second - 3) + kappa / 2 * change**2
    density = np.asarray(found)
    return density


def _energy_of_stretches(
    law: Law, stretches: Array, lmbda: Array, mu: Array, terms: OgdenTerms
) -> Array:
    found: Array
    if law is Law.COROTATIONAL:
        less = stretches - 1.0
        found = mu * (less**2).sum(axis=1) + lmbda / 2 * less.sum(axis=1) ** 2
        return found
    J = stretches.prod(axis=1)
    found = (lmbda + 2 * mu / 3) / 2 * (J - 1) ** 2
    for share, alpha in terms:
        isochoric = stretches * J[:, None] ** (-1 / 3)
        found = found + 2 * mu * share / alpha**2 * ((isochoric**alpha).sum(axis=1) - 3)
    return found


def finite_stress(
    law: Law, H: Array, lmbda: Array, mu: Array, c01: Array, terms: OgdenTerms = ()
) -> Array:
    """P = dW/dF of displacement gradients [Pa], (num_cells, 3, 3); for arguments see above.

    Raises:
        LinAlgError: A cell that is squeezed flat, where the law has no stress.
    """
    F = _ONE + H
    if law is Law.SAINT_VENANT_KIRCHHOFF:
        E = 0.5 * (H + transposed(H) + transposed(H) @ H)
        trace = _by_cell(np.trace(E, axis1=1, axis2=2))
        return np.asarray(F @ (_by_cell(lmbda) * trace * _ONE + 2.0 * _by_cell(mu) * E))
    if law is Law.COROTATIONAL:
        U = root(transposed(F) @ F)
        R = F @ np.linalg.inv(U)
        stretch = _by_cell(np.trace(U, axis1=1, axis2=2) - 3.0)
        return np.asarray(2.0 * _by_cell(mu) * (F - R) + _by_cell(lmbda) * stretch * R)
    J = _by_cell(np.linalg.det(F))
    # J F^-T = cof F = dJ/dF.
    cofactor = J * transposed(np.linalg.inv(F))
    lmbda, mu, c01 = (_by_cell(of) for of in (lmbda, mu, c01))
    with np.errstate(invalid="ignore", divide="ignore"):
        match law:
            case Law.NEO_HOOKEAN_STABLE:
                return np.asarray(mu * F + ((lmbda + mu) * (J - 1.0) - mu) * cofactor)
            case Law.NEO_HOOKEAN_STABLE_LOG:
                m, own = _with_logarithm(lmbda, mu)
                more = _by_cell(np.einsum("cij,cij->c", F, F)) + 1.0
                return np.asarray(
                    m * (1.0 - 1.0 / more) * F + (own * (J - 1.0) - 0.75 * m) * cofactor
                )
            case Law.NEO_HOOKEAN:
                return np.asarray(mu * F + (lmbda * np.log(J) - mu) / J * cofactor)
        C = transposed(F) @ F
        if law is Law.OGDEN:
            return np.asarray(cofactor @ _kirchhoff_of_ogden(C, J, lmbda, mu, terms) / J)
        c01 = c01 if law.has_c01 else np.zeros_like(c01)
        first = _by_cell(np.trace(C, axis1=1, axis2=2))
        second = (first**2 - _by_cell(np.einsum("cij,cji->c", C, C))) / 2
        shrunk = J ** (-1 / 3)
        of_first = 2.0 * shrunk**2 * (F - first / (3.0 * J) * cofactor)
        of_second = 2.0 * shrunk**4 * (first * F - F @ C - 2.0 * second / (3.0 * J) * cofactor)
        change = np.log(J) / J if law.is_by_log_of_volume else J - 1.0
    pressure = (lmbda + 2.0 * mu / 3.0) * change
    return np.asarray((mu / 2.0 - c01) * of_first + c01 * of_second + pressure * cofactor)


def _kirchhoff_of_ogden(C: Any, J: Any, lmbda: Any, mu: Any, terms: OgdenTerms) -> Array:
    """F^T P = sum of mu_p dev (C / J^(2/3))^(alpha_p / 2) + kappa J (J - 1) I."""
    found = (lmbda + 2.0 * mu / 3.0) * J * (J - 1.0) * _ONE
    for share, alpha in terms:
        X = power(C * J ** (-2 / 3), 0.5 * alpha)
        X = X - _by_cell(np.trace(X, axis1=1, axis2=2)) / 3.0 * _ONE
        found = found + 2.0 * mu * share / alpha * X
    return np.asarray(found)


def stress_change(
    law: Law,
    H: Array,
    dH: Array,
    lmbda: Array,
    mu: Array,
    c01: Array,
    terms: OgdenTerms = (),
) -> Array:
    """Derivative of P along dH [Pa], (num_cells, 3, 3), exact to rounding."""
    return along(lambda at: finite_stress(law, at, lmbda, mu, c01, terms), H, dH)


def along(stress: Callable[[Array], Array], H: Array, dH: Array) -> Array:
    """Derivative of a stress that takes complex H along dH, both (num_cells, 3, 3)."""
    stepped: Any = H + 1j * _STEP * dH
    change: Array = np.imag(stress(stepped)) / _STEP
    return change


def laws_instead_of_law(strain: Strain, asked: Law) -> dict[str, LawOfCells]:
    """By name, the laws that may stand where this strain measure and law were asked for."""
    others = laws_instead_of(strain)
    if strain is Strain.LINEAR:
        return others
    if asked.is_linear_in_strain:
        return others | {f"{law} law": partial(_without_c01, law) for law in _STABLE}
    # Slips in Saint-Venant-Kirchhoff's own formula are none of another law's.
    kept = (OTHER_STRAIN[strain], "neo-Hookean law, with J - 1")
    found = {name: others[name] for name in kept}
    for law in Law:
        if not (law in (asked, Law.OGDEN) or law.has_c01):
            found[f"{law} law"] = partial(_without_c01, law)
    return found


def _with_logarithm(lmbda: Any, mu: Any) -> tuple[Any, Any]:
    """The law's own mu and lambda, of those at rest (Smith, De Goes, Kim 2018, section 3.4)."""
    return 4.0 / 3.0 * mu, lmbda + 5.0 / 6.0 * mu


def _without_c01(law: Law, H: Array, lmbda: Array, mu: Array) -> Array:
    return finite_stress(law, H, lmbda, mu, np.zeros_like(mu))


def _by_cell(values: Any) -> Any:
    return values[:, None, None]
