"""A confined column pulled by its own weight: a smooth nonlinear problem with a closed form.

Rollers on the sides leave one unknown, the stretch a(x) along the column of length L, with
(lmbda + 2 mu) a (a^2 - 1) / 2 = f (L - x). Supports and load are what every simulator can be given.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem
from palpate.meshes.refinement import refine_problem
from palpate.validation.studies.manufactured import gauss_rule
from palpate.validation.studies.validity_modes import stretch_under

MATERIAL = Material(1.0, 0.3)
LENGTH, WIDTH = 1.0, 0.5
# f L / (lmbda + 2 mu): stretched by 1.276 where it is held.
LOAD = 0.4


@dataclass(frozen=True)
class ColumnAnswer:
    """Strain energy [J] and change of volume [m3]; both converge with order 2 p."""

    strain_energy: float
    volume_change: float


def confined_modulus(material: Material = MATERIAL) -> float:
    """Return lmbda + 2 mu [Pa]."""
    E, nu = material.youngs_modulus, material.poissons_ratio
    return E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))


def column(refinements: int) -> Problem:
    """The column on a mesh whose inner points are moved, so that no symmetry helps.

    Args:
        refinements: How often its 96 cells are cut in eight.
    """
    mesh = brick_box((4, 2, 2), (LENGTH, WIDTH, WIDTH), ragged=0.1)
    facets = mesh.boundary_facets
    supports = []
    for axis, places in ((0, (0.0,)), (1, (0.0, WIDTH)), (2, (0.0, WIDTH))):
        for place in places:
            side = facets[(np.abs(mesh.points[facets][:, :, axis] - place) < 1e-12).all(axis=1)]
            held = (axis == 0, axis == 1, axis == 2)
            supports.append(Support(np.unique(side).astype(np.int32), side, held))
    force = LOAD * confined_modulus() / LENGTH
    problem = Problem(mesh, MATERIAL, tuple(supports), (BodyForce((force, 0.0, 0.0)),))
    for _ in range(refinements):
        problem = refine_problem(problem)
    return problem


def exact_column() -> ColumnAnswer:
    """By Gauss quadrature of the closed form, to rounding."""
    x, w = (LENGTH * part for part in gauss_rule(40))
    a = np.array([stretch_under(LOAD * (1.0 - place / LENGTH)) for place in x])
    area = WIDTH**2
    energy = area * confined_modulus() / 8.0 * float(w @ (a**2 - 1.0) ** 2)
    return ColumnAnswer(energy, area * float(w @ (a - 1.0)))
