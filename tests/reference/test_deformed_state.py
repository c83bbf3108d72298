"""Volume, area and det F of displacements known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.problem import Material, Strain
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference.deformed_state import (
        DetFSampler,
        lattice,
        least_moduli,
        measure_state,
    )
    from palpate.reference.discrete_problem import ElasticBody
    from palpate.reference.mesh_transfer import create_space, transfer

pytestmark = pytest.mark.dolfinx


def body_of(mesh, degree):
    return ElasticBody(create_space(transfer(mesh), degree), Material(1.0, 0.3), Strain.GREEN)


def interpolated(body, displacement):
    """Nodal values of a displacement given as a function of the rest position."""
    return displacement(body.space.space.tabulate_dof_coordinates()).ravel()


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_affine_state_is_exact(box, degree):
    body = body_of(box(size=(1.0, 2.0, 0.5), jitter=0.2), degree)
    F = np.array([[1.2, 0.1, 0.0], [-0.3, 0.9, 0.2], [0.1, 0.0, 1.1]])
    u = interpolated(body, lambda x: x @ (F - np.eye(3)).T)
    state = measure_state(body, u)
    det = np.linalg.det(F)
    edges = F @ np.diag([1.0, 2.0, 0.5])
    sides = [
        np.linalg.norm(np.cross(edges[:, i], edges[:, j])) for i, j in ((0, 1), (1, 2), (0, 2))
    ]
    assert state.volume == pytest.approx(det, rel=1e-13)
    assert state.surface_area == pytest.approx(2 * sum(sides), rel=1e-13)
    assert DetFSampler(body).smallest(u) == pytest.approx(det, rel=1e-13)


@pytest.mark.parametrize("degree", [2, 3])
def test_quadratic_displacements_are_integrated_exactly(box, degree):
    # u = (x^2/10 + y^2/5, 0, -z^2/5): det F = (1 + x/5)(1 - 2z/5), volume (1 + 1/10)(1 - 1/5).
    body = body_of(box(jitter=0.2), degree)
    x, y, z = (lambda p, k=k: p[:, k] for k in range(3))
    u = interpolated(
        body,
        lambda p: np.stack([x(p) ** 2 / 10 + y(p) ** 2 / 5, 0 * x(p), -(z(p) ** 2) / 5], axis=1),
    )
    assert measure_state(body, u).volume == pytest.approx(1.1 * 0.8, rel=1e-13)
    # Smallest at x = 0, z = 1.
    assert DetFSampler(body).smallest(u) == pytest.approx(0.6, rel=1e-12)


def test_curved_facets_are_measured(box):
    # u = (0, 0, x^2/2): the faces z = 0 and z = 1 become parabolic sheets of length
    # integral of sqrt(1 + x^2) = (sqrt 2 + asinh 1) / 2; the sides keep their areas.
    body = body_of(box((4, 2, 2)), 2)
    u = interpolated(body, lambda p: np.stack([0 * p[:, 0], 0 * p[:, 0], p[:, 0] ** 2 / 2], axis=1))
    sheet = (np.sqrt(2.0) + np.arcsinh(1.0)) / 2
    assert measure_state(body, u).surface_area == pytest.approx(4.0 + 2 * sheet, rel=1e-7)


def test_an_inverted_spot_between_the_vertices_is_seen(box):
    # det F = 1 - 4.2 x (1 - x): 1 at every vertex, -0.05 half-way.
    body = body_of(box((1, 1, 1)), 3)
    u = interpolated(
        body,
        lambda p: np.stack(
            [-4.2 * (p[:, 0] ** 2 / 2 - p[:, 0] ** 3 / 3), 0 * p[:, 0], 0 * p[:, 0]], axis=1
        ),
    )
    assert DetFSampler(body).smallest(u) == pytest.approx(1 - 4.2 / 4, abs=1e-12)


def test_lattice_holds_the_vertices_and_determines_a_polynomial():
    assert np.array_equal(lattice(0), [[0.25, 0.25, 0.25]])
    for order, count in ((1, 4), (3, 20), (6, 84)):
        points = lattice(order)
        assert len(points) == count
        for vertex in np.vstack([np.zeros(3), np.eye(3)]):
            assert np.any(np.all(points == vertex, axis=1))


@pytest.mark.parametrize(
    ("stretches", "least"),
    [
        # Confined compression a: S_xx = (lmbda + 2 mu) e with e = (a^2 - 1) / 2, which leaves
        # 1 + 3 e for more of it and 1 + 3.5 e for a shear, (lmbda + 2 mu) / mu = 3.5.
        ((0.75, 1.0, 1.0), 1.0 + 1.75 * (0.75**2 - 1.0)),
        ((1.0, (1.0 - 2.0 / 3.5) ** 0.5, 1.0), 0.0),
        ((1.0, 1.0, 1.0), 1.0),
        # Pulled with its sides free: S = (E e, 0, 0), and l^2 = 1 - 2 nu e across.
        ((1.5, (1.0 - 0.3 * 1.25) ** 0.5, (1.0 - 0.3 * 1.25) ** 0.5), 1.0 - 0.3 * 1.25),
    ],
)
def test_how_much_stiffness_is_left(box, stretches, least):
    body = body_of(box(jitter=0.2), 2)
    turn = np.linalg.qr(np.array([[1.0, 2.0, 0.0], [0.5, -1.0, 3.0], [2.0, 0.0, 1.0]]))[0]
    other = np.linalg.qr(np.array([[0.0, 1.0, 1.0], [1.0, 3.0, 0.0], [2.0, 0.0, -1.0]]))[0]
    F = turn @ np.diag(stretches) @ other
    u = interpolated(body, lambda x: x @ (F - np.eye(3)).T)
    np.testing.assert_allclose(least_moduli(body, u), least, atol=1e-12)


def test_a_plane_shear_softens_less_than_a_compression_to_the_same_stretch(box):
    # At a clamp's edge cells are sheared, and stay stiff.
    body = body_of(box(), 2)
    sheared = interpolated(body, lambda p: p[:, [1]] * np.array([[0.8, 0.0, 0.0]]))
    shortest = (1.0 + 0.8**2 / 4.0) ** 0.5 - 0.4
    crushed = interpolated(body, lambda p: p * np.array([[shortest - 1.0, 0.0, 0.0]]))
    assert shortest == pytest.approx(0.677, abs=1e-3)
    assert least_moduli(body, sheared).min() > 0.4
    assert least_moduli(body, crushed).max() < 0.1
