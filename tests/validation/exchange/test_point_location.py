"""Points in a mesh and nearest on a surface: against brute force, on facets, outside."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.meshes.bricks import brick_box
from palpate.meshes.shapes import shape_sphere
from palpate.validation.exchange.point_location import locate, nearest_on_surface

MESH = brick_box((4, 3, 5), (2.0, 0.9, 1.1), ragged=0.25)
ROUNDING = 100 * np.finfo(float).eps


def test_a_linear_field_is_read_exactly_everywhere_inside():
    positions = np.random.default_rng(1).uniform(0.0, 1.0, (500, 3)) * [2.0, 0.9, 1.1]
    location = locate(MESH.points, MESH.cells, positions)
    assert not location.distances.any()
    matrix = np.array([[1.0, 2.0, -1.0], [0.5, 0.0, 3.0], [1.0, 1.0, 1.0]])
    read = location.read(MESH.cells, MESH.points @ matrix + 1.0)
    np.testing.assert_allclose(read, positions @ matrix + 1.0, rtol=0.0, atol=1e3 * ROUNDING)


def test_the_cell_found_is_the_one_that_contains_the_position():
    centres = MESH.points[MESH.cells].mean(axis=1)
    location = locate(MESH.points, MESH.cells, centres)
    np.testing.assert_array_equal(location.cells, np.arange(MESH.num_cells))


def test_points_of_the_mesh_itself_are_found_with_all_weight_on_them():
    location = locate(MESH.points, MESH.cells, MESH.points)
    np.testing.assert_allclose(location.weights.max(axis=1), 1.0, atol=1e-8)
    read = location.read(MESH.cells, MESH.points)
    np.testing.assert_allclose(read, MESH.points, rtol=0.0, atol=1e-8)


def test_a_position_outside_takes_the_nearest_point_and_says_how_far():
    positions = np.array([[2.3, 0.5, 0.5], [-3.0, -4.0, 0.5], [1.0, 0.45, 1.1 + 1e-7]])
    location = locate(MESH.points, MESH.cells, positions)
    # Beyond a face; beyond an edge, 3-4-5; by a hair.
    np.testing.assert_allclose(location.distances, [0.3, 5.0, 1e-7], rtol=1e-6)
    read = location.read(MESH.cells, MESH.points)
    expected = [[2.0, 0.5, 0.5], [0.0, 0.0, 0.5], [1.0, 0.45, 1.1]]
    np.testing.assert_allclose(read, expected, rtol=0.0, atol=1e-9)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(0, 20))
def test_cells_of_all_sizes_are_found_by_what_lies_in_them(seed, num_cells, num_positions):
    rng = np.random.default_rng(seed)
    sizes = 10.0 ** rng.uniform(-4.0, 0.5, (num_cells, 1, 1))
    corners = rng.uniform(-1.0, 1.0, (num_cells, 1, 3)) + sizes * (
        np.vstack([np.zeros(3), np.eye(3)]) + rng.uniform(-0.2, 0.2, (num_cells, 4, 3))
    )
    positions = np.concatenate([rng.uniform(-1.0, 1.0, (num_positions, 3)), corners.mean(axis=1)])
    found = locate(corners.reshape(-1, 3), np.arange(4 * num_cells).reshape(-1, 4), positions)
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    inner = np.linalg.solve(edges[None], (positions[:, None] - corners[:, 0])[..., None])[..., 0]
    depth = np.minimum(inner.min(axis=2), 1.0 - inner.sum(axis=2))
    np.testing.assert_array_equal(found.distances > 0.0, depth.max(axis=1) < -1e-9)
    inside = found.distances == 0.0
    deepest = depth.argmax(axis=1)
    np.testing.assert_array_equal(found.cells[inside], deepest[inside])


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.floats(0.01, 100.0))
def test_the_nearest_facet_is_that_of_brute_force(seed, count, size):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(3 * count, 3))
    points[2::3] = points[::3] + size * rng.normal(size=(count, 3))
    facets = np.arange(3 * count).reshape(-1, 3)
    # Middles lie in their facets: distance 0, with a box that rounding may leave them outside of.
    positions = np.concatenate([points[facets].mean(axis=1), 10.0 * rng.normal(size=(20, 3))])
    found = nearest_on_surface(positions, points, facets)
    alone = np.array([nearest_on_surface(positions, points, f[None]).distances for f in facets])
    largest = np.abs(points).max() + np.abs(positions).max()
    np.testing.assert_allclose(found.distances, alone.min(axis=0), rtol=1e-9, atol=1e-14 * largest)
    at = np.einsum("pa,pai->pi", found.weights, points[facets[found.facets]])
    apart = np.linalg.norm(at - positions, axis=1)
    np.testing.assert_allclose(apart, found.distances, rtol=1e-9, atol=1e-13 * largest)
    assert found.weights.min() >= 0.0


@pytest.mark.parametrize("thickness", [0.0, 1e-9])
def test_middles_of_flat_facets_are_on_them(thickness):
    # A plane at a height that no number holds exactly: the mean of three of it may differ.
    sphere = shape_sphere(1.0, edge_length=0.3)
    points = sphere.points * [1.0, 1.0, thickness] + [0.1, 0.7, 1.0 / 3.0]
    middles = points[sphere.facets].mean(axis=1)
    found = nearest_on_surface(middles, points, sphere.facets)
    assert found.distances.max() <= 1e-15


@pytest.mark.parametrize("far", [1e3, 1e154, 1e200, 1e300])
def test_positions_whose_squares_overflow_are_far_away(far):
    positions = np.array([[far, 0.0, 0.0], [1.0, 0.5, 0.5]])
    ball = shape_sphere(0.1, edge_length=0.05)
    with np.errstate(over="ignore", invalid="ignore"):
        assert locate(MESH.points, MESH.cells, positions).distances[0] >= 0.9 * far
        nearest = nearest_on_surface(positions, ball.points, ball.facets)
    assert nearest.distances[0] >= 0.9 * far
    # |(1, 0.5, 0.5)| = 1.2247, less the radius.
    assert nearest.distances[1] == pytest.approx(1.1247, abs=0.01)
