"""Cells between a point and facets, four at once, against angles and altitudes cell by cell."""

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.meshes.quality import dihedral_angles
from palpate.meshes.shapes import shape_sphere
from palpate.meshes.tet_mesh import CELL_FACETS, signed_volumes

Array = NDArray[np.float64]
EPS = np.finfo(float).eps


def _fan(num_facets: int, position: Array) -> tuple[Array, NDArray[np.int32], Array]:
    """Facets of a ragged ball, the point, and the cells' points as one array of cells."""
    ball = shape_sphere(edge_length=0.6)
    rng = np.random.default_rng(7)
    points = ball.points * rng.uniform(0.8, 1.2, (len(ball.points), 1))
    facets = ball.facets[:num_facets]
    # Seen counter-clockwise from outside, with the point behind: (b, a, c, point) is positive.
    cells = np.array([[points[b], points[a], points[c], position] for a, b, c in facets])
    return points, facets, cells


def _qualities(cells: Array) -> Array:
    flat = cells.reshape(-1, 3)
    numbers = np.arange(len(flat), dtype=np.int32).reshape(-1, 4)
    sines = np.sin(dihedral_angles(flat, numbers)).min(axis=1)
    return np.sign(signed_volumes(flat, numbers)) * np.abs(sines)


def _altitudes(cells: Array) -> Array:
    flat = cells.reshape(-1, 3)
    volumes = signed_volumes(flat, np.arange(len(flat), dtype=np.int32).reshape(-1, 4))
    corners = cells[:, CELL_FACETS]
    normals = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    return 3.0 * volumes / (0.5 * np.linalg.norm(normals, axis=2).max(axis=1))


# Whole blocks of four, and blocks that are not full.
@pytest.mark.parametrize("num_facets", [1, 3, 4, 5, 8, 23])
def test_qualities_are_the_smallest_sines(num_facets: int) -> None:
    position = np.array([0.1, -0.05, 0.2])
    points, facets, cells = _fan(num_facets, position)
    found, worst = _core.rate_star(points, facets, position.tolist(), 0.0)
    expected = _qualities(cells)
    # About a hundred roundings, of squares that are halved by the root.
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=200 * EPS)
    assert worst == pytest.approx(expected.min(), abs=200 * EPS)


def test_a_point_outside_makes_negative_cells() -> None:
    position = np.array([0.0, 0.0, 3.0])
    points, facets, cells = _fan(40, position)
    found, _ = _core.rate_star(points, facets, position.tolist(), 0.0)
    assert (np.array(found) < 0.0).tolist() == (_qualities(cells) < 0.0).tolist()
    assert min(found) < 0.0 < max(found)


def test_a_thin_cell_is_rated_by_its_altitude() -> None:
    position = np.array([0.3, 0.2, 0.1])
    points, facets, cells = _fan(20, position)
    found, _ = _core.rate_star(points, facets, position.tolist(), 5.0)
    by_altitude = _altitudes(cells) / 5.0
    expected = np.minimum(_qualities(cells), by_altitude)
    assert (expected == by_altitude).any()
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=200 * EPS)


@pytest.mark.parametrize("power", [-20, 20])
def test_the_unit_does_not_matter(power: int) -> None:
    position = np.array([0.1, -0.05, 0.2])
    points, facets, _ = _fan(9, position)
    unit = 2.0**power  # changes no digit; products of twelve lengths stay in range
    scaled = _core.rate_star(points * unit, facets, (position * unit).tolist(), unit)
    assert scaled == _core.rate_star(points, facets, position.tolist(), 1.0)


def test_a_facet_without_area_is_as_bad_as_a_flat_cell() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    facets = np.array([[0, 1, 2]], dtype=np.int32)
    assert _core.rate_star(points, facets, [0.5, 1.0, 0.0], 0.0) == ([0.0], 0.0)
