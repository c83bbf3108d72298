"""Raw Delaunay: proved by exact tests across every facet, and by the hull's volume."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from palpate.fastsim.mesher import FlatPointsError, check_delaunay, delaunay
from palpate.meshes.tet_mesh import signed_volumes

Array = NDArray[np.float64]
EPS = np.finfo(float).eps


def _grid(n: int) -> Array:
    axis = np.arange(float(n))
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)


def _require_delaunay(points: Array) -> tuple[NDArray[np.int32], list[int]]:
    cells, left_out = delaunay(points)
    assert check_delaunay(points, cells) is None
    assert sorted({*np.unique(cells).tolist(), *left_out}) == list(range(len(points)))
    return cells, left_out


def test_random_points_fill_their_hull() -> None:
    rng = np.random.default_rng(1)
    corners = _grid(2)
    points = np.vstack([corners, rng.random((2000, 3))])
    cells, _ = _require_delaunay(points)
    # The hull is the unit cube; one rounding per cell.
    assert abs(signed_volumes(points, cells).sum() - 1.0) < len(cells) * EPS


@pytest.mark.parametrize("seed", range(3))
def test_grid_where_everything_is_cospherical(seed: int) -> None:
    points = np.random.default_rng(seed).permutation(_grid(7))
    cells, left_out = _require_delaunay(points)
    assert left_out == []
    # Volumes of cells on whole numbers are whole sixths: exact to one rounding each.
    assert abs(signed_volumes(points, cells).sum() - 6.0**3) < len(cells) * 6.0**3 * EPS


def test_points_on_a_sphere_use_every_point() -> None:
    points = np.random.default_rng(2).normal(size=(800, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    _, left_out = _require_delaunay(points)
    assert left_out == []


def test_equal_points_are_left_out_and_named() -> None:
    grid = _grid(4)
    points = np.vstack([grid, grid[:10]])
    _, left_out = _require_delaunay(points)
    assert len(left_out) == 10
    assert {tuple(points[k]) for k in left_out} == {tuple(p) for p in grid[:10]}


def test_same_points_give_the_same_cells() -> None:
    points = np.random.default_rng(3).random((500, 3))
    np.testing.assert_array_equal(delaunay(points)[0], delaunay(points.copy())[0])


@pytest.mark.parametrize("power", [-300, -40, 40, 100, 200])
def test_cells_do_not_depend_on_the_unit(power: int) -> None:
    # Powers of two change no digit; far up and down the stored determinants are not trusted.
    points = np.random.default_rng(5).random((400, 3)) ** 3  # crowded towards a corner
    points = np.vstack([points, _grid(4) / 4.0])
    np.testing.assert_array_equal(delaunay(points)[0], delaunay(points * 2.0**power)[0])


@pytest.mark.parametrize("points", [np.zeros((5, 3)), _grid(3)[:9], _grid(3)[:3], _grid(1)])
def test_points_without_volume_are_refused(points: Array) -> None:
    with pytest.raises(FlatPointsError):
        delaunay(points)


coordinates = st.sampled_from([0.0, 0.5, 1.0, 1.0 + 2.0**-52, 2.0, 3.0, 0.1])


@given(st.lists(st.tuples(coordinates, coordinates, coordinates), min_size=4, max_size=40))
@settings(max_examples=200, deadline=None)
def test_any_degenerate_points(rows: list[tuple[float, float, float]]) -> None:
    points = np.array(rows)
    try:
        _require_delaunay(points)
    except FlatPointsError:
        assert np.linalg.matrix_rank(points - points[0], tol=1e-12) < 3


def test_checker_finds_a_spoiled_mesh() -> None:
    rng = np.random.default_rng(4)
    points = rng.random((60, 3))
    cells, _ = delaunay(points)
    mirrored = cells.copy()
    mirrored[7, [0, 1]] = mirrored[7, [1, 0]]
    assert check_delaunay(points, mirrored) == (7, -1, -1)
    moved = points.copy()
    moved[10] += 0.3 * (rng.random(3) - 0.5)
    assert check_delaunay(moved, cells) is not None


def test_checker_finds_a_cell_that_is_missing_at_the_hull() -> None:
    points = np.random.default_rng(6).random((200, 3))
    cells, _ = delaunay(points)
    # A cell with an outer facet: without it the outside has a dent.
    facets = np.sort(cells[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    _, first, count = np.unique(facets, axis=0, return_index=True, return_counts=True)
    outer = int(first[count == 1][0]) // 4
    fault = check_delaunay(points, np.delete(cells, outer, axis=0))
    assert fault is not None
    # A cell missing inside leaves a hole, whose facets bend inwards.
    inner = next(c for c in range(len(cells)) if c not in set((first[count == 1] // 4).tolist()))
    assert check_delaunay(points, np.delete(cells, inner, axis=0)) is not None
