"""Places in a mesh: against brute force, on facets, outside."""

from __future__ import annotations

import numpy as np

from palpate.meshes.bricks import brick_box
from palpate.validation.exchange.point_location import locate

MESH = brick_box((4, 3, 5), (2.0, 0.9, 1.1), ragged=0.25)
ROUNDING = 100 * np.finfo(float).eps


def test_a_linear_field_is_read_exactly_everywhere_inside() -> None:
    places = np.random.default_rng(1).uniform(0.0, 1.0, (500, 3)) * [2.0, 0.9, 1.1]
    location = locate(MESH.points, MESH.cells, places)
    assert not location.distances.any()
    matrix = np.array([[1.0, 2.0, -1.0], [0.5, 0.0, 3.0], [1.0, 1.0, 1.0]])
    read = location.read(MESH.cells, MESH.points @ matrix + 1.0)
    np.testing.assert_allclose(read, places @ matrix + 1.0, rtol=0.0, atol=1e3 * ROUNDING)


def test_the_cell_found_is_the_one_that_holds_the_place() -> None:
    centres = MESH.points[MESH.cells].mean(axis=1)
    location = locate(MESH.points, MESH.cells, centres)
    np.testing.assert_array_equal(location.cells, np.arange(MESH.num_cells))


def test_points_of_the_mesh_itself_are_found_with_all_weight_on_them() -> None:
    location = locate(MESH.points, MESH.cells, MESH.points)
    np.testing.assert_allclose(location.weights.max(axis=1), 1.0, atol=1e-8)
    read = location.read(MESH.cells, MESH.points)
    np.testing.assert_allclose(read, MESH.points, rtol=0.0, atol=1e-8)


def test_a_place_outside_takes_the_nearest_point_and_says_how_far() -> None:
    places = np.array([[2.3, 0.5, 0.5], [-3.0, -4.0, 0.5], [1.0, 0.45, 1.1 + 1e-7]])
    location = locate(MESH.points, MESH.cells, places)
    # Beyond a face; beyond an edge, 3-4-5; by a hair.
    np.testing.assert_allclose(location.distances, [0.3, 5.0, 1e-7], rtol=1e-6)
    read = location.read(MESH.cells, MESH.points)
    expected = [[2.0, 0.5, 0.5], [0.0, 0.0, 0.5], [1.0, 0.45, 1.1]]
    np.testing.assert_allclose(read, expected, rtol=0.0, atol=1e-9)
