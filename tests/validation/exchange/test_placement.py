"""Results come back in every allowed form as the same displacement; all else is refused."""

import math

import numpy as np
import pytest

from palpate.meshes.bricks import brick_box
from palpate.meshes.files import write_mesh
from palpate.meshes.problem import Material, Problem
from palpate.meshes.refinement import refine_uniformly
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.exchange.placement import match_points
from palpate.validation.exchange.result_files import ResultFileError, read_result
from palpate.validation.states import CandidateFailedError


def npz(folder, **arrays):
    np.savez(folder / "r.npz", **arrays)
    return folder / "r.npz"


def placed(path, problem):
    return match_points(read_result(path), problem).displacement[-1]


def shuffled(problem):
    return np.random.default_rng(3).permutation(problem.mesh.num_points)


def renumbered(mesh, order):
    new = np.empty_like(order)
    new[order] = np.arange(len(order))
    return TetMesh(mesh.points[order], new[mesh.cells].astype(np.int32))


@pytest.mark.parametrize("form", ["plain", "positions", "by id", "by position", "mm", "series"])
def test_an_npz_in_every_form_gives_the_same(tmp_path, problem, solution, form):
    points, order = problem.mesh.points, shuffled(problem)
    arrays = {
        "plain": {"displacement": solution},
        "positions": {"positions": points + solution},
        "by id": {"displacement": solution[order], "original_id": order},
        "by position": {"displacement": solution[order], "points": points[order]},
        "mm": {"displacement": 1e3 * solution, "length_unit": "mm"},
        "series": {"displacement": np.stack([0 * solution, solution]), "times": [0.0, 1.0]},
    }[form]
    found = placed(npz(tmp_path, **arrays), problem)
    np.testing.assert_allclose(found, solution, rtol=0.0, atol=1e-14 * np.abs(points).max())


def test_a_vtu_renumbered_moved_or_at_rest_gives_the_same(tmp_path, problem, solution):
    order = shuffled(problem)
    meshes = {
        "rest": (problem.mesh, solution),
        "renumbered": (renumbered(problem.mesh, order), solution[order]),
        "moved": (TetMesh(problem.mesh.points + solution, problem.mesh.cells), solution),
    }
    for name, (mesh, field) in meshes.items():
        path = tmp_path / f"{name}.vtu"
        write_mesh(path, mesh, point_data={"displacement": field})
        np.testing.assert_array_equal(
            placed(path, problem), field if name != "renumbered" else solution
        )


def test_a_csv_with_ids_or_places_gives_the_same(tmp_path, problem, solution):
    order = shuffled(problem)
    table = np.column_stack([order, solution[order]])
    path = tmp_path / "r.csv"
    np.savetxt(path, table, "%.17g", ",", header="original_id,ux,uy,uz", comments="")
    np.testing.assert_array_equal(placed(path, problem), solution)
    positions = problem.mesh.points[order]
    np.savetxt(
        path, np.column_stack([positions, positions + solution[order]]), "%.17g", ",",
        header="x,y,z,px,py,pz", comments="",
    )  # fmt: skip
    np.testing.assert_allclose(placed(path, problem), solution, rtol=0.0, atol=1e-14)


LARGE = [2.0**53, 1e300, -1e300]
# Arrays of a file, by their names in `test_what_cannot_be_used` or as they are, and what is said.
UNUSABLE = [
    ({}, "exactly one of"),
    ({"displacement": "u", "positions": "u"}, "exactly one of"),
    ({"displacements": "u"}, "it holds: 'displacements'"),
    ({"displacement": "short"}, "points, the case"),
    ({"displacement": "flat"}, r"needs \(num_points, 3\)"),
    ({"displacement": "u", "original_id": "zeros"}, "each of"),
    ({"displacement": "u", "original_id": "far"}, "outside 0"),
    ({"displacement": "u", "original_id": "farther"}, "outside 0"),
    ({"displacement": "one more", "original_id": "first twice"}, "each of"),
    *(({"displacement": "u", "original_id": np.full(45, x)}, "no whole number") for x in LARGE),
    ({"displacement": "u", "points": "rest", "cells": "beyond"}, "points that do not exist"),
    ({"displacement": "u", "points": "rest", "cells": "before"}, "points that do not exist"),
    ({"displacement": "u", "points": "elsewhere"}, "no tetrahedra"),
    ({"displacement": "u", "points": np.array(1.0)}, "points have shape"),
    ({"displacement": "text"}, "not numbers"),
    # Times.
    ({"displacement": "two"}, "without `times`"),
    ({"displacement": "two", "times": [1.0, 1.0]}, "must increase"),
    ({"displacement": "one", "times": [math.nan]}, "finite"),
    ({"displacement": "one", "times": [math.inf]}, "finite"),
    ({"displacement": "two", "times": [0.0, math.nan]}, "finite"),
    ({"displacement": "two", "times": [0.0, math.inf]}, "finite"),
    ({"displacement": "one", "times": [[0.0]]}, "one for each of 1"),
    # Texts.
    ({"displacement": "u", "length_unit": np.array("inch")}, "length_unit 'inch'"),
    *(
        ({"displacement": "u", name: value}, f"`{name}` must be one text")
        for name in ("about", "length_unit", "case_key")
        for value in (np.arange(3), np.array(["a", "b"]), np.zeros((0,), "U1"))
    ),
    ({"displacement": "u", "about": np.array("{")}, "not JSON"),
    *(
        ({"displacement": "u", "about": np.array(about)}, "about")
        for about in (
            "[1]", "7", '"text"', "null", "[" * 2000, '{"a": ' * 1000 + "1" + "}" * 1000,
            '{"a": 1' + "0" * 400 + "}",
        )
    ),
]  # fmt: skip


