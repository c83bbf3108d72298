"""Nodal forces: derivative of the energy, no force from rigid motions."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.errors import InputError, MeshError
from palpate.meshes.problem import Material, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference.discrete_problem import ElasticBody, internal_force
    from palpate.reference.mesh_transfer import create_space, transfer

pytestmark = pytest.mark.dolfinx

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


@pytest.mark.parametrize("degree", [1, 2])
def test_rigid_motion_gives_no_force_and_linear_strain_fails_it(box, degree):
    mesh = box((2, 2, 2), jitter=0.2)
    c, s = np.cos(0.7), np.sin(0.7)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    moved = mesh.points @ rotation.T + [3.0, -1.0, 2.0] - mesh.points
    space = create_space(transfer(mesh), degree)
    green, linear = (
        ElasticBody(space, MATERIAL, strain) for strain in (Strain.GREEN, Strain.LINEAR)
    )
    u = space.from_points(moved)
    # E h^2 of a cell, times rounding of positions as large as 4.
    scale = MATERIAL.youngs_modulus * 0.25
    assert np.abs(green.internal_force(u)).max() <= 100 * EPS * 4.0 * scale
    assert np.abs(linear.internal_force(u)).max() > 0.01 * scale


def test_forces_sum_to_zero_and_turn_with_the_body(box):
    mesh = box((3, 2, 2), jitter=0.2)
    u = random_displacement(mesh)
    forces = internal_force(mesh, u, material=MATERIAL)
    largest = np.abs(forces).max()
    assert largest > 1.0
    assert np.abs(forces.sum(axis=0)).max() <= 1e-12 * largest
    torque = np.cross(mesh.points + u, forces).sum(axis=0)
    assert np.abs(torque).max() <= 1e-12 * largest
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = (mesh.points + u) @ turn.T - mesh.points
    again = internal_force(mesh, turned, material=MATERIAL)
    assert np.abs(again - forces @ turn.T).max() <= 1e-12 * largest


def test_forces_equal_a_cell_by_cell_sum_in_numpy(box):
    # f_a = V0 P grad N_a with P = F S, written again without UFL.
    mesh = box((3, 2, 2), jitter=0.2)
    u = random_displacement(mesh)
    x = mesh.points[mesh.cells]
    rest = (x[:, 1:] - x[:, :1]).transpose(0, 2, 1)
    moved = rest + (u[mesh.cells][:, 1:] - u[mesh.cells][:, :1]).transpose(0, 2, 1)
    inverse = np.linalg.inv(rest)
    F = moved @ inverse
    green = (F.transpose(0, 2, 1) @ F - np.eye(3)) / 2
    E, nu = MATERIAL.youngs_modulus, MATERIAL.poissons_ratio
    lmbda, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    trace = np.trace(green, axis1=1, axis2=2)[:, None, None]
    P = F @ (lmbda * trace * np.eye(3) + 2 * mu * green)
    volumes = np.linalg.det(rest)[:, None, None] / 6
    nodal = volumes * (inverse @ P.transpose(0, 2, 1))
    expected = np.zeros_like(u)
    for corner in range(3):
        np.add.at(expected, mesh.cells[:, corner + 1], nodal[:, corner])
        np.add.at(expected, mesh.cells[:, 0], -nodal[:, corner])
    forces = internal_force(mesh, u, material=MATERIAL)
    assert np.abs(forces - expected).max() <= 1e-12 * np.abs(expected).max()


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
