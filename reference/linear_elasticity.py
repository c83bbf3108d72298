"""Linear elasticity: engineering strain with the same linear stress law.

The control beside the Saint-Venant-Kirchhoff material, and the paper's eq. 1-5.

Note:
    A finite rotation strains it, so bodies that turn grow; not for rotations beyond a few degrees.
"""

from __future__ import annotations

from typing import Any

from palpate.reference.fenicsx import ufl
from palpate.reference.kinematics import engineering_strain


def cauchy_stress(u: Any, lmbda: Any, mu: Any) -> Any:
    """Return sigma = lmbda tr(eps) I + 2 mu eps [Pa]."""
    strain = engineering_strain(u)
    return lmbda * ufl.tr(strain) * ufl.Identity(len(u)) + 2 * mu * strain


def energy_density(u: Any, lmbda: Any, mu: Any) -> Any:
    """Return psi = sigma : eps / 2 [J/m3]."""
    return ufl.inner(cauchy_stress(u, lmbda, mu), engineering_strain(u)) / 2


def internal_virtual_work_density(u: Any, v: Any, lmbda: Any, mu: Any) -> Any:
    """Return sigma(u) : grad v [J/m3]."""
    return ufl.inner(cauchy_stress(u, lmbda, mu), ufl.grad(v))
