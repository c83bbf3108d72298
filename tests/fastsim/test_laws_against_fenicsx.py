"""Every law by hand against its energy in UFL: forces, equilibria and motion, node for node."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from palpate.fastsim.body import Body
from palpate.fastsim.cell_stress import cauchy_stress
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Support, Traction
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Inclusion, Material, Problem, TimeSpan
from palpate.meshes.tet_mesh import TetMesh

pytestmark = pytest.mark.dolfinx

MakeBox = Callable[..., TetMesh]
# What the reference knows.
KNOWN = [law for law in Law if not (law.is_linear_in_strain or law is Law.OGDEN)]
LAWS = pytest.mark.parametrize("law", KNOWN)


def material(law: Law, nu: float = 0.4) -> Material:
    mu = 1e4 / (2.0 * (1.0 + nu))
    c01 = 0.2 * mu if law is Law.MOONEY_RIVLIN else 0.0
    return Material(1e4, nu, law=law, c01=c01)


@LAWS
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_internal_force_is_the_ufl_residual(make_box: MakeBox, law: Law, nu: float) -> None:
    from palpate.reference.residual import internal_force

    mesh = make_box((5, 4, 4), (1.0, 0.8, 0.8), ragged=0.2)
    inclusions = (Inclusion(np.arange(50), material(law, 0.2)),)
    # About 10 % of the cell size, 0.2.
    u = 0.02 * np.random.default_rng(7).standard_normal(mesh.points.shape)
    ours = Body(mesh, material(law, nu), inclusions=inclusions).internal_force(u)
    theirs = internal_force(mesh, u, material=material(law, nu), inclusions=inclusions)
    assert np.abs(ours).max() > 1.0
    assert np.abs(ours - theirs).max() < 1e-12 * np.abs(theirs).max()


def bar(mesh: TetMesh, law: Law, span: TimeSpan | None) -> Problem:
    """Held at one end, pulled, pressed from above and heavy."""
    corners = mesh.points[mesh.boundary_facets]
    end = mesh.boundary_facets[(corners[:, :, 0] > 2.0 - 1e-9).all(axis=1)]
    top = mesh.boundary_facets[(corners[:, :, 2] > 0.5 - 1e-9).all(axis=1)]
    held = Support(np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32))
    loads = (BodyForce((0.0, 40.0, -200.0)), Traction(end, (600.0, 20.0, -10.0)), Pressure(top, 60))
    return Problem(mesh, material(law), (held,), loads, span)


@LAWS
def test_trajectory_is_that_of_the_explicit_reference(make_box: MakeBox, law: Law) -> None:
    from palpate.reference.explicit import simulate_explicit

    mesh = make_box((4, 1, 1), (2.0, 0.5, 0.5), ragged=0.1)
    problem = bar(mesh, law, TimeSpan(5.0, 5e-3, mass_damping=2.0, num_outputs=10))
    ours, theirs = simulate(problem), simulate_explicit(problem)
    assert (ours.num_steps, ours.time_step) == (1000, 5e-3)
    largest = np.abs(theirs.displacements[1:]).max(axis=(1, 2))
    assert largest.min() > 0.01
    error = np.abs(ours.displacements - theirs.displacements)[1:].max(axis=(1, 2))
    assert (error / largest).max() < 1e-10


@pytest.mark.parametrize(
    ("law", "name"),
    [
        pytest.param(law, name, marks=mark)
        for law in KNOWN
        for name, mark in (
            ("kidney", pytest.mark.nightly if law.is_of_stretches else ()),
            ("beam", pytest.mark.nightly if law.is_of_stretches else pytest.mark.slow),
            ("block", ()),
        )
    ],
)
def test_equilibrium_is_that_of_the_reference_on_the_same_mesh(law: Law, name: str) -> None:
    from palpate.reference.statics import solve_static as solve_reference
    from palpate.validation.case import load_case

    problem = load_case(name).problem
    asked = problem.material
    share = 0.2 if law is Law.MOONEY_RIVLIN else 0.0
    mu = asked.youngs_modulus / (2.0 * (1.0 + asked.poissons_ratio))
    rubber = dataclasses.replace(
        problem,
        material=dataclasses.replace(asked, law=law, c01=share * mu),
    )
    ours, theirs = solve_static(rubber), solve_reference(rubber, degree=1)
    u, sigma = theirs.displacement, theirs.cauchy_stress
    assert np.abs(ours.displacement - u).max() < 1e-8 * np.abs(u).max()
    stress = cauchy_stress(Body.of(rubber), ours.displacement)
    assert np.abs(stress - sigma).max() < 1e-7 * np.abs(sigma).max()
    plain = solve_static(problem, start=u).displacement
    assert np.abs(plain - u).max() > 1e-4 * np.abs(u).max()
