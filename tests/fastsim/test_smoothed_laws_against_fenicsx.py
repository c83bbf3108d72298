"""The smoothed element of every law by hand against its energy in UFL, on the same mesh."""

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
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh

pytestmark = pytest.mark.dolfinx

MakeBox = Callable[..., TetMesh]
LAWS = pytest.mark.parametrize(
    "law", [law for law in Law if not (law.is_linear_in_strain or law.is_of_stretches)]
)
SMOOTHED = Element.SMOOTHED


def material(law: Law, nu: float = 0.4) -> Material:
    mu = 1e4 / (2.0 * (1.0 + nu))
    c01 = 0.2 * mu if law is Law.MOONEY_RIVLIN else 0.0
    return Material(1e4, nu, law=law, c01=c01)


@LAWS
@pytest.mark.parametrize("nu", [0.0, 0.49])
def test_force_energy_and_tangent_are_those_of_ufl(make_box: MakeBox, law: Law, nu: float) -> None:
    from palpate.reference.discrete_problem import DiscreteProblem

    mesh = make_box((5, 4, 4), (1.0, 0.8, 0.8), ragged=0.2)
    inclusions = (Inclusion(np.arange(50), material(law, 0.2)),)
    problem = Problem(mesh, material(law, nu), (), (), inclusions=inclusions)
    # About 10 % of the cell size, 0.2.
    u = 0.02 * np.random.default_rng(7).standard_normal(mesh.points.shape)
    body = Body.of(problem, element=SMOOTHED)
    ours = body.internal_force(u)
    other = DiscreteProblem(problem, strain=Strain.GREEN, degree=1, element=SMOOTHED)
    flat = other.space.from_points(u)
    theirs = other.at_points(other.internal_force(flat))
    assert np.abs(ours).max() > 1.0
    assert np.abs(ours - theirs).max() < 1e-12 * np.abs(theirs).max()
    assert body.strain_energy(u) == pytest.approx(other.strain_energy(flat), rel=1e-12)
    matrix = other.tangent(flat, 0.0)
    x, y = matrix.createVecs()
    way = np.random.default_rng(8).standard_normal(u.shape)
    x.array[:] = other.space.from_points(way)
    matrix.mult(x, y)
    change = other.at_points(np.array(y.array))
    body.core.assemble_tangent(u)
    assert np.abs(body.core.multiply(way) - change).max() < 1e-12 * np.abs(change).max()


@LAWS
def test_trajectory_is_that_of_the_explicit_reference(make_box: MakeBox, law: Law) -> None:
    from palpate.reference.explicit import simulate_explicit

    mesh = make_box((4, 1, 1), (2.0, 0.5, 0.5), ragged=0.1)
    corners = mesh.points[mesh.boundary_facets]
    end = mesh.boundary_facets[(corners[:, :, 0] > 2.0 - 1e-9).all(axis=1)]
    top = mesh.boundary_facets[(corners[:, :, 2] > 0.5 - 1e-9).all(axis=1)]
    held = Support(np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32))
    loads = (BodyForce((0.0, 40.0, -200.0)), Traction(end, (600.0, 20.0, -10.0)), Pressure(top, 60))
    span = TimeSpan(5.0, 5e-3, mass_damping=2.0, num_outputs=10)
    problem = Problem(mesh, material(law), (held,), loads, span)
    ours = simulate(problem, element=SMOOTHED)
    theirs = simulate_explicit(problem, element=SMOOTHED)
    assert (ours.num_steps, ours.time_step) == (1000, 5e-3)
    largest = np.abs(theirs.displacements[1:]).max(axis=(1, 2))
    assert largest.min() > 0.01
    error = np.abs(ours.displacements - theirs.displacements)[1:].max(axis=(1, 2))
    assert (error / largest).max() < 1e-10


@LAWS
@pytest.mark.parametrize(
    "name",
    [
        pytest.param("kidney", marks=pytest.mark.nightly),
        pytest.param("beam", marks=pytest.mark.nightly),
        "block",
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
    ours = solve_static(rubber, element=SMOOTHED)
    theirs = solve_reference(rubber, degree=1, element=SMOOTHED)
    u, sigma = theirs.displacement, theirs.cauchy_stress
    assert np.abs(ours.displacement - u).max() < 1e-8 * np.abs(u).max()
    stress = cauchy_stress(Body.of(rubber, element=SMOOTHED), ours.displacement)
    assert np.abs(stress - sigma).max() < 1e-7 * np.abs(sigma).max()
    plain = solve_static(rubber, start=u).displacement
    assert np.abs(plain - u).max() > 1e-3 * np.abs(u).max()
