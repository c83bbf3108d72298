"""Manufactured solutions: the error falls at the order of theory.

The body force is -Div P of a chosen displacement, P here by differentiating the energy with
respect to F: another route than the one the solver takes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.meshes.problem import Material, Problem, Strain
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference import fenicsx
    from palpate.reference.deformed_state import DetFSampler
    from palpate.reference.discrete_problem import DiscreteProblem
    from palpate.reference.fenicsx import ufl
    from palpate.reference.laws import lame_parameters
    from palpate.reference.newton import Newton

pytestmark = pytest.mark.dolfinx

MATERIAL = Material(1.0, 0.3)
# Gradients up to about 0.2: the quadratic part of the strain matters, and nothing softens much.
AMPLITUDE = 0.06


@dataclass
class Pinned:
    """Degrees of freedom held each at a value of its own."""

    dofs: NDArray[np.int32]
    values: NDArray[np.float64]

    def at(self, factor):
        return factor * self.values


def chosen_displacement(x):
    """Smooth, of all orders, different along each axis."""
    return AMPLITUDE * ufl.as_vector(
        [
            ufl.sin(1.7 * x[1]) * ufl.cos(x[0]) + x[2] ** 2,
            ufl.cos(1.3 * x[2]) * x[0] - ufl.sin(x[1]) ** 2,
            ufl.sin(x[0] * x[1]) + ufl.cos(2.0 * x[2]) * x[1],
        ]
    )


def chosen_values(x):
    x, y, z = x.T
    return AMPLITUDE * np.stack(
        [
            np.sin(1.7 * y) * np.cos(x) + z**2,
            np.cos(1.3 * z) * x - np.sin(y) ** 2,
            np.sin(x * y) + np.cos(2.0 * z) * y,
        ],
        axis=1,
    )


def body_force(u, strain):
    lmbda, mu = lame_parameters(MATERIAL)
    gradient = ufl.variable(ufl.grad(u))
    identity = ufl.Identity(3)
    if strain is Strain.GREEN:
        F = identity + gradient
        e = (F.T * F - identity) / 2
    else:
        e = (gradient + gradient.T) / 2
    energy = lmbda / 2 * ufl.tr(e) ** 2 + mu * ufl.tr(e * e)
    return -ufl.div(ufl.diff(energy, gradient))


def solve_errors(mesh, degree, strain, *, force_strain=None):
    """L2 and H1 errors of the discrete solution."""
    discrete = DiscreteProblem(Problem(mesh, MATERIAL, (), ()), strain=strain, degree=degree)
    domain = discrete.space.transferred.mesh
    x = ufl.SpatialCoordinate(domain)
    dx = ufl.dx(domain=domain, metadata={"quadrature_degree": 2 * degree + 4})
    exact = chosen_displacement(x)
    force = body_force(exact, force_strain or strain)
    discrete.dead_force = fenicsx.assemble_vector(fenicsx.form(ufl.inner(force, discrete.v) * dx))
    nodes = discrete.space.space.tabulate_dof_coordinates()
    values = chosen_values(nodes)
    outside = np.any((nodes < 1e-12) | (nodes > 1 - 1e-12), axis=1)
    dofs = (3 * np.flatnonzero(outside)[:, None] + np.arange(3)).ravel()
    discrete.held = Pinned(dofs.astype(np.int32), values.ravel()[dofs])
    discrete.free = np.setdiff1d(np.arange(discrete.num_dofs), dofs)
    newton = Newton(discrete, DetFSampler(discrete), relative_tolerance=1e-11)
    outcome = newton.solve(values.ravel(), 1.0)
    assert outcome.converged, outcome.reason
    discrete.set_displacement(outcome.displacement)
    error = discrete.u - exact
    squares = (
        ufl.inner(error, error) * dx,
        ufl.inner(ufl.grad(error), ufl.grad(error)) * dx,
    )
    return [np.sqrt(fenicsx.assemble_scalar(fenicsx.form(s))) for s in squares]


@pytest.mark.slow
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize(("degree", "counts"), [(1, (4, 8, 16)), (2, (2, 4, 8)), (3, (1, 2, 4))])
def test_errors_fall_at_the_order_of_theory(box, strain, degree, counts):
    errors = np.array([solve_errors(box((n, n, n)), degree, strain) for n in counts])
    orders = np.log2(errors[:-1] / errors[1:])
    # Theory: degree + 1 in L2, degree in H1; within 0.2 on the finest pair.
    assert orders[-1] == pytest.approx([degree + 1, degree], abs=0.2)
    assert errors[-1, 0] > 1e-8


@pytest.mark.slow
def test_the_nonlinear_part_is_exercised(box):
    # The Green solution with the linear body force is off by far more than the discretisation.
    mesh = box((4, 4, 4))
    green = solve_errors(mesh, 2, Strain.GREEN)
    mixed = solve_errors(mesh, 2, Strain.GREEN, force_strain=Strain.LINEAR)
    assert mixed[0] > 20 * green[0]
