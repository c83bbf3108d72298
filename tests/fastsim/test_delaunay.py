"""Raw Delaunay: proved by exact tests across every facet, and by the hull's volume."""

import subprocess
import sys
from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from limits import PRINT_MOST_MEMORY
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.fastsim.mesher import FlatPointsError, delaunay
from palpate.meshes.tet_mesh import signed_volumes

Array = NDArray[np.float64]
EPS = np.finfo(float).eps
# Facet k lies opposite corner k; counter-clockwise seen from outside a positive cell.
FACET_OF = ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))


def _grid(n: int) -> Array:
    axis = np.arange(float(n))
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)


def find_fault(points: Array, cells: NDArray[np.int32]) -> tuple[int, int, int] | None:
    """The first thing that is not Delaunay, by exact predicates: cell, facet, point; -1 for none.

    Cells are positive; across a facet of two cells neither's far corner is in the other's sphere;
    facets of one cell are a closed surface that is convex at every edge: the whole hull.
    """
    at, rows = points.tolist(), cells.tolist()
    sides = defaultdict(list)
    for number, cell in enumerate(rows):
        if _core.orient3d(*(at[v] for v in cell)) <= 0:
            return number, -1, -1
        for k in range(4):
            sides[tuple(sorted(cell[:k] + cell[k + 1 :]))].append((number, k))
    edges = defaultdict(list)
    for (cell, k), *others in sides.values():
        if len(others) > 1:
            return cell, k, -1  # three cells at one facet
        if others:
            apex = rows[others[0][0]][others[0][1]]
            flipped = [*rows[cell][:k], apex, *rows[cell][k + 1 :]]
            inside = _core.in_sphere(*(at[v] for v in rows[cell]), at[apex]) > 0
            if _core.orient3d(*(at[v] for v in flipped)) >= 0 or inside:
                return cell, k, apex
            continue
        outward = [rows[cell][i] for i in FACET_OF[k]]
        for corner in outward:
            edge = tuple(sorted(v for v in outward if v != corner))
            edges[edge].append((cell, k, outward, corner))
    for ends in edges.values():
        cell, k, outward, _ = ends[0]
        if len(ends) != 2:
            return cell, k, -1  # the hull is open
        if _core.orient3d(*(at[v] for v in outward), at[ends[1][3]]) > 0:
            return cell, k, ends[1][3]
    return None


def _require_delaunay(points: Array) -> tuple[NDArray[np.int32], list[int]]:
    cells, left_out = delaunay(points)
    assert find_fault(points, cells) is None
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


def test_checker_finds_a_perturbed_mesh() -> None:
    rng = np.random.default_rng(4)
    points = rng.random((60, 3))
    cells, _ = delaunay(points)
    mirrored = cells.copy()
    mirrored[7, [0, 1]] = mirrored[7, [1, 0]]
    assert find_fault(points, mirrored) == (7, -1, -1)
    moved = points.copy()
    moved[10] += 0.3 * (rng.random(3) - 0.5)
    assert find_fault(moved, cells) is not None


def test_checker_finds_a_cell_that_is_missing_at_the_hull() -> None:
    points = np.random.default_rng(6).random((200, 3))
    cells, _ = delaunay(points)
    # A cell with an outer facet: without it the outside has a dent.
    facets = np.sort(cells[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    _, first, count = np.unique(facets, axis=0, return_index=True, return_counts=True)
    outer = int(first[count == 1][0]) // 4
    fault = find_fault(points, np.delete(cells, outer, axis=0))
    assert fault is not None
    # A cell missing inside leaves a hole, whose facets bend inwards.
    inner = next(c for c in range(len(cells)) if c not in set((first[count == 1] // 4).tolist()))
    assert find_fault(points, np.delete(cells, inner, axis=0)) is not None


def test_a_point_that_every_facet_sees_takes_memory_for_the_facets_alone() -> None:
    """A body with a dense surface and a coarse inside; a table of all pairs of corners had 4 GB."""
    code = """
import numpy as np
from palpate.fastsim.mesher import delaunay
points = np.random.default_rng(5).normal(size=(25000, 3))
points /= np.linalg.norm(points, axis=1, keepdims=True)
near_the_centre = [[1e-3, -1e-3, -1e-3]]  # where it is among the last that are inserted
cells, _ = delaunay(np.vstack([points, near_the_centre]))
print(len(cells), (cells == 25000).any(axis=1).all())
"""
    command = [sys.executable, "-c", code + PRINT_MOST_MEMORY]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120.0, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    *found, most = done.stdout.split()
    # 50 000 cells take some 10 MB, the interpreter with numpy 100, and what checks memory as much.
    assert float(most) < 1e9
    # By Euler's formula the hull of points on a sphere has 2 n - 4 triangles.
    assert found == [str(2 * 25000 - 4), "True"]
