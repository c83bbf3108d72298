"""Kinematics of finite deformation and elastic laws in UFL.

J. Bonet, R. D. Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed. 2008,
chapters 4 and 6; the paper: Yan et al. 2007, "Soft Tissue Deformation Simulation in Virtual Surgery
using Nonlinear Finite Element Method".

The formula, source and range of each law are in `palpate.meshes.material_law.Law`. With the
engineering strain instead of E Saint-Venant-Kirchhoff's law is linear elasticity, S is Cauchy's
stress, and the equations are the paper's eq. 1-5. The engineering strain of a finite rotation is
not zero: bodies that turn grow. Laws in invariants of C are written as energies, from which UFL
derives stresses and tangents; laws in stretches are in `principal_laws`.

Note:
    Energies in F lose digits for small displacements: the rounding error of forces is that of the
    moduli times the areas, about 1e-16 / |strain| relative to the forces.
"""

from __future__ import annotations

from typing import Any

from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Strain
from palpate.reference.fenicsx import ufl


def lame_parameters(material: Material) -> tuple[float, float]:
    """Return lmbda and mu [Pa] of an isotropic material."""
    E, nu = material.youngs_modulus, material.poissons_ratio
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def deformation_gradient(u: Any) -> Any:
    """Return F = I + grad u [-]."""
    return ufl.Identity(len(u)) + ufl.grad(u)


def right_cauchy_green(F: Any) -> Any:
    """Return C = F^T F [-]."""
    return F.T * F


def green_lagrange_strain(F: Any) -> Any:
    """Return E = (C - I) / 2 (the paper's eq. 6-7) [-]."""
    return (right_cauchy_green(F) - ufl.Identity(F.ufl_shape[0])) / 2


def engineering_strain(u: Any) -> Any:
    """Return the linear part of E, (grad u + grad u^T) / 2 (the paper's eq. 3-4) [-].

    It is not zero for a finite rotation.
    """
    return ufl.sym(ufl.grad(u))


def strain_tensor(u: Any, strain: Strain) -> Any:
    """Return Green's strain of a displacement, or its linear part [-]."""
    if strain is Strain.LINEAR:
        return engineering_strain(u)
    return green_lagrange_strain(deformation_gradient(u))


def cofactor(F: Any) -> Any:
    """Return cof F = det(F) F^-T, written without a division, so that it exists for any F.

    Nanson's formula: n da = cof(F) N dA.
    """
    a, b, c = F[:, 0], F[:, 1], F[:, 2]
    return ufl.as_tensor([ufl.cross(b, c), ufl.cross(c, a), ufl.cross(a, b)]).T


def strain_energy_density(E: Any, lmbda: Any, mu: Any) -> Any:
    """Return psi = lmbda/2 tr(E)^2 + mu E : E [J/m3]."""
    return lmbda / 2 * ufl.tr(E) ** 2 + mu * ufl.inner(E, E)


def second_piola_kirchhoff_stress(E: Any, lmbda: Any, mu: Any) -> Any:
    """Return S = lmbda tr(E) I + 2 mu E (the paper's eq. 2) [Pa]."""
    return lmbda * ufl.tr(E) * ufl.Identity(E.ufl_shape[0]) + 2 * mu * E


def energy_density(F: Any, law: Law, lmbda: Any, mu: Any, c01: Any) -> Any:
    """Energy density W of a deformation gradient [J/m3], 0 at rest, of moduli at rest [Pa].

    det F > 0 except for the stable neo-Hookean laws. The law is neither Saint-Venant-Kirchhoff's,
    which is written in E, nor a law in stretches; only Mooney and Rivlin's reads c01.
    """
    return _density(right_cauchy_green(F), ufl.det(F), law, lmbda, mu, c01)


def shape_energy_density(E: Any, law: Law, mu: Any, c01: Any) -> Any:
    """Energy density W of a Green strain [J/m3] with lmbda = 0, J the root of det C; see above.

    E is symmetric with C = I + 2 E positive definite; need not be the strain of a displacement.
    """
    C = ufl.Identity(3) + 2 * E
    return _density(C, ufl.sqrt(ufl.det(C)), law, 0, mu, c01)


def _density(C: Any, J: Any, law: Law, lmbda: Any, mu: Any, c01: Any) -> Any:
    first = ufl.tr(C)
    match law:
        case Law.NEO_HOOKEAN_STABLE:
            # mu/2 (I - 3) + L/2 (J - 1 - mu/L)^2 - mu^2 / (2 L), L = lmbda + mu.
            L = lmbda + mu
            return mu / 2 * (first - 3) + L / 2 * (J - 1 - mu / L) ** 2 - mu**2 / (2 * L)
        case Law.NEO_HOOKEAN_STABLE_LOG:
            # m/2 (I - 3) + l/2 (J - a)^2 - m/2 ln(I + 1), a = 1 + 3/4 m/l, less its value at rest.
            m, l = 4 * mu / 3, lmbda + 5 * mu / 6  # noqa: E741
            a = 1 + 3 * m / (4 * l)
            volume = l / 2 * ((J - a) ** 2 - (1 - a) ** 2)
            return m / 2 * (first - 3) + volume - m / 2 * ufl.ln((first + 1) / 4)
        case Law.NEO_HOOKEAN:
            return mu / 2 * (first - 3) - mu * ufl.ln(J) + lmbda / 2 * ufl.ln(J) ** 2
        case Law.NEO_HOOKEAN_ISOCHORIC:
            return mu / 2 * (J ** (-2 / 3) * first - 3) + _by_volume(J - 1, lmbda, mu)
        case Law.MOONEY_RIVLIN | Law.MOONEY_RIVLIN_LOG:
            second = (first**2 - ufl.tr(C * C)) / 2
            shape = (mu / 2 - c01) * (J ** (-2 / 3) * first - 3)
            change = ufl.ln(J) if law.is_by_log_of_volume else J - 1
            return shape + c01 * (J ** (-4 / 3) * second - 3) + _by_volume(change, lmbda, mu)
    raise ValueError(f"{law} is written in E, or in stretches: see principal_laws")


def _by_volume(change: Any, lmbda: Any, mu: Any) -> Any:
    return (lmbda + 2 * mu / 3) / 2 * change**2


def first_piola_kirchhoff_stress(F: Any, law: Law, lmbda: Any, mu: Any, c01: Any) -> Any:
    """P = dW/dF [Pa]."""
    F = ufl.variable(F)
    return ufl.diff(energy_density(F, law, lmbda, mu, c01), F)


def volume_change(F: Any, law: Law) -> Any:
    """Measure g(J) of the law's volumetric energy lmbda/2 g(J)^2: J - 1, or ln J."""
    J = ufl.det(F)
    return ufl.ln(J) if law.is_by_log_of_volume else J - 1


def quadrature_degree(degree: int) -> int:
    """Degree to which the virtual work is integrated for displacements of a polynomial degree.

    Exact for linear ones, where F is constant in a cell, and for the stable neo-Hookean law, whose
    W is of degree 6 in F. The others are not polynomials and are integrated with the same degree.
    """
    return 6 * (degree - 1)
