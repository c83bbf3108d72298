"""A simulator may send its stresses of cells: read in any order, held against the reference's."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.meshes.files import write_mesh
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.refinement import refine_uniformly
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.candidates.fastsim import run_fastsim
from palpate.validation.candidates.result_states import state_of_result
from palpate.validation.exchange.case_folder import describe_conventions
from palpate.validation.exchange.point_location import locate_points
from palpate.validation.exchange.result_files import ResultFileError, read_result, write_solution
from palpate.validation.metrics import Part, make_state, measure
from palpate.validation.metrics.body import Body
from palpate.validation.states import CandidateFailedError, State

Field = NDArray[np.float64]


def sent(problem: Problem, path: Path, **arrays: object) -> State:
    """What an .npz file with these arrays is judged as."""
    with path.open("wb") as stream:
        np.savez(stream, **{name: np.asarray(value) for name, value in arrays.items()})
    return state_of_result(read_result(path), problem, "mine", Strain.GREEN)


def error(problem: Problem, state: State, answer: Field) -> float:
    everywhere = Part(
        np.arange(problem.mesh.num_cells, dtype=np.int32), np.zeros_like(problem.mesh.points)
    )
    right = make_state(problem.mesh, answer, label="x", simulator="x", strain=Strain.GREEN)
    return measure("stress_l2", problem, state, right, everywhere).value


@pytest.fixture
def stress(problem: Problem, answer: Field) -> Field:
    return Body(problem, Strain.GREEN).stresses(answer)[0]


def test_what_is_sent_is_judged_and_else_what_follows_from_the_displacement(
    problem: Problem, answer: Field, stress: Field, tmp_path: Path
) -> None:
    file = tmp_path / "r.npz"
    plain = sent(problem, file, displacement=answer)
    assert plain.sent_stress is None
    assert error(problem, plain, answer) <= 1e-14
    for form in (stress, stress.reshape(-1, 9), stress.astype(np.float32)):
        state = sent(problem, file, displacement=answer, cauchy_stress=form)
        assert error(problem, state, answer) <= 1e-6
    # kPa sent for Pa: as far off as can be.
    state = sent(problem, file, displacement=answer, cauchy_stress=stress / 1000.0)
    assert error(problem, state, answer) == pytest.approx(0.999)


def test_numbers_in_another_order_are_put_in_the_cases(
    problem: Problem, answer: Field, stress: Field, tmp_path: Path
) -> None:
    mesh, rng = problem.mesh, np.random.default_rng(5)
    ids, rows = rng.permutation(mesh.num_points), rng.permutation(mesh.num_cells)
    new = np.empty(mesh.num_points, dtype=np.int64)
    new[ids] = np.arange(mesh.num_points)
    cells = new[mesh.cells[rows]][:, [1, 2, 0, 3]]
    told = {"displacement": answer[ids], "cells": cells, "cauchy_stress": stress[rows]}
    by_id = sent(problem, tmp_path / "a.npz", original_id=ids, **told)
    by_place = sent(problem, tmp_path / "b.npz", points=mesh.points[ids], **told)
    for state in (by_id, by_place):
        assert state.sent_stress is not None
        assert np.array_equal(state.sent_stress, stress)
        assert error(problem, state, answer) <= 1e-14
    # A file of cells in the case's order of points, and those in another.
    write_mesh(
        tmp_path / "c.vtu",
        TetMesh(mesh.points, mesh.cells[rows]),
        point_data={"displacement": answer},
        cell_data={"cauchy_stress": stress[rows].reshape(-1, 9)},
    )
    state = state_of_result(read_result(tmp_path / "c.vtu"), problem, "mine", Strain.GREEN)
    assert np.array_equal(state.sent_stress, stress)


def test_what_palpate_writes_it_reads(problem: Problem, answer: Field, tmp_path: Path) -> None:
    found = run_fastsim(problem, Strain.GREEN, lambda _line: None)
    write_solution(tmp_path / "r.vtu", problem, found)
    state = state_of_result(read_result(tmp_path / "r.vtu"), problem, "mine", Strain.GREEN)
    assert found.stresses is not None
    assert (
        np.abs(state.sent_stress - found.stresses.cauchy).max()
        <= 1e-12 * np.abs(found.stresses.cauchy).max()
    )
    assert error(problem, state, answer) <= 1e-9


def test_on_a_mesh_of_its_own_it_is_that_of_its_own_cells(
    problem: Problem, answer: Field, stress: Field, tmp_path: Path
) -> None:
    own = refine_uniformly(problem.mesh)
    u = locate_points(problem.mesh, own).read(problem.mesh.cells, answer)
    children = np.concatenate([np.tile(stress, (4, 1, 1)), np.repeat(stress, 4, axis=0)])
    for factor, expected in ((1.0, 0.0), (2.0, 1.0)):
        state = sent(
            problem,
            tmp_path / "r.npz",
            displacement=u,
            points=own.points,
            cells=own.cells,
            cauchy_stress=factor * children,
        )
        assert state.own is not None
        assert error(problem, state, answer) == pytest.approx(expected, abs=1e-12)


def test_what_cannot_be_used_is_said(
    problem: Problem, answer: Field, stress: Field, tmp_path: Path
) -> None:
    file, mesh = tmp_path / "r.npz", problem.mesh
    lopsided = stress.copy()
    lopsided[:, 0, 1] *= -1.0
    others = mesh.cells.copy()
    others[0, 0] = next(p for p in range(mesh.num_points) if p not in others[0])
    for told, words in (
        ({"cauchy_stress": stress[:-1]}, f"the case has {mesh.num_cells} cells"),
        ({"cauchy_stress": stress[:, :2]}, r"needs \(num_cells, 9\)"),
        ({"cauchy_stress": lopsided}, "not symmetric"),
        ({"cauchy_stress": stress[:-1], "cells": mesh.cells}, "rows of cauchy_stress but"),
        ({"cauchy_stress": stress, "cells": others}, "of other tetrahedra"),
        ({"cauchy_stress": np.array(["a"])}, "not numbers"),
    ):
        with pytest.raises(ResultFileError, match=words):
            sent(problem, file, displacement=answer, **told)
    for number in (np.nan, np.inf):
        broken = stress.copy()
        broken[3] = number
        with pytest.raises(CandidateFailedError, match=r"in 1 cell\(s\), first 3"):
            sent(problem, file, displacement=answer, cauchy_stress=broken)
    huge = sent(problem, file, displacement=answer, cauchy_stress=np.full_like(stress, 1e308))
    assert error(problem, huge, answer) == np.inf


def test_the_conventions_say_so_and_what_never_to_read() -> None:
    told = describe_conventions(Strain.GREEN)
    assert "`cauchy_stress` [Pa]" in told["answer"]
    assert "row by row" in told["answer"]
    assert "alternate from node to node" in told["conventions"]["smoothed_element"]
    json.dumps(told)


def test_smoothed_stresses_are_taken_where_the_answer_says_smoothed(
    problem: Problem, answer: Field, tmp_path: Path
) -> None:
    about = np.array(json.dumps({"element": "smoothed"}))
    state = sent(problem, tmp_path / "r.npz", displacement=answer, about=about)
    assert state.element is Element.SMOOTHED
    assert error(problem, state, answer) > 0.05
    linear = dataclasses.replace(state, element=Element.LINEAR)
    assert error(problem, linear, answer) <= 1e-14
