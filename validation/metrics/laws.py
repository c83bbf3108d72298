"""Energy and stress of the laws of tissue by cell, as the judge writes them himself.

In terms of H = F - I, C = F^T F and J as in `palpate.meshes.material_law.Law`, apart from fastsim
and from the reference. Stresses are written so that they take complex numbers: a derivative along
dH is the imaginary part of a step i h dH, without a difference and to rounding (W. Squire,
G. Trapp, SIAM Review 40, 1998).

Beside them the laws that a simulator may have used instead of the one asked for: each takes
the displacement gradient and Lame's parameters by cell to the first Piola-Kirchhoff stress P,
(num_cells, 3, 3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.material_law import Law
from palpate.meshes.problem import Strain

Array = NDArray[np.float64]
LawOfCells = Callable[[Array, Array, Array], Array]
OgdenTerms = Sequence[tuple[float, float]]

OTHER_STRAIN = {
    Strain.GREEN: "linear strain instead of Green strain",
    Strain.LINEAR: "Green strain instead of linear strain",
}
_ONE = np.eye(3)
_STEP = 1e-100
# Laws of simulators for graphics and robots, which take Saint-Venant-Kirchhoff's parameters.
_STABLE = (Law.NEO_HOOKEAN_STABLE, Law.NEO_HOOKEAN_STABLE_LOG, Law.NEO_HOOKEAN_ISOCHORIC)


def transposed(tensors: Array) -> Array:
    """The transpose of each."""
    return tensors.transpose(0, 2, 1)


def rotation_of(F: Array) -> Array:
    """The rotation nearest to each deformation gradient, (n, 3, 3) (Higham 1989)."""
    U, _, Vt = np.linalg.svd(F)
    # An inverted cell's nearest orthogonal matrix is a reflection: its last axis is turned back.
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    R: Array = U @ Vt
    return R


def tensor_power(C: Any, exponent: float) -> Any:
    """C^a of symmetric positive tensors, (n, 3, 3); of complex ones to first order in i Im C.

    The derivative of a tensor function by divided differences of its eigenvalues (Ju. L. Daleckii,
    S. G. Krein, 1965): (l^a - m^a) / (l - m) = m^(a - 1) (e^(a x) - 1) / (e^x - 1), x = ln(l / m),
    which has all its digits where l and m are close.
    """
    values, Q = np.linalg.eigh(C.real)
    with np.errstate(all="ignore"):
        found = (Q * (values**exponent)[:, None]) @ transposed(Q)
        if not np.iscomplexobj(C):
            return found
        one, other = values[:, :, None], values[:, None, :]
        relative = (one - other) / other
        quotient = np.expm1(exponent * np.log1p(relative)) / relative
        quotient = np.where(relative == 0.0, exponent, quotient)
        slopes = other ** (exponent - 1.0) * quotient
    return found + 1j * Q @ (slopes * (transposed(Q) @ C.imag @ Q)) @ transposed(Q)


def strain_of(H: Array, strain: Strain) -> Array:
    """Engineering strain, or Green's."""
    E = 0.5 * (H + transposed(H))
    return E + 0.5 * transposed(H) @ H if strain is Strain.GREEN else E


def hooke(E: Array, lmbda: Array, mu: Array) -> Array:
    """S = lmbda tr(E) I + 2 mu E."""
    S: Array = 2.0 * mu[:, None, None] * E
    diagonal = np.arange(3)
    S[:, diagonal, diagonal] += (lmbda * np.trace(E, axis1=1, axis2=2))[:, None]
    return S


def green(H: Array, lmbda: Array, mu: Array) -> Array:
    """Saint-Venant-Kirchhoff."""
    return push_forward(H, hooke(strain_of(H, Strain.GREEN), lmbda, mu), Strain.GREEN)


def linear(H: Array, lmbda: Array, mu: Array) -> Array:
    """Linear elasticity."""
    return hooke(strain_of(H, Strain.LINEAR), lmbda, mu)


def push_forward(H: Array, S: Array, strain: Strain) -> Array:
    """P of a stress of the strain measure."""
    P: Array = (_ONE + H) @ S if strain is Strain.GREEN else S
    return P


def sheared(strain: Strain, factor: float) -> LawOfCells:
    """Shear stresses `factor` times what they should be, normal ones right."""
    weights = np.where(_ONE > 0.0, 1.0, factor)

    def law(H: Array, lmbda: Array, mu: Array) -> Array:
        return push_forward(H, hooke(strain_of(H, strain), lmbda, mu) * weights, strain)

    return law


def _without_f(H: Array, lmbda: Array, mu: Array) -> Array:
    return hooke(strain_of(H, Strain.GREEN), lmbda, mu)


def _as_cauchy(H: Array, lmbda: Array, mu: Array) -> Array:
    F = _ONE + H
    S = hooke(strain_of(H, Strain.GREEN), lmbda, mu)
    P: Array = np.linalg.det(F)[:, None, None] * S @ transposed(np.linalg.inv(F))
    return P


def _transposed_gradient(H: Array, lmbda: Array, mu: Array) -> Array:
    return green(transposed(H), lmbda, mu)


def _half_missing(H: Array, lmbda: Array, mu: Array) -> Array:
    F = _ONE + H
    return push_forward(H, hooke(transposed(F) @ F - _ONE, lmbda, mu), Strain.GREEN)


def _neo_hookean(H: Array, lmbda: Array, mu: Array) -> Array:
    F = _ONE + H
    inverse = transposed(np.linalg.inv(F))
    with np.errstate(invalid="ignore", divide="ignore"):
        log_j = np.log(np.linalg.det(F))
    P: Array = mu[:, None, None] * (F - inverse) + (lmbda * log_j)[:, None, None] * inverse
    return P


