"""The judge's own smoothed tetrahedra: what they must keep by themselves, on a ragged mesh."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.metrics.body import Body
from palpate.validation.metrics.laws import linear
from palpate.validation.metrics.smoothing import Smoothing

RANDOM = np.random.default_rng(5)
ONE_CELL = TetMesh(
    np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    np.array([[0, 1, 2, 3]], dtype=np.int32),
)


@pytest.fixture(scope="module")
def ragged():
    mesh = brick_box((3, 2, 2), (0.03, 0.02, 0.02))
    points = mesh.points.copy()
    inner = np.setdiff1d(np.arange(len(points)), np.unique(mesh.boundary_facets))
    points[inner] += RANDOM.uniform(-1e-3, 1e-3, (len(inner), 3))
    return TetMesh(points, mesh.cells)


def random_strains(count):
    E = RANDOM.normal(size=(count, 3, 3))
    return E + E.transpose(0, 2, 1)


def lame(mesh, lmbda=3.0, mu=2.0):
    return np.full(mesh.num_cells, lmbda), np.full(mesh.num_cells, mu)


def hooke(E, lmbda, mu):
    trace = np.trace(E, axis1=1, axis2=2)
    return 2.0 * mu[:, None, None] * E + (lmbda * trace)[:, None, None] * np.eye(3)


def test_a_single_cell_has_nobody_to_share_with():
    E = random_strains(1)
    assert Smoothing(ONE_CELL, *lame(ONE_CELL)).stress(E) == pytest.approx(
        hooke(E, *lame(ONE_CELL)), rel=1e-14
    )


def test_a_constant_strain_has_its_plain_stress(ragged):
    E = np.repeat(random_strains(1), ragged.num_cells, axis=0)
    S = Smoothing(ragged, *lame(ragged)).stress(E)
    assert pytest.approx(hooke(E, *lame(ragged)), abs=1e-13 * np.abs(S).max()) == S


def test_the_stress_is_that_of_an_energy(ragged):
    # Symmetric: E1 : S(E2) = E2 : S(E1); never stiffer than plain tetrahedra (Jensen).
    volumes, smoothing = (
        signed_volumes(ragged.points, ragged.cells),
        Smoothing(ragged, *lame(ragged)),
    )
    one, other = random_strains(ragged.num_cells), random_strains(ragged.num_cells)
    there = np.einsum("c,cij,cij->", volumes, one, smoothing.stress(other))
    back = np.einsum("c,cij,cij->", volumes, other, smoothing.stress(one))
    assert there == pytest.approx(back, rel=1e-12)
    smoothed = np.einsum("c,cij,cij->", volumes, one, smoothing.stress(one))
    plain = np.einsum("c,cij,cij->", volumes, one, hooke(one, *lame(ragged)))
    assert 0.0 < smoothed < 0.9 * plain


def test_shear_goes_over_edges_and_volume_over_nodes():
    # Two cells share a facet: 3 edges and 3 nodes; by hand, with equal volumes.
    points = np.array([[0.0, 0, 0], [1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [0, 0, -1.0]])
    mesh = TetMesh(points, np.array([[0, 1, 2, 3], [0, 2, 1, 4]], dtype=np.int32))
    E = np.zeros((2, 3, 3))
    E[0, 0, 1] = E[0, 1, 0] = 1.0
    S = Smoothing(mesh, *lame(mesh)).stress(E)
    # Its three own edges keep 1, the three shared have 1/2: (3 + 3/2) / 6 = 3/4; next door 1/4.
    assert S[:, 0, 1] == pytest.approx([2 * 2.0 * 0.75, 2 * 2.0 * 0.25], rel=1e-14)
    assert np.abs(S[:, [0, 1, 2], [0, 1, 2]]).max() == 0.0
    E = np.zeros((2, 3, 3))
    E[0] = np.eye(3)
    S = Smoothing(mesh, *lame(mesh)).stress(E)
    # One own node keeps tr E = 3, three shared have 3/2: (3 + 4.5) / 4; next door 4.5 / 4.
    assert S[:, 0, 0] == pytest.approx(
        [2 * 2.0 * 0.75 + 3.0 * 7.5 / 4.0, 2 * 2.0 * 0.25 + 3.0 * 4.5 / 4.0], rel=1e-14
    )


def test_nothing_is_averaged_across_materials(ragged):
    is_stiff = ragged.points[ragged.cells].mean(axis=1)[:, 0] > 0.015
    mu = np.where(is_stiff, 20.0, 2.0)
    E = random_strains(2)[is_stiff.astype(int)]
    S = Smoothing(ragged, np.full(ragged.num_cells, 3.0), mu).stress(E)
    assert (
        pytest.approx(hooke(E, np.full(ragged.num_cells, 3.0), mu), abs=1e-12 * np.abs(S).max())
        == S
    )


@pytest.mark.dolfinx
@pytest.mark.parametrize("strain", Strain)
def test_its_forces_are_the_references(ragged, strain):
    from palpate.reference.discrete_problem import internal_force

    problem = Problem(ragged, Material(5.0, 0.4), (), ())
    u = RANDOM.uniform(-1e-3, 1e-3, ragged.points.shape)
    mine = Body(problem, strain, Element.SMOOTHED).internal(u)
    theirs = internal_force(
        ragged, u, material=problem.material, strain=strain, element=Element.SMOOTHED
    )
    assert mine == pytest.approx(theirs, abs=1e-12 * np.abs(theirs).max())
    plain = Body(problem, strain).internal(u)
    assert np.abs(mine - plain).max() > 0.01 * np.abs(plain).max()


@pytest.mark.parametrize("strain", Strain)
def test_its_force_is_the_derivative_of_its_energy(ragged, strain):
    body = Body(Problem(ragged, Material(5.0, 0.4), (), ()), strain, Element.SMOOTHED)
    u, along = (RANDOM.uniform(-1e-3, 1e-3, ragged.points.shape) for _ in range(2))
    # Of fourth order: what is left is of h^4, and rounding over h.
    h = 1e-3
    values = [body.energy(u + k * h * along) for k in (-2, -1, 1, 2)]
    slope = (values[0] - 8.0 * values[1] + 8.0 * values[2] - values[3]) / (12.0 * h)
    work = float((body.internal(u) * along).sum())
    assert slope == pytest.approx(work, rel=1e-9)
    plain = Body(Problem(ragged, Material(5.0, 0.4), (), ()), strain)
    assert body.energy(u) < 0.99 * plain.energy(u)


def test_another_material_and_another_strain_are_tried_with_the_same_averages(ragged):
    problem = Problem(ragged, Material(5.0, 0.4), (), ())
    softer = Body(Problem(ragged, Material(4.0, 0.3), (), ()), Strain.GREEN, Element.SMOOTHED)
    body = Body(problem, Strain.GREEN, Element.SMOOTHED)
    u = RANDOM.uniform(-1e-3, 1e-3, ragged.points.shape)
    given = body.internal(u, lame=(softer.lmbda, softer.mu))
    assert given == pytest.approx(softer.internal(u), abs=1e-14)
    other = Body(problem, Strain.LINEAR, Element.SMOOTHED).internal(u)
    assert body.internal(u, linear) == pytest.approx(other, abs=1e-14)