@pytest.mark.parametrize(("arrays", "message"), UNUSABLE)
def test_what_cannot_be_used_is_an_input_error(tmp_path, problem, solution, arrays, message):
    known = {
        "u": solution,
        "one": solution[None],
        "two": np.stack([solution, solution]),
        "short": solution[:-1],
        "flat": solution.ravel(),
        "zeros": np.zeros(len(solution), dtype=int),
        "far": np.arange(len(solution)) + 1,
        "farther": np.arange(len(solution)) + 7,
        "one more": np.vstack([solution, solution[:1]]),
        "first twice": np.append(np.arange(len(solution)), 0),
        "rest": problem.mesh.points,
        "beyond": problem.mesh.cells + 1,
        "before": problem.mesh.cells - 1,
        "elsewhere": problem.mesh.points + 0.01,
        "text": np.full(solution.shape, "x"),
    }
    filled = {k: known[v] if isinstance(v, str) else v for k, v in arrays.items()}
    with pytest.raises(ResultFileError, match=message):
        placed(npz(tmp_path, **filled), problem)


def test_damaged_files_are_input_errors(tmp_path, problem, solution):
    whole = npz(tmp_path, displacement=solution).read_bytes()
    write_mesh(tmp_path / "v.vtu", problem.mesh, point_data={"displacement": solution})
    files = {
        "cut.npz": whole[: len(whole) // 2],
        "cut.vtu": (tmp_path / "v.vtu").read_bytes()[:300],
        "empty.csv": b"",
        "bad.csv": b"ux,uy,uz\n1,2,x\n",
        "ragged.csv": b"ux,uy,uz\n1,2,3\n1,2\n",
        "points.csv": b"x,y,z\n0,0,0\n1,0,0\n",
        "binary.csv": bytes(range(128, 256)),
        "other.txt": b"1 2 3",
    }
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(ResultFileError, match="'points'" if name == "points.csv" else None):
            read_result(tmp_path / name)
    with pytest.raises(ResultFileError, match="no such file"):
        read_result(tmp_path / "missing.npz")


def test_nan_and_a_body_of_another_unit_are_the_candidates_failure(tmp_path, problem, solution):
    broken = solution.copy()
    broken[5, 1] = np.nan
    with pytest.raises(CandidateFailedError, match=r"1 point\(s\), first 5"):
        placed(npz(tmp_path, displacement=broken), problem)
    in_mm = {"displacement": 1e3 * solution, "points": 1e3 * problem.mesh.points}
    with pytest.raises(CandidateFailedError, match="1000 times as large"):
        placed(npz(tmp_path, **in_mm), problem)
    declared = placed(npz(tmp_path, **in_mm, length_unit="mm"), problem)
    np.testing.assert_allclose(declared, solution, rtol=1e-12, atol=1e-15)


SLOPE = np.array([[0.1, 0.2, 0.0], [0.0, -0.1, 0.3], [0.2, 0.0, 0.1]])


def sent(folder, problem, points, cells, displacement=None):
    """The result `points @ SLOPE`, or another, on these points and cells."""
    field = points @ SLOPE if displacement is None else displacement
    np.savez(folder / "r.npz", displacement=field, points=points, cells=cells)
    return match_points(read_result(folder / "r.npz"), problem)


def require_unharmed(found, problem, own):
    """The same own mesh as without the oddity, and the same result on it."""
    assert found.own_mesh.num_points == own.num_points
    assert found.own_mesh.volume == pytest.approx(own.volume, rel=1e-12)
    assert found.own_mesh.surface_area == pytest.approx(own.surface_area, rel=1e-12)
    np.testing.assert_array_equal(found.own_displacement[0], found.own_mesh.points @ SLOPE)
    expected = problem.mesh.points @ SLOPE
    np.testing.assert_allclose(found.displacement[0], expected, rtol=0.0, atol=1e-8)


def unused(own):
    points = np.vstack([[[9.0, 9.0, 9.0]], own.points, [[0.1, 0.1, 0.1]]])
    points[0] = 0.5 * points[1:].mean(axis=0)
    return points, own.cells + 1


def unshared(own):
    return own.points[own.cells.ravel()], np.arange(4 * own.num_cells).reshape(-1, 4)


def turned(own, rows=slice(None)):
    cells = own.cells.copy()
    cells[rows] = cells[rows][:, [1, 0, 2, 3]]
    return own.points, cells


@pytest.mark.parametrize(
    ("change", "note"),
    [
        (lambda own: (own.points, own.cells), "mesh of its own with 768 cells"),
        (unused, "2 point(s) that no cell uses"),
        (unshared, "joined"),
        (turned, "turned"),
    ],
)
def test_a_field_on_a_mesh_of_its_own_is_read_exactly(tmp_path, problem, change, note):
    own = refine_uniformly(problem.mesh)
    found = sent(tmp_path, problem, *change(own))
    require_unharmed(found, problem, own)
    assert any(note in text for text in found.notes)


def test_another_mesh_of_the_same_body_is_taken(tmp_path, problem):
    for divisions in ((3, 2, 2), (7, 5, 4)):
        own = brick_box(divisions, (2.0, 1.0, 1.0), ragged=0.2)
        require_unharmed(sent(tmp_path, problem, own.points, own.cells), problem, own)


def test_points_at_one_position_that_move_apart_are_a_torn_body(tmp_path, problem):
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


def test_bodies_of_the_case_that_touch_may_part(tmp_path):
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
    assert found.own_mesh.num_points == own.num_points


def very_many_points_at_one_position(own):
    many = 20_000
    points = np.vstack([own.points, np.tile(own.points[-1], (many, 1))])
    # Each in a cell of its own, else it is left out for being unused.
    row = own.cells[(own.cells == own.num_points - 1).any(axis=1)][0]
    extra = np.tile(row, (many, 1))
    extra[:, row == own.num_points - 1] = own.num_points + np.arange(many)[:, None]
    return points, np.vstack([own.cells, extra])


def compacted(own, keep):
    used, cells = np.unique(own.cells[keep], return_inverse=True)
    return own.points[used], cells.reshape(-1, 4)


def scaled(size):
    return lambda own: (own.points.mean(0) + size * (own.points - own.points.mean(0)), own.cells)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda own: turned(own, slice(5, 6)), "inverted"),
        (lambda own: turned(own, slice(None, None, 2)), "inverted"),
        (lambda own: (own.points, np.vstack([own.cells, own.cells[7:8]])), "share one facet"),
        (lambda own: (own.points, np.vstack([own.cells, own.cells])), "share one facet"),
        (very_many_points_at_one_position, "share one facet"),
        (lambda own: compacted(own, own.points[own.cells].mean(1)[:, 0] < 1.5), "same body"),
        # 1.05^3 is 1.158, 0.9^3 is 0.729: more than a tenth of the volume.
        (scaled(0.9), "same body"),
        (scaled(1.05), "same body"),
        (scaled(1.3), "same body"),
    ],
)
def test_a_mesh_of_another_body_or_of_none_is_refused(tmp_path, problem, change, reason):
    with pytest.raises(ResultFileError, match=reason):
        sent(tmp_path, problem, *change(refine_uniformly(problem.mesh)))


def test_a_cavity_is_neither_made_nor_filled(tmp_path):
    whole = brick_box((4, 4, 4), (1.0, 1.0, 1.0))
    own = refine_uniformly(whole)
    problem = Problem(whole, Material(1.0, 0.3), (), ())
    middle = np.abs(own.points[own.cells].mean(axis=1) - 0.5).max(axis=1)
    with pytest.raises(ResultFileError, match="same body"):
        sent(tmp_path, problem, *compacted(own, middle > 0.2))
    middle = np.abs(whole.points[whole.cells].mean(axis=1) - 0.5).max(axis=1)
    points, cells = compacted(whole, middle > 0.25)
    problem = Problem(TetMesh(points, cells.astype(np.int32)), Material(1.0, 0.3), (), ())
    # All points but the one in the middle of the cavity are points of the case.
    with pytest.raises(ResultFileError, match="same body"):
        sent(tmp_path, problem, whole.points, whole.cells)
