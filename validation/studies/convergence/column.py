"""A confined column pulled by its own weight: a smooth nonlinear problem with a closed form.

Rollers on the sides leave one unknown, the stretch a(x) along the column of length L, with
(lmbda + 2 mu) a (a^2 - 1) / 2 = f (L - x). Supports and load are what every simulator can be given.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce
from palpate.meshes.bricks import brick_box, rollers
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.validation.mechanics.body import body_of
from palpate.validation.metrics.grid_convergence import GridConvergence, assess_grid_convergence
from palpate.validation.studies.bodies import Solve, volume_change
from palpate.validation.studies.closed_forms import confined_modulus, stretch_under
from palpate.validation.studies.convergence.manufactured import gauss_rule

MATERIAL = Material(1.0, 0.3)
LENGTH, WIDTH = 1.0, 0.5
# f L / (lmbda + 2 mu): stretched by 1.276 where it is held.
LOAD = 0.4


class ColumnAnswer(NamedTuple):
    """Strain energy [J] and change of volume [m3]; both converge with order 2 p."""

    strain_energy: float
    volume_change: float


def column(refinements: int) -> Problem:
    """The column on a mesh whose inner points are moved, so that no symmetry helps.

    Args:
        refinements: How often its 96 cells are cut in eight.
    """
    mesh = brick_box((4, 2, 2), (LENGTH, WIDTH, WIDTH), ragged=0.1)
    sides = ((0, 0.0), (1, 0.0), (1, WIDTH), (2, 0.0), (2, WIDTH))
    force = LOAD * confined_modulus(MATERIAL) / LENGTH
    problem = Problem(mesh, MATERIAL, rollers(mesh, sides), (BodyForce((force, 0.0, 0.0)),))
    for _ in range(refinements):
        problem = refine_problem(problem)
    return problem


def exact_column() -> ColumnAnswer:
    """By Gauss quadrature of the closed form, to rounding."""
    x, w = (LENGTH * part for part in gauss_rule(40))
    a = np.array([stretch_under(LOAD * (1.0 - place / LENGTH)) for place in x])
    area = WIDTH**2
    energy = area * confined_modulus(MATERIAL) / 8.0 * float(w @ (a**2 - 1.0) ** 2)
    return ColumnAnswer(energy, area * float(w @ (a - 1.0)))


class ColumnGrid(NamedTuple):
    """A number of the column in closed form, and what fastsim's three meshes tell about it."""

    quantity: str
    exact: float
    assessed: GridConvergence

    @property
    def is_as_expected(self) -> bool:
        """Is the order 2 within 0.2, and does the error bar hold the exact value?"""
        bar, order = self.assessed.error_bar, self.assessed.order
        if bar is None or order is None:
            return False
        return abs(self.assessed.value - self.exact) <= bar and abs(order - 2.0) <= 0.2


def follow_column(*, first: int = 1, solve: Solve = solve_static) -> list[ColumnGrid]:
    """Energy and change of volume of the column by fastsim on three meshes, with their GCI.

    Args:
        first: Refinements of the coarsest mesh.
        solve: fastsim's statics, or what is put to the test in its place.
    """
    answers = []
    for problem in map(column, (first + 2, first + 1, first)):
        u = solve(problem).displacement
        change = volume_change(problem.mesh, u) * problem.mesh.volume
        answers.append(ColumnAnswer(body_of(problem, Strain.GREEN).energy(u), change))
    names = ("strain energy [J]", "change of volume [m3]")
    return [
        ColumnGrid(
            name, exact, assess_grid_convergence(values, [1.0, 2.0, 4.0], expected_order=2.0)
        )
        for name, exact, *values in zip(names, exact_column(), *answers, strict=True)
    ]
