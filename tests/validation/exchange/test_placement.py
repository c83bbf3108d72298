"""Results come back in every allowed form as the same displacement; all else is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.meshes.files import write_mesh
from palpate.meshes.problem import Problem
from palpate.meshes.refinement import refine_uniformly
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.exchange.placement import place
from palpate.validation.exchange.result_files import ResultFileError, read_result
from palpate.validation.states import CandidateFailedError

Field = NDArray[np.float64]


def npz(folder: Path, **arrays: Any) -> Path:
    np.savez(folder / "r.npz", **arrays)
    return folder / "r.npz"


def placed(path: Path, problem: Problem) -> Field:
    return place(read_result(path), problem).displacement[-1]


def shuffled(problem: Problem) -> NDArray[np.int64]:
    return np.random.default_rng(3).permutation(problem.mesh.num_points)


def renumbered(mesh: TetMesh, order: NDArray[np.int64]) -> TetMesh:
    new = np.empty_like(order)
    new[order] = np.arange(len(order))
    return TetMesh(mesh.points[order], new[mesh.cells].astype(np.int32))


@pytest.mark.parametrize("form", ["plain", "positions", "by id", "by place", "mm", "series"])
def test_an_npz_in_every_form_gives_the_same(
    tmp_path: Path, problem: Problem, answer: Field, form: str
) -> None:
    points, order = problem.mesh.points, shuffled(problem)
    arrays: dict[str, Any] = {
        "plain": {"displacement": answer},
        "positions": {"positions": points + answer},
        "by id": {"displacement": answer[order], "original_id": order},
        "by place": {"displacement": answer[order], "points": points[order]},
        "mm": {"displacement": 1e3 * answer, "length_unit": "mm"},
        "series": {"displacement": np.stack([0 * answer, answer]), "times": [0.0, 1.0]},
    }[form]
    found = placed(npz(tmp_path, **arrays), problem)
    np.testing.assert_allclose(found, answer, rtol=0.0, atol=1e-14 * np.abs(points).max())


def test_a_vtu_renumbered_moved_or_at_rest_gives_the_same(
    tmp_path: Path, problem: Problem, answer: Field
) -> None:
    order = shuffled(problem)
    meshes = {
        "rest": (problem.mesh, answer),
        "renumbered": (renumbered(problem.mesh, order), answer[order]),
        "moved": (TetMesh(problem.mesh.points + answer, problem.mesh.cells), answer),
    }
    for name, (mesh, field) in meshes.items():
        path = tmp_path / f"{name}.vtu"
        write_mesh(path, mesh, point_data={"displacement": field})
        np.testing.assert_array_equal(
            placed(path, problem), field if name != "renumbered" else answer
        )


def test_a_csv_with_ids_or_places_gives_the_same(
    tmp_path: Path, problem: Problem, answer: Field
) -> None:
    order = shuffled(problem)
    table = np.column_stack([order, answer[order]])
    path = tmp_path / "r.csv"
    np.savetxt(path, table, "%.17g", ",", header="original_id,ux,uy,uz", comments="")
    np.testing.assert_array_equal(placed(path, problem), answer)
    places = problem.mesh.points[order]
    np.savetxt(
        path, np.column_stack([places, places + answer[order]]), "%.17g", ",",
        header="x,y,z,px,py,pz", comments="",
    )  # fmt: skip
    np.testing.assert_allclose(placed(path, problem), answer, rtol=0.0, atol=1e-14)


def test_a_linear_field_on_another_mesh_is_read_exactly(tmp_path: Path, problem: Problem) -> None:
    finer = refine_uniformly(problem.mesh)
    matrix = np.array([[0.1, 0.2, 0.0], [0.0, -0.1, 0.3], [0.2, 0.0, 0.1]])
    path = tmp_path / "r.vtu"
    write_mesh(path, finer, point_data={"displacement": finer.points @ matrix})
    result = place(read_result(path), problem)
    np.testing.assert_allclose(
        result.displacement[0], problem.mesh.points @ matrix, rtol=0.0, atol=1e-8
    )
    assert result.own_mesh is not None
    assert result.own_mesh.num_cells == 8 * problem.mesh.num_cells
    assert "mesh of its own" in result.notes[0]


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({}, "exactly one of"),
        ({"displacement": "u", "positions": "u"}, "exactly one of"),
        ({"displacement": "short"}, "points, the case"),
        ({"displacement": "flat"}, "needs \\(num_points, 3\\)"),
        ({"displacement": "u", "length_unit": np.array("inch")}, "length_unit 'inch'"),
        ({"displacement": "u", "original_id": "zeros"}, "each of"),
        ({"displacement": "u", "original_id": "far"}, "outside 0"),
        ({"displacement": "u", "original_id": "farther"}, "outside 0"),
        ({"displacement": "one more", "original_id": "first twice"}, "each of"),
        ({"displacement": "u", "points": "rest", "cells": "beyond"}, "points that do not exist"),
        ({"displacement": "u", "points": "rest", "cells": "before"}, "points that do not exist"),
        ({"displacement": "u", "points": "elsewhere"}, "no tetrahedra"),
        ({"displacement": "text"}, "not numbers"),
        ({"displacement": "two"}, "without `times`"),
        ({"displacement": "two", "times": np.array([1.0, 1.0])}, "must increase"),
        ({"displacement": "u", "about": np.array("{")}, "not JSON"),
    ],
)
def test_what_cannot_be_used_is_an_input_error(
    tmp_path: Path, problem: Problem, answer: Field, arrays: dict[str, Any], message: str
) -> None:
    known = {
        "u": answer,
        "short": answer[:-1],
        "flat": answer.ravel(),
        "zeros": np.zeros(len(answer), dtype=int),
        "far": np.arange(len(answer)) + 1,
        "farther": np.arange(len(answer)) + 7,
        "one more": np.vstack([answer, answer[:1]]),
        "first twice": np.append(np.arange(len(answer)), 0),
        "rest": problem.mesh.points,
        "beyond": problem.mesh.cells + 1,
        "before": problem.mesh.cells - 1,
        "elsewhere": problem.mesh.points + 0.01,
        "text": np.full(answer.shape, "x"),
        "two": np.stack([answer, answer]),
    }
    filled = {k: known[v] if isinstance(v, str) else v for k, v in arrays.items()}
    with pytest.raises(ResultFileError, match=message):
        placed(npz(tmp_path, **filled), problem)


def test_a_csv_without_an_answer_is_told_what_it_holds(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("x,y,z\n0,0,0\n1,0,0\n", encoding="utf-8")
    with pytest.raises(ResultFileError, match="it holds: 'points'"):
        read_result(tmp_path / "r.csv")


def test_damaged_files_are_input_errors(tmp_path: Path, problem: Problem, answer: Field) -> None:
    whole = npz(tmp_path, displacement=answer).read_bytes()
    write_mesh(tmp_path / "v.vtu", problem.mesh, point_data={"displacement": answer})
    files = {
        "cut.npz": whole[: len(whole) // 2],
        "cut.vtu": (tmp_path / "v.vtu").read_bytes()[:300],
        "empty.csv": b"",
        "bad.csv": b"ux,uy,uz\n1,2,x\n",
        "ragged.csv": b"ux,uy,uz\n1,2,3\n1,2\n",
        "binary.csv": bytes(range(128, 256)),
        "other.txt": b"1 2 3",
    }
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(ResultFileError):
            read_result(tmp_path / name)
    with pytest.raises(ResultFileError, match="no such file"):
        read_result(tmp_path / "missing.npz")


def test_nan_and_a_body_of_another_unit_are_the_candidates_failure(
    tmp_path: Path, problem: Problem, answer: Field
) -> None:
    spoiled = answer.copy()
    spoiled[5, 1] = np.nan
    with pytest.raises(CandidateFailedError, match=r"1 point\(s\), first 5"):
        placed(npz(tmp_path, displacement=spoiled), problem)
    in_mm = {"displacement": 1e3 * answer, "points": 1e3 * problem.mesh.points}
    with pytest.raises(CandidateFailedError, match="1000 times as large"):
        placed(npz(tmp_path, **in_mm), problem)
    declared = placed(npz(tmp_path, **in_mm, length_unit="mm"), problem)
    np.testing.assert_allclose(declared, answer, rtol=1e-12, atol=1e-15)