def _neo_hookean_of_j(H: Array, lmbda: Array, mu: Array) -> Array:
    F = _ONE + H
    inverse, J = transposed(np.linalg.inv(F)), np.linalg.det(F)
    P: Array = mu[:, None, None] * (F - inverse) + (lmbda * (J - 1.0) * J)[:, None, None] * inverse
    return P


def _corotated(H: Array, lmbda: Array, mu: Array) -> Array:
    F = _ONE + H
    R = rotation_of(F)
    trace = np.einsum("cij,cij->c", R, F) - 3.0
    P: Array = 2.0 * mu[:, None, None] * (F - R) + (lmbda * trace)[:, None, None] * R
    return P


def laws_instead_of(strain: Strain) -> dict[str, LawOfCells]:
    """Laws that a simulator may have used where this strain measure was asked for, by name."""
    return {
        OTHER_STRAIN[strain]: linear if strain is Strain.GREEN else green,
        "engineering shear strain taken for tensor shear: shear stresses doubled": sheared(
            strain, 2.0
        ),
        "tensor shear strain taken for engineering shear: shear stresses halved": sheared(
            strain, 0.5
        ),
        "second Piola-Kirchhoff stress not pushed forward (P = S instead of F S)": _without_f,
        "second Piola-Kirchhoff stress taken for the Cauchy stress": _as_cauchy,
        "displacement gradient transposed": _transposed_gradient,
        "Green strain without its factor 1/2": _half_missing,
        "neo-Hookean law, with ln J": _neo_hookean,
        "neo-Hookean law, with J - 1": _neo_hookean_of_j,
        "corotated linear law": _corotated,
    }


# What each of the two measures strain by; the others are no laws of smoothed tetrahedra.
MEASURES: dict[LawOfCells, Strain] = {green: Strain.GREEN, linear: Strain.LINEAR}


def energy_density(
    law: Law, H: Array, lmbda: Array, mu: Array, c01: Array, terms: OgdenTerms = ()
) -> Array:
    """W of displacement gradients H = F - I by cell [J/m3], (num_cells,); NaN where there is none.

    By Lamé's parameters at rest by cell [Pa]; c01 and terms are read by Mooney and Rivlin's law and
    by Ogden's (see `Material`) only.
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
    for fraction, alpha in terms:
        isochoric = stretches * J[:, None] ** (-1 / 3)
        found = found + 2 * mu * fraction / alpha**2 * ((isochoric**alpha).sum(axis=1) - 3)
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
        return green(H, lmbda, mu)
    if law is Law.COROTATIONAL:
        U = tensor_power(transposed(F) @ F, 0.5)
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
    for fraction, alpha in terms:
        X = tensor_power(C * J ** (-2 / 3), 0.5 * alpha)
        X = X - _by_cell(np.trace(X, axis1=1, axis2=2)) / 3.0 * _ONE
        found = found + 2.0 * mu * fraction / alpha * X
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
    """Laws that may have been used where this strain measure and law were asked for, by name."""
    others = laws_instead_of(strain)
    if strain is Strain.LINEAR:
        return others
    if asked.is_linear_in_strain:
        return others | {f"{law} law": partial(_without_c01, law) for law in _STABLE}
    # A mistake in Saint-Venant-Kirchhoff's own formula is no mistake in another law's.
    common = (OTHER_STRAIN[strain], "neo-Hookean law, with J - 1")
    found = {name: others[name] for name in common}
    if not (asked is Law.OGDEN or asked.has_c01):
        name = "volume of inverted cells by its absolute value (|det F|)"
        found[name] = partial(_reflected, asked)
    for law in Law:
        if not (law in (asked, Law.OGDEN) or law.has_c01):
            found[f"{law} law"] = partial(_without_c01, law)
    return found


def _with_logarithm(lmbda: Any, mu: Any) -> tuple[Any, Any]:
    """The law's own mu and lambda, of those at rest (Smith, De Goes, Kim 2018, section 3.4)."""
    return 4.0 / 3.0 * mu, lmbda + 5.0 / 6.0 * mu


def _reflected(law: Law, H: Array, lmbda: Array, mu: Array) -> Array:
    """P of W(|det F|, C): that of F Q with a reflection Q where F is inverted, times Q.

    C and Q^T C Q have the same invariants, and det F Q = -det F.
    """
    Q = np.where(np.linalg.det(_ONE + H)[:, None, None] < 0.0, np.diag([1.0, 1.0, -1.0]), _ONE)
    P: Array = _without_c01(law, (_ONE + H) @ Q - _ONE, lmbda, mu) @ Q
    return P


def _without_c01(law: Law, H: Array, lmbda: Array, mu: Array) -> Array:
    return finite_stress(law, H, lmbda, mu, np.zeros_like(mu))


def _by_cell(values: Any) -> Any:
    return values[:, None, None]


def mistaken_constants(law: Law, lmbda: Array, mu: Array) -> dict[str, tuple[Array, Array]]:
    """Lamé's parameters [Pa] that a body has whose law was given them as its own constants.

    By what is said of it; nothing where the law's constants are Lamé's parameters. B. Smith, F. De
    Goes, T. Kim, "Stable Neo-Hookean Flesh Simulation", 2018, section 3.4, has the constants that
    give E and nu at rest.
    """
    return {
        Law.NEO_HOOKEAN_STABLE: {
            "lmbda instead of lmbda + mu as the constant of the law": (lmbda - mu, mu)
        },
        Law.NEO_HOOKEAN_STABLE_LOG: {
            "Lamé's parameters as the constants of the law": (lmbda - 0.625 * mu, 0.75 * mu)
        },
    }.get(law, {})
