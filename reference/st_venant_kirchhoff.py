"""The Saint-Venant-Kirchhoff material: Green strain with a linear stress law.

psi(E) = lmbda/2 tr(E)^2 + mu E : E. J. Bonet, R. D. Wood, Nonlinear Continuum Mechanics for
Finite Element Analysis, 2nd ed. 2008, section 6.3.

Note:
    Softens and then inverts under strong compression: in uniaxial strain or free uniaxial stress
    the nominal stress turns at the stretch 1/sqrt(3) = 0.577. Not for stretches below that.
"""

from __future__ import annotations

from typing import Any

from palpate.reference.fenicsx import ufl
from palpate.reference.kinematics import deformation_gradient, green_lagrange_strain


def strain_energy_density(E: Any, lmbda: Any, mu: Any) -> Any:
    """Return psi = lmbda/2 tr(E)^2 + mu E : E [J/m3]."""
    return lmbda / 2 * ufl.tr(E) ** 2 + mu * ufl.inner(E, E)


def second_piola_kirchhoff_stress(E: Any, lmbda: Any, mu: Any) -> Any:
    """Return S = lmbda tr(E) I + 2 mu E [Pa]."""
    return lmbda * ufl.tr(E) * ufl.Identity(E.ufl_shape[0]) + 2 * mu * E


def first_piola_kirchhoff_stress(F: Any, lmbda: Any, mu: Any) -> Any:
    """Return P = F S [Pa]."""
    return F * second_piola_kirchhoff_stress(green_lagrange_strain(F), lmbda, mu)


def energy_density(u: Any, lmbda: Any, mu: Any) -> Any:
    """Return psi of a displacement [J/m3]."""
    return strain_energy_density(green_lagrange_strain(deformation_gradient(u)), lmbda, mu)


def internal_virtual_work_density(u: Any, v: Any, lmbda: Any, mu: Any) -> Any:
    """Return P(u) : grad v [J/m3]."""
    return ufl.inner(first_piola_kirchhoff_stress(deformation_gradient(u), lmbda, mu), ufl.grad(v))
