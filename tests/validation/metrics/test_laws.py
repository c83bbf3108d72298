"""The judge's own laws: P by the energy, changes of P by P, and fastsim's forces beside them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.fastsim.body import Body as FastBody
from palpate.fastsim.statics import solve_static
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Inclusion, Strain
from palpate.validation.case import load_case
from palpate.validation.diagnosis.law_simulators import example_material, following
from palpate.validation.metrics.audit import Tangent, audit_on_own_mesh
from palpate.validation.metrics.body import Body
from palpate.validation.metrics.laws import energy_density, finite_stress, stress_change

LAWS = pytest.mark.parametrize("law", list(Law))
ELEMENTS = pytest.mark.parametrize("element", list(Element))


def problem_of(law, name="stretch"):
    problem = load_case(name).problem
    return dataclasses.replace(problem, material=following(problem.material, law))


@LAWS
def test_stress_is_the_derivative_of_energy(law):
    rng = np.random.default_rng(1)
    H, dH = 0.2 * rng.standard_normal((2, 40, 3, 3))
    assert (np.linalg.det(np.eye(3) + H) > 0).all()
    constants = [np.full(40, value) for value in (2e3, 1e3, 200.0)]
    constants.append(example_material(law).ogden_terms)
    P, h = finite_stress(law, H, *constants), 1e-6
    ends = [energy_density(law, H + s * h * dH, *constants) for s in (1.0, -1.0)]
    work = np.einsum("cij,cij->c", P, dH)
    assert np.abs((ends[0] - ends[1]) / (2 * h) - work).max() < 1e-7 * np.abs(work).max()
    change = stress_change(law, H, dH, *constants)
    ends = [finite_stress(law, H + s * h * dH, *constants) for s in (1.0, -1.0)]
    assert np.abs((ends[0] - ends[1]) / (2 * h) - change).max() < 1e-6 * np.abs(change).max()


@LAWS
@ELEMENTS
def test_forces_and_energy_are_fastsims(law, element):
    problem = problem_of(law)
    some = Inclusion(np.arange(7), dataclasses.replace(problem.material, poissons_ratio=0.1))
    problem = dataclasses.replace(problem, inclusions=(some,))
    size = 0.05 * np.cbrt(problem.mesh.volume / problem.mesh.num_cells)
    u = size * np.random.default_rng(2).standard_normal(problem.mesh.points.shape)
    ours = Body(problem, Strain.GREEN, element)
    theirs = FastBody.of(problem, element=element)
    force = theirs.internal_force(u)
    assert np.abs(ours.internal(u) - force).max() < 1e-12 * np.abs(force).max()
    assert ours.energy(u) == pytest.approx(theirs.strain_energy(u), rel=1e-10)


@LAWS
def test_the_audit_distinguishes_an_equilibrium_of_the_law_from_that_of_another(law):
    problem = problem_of(law)
    u = solve_static(problem).displacement
    found = audit_on_own_mesh(problem, u, Strain.GREEN)
    assert found.relative_residual_norm < 1e-9
    assert found.displacement_error == pytest.approx(0.0, abs=1e-8)
    assert found.is_stable
    other = Law.NEO_HOOKEAN if law is not Law.NEO_HOOKEAN else Law.SAINT_VENANT_KIRCHHOFF
    wrong = audit_on_own_mesh(problem_of(other), u, Strain.GREEN)
    right = solve_static(problem_of(other)).displacement
    apart = np.linalg.norm(u - right) / np.linalg.norm(right)
    assert apart > 1e-3
    assert wrong.displacement_error == pytest.approx(apart, rel=0.3)


@LAWS
def test_tangent_of_smoothed_tetrahedra_is_the_derivative_of_their_force(law):
    problem = problem_of(law)
    body, shape = Body(problem, Strain.GREEN, Element.SMOOTHED), problem.mesh.points.shape
    size = 0.05 * np.cbrt(problem.mesh.volume / problem.mesh.num_cells)
    u, way = size * np.random.default_rng(2).standard_normal((2, *shape))
    way = body.freed(way)
    product, h = Tangent(body, u).times(way), 1e-4
    positions = [u + s * h * way for s in (1.0, -1.0)]
    ends = [body.freed(body.internal(at) - body.external(at)) for at in positions]
    change = (ends[0] - ends[1]) / (2 * h)
    assert np.abs(change - product).max() < 1e-6 * np.abs(product).max()
