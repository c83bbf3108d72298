"""Kinematics of finite deformation in UFL.

J. Bonet, R. D. Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed. 2008,
chapter 4; the paper: Yan et al. 2007, "Soft Tissue Deformation Simulation in Virtual Surgery
using Nonlinear Finite Element Method".
"""

from __future__ import annotations

from typing import Any

from palpate.meshes.problem import Strain
from palpate.reference.fenicsx import ufl


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

    Not zero for a finite rotation.
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
