"""Stress in plane strain: Hooke's law, and two of finite strain.

Saint-Venant-Kirchhoff's by Green strain, P = F S (eq. 6-7); and the stable neo-Hookean one of
`Law`, P = mu F + L (J - a) cof F. E_yy = 0, and J is that of the section.
"""

from __future__ import annotations

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Strain
from palpate.validation.studies.closed_forms import confined_modulus


def stress_of(material: Material, strain: Strain, H: Floats) -> tuple[Floats, Floats]:
    """First Piola-Kirchhoff stress in plane strain, and its slope.

    Args:
        material: Young's modulus, Poisson's ratio, and with Green strain the law.
        strain: Which strain measure.
        H: Displacement gradients, shape (elements, places, 2, 2).

    Returns:
        P [Pa], of the same shape, and dP/dH [Pa], two more axes of 2 behind.

    Raises:
        InputError: A law that is not written here.
    """
    if material.law not in (Law.SAINT_VENANT_KIRCHHOFF, Law.NEO_HOOKEAN_STABLE):
        raise InputError(f"no plane strain here with law = {material.law}")
    eye, mu = np.eye(2), 0.5 * material.youngs_modulus / (1.0 + material.poissons_ratio)
    lmbda = confined_modulus(material) - 2.0 * mu
    F = H + eye
    if strain is Strain.GREEN and material.law is Law.NEO_HOOKEAN_STABLE:
        bulk = lmbda + mu
        turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
        cofactor = turn @ F @ turn.T
        excess = np.linalg.det(F) - 1.0 - mu / bulk
        P = mu * F + bulk * excess[..., None, None] * cofactor
        A = bulk * np.einsum("eqij,eqkl->eqijkl", cofactor, cofactor)
        A += bulk * np.einsum("eq,ik,jl->eqijkl", excess, turn, turn)
        return P, A + mu * np.einsum("ik,jl->ijkl", eye, eye)
    C = lmbda * np.einsum("ij,kl->ijkl", eye, eye) + mu * (
        np.einsum("ik,jl->ijkl", eye, eye) + np.einsum("il,jk->ijkl", eye, eye)
    )
    if strain is Strain.LINEAR:
        P = np.einsum("ijkl,eqkl->eqij", C, H)
        return P, np.broadcast_to(C, (*H.shape[:2], 2, 2, 2, 2))
    S = np.einsum("ijkl,eqkl->eqij", C, 0.5 * (np.swapaxes(F, 2, 3) @ F - eye))
    A = np.einsum("eqia,ajbl,eqkb->eqijkl", F, C, F, optimize=True)
    return F @ S, A + np.einsum("ik,eqlj->eqijkl", eye, S)
