"""The reference between its points: exact for quadratics, and honest about what it may be off."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.meshes.bricks import brick_box
from palpate.meshes.refinement import refine_uniformly
from palpate.validation.metrics.own_mesh import read_between, recovered_gradients

Field = NDArray[np.float64]
MESH = brick_box((6, 5, 4), (1.0, 1.0, 1.0), ragged=0.2)
OWN = refine_uniformly(refine_uniformly(MESH))
RNG = np.random.default_rng(7)
BENT, SLOPE = RNG.normal(size=(3, 3, 3)), RNG.normal(size=(3, 3))


def quadratic(points: Field) -> Field:
    bent: Field = np.einsum("ijk,pj,pk->pi", BENT, points, points)
    return bent + points @ SLOPE.T


def test_gradients_of_a_quadratic_are_recovered_at_every_point() -> None:
    # d/dx_k of B_ijk x_j x_k is (B_ijk + B_ikj) x_j; the ridge keeps eight digits of them.
    exact = np.einsum("ijk,pj->pik", BENT + BENT.transpose(0, 2, 1), MESH.points) + SLOPE
    found = recovered_gradients(MESH, quadratic(MESH.points))
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-5)


def test_a_quadratic_is_read_exactly_and_the_doubt_is_what_linear_reading_would_miss() -> None:
    read = read_between(MESH, quadratic(MESH.points), 2, OWN)
    exact = quadratic(OWN.points)
    np.testing.assert_allclose(read.value, exact, rtol=0.0, atol=1e-6)
    linear = read_between(MESH, quadratic(MESH.points), 1, OWN)
    assert not linear.doubt.any()
    np.testing.assert_allclose(read.added, exact - linear.value, rtol=0.0, atol=1e-6)
    # Twice what each of six edges adds, whatever its direction.
    assert (read.doubt >= 2.0 * np.linalg.norm(read.added, axis=1) - 1e-6).all()
    assert 0.02 < read.doubt.max() < 12.0 * np.linalg.norm(read.added, axis=1).max()


def test_beside_a_kink_the_doubt_is_as_large_as_the_error() -> None:
    # Still where x < 0.5, which no plane of points follows; a slope of 1 beyond.
    def kinked(points: Field) -> Field:
        return np.clip(points - 0.5, 0.0, None) * [1.0, 0.0, 0.0]

    read = read_between(MESH, kinked(MESH.points), 2, OWN)
    error = np.linalg.norm(read.value - kinked(OWN.points), axis=1)
    assert error.max() > 0.01
    assert error.max() < read.doubt.max()
    assert np.sqrt(np.mean(error**2)) < np.sqrt(np.mean(read.doubt**2))
    assert (error <= read.doubt + 1e-6).mean() > 0.95


def test_a_smooth_field_is_missed_by_less_than_the_doubt() -> None:
    def wave(points: Field) -> Field:
        found: Field = np.sin(4.0 * points) + np.cos(3.0 * points[:, [1, 2, 0]])
        return found

    read = read_between(MESH, wave(MESH.points), 2, OWN)
    error, doubt = np.linalg.norm(read.value - wave(OWN.points), axis=1), read.doubt
    # In the mean and at the worst place.
    assert np.sqrt(np.mean(error**2)) < 0.5 * np.sqrt(np.mean(doubt**2))
    assert error.max() < doubt.max()


@pytest.mark.parametrize("divisions", [(1, 1, 1), (2, 1, 1), (6, 4, 1)])
def test_a_linear_field_leaves_no_doubt_however_few_the_points(
    divisions: tuple[int, int, int],
) -> None:
    mesh = brick_box(divisions, (2.0, 1.0, 0.3))
    read = read_between(mesh, mesh.points @ SLOPE.T, 2, refine_uniformly(mesh))
    assert np.abs(read.doubt).max() < 1e-6


def test_outside_of_the_mesh_all_that_is_added_is_doubt() -> None:
    grown = brick_box((6, 5, 4), (1.02, 1.0, 1.0))
    read = read_between(MESH, MESH.points @ SLOPE.T, 1, grown)
    np.testing.assert_allclose(read.value, grown.points @ SLOPE.T, rtol=0.0, atol=1e-6)
    beyond = np.clip(grown.points[:, 0] - 1.0, 0.0, None)
    expected = beyond * np.linalg.norm(SLOPE[:, 0])
    np.testing.assert_allclose(read.doubt, expected, rtol=0.0, atol=1e-6)
