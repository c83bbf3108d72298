"""Elastic laws: closed forms, materials by cell, and nodal forces as derivatives of the energy."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from bank import KINDS, rollers, support

from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.errors import InputError, MeshError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.availability import is_available
from palpate.validation.diagnosis.law_simulators import example_material as material

if is_available():
    from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering

    from palpate.reference import laws
    from palpate.reference.discrete_problem import ElasticBody, internal_force
    from palpate.reference.dynamics import simulate_implicit
    from palpate.reference.fenicsx import ufl
    from palpate.reference.mesh_transfer import create_space, transfer
    from palpate.reference.principal_laws import energy_of_stretches, stretch_sum
    from palpate.reference.statics import solve_static
    from palpate.reference.stepping import simulate_explicit

pytestmark = pytest.mark.dolfinx

FINITE = [law for law in Law if not law.is_linear_in_strain]
LAWS = pytest.mark.parametrize("law", FINITE)


@LAWS
def test_small_strains_are_hookes(box, law):
    """The difference from linear strain falls with the load's square."""
    mesh, of = box((2, 2, 2), jitter=0.2), material(law)
    differences = []
    for size in (1.0, 0.1):
        pull = Traction(mesh.facet_groups["x1"], (50.0 * size, 0.0, 30.0 * size))
        problem = Problem(mesh, of, rollers(mesh), (pull,))
        u = solve_static(problem).displacement
        linear = solve_static(problem, strain=Strain.LINEAR).displacement
        differences.append(np.abs(u - linear).max())
    assert differences[0] / differences[1] == pytest.approx(100.0, rel=0.1)
    other = dataclasses.replace(problem, material=Material(1e4, 0.4))
    assert np.array_equal(solve_static(other, strain=Strain.LINEAR).displacement, linear)


@LAWS
def test_what_a_law_has_of_lmbda_is_that_of_its_volume(law):
    """W = W_0 + lmbda/2 g^2: the mixed form solves for g, smoothed cells average both apart."""
    F = np.eye(3) + np.random.default_rng(4).uniform(-0.3, 0.3, (3, 3))
    J, lmbda, mu, c01 = np.linalg.det(F), 7.0, 2.0, 0.3
    if law.is_of_stretches:
        e = np.linalg.eigvalsh(F.T @ F - np.eye(3))[None] / 2
        terms = material(law).ogden_terms
        whole, rest = (
            float(energy_of_stretches(law, np.array([of]), np.array([mu]), terms)(e).value[0])
            for of in (lmbda, 0.0)
        )
        g = stretch_sum(e).value[0] if law is Law.COROTATIONAL else J - 1.0
    else:
        gradient = ufl.as_matrix(F.tolist())
        whole, rest = (
            value(laws.energy_density(gradient, law, of, mu, c01)) for of in (lmbda, 0.0)
        )
        g = value(laws.volume_change(gradient, law))
        assert g == pytest.approx(np.log(J) if law.is_by_log_of_volume else J - 1.0, rel=1e-13)
    assert whole - rest == pytest.approx(lmbda / 2 * g**2, rel=1e-12)


def value(expression):
    return apply_algebra_lowering(expression)(())


@LAWS
@pytest.mark.long
def test_implicit_motion_is_the_explicit_one(box, law):
    mesh = box((2, 1, 1), jitter=0.0)
    fixed = support(mesh, "x0")
    pull = Traction(mesh.facet_groups["x1"], (0.0, 0.0, -400.0))
    span = TimeSpan(0.5, 2e-3, num_outputs=5)
    problem = Problem(mesh, material(law), (fixed,), (pull,), span)
    explicit = simulate_explicit(problem).displacements
    implicit = simulate_implicit(problem, degree=1, is_mass_lumped=True).displacements
    largest = np.abs(explicit).max()
    assert largest > 0.05
    assert np.abs(implicit - explicit).max() < 2e-3 * largest
    plain = dataclasses.replace(problem, material=Material(1e4, 0.4))
    assert np.abs(simulate_explicit(plain).displacements - explicit).max() > 5e-3 * largest


def test_what_knows_one_law_says_so(box):
    mesh, of = box((1, 1, 1)), material(Law.NEO_HOOKEAN)
    problem = Problem(mesh, of, rollers(mesh), (Traction(mesh.facet_groups["x1"], (1.0, 0, 0)),))
    with pytest.raises(InputError, match="inclusions follow the law"):
        dataclasses.replace(problem, inclusions=(Inclusion(np.array([0]), Material(1e4, 0.4)),))


