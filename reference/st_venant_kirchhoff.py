"""The Saint-Venant-Kirchhoff material: Green strain with a linear stress law.

psi(E) = lmbda/2 tr(E)^2 + mu E : E. J. Bonet, R. D. Wood, Nonlinear Continuum Mechanics for
Finite Element Analysis, 2nd ed. 2008, section 6.3.

With the engineering strain in E's place it is linear elasticity, and S is Cauchy's stress: the
control, and the paper's eq. 1-5. A finite rotation strains that, so bodies that turn grow.

Note:
    Softens and then inverts under strong compression: in uniaxial strain or free uniaxial stress
    the nominal stress turns at the stretch 1/sqrt(3) = 0.577. Not for stretches below that.
"""

from __future__ import annotations

from typing import Any

from palpate.reference.fenicsx import ufl


def strain_energy_density(E: Any, lmbda: Any, mu: Any) -> Any:
    """Return psi = lmbda/2 tr(E)^2 + mu E : E [J/m3]."""
    return lmbda / 2 * ufl.tr(E) ** 2 + mu * ufl.inner(E, E)


def second_piola_kirchhoff_stress(E: Any, lmbda: Any, mu: Any) -> Any:
    """Return S = lmbda tr(E) I + 2 mu E (the paper's eq. 2) [Pa]."""
    return lmbda * ufl.tr(E) * ufl.Identity(E.ufl_shape[0]) + 2 * mu * E
