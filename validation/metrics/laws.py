"""Laws that a simulator may have used in the place of the one asked for.

Each takes the displacement gradient H = F - I and Lamé's parameters by cell to the first
Piola-Kirchhoff stress P, (num_cells, 3, 3).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.problem import Strain

Array = NDArray[np.float64]
Law = Callable[[Array, Array, Array], Array]

OTHER_STRAIN = {
    Strain.GREEN: "linear strain in the place of Green strain",
    Strain.LINEAR: "Green strain in the place of linear strain",
}
_ONE = np.eye(3)


def transposed(tensors: Array) -> Array:
    """The transpose of each."""
    return tensors.transpose(0, 2, 1)


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


def sheared(strain: Strain, factor: float) -> Law:
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
    U, _, Vt = np.linalg.svd(F)
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    R = U @ Vt
    trace = np.einsum("cij,cij->c", R, F) - 3.0
    P: Array = 2.0 * mu[:, None, None] * (F - R) + (lmbda * trace)[:, None, None] * R
    return P


def laws_instead_of(strain: Strain) -> dict[str, Law]:
    """By name, the laws that may stand where this strain measure was asked for."""
    return {
        OTHER_STRAIN[strain]: linear if strain is Strain.GREEN else green,
        "engineering shear strain taken for tensor shear: shear stresses doubled": sheared(
            strain, 2.0
        ),
        "tensor shear strain taken for engineering shear: shear stresses halved": sheared(
            strain, 0.5
        ),
        "second Piola-Kirchhoff stress not pushed forward (P = S in the place of F S)": _without_f,
        "second Piola-Kirchhoff stress taken for the Cauchy stress": _as_cauchy,
        "displacement gradient transposed": _transposed_gradient,
        "Green strain without its factor 1/2": _half_missing,
        "neo-Hookean law, with ln J": _neo_hookean,
        "neo-Hookean law, with J - 1": _neo_hookean_of_j,
        "corotated linear law": _corotated,
    }


# What each of the two measures strain by; the others are no laws of smoothed tetrahedra.
MEASURES: dict[Law, Strain] = {green: Strain.GREEN, linear: Strain.LINEAR}


def law_of(strain: Strain) -> Law:
    """The law that was asked for."""
    return green if strain is Strain.GREEN else linear