SOFT, STIFF = Material(1e4, 0.3, 1000.0), Material(5e4, 0.2, 3000.0)


def test_an_inclusion_of_the_same_material_changes_nothing(box):
    mesh = box((3, 2, 2), jitter=0.2)
    loads = (Traction(mesh.facet_groups["x1"], (0.0, 0.0, 300.0)),)
    supports = (support(mesh, "x0"),)
    some = np.arange(0, mesh.num_cells, 3, dtype=np.int32)
    plain = solve_static(Problem(mesh, SOFT, supports, loads))
    same = solve_static(Problem(mesh, SOFT, supports, loads, inclusions=(Inclusion(some, SOFT),)))
    assert np.array_equal(plain.displacement, same.displacement)


MATERIAL = Material(3000.0, 0.3)
EPS = np.finfo(float).eps


def random_displacement(mesh, fraction=0.1):
    size = (mesh.volume / mesh.num_cells) ** (1 / 3)
    return np.random.default_rng(5).uniform(-fraction * size, fraction * size, mesh.points.shape)


@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize("degree", [1, 2])
def test_force_is_the_derivative_of_the_energy(box, strain, degree):
    space = create_space(transfer(box((2, 1, 1), jitter=0.2)), degree)
    body = ElasticBody(space, MATERIAL, strain)
    random = np.random.default_rng(1)
    u = random.uniform(-0.03, 0.03, body.num_dofs)
    direction = random.uniform(-1.0, 1.0, body.num_dofs)
    h = 1e-5
    slope = (body.strain_energy(u + h * direction) - body.strain_energy(u - h * direction)) / 2 / h
    work = body.internal_force(u) @ direction
    assert abs(work) > 1.0
    assert slope == pytest.approx(work, rel=1e-6)


@pytest.mark.parametrize("kind", ["linear", "smoothed", "quadratic"])
def test_rigid_motion_gives_no_force_and_linear_strain_fails_it(box, kind):
    mesh = box((2, 2, 2), jitter=0.2)
    c, s = np.cos(0.7), np.sin(0.7)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    moved = mesh.points @ rotation.T + [3.0, -1.0, 2.0] - mesh.points
    options = dict(KINDS[kind])
    space = create_space(transfer(mesh), options.pop("degree", 1))
    green, linear = (
        ElasticBody(space, MATERIAL, strain, **options) for strain in (Strain.GREEN, Strain.LINEAR)
    )
    u = space.from_points(moved)
    # E h^2 of a cell, times rounding of positions as large as 4.
    scale = MATERIAL.youngs_modulus * 0.25
    assert np.abs(green.internal_force(u)).max() <= 100 * EPS * 4.0 * scale
    assert np.abs(linear.internal_force(u)).max() > 0.01 * scale


@pytest.mark.parametrize("element", list(Element))
def test_forces_sum_to_zero_and_turn_with_the_body(box, element):
    mesh = box((3, 2, 2), jitter=0.2)
    u = random_displacement(mesh)
    forces = internal_force(mesh, u, material=MATERIAL, element=element)
    largest = np.abs(forces).max()
    assert largest > 1.0
    assert np.abs(forces.sum(axis=0)).max() <= 1e-12 * largest
    torque = np.cross(mesh.points + u, forces).sum(axis=0)
    assert np.abs(torque).max() <= 1e-12 * largest
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = (mesh.points + u) @ turn.T - mesh.points
    again = internal_force(mesh, turned, material=MATERIAL, element=element)
    assert np.abs(again - forces @ turn.T).max() <= 1e-12 * largest


@pytest.mark.parametrize(
    "displacement", [np.zeros((3, 3)), np.full((27, 3), np.nan)], ids=["shape", "nan"]
)
def test_unusable_displacements_are_refused(box, displacement):
    with pytest.raises(InputError, match="displacement"):
        internal_force(box(), displacement, material=MATERIAL)


def test_overlapping_cells_are_refused_before_dolfinx_sees_them(box):
    mesh = box((1, 1, 1))
    doubled = TetMesh(mesh.points, np.vstack([mesh.cells, mesh.cells[:1]]))
    with pytest.raises(MeshError, match="duplicate"):
        internal_force(doubled, np.zeros((8, 3)), material=MATERIAL)
    alone = TetMesh(np.vstack([np.zeros(3), np.eye(3)]), [[0, 1, 2, 3], [0, 1, 2, 3]])
    with pytest.raises(MeshError, match="duplicate"):
        internal_force(alone, np.zeros((4, 3)), material=MATERIAL)
