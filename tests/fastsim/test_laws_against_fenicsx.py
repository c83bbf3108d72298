"""Every law of the core against its energy in the reference: forces, equilibria and motion."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.fastsim.body import Body, cauchy_stress
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Support, Traction
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.diagnosis.law_simulators import example_material, following

pytestmark = pytest.mark.dolfinx

FINITE = [law for law in Law if not law.is_linear_in_strain]
# Of these the smoothed forms compile long, and differ from another law's by one term.
_LIKE_ANOTHER = (Law.NEO_HOOKEAN_STABLE_LOG, Law.MOONEY_RIVLIN_LOG)
BOTH_ELEMENTS = pytest.mark.parametrize(
    ("law", "element"),
    [
        pytest.param(
            law,
            element,
            marks=pytest.mark.nightly
            if element is Element.SMOOTHED and law in _LIKE_ANOTHER
            else (),
        )
        for law in FINITE
        for element in Element
    ],
)


@BOTH_ELEMENTS
def test_force_energy_and_tangent_are_those_of_ufl(law: Law, element: Element) -> None:
    from palpate.reference.discrete_problem import DiscreteProblem

    mesh = brick_box((5, 4, 4), (1.0, 0.8, 0.8), ragged=0.2)
    inclusions = tuple(
        Inclusion(np.arange(50 * k, 50 * k + 50), example_material(law, nu))
        for k, nu in enumerate((0.0, 0.2))
    )
    problem = Problem(mesh, example_material(law, 0.49), (), (), inclusions=inclusions)
    # About 10 % of the cell size, 0.2.
    u = 0.02 * np.random.default_rng(7).standard_normal(mesh.points.shape)
    body = Body.of(problem, element=element)
    ours = body.internal_force(u)
    other = DiscreteProblem(problem, strain=Strain.GREEN, degree=1, element=element)
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


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_smoothed_cells_that_are_compressed_are_those_of_ufl_and_of_the_judge(nu: float) -> None:
    """Saint-Venant-Kirchhoff's, between the plain element and the smoothed one, and beyond."""
    from palpate.reference.discrete_problem import DiscreteProblem
    from palpate.validation.metrics.body import Body as JudgedBody

    mesh = brick_box((5, 4, 4), (1.0, 0.8, 0.8), ragged=0.2)
    material = Material(1e4, nu)
    inclusions = (Inclusion(np.arange(50), Material(3e3, 0.2)),)
    problem = Problem(mesh, material, (), (), inclusions=inclusions)
    rng = np.random.default_rng(7)
    u = mesh.points * [-0.05, -0.03, -0.12] + 0.02 * rng.standard_normal(mesh.points.shape)
    body, judged = (
        Body.of(problem, element=Element.SMOOTHED),
        JudgedBody(problem, Strain.GREEN, Element.SMOOTHED),
    )
    ours = body.internal_force(u)
    other = DiscreteProblem(problem, strain=Strain.GREEN, degree=1, element=Element.SMOOTHED)
    flat = other.space.from_points(u)
    for theirs in (other.at_points(other.internal_force(flat)), judged.internal(u)):
        assert np.abs(ours - theirs).max() < 1e-12 * np.abs(theirs).max()
    for energy in (other.strain_energy(flat), judged.energy(u)):
        assert body.strain_energy(u) == pytest.approx(energy, rel=1e-12)
    matrix = other.tangent(flat, 0.0)
    x, y = matrix.createVecs()
    way = rng.standard_normal(u.shape)
    x.array[:] = other.space.from_points(way)
    matrix.mult(x, y)
    change = other.at_points(np.array(y.array))
    body.core.assemble_tangent(u)
    assert np.abs(body.core.multiply(way) - change).max() < 1e-12 * np.abs(change).max()
    h = 1e-6
    ahead, behind = (body.internal_force(u + s * way) for s in (h, -h))
    assert np.abs(ahead - behind - 2 * h * change).max() < 2e-7 * h * np.abs(change).max()


def bar(mesh: TetMesh, law: Law, span: TimeSpan | None) -> Problem:
    """Held at one end, pulled, pressed from above and heavy."""
    end, top = side(mesh, 0, 2.0), side(mesh, 2, 0.5)
    fixed = Support(np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32))
    loads = (BodyForce((0.0, 40.0, -200.0)), Traction(end, (600.0, 20.0, -10.0)), Pressure(top, 60))
    return Problem(mesh, example_material(law), (fixed,), loads, span)


@BOTH_ELEMENTS
def test_trajectory_is_that_of_the_explicit_reference(law: Law, element: Element) -> None:
    from palpate.reference.stepping import simulate_explicit

    mesh = brick_box((4, 1, 1), (2.0, 0.5, 0.5), ragged=0.1)
    problem = bar(mesh, law, TimeSpan(1.0, 5e-3, mass_damping=2.0, num_outputs=5))
    ours = simulate(problem, element=element)
    theirs = simulate_explicit(problem, element=element)
    assert (ours.num_steps, ours.time_step) == (200, 5e-3)
    largest = np.abs(theirs.displacements[1:]).max(axis=(1, 2))
    assert largest.min() > 0.01
    error = np.abs(ours.displacements - theirs.displacements)[1:].max(axis=(1, 2))
    assert (error / largest).max() < 1e-10


@pytest.mark.parametrize(
    ("law", "element", "name"),
    [
        pytest.param(law, element, name, marks=marks)
        for law in FINITE
        for element in Element
        for name, marks in (
            ("kidney", pytest.mark.nightly),
            ("beam", pytest.mark.nightly if element is Element.SMOOTHED else pytest.mark.slow),
            ("block", pytest.mark.nightly if law in _LIKE_ANOTHER else ()),
        )
    ],
)
def test_equilibrium_is_that_of_the_reference_on_the_same_mesh(
    law: Law, element: Element, name: str
) -> None:
    from palpate.reference.statics import solve_static as solve_reference
    from palpate.validation.case import load_case

    problem = load_case(name).problem
    rubber = dataclasses.replace(problem, material=following(problem.material, law))
    ours = solve_static(rubber, element=element)
    theirs = solve_reference(rubber, degree=1, element=element)
    u, sigma = theirs.displacement, theirs.cauchy_stress
    assert np.abs(ours.displacement - u).max() < 1e-8 * np.abs(u).max()
    stress = cauchy_stress(Body.of(rubber, element=element), ours.displacement)
    assert np.abs(stress - sigma).max() < 1e-7 * np.abs(sigma).max()
    # Neither another law nor the other element is mistaken for it.
    plain = solve_static(problem, start=u, element=element).displacement
    assert np.abs(plain - u).max() > 1e-4 * np.abs(u).max()
    if element is Element.SMOOTHED:
        plain = solve_static(rubber, start=u).displacement
        assert np.abs(plain - u).max() > 1e-3 * np.abs(u).max()
