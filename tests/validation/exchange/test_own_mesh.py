"""An answer's own mesh is of the same body or refused; harmless oddities are mended and told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem
from palpate.meshes.refinement import refine_uniformly
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.exchange.placement import Placed, place
from palpate.validation.exchange.result_files import ResultFileError, read_result
from palpate.validation.states import CandidateFailedError

Field = NDArray[np.float64]
SLOPE = np.array([[0.1, 0.2, 0.0], [0.0, -0.1, 0.3], [0.2, 0.0, 0.1]])


def sent(
    folder: Path, problem: Problem, points: Field, cells: Any, displacement: Field | None = None
) -> Placed:
    """The answer `points @ SLOPE`, or another, on these points and cells."""
    field = points @ SLOPE if displacement is None else displacement
    np.savez(folder / "r.npz", displacement=field, points=points, cells=cells)
    return place(read_result(folder / "r.npz"), problem)


def require_unharmed(found: Placed, problem: Problem, own: TetMesh) -> None:
    """The same own mesh as without the oddity, and the same answer on it."""
    assert found.own_mesh is not None
    assert found.own_displacement is not None
    assert found.own_mesh.num_points == own.num_points
    assert found.own_mesh.volume == pytest.approx(own.volume, rel=1e-12)
    assert found.own_mesh.surface_area == pytest.approx(own.surface_area, rel=1e-12)
    np.testing.assert_array_equal(found.own_displacement[0], found.own_mesh.points @ SLOPE)
    expected = problem.mesh.points @ SLOPE
    np.testing.assert_allclose(found.displacement[0], expected, rtol=0.0, atol=1e-8)


def test_points_that_no_cell_uses_are_left_out_and_told(tmp_path: Path, problem: Problem) -> None:
    own = refine_uniformly(problem.mesh)
    points = np.vstack([[[9.0, 9.0, 9.0]], own.points, [[0.1, 0.1, 0.1]]])
    points[0] = 0.5 * points[1:].mean(axis=0)
    found = sent(tmp_path, problem, points, own.cells + 1)
    require_unharmed(found, problem, own)
    assert any("2 point(s) that no cell uses" in note for note in found.notes)


def test_cells_that_share_no_numbers_are_joined_and_told(tmp_path: Path, problem: Problem) -> None:
    own = refine_uniformly(problem.mesh)
    cells = np.arange(4 * own.num_cells).reshape(-1, 4)
    found = sent(tmp_path, problem, own.points[own.cells.ravel()], cells)
    require_unharmed(found, problem, own)
    assert any("joined" in note for note in found.notes)


def test_very_many_points_at_one_place_are_joined(tmp_path: Path, problem: Problem) -> None:
    own = refine_uniformly(problem.mesh)
    many = 20_000
    points = np.vstack([own.points, np.tile(own.points[-1], (many, 1))])
    # Each in a cell of its own, else it is left out for being unused.
    row = own.cells[(own.cells == own.num_points - 1).any(axis=1)][0]
    extra = np.tile(row, (many, 1))
    extra[:, row == own.num_points - 1] = own.num_points + np.arange(many)[:, None]
    with pytest.raises(ResultFileError, match="share one facet"):
        sent(tmp_path, problem, points, np.vstack([own.cells, extra]))


def test_points_at_one_place_that_move_apart_are_a_torn_body(
    tmp_path: Path, problem: Problem
) -> None:
    own = refine_uniformly(problem.mesh)
    points, cells = np.vstack([own.points, own.points[-1:]]), own.cells.copy()
    around = np.flatnonzero((cells == own.num_points - 1).any(axis=1))
    row = cells[around[0]]
    cells[around[0]] = np.where(row == own.num_points - 1, own.num_points, row)
    field = points @ SLOPE
    require_unharmed(sent(tmp_path, problem, points, cells, field), problem, own)
    field[-1] += 0.01
    with pytest.raises(CandidateFailedError, match=r"1 pair\(s\).*0\.0173 m at .*torn"):
        sent(tmp_path, problem, points, cells, field)


def test_bodies_of_the_case_that_touch_may_part(tmp_path: Path) -> None:
    lower = brick_box((2, 2, 1), (1.0, 1.0, 0.5))
    both = np.vstack([lower.points, lower.points + np.array([0.0, 0.0, 0.5])])
    cells = np.vstack([lower.cells, lower.cells + lower.num_points]).astype(np.int32)
    problem = Problem(TetMesh(both, cells), Material(1.0, 0.3), (), ())
    own = refine_uniformly(problem.mesh)
    field = np.zeros_like(own.points)
    is_upper = np.zeros(own.num_points, dtype=bool)
    is_upper[np.unique(own.cells[own.points[own.cells].mean(axis=1)[:, 2] > 0.5])] = True
    field[is_upper] = [0.0, 0.0, 0.1]
    found = sent(tmp_path, problem, own.points, own.cells, field)
    assert found.own_mesh is not None
    assert found.own_mesh.num_points == own.num_points


def test_cells_all_numbered_the_other_way_round_are_turned_and_told(
    tmp_path: Path, problem: Problem
) -> None:
    own = refine_uniformly(problem.mesh)
    found = sent(tmp_path, problem, own.points, own.cells[:, [1, 0, 2, 3]])
    require_unharmed(found, problem, own)
    assert any("turned" in note for note in found.notes)


@pytest.mark.parametrize("which", ["one", "half"])
def test_some_cells_inverted_at_rest_are_refused(
    tmp_path: Path, problem: Problem, which: str
) -> None:
    own = refine_uniformly(problem.mesh)
    cells = own.cells.copy()
    rows = slice(5, 6) if which == "one" else slice(None, None, 2)
    cells[rows] = cells[rows][:, [1, 0, 2, 3]]
    with pytest.raises(ResultFileError, match="inverted"):
        sent(tmp_path, problem, own.points, cells)


def test_a_cell_given_twice_is_refused(tmp_path: Path, problem: Problem) -> None:
    own = refine_uniformly(problem.mesh)
    with pytest.raises(ResultFileError, match="share one facet"):
        sent(tmp_path, problem, own.points, np.vstack([own.cells, own.cells[7:8]]))


def test_all_cells_given_twice_are_refused(tmp_path: Path, problem: Problem) -> None:
    own = refine_uniformly(problem.mesh)
    with pytest.raises(ResultFileError, match="share one facet"):
        sent(tmp_path, problem, own.points, np.vstack([own.cells, own.cells]))


def compacted(own: TetMesh, keep: NDArray[np.bool_]) -> tuple[Field, NDArray[np.int64]]:
    used, cells = np.unique(own.cells[keep], return_inverse=True)
    return own.points[used], cells.reshape(-1, 4)


def test_a_part_of_the_body_is_refused(tmp_path: Path, problem: Problem) -> None:
    own = refine_uniformly(problem.mesh)
    keep = own.points[own.cells].mean(axis=1)[:, 0] < 1.5
    with pytest.raises(ResultFileError, match="same body"):
        sent(tmp_path, problem, *compacted(own, keep))


def test_a_hole_within_the_body_is_refused(tmp_path: Path) -> None:
    mesh = brick_box((4, 4, 4), (1.0, 1.0, 1.0))
    own = refine_uniformly(mesh)
    problem = Problem(mesh, Material(1.0, 0.3), (), ())
    middle = np.abs(own.points[own.cells].mean(axis=1) - 0.5).max(axis=1)
    with pytest.raises(ResultFileError, match="same body"):
        sent(tmp_path, problem, *compacted(own, middle > 0.2))


def test_a_cavity_that_is_filled_is_refused(tmp_path: Path) -> None:
    whole = brick_box((4, 4, 4), (1.0, 1.0, 1.0))
    middle = np.abs(whole.points[whole.cells].mean(axis=1) - 0.5).max(axis=1)
    points, cells = compacted(whole, middle > 0.25)
    problem = Problem(TetMesh(points, cells.astype(np.int32)), Material(1.0, 0.3), (), ())
    # All points but the one in the middle of the cavity are points of the case.
    with pytest.raises(ResultFileError, match="same body"):
        sent(tmp_path, problem, whole.points, whole.cells)


@pytest.mark.parametrize("size", [0.9, 1.05, 1.3])
def test_a_larger_or_smaller_body_is_refused(tmp_path: Path, problem: Problem, size: float) -> None:
    own = refine_uniformly(problem.mesh)
    centre = own.points.mean(axis=0)
    # 1.05^3 is 1.158, 0.9^3 is 0.729: more than a tenth of the volume.
    with pytest.raises(ResultFileError, match="same body"):
        sent(tmp_path, problem, centre + size * (own.points - centre), own.cells)


def test_another_mesh_of_the_same_body_is_taken(tmp_path: Path, problem: Problem) -> None:
    for divisions in ((3, 2, 2), (7, 5, 4)):
        own = brick_box(divisions, (2.0, 1.0, 1.0), ragged=0.2)
        require_unharmed(sent(tmp_path, problem, own.points, own.cells), problem, own)
