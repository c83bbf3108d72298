"""Result files: written, read back, with their stress, and refused where they are hostile."""

import dataclasses
import json
import re

import meshio
import numpy as np
import pytest

from palpate.meshes.errors import InputError
from palpate.meshes.files import write_mesh
from palpate.meshes.problem import Element, Strain
from palpate.meshes.refinement import refine_uniformly
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.candidates.candidate import result_candidate
from palpate.validation.candidates.fastsim import run_fastsim
from palpate.validation.candidates.result_states import state_of_result
from palpate.validation.exchange.case_folder import describe_conventions
from palpate.validation.exchange.point_location import locate_points
from palpate.validation.exchange.result_files import (
    ResultFileError,
    read_result,
    room_for_result,
    write_solution,
)
from palpate.validation.metrics import Part, make_state, measure
from palpate.validation.metrics.body import Body
from palpate.validation.states import CandidateFailedError, CellStresses, Trajectory, in_silence

TIMES = np.array([0.0, 0.25, 0.75])


def moving(problem):
    states = np.random.default_rng(5).uniform(-1e-3, 1e-3, (3, *problem.mesh.points.shape))
    return make_state(
        problem.mesh, states[-1], label="mine", simulator="mine", strain=Strain.GREEN,
        trajectory=Trajectory(TIMES, states),
    )  # fmt: skip


def test_a_motion_is_written_whole_and_its_end_is_reported(tmp_path, problem):
    state = moving(problem)
    line = write_solution(tmp_path / "m.npz", problem, state)
    assert line.endswith(f"of {problem.mesh.num_points} points, green strain, 3 states to 0.75 s")
    found = read_result(tmp_path / "m.npz")
    np.testing.assert_array_equal(found.values, state.trajectory.displacements)
    np.testing.assert_array_equal(found.times, TIMES)


@pytest.mark.parametrize("kind", ["vtu", "vtk", "msh"])
def test_a_mesh_file_holds_the_stresses_of_cells_row_by_row(tmp_path, problem, kind):
    path, count = tmp_path / f"s.{kind}", problem.mesh.num_cells
    rng = np.random.default_rng(6)
    S, sigma = rng.normal(size=(2, count, 3, 3))
    sigma += sigma.transpose(0, 2, 1)
    # A shear of 2 Pa: sqrt(3) of it; and hydrostatic stress: nothing.
    sigma[0] = 2.0 * np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    sigma[1] = 5.0 * np.eye(3)
    state = dataclasses.replace(moving(problem), stresses=CellStresses(S, sigma))
    assert f", stresses [Pa] of {count} cells" in write_solution(path, problem, state)
    written = meshio.read(path)
    fields = {name: np.concatenate(parts) for name, parts in written.cell_data.items()}
    np.testing.assert_array_equal(written.cells_dict["tetra"], problem.mesh.cells)
    rows = fields["second_piola_kirchhoff_stress"].reshape(count, 9)
    np.testing.assert_array_equal(rows[:, 1], S[:, 0, 1])
    np.testing.assert_array_equal(rows.reshape(count, 3, 3), S)
    np.testing.assert_array_equal(fields["cauchy_stress"].reshape(count, 3, 3), sigma)
    mises = fields["von_mises_stress"].reshape(count)
    assert mises[:2] == pytest.approx([2.0 * np.sqrt(3.0), 0.0], abs=1e-12)
    if kind == "vtu":  # the kind that is a result too
        read = read_result(path)
        np.testing.assert_allclose(read.values[0], state.displacement, atol=1e-18)
        np.testing.assert_array_equal(read.cauchy_stress, sigma)


def test_a_state_without_stresses_has_no_field_of_them(tmp_path, problem):
    line = write_solution(tmp_path / "m.vtu", problem, moving(problem))
    assert "stresses [Pa]" not in line
    assert not meshio.read(tmp_path / "m.vtu").cell_data


def test_a_mesh_file_holds_the_end_and_says_so(tmp_path, problem):
    state = moving(problem)
    line = write_solution(tmp_path / "m.vtu", problem, state)
    assert ", at 0.75 s;" in line
    found = read_result(tmp_path / "m.vtu")
    np.testing.assert_allclose(found.values[0], state.displacement, rtol=0.0, atol=1e-18)
    with pytest.raises(InputError, match="unknown kind"):
        write_solution(tmp_path / "m.obj", problem, state)


def npz(folder, **arrays):
    np.savez_compressed(folder / "r.npz", **arrays)
    return folder / "r.npz"


@pytest.mark.parametrize(
    "forces",
    ["many", ["a", "b", "c"], [["1", "2", "3"]], [[1.0, 2.0], [3.0]], [1.0, 2.0, 3.0], {"x": 1},
     [[1.0, 2.0]], [[[[1.0, 2.0, 3.0]]]], True, [[True, False, True]], 7],
)  # fmt: skip
def test_tool_forces_that_are_no_forces_are_refused(tmp_path, problem, solution, forces):
    path = npz(tmp_path, displacement=solution, about=json.dumps({"tool_forces": forces}))
    with pytest.raises(ResultFileError, match="tool_forces"):
        result_candidate(path).solve(problem, Strain.GREEN, in_silence)


def test_tool_forces_with_a_nan_are_read_as_they_are(tmp_path, problem, solution):
    path = npz(tmp_path, displacement=solution, about='{"tool_forces": [[NaN, 0, 1]]}')
    state = result_candidate(path).solve(problem, Strain.GREEN, in_silence)
    assert np.isnan(state.tool_forces[0, 0])


def test_fields_of_a_vtu_called_as_texts_are_refused(tmp_path, problem, solution):
    for name in ("about", "length_unit", "times", "original_id"):
        path = tmp_path / f"{name}.vtu"
        fields = {"displacement": solution, name: solution[:, 0]}
        write_mesh(path, problem.mesh, point_data=fields)
        with pytest.raises(ResultFileError):
            read_result(path)


def test_a_damaged_stream_is_refused_in_npz_and_vtu(tmp_path, problem, solution):
    zipped = npz(tmp_path, displacement=solution)
    middle = zipped.stat().st_size // 2
    data = bytearray(zipped.read_bytes())
    data[middle : middle + 8] = b"\xff" * 8
    zipped.write_bytes(bytes(data))
    write_mesh(tmp_path / "r.vtu", problem.mesh, point_data={"displacement": solution})
    text = (tmp_path / "r.vtu").read_text("ascii")
    longest = max(re.findall(r"[A-Za-z0-9+/=]{60,}", text), key=len)
    broken = longest[:50] + "/" * 12 + longest[62:]
    (tmp_path / "r.vtu").write_text(text.replace(longest, broken), encoding="ascii")
    for path in (zipped, tmp_path / "r.vtu"):
        with pytest.raises(ResultFileError, match="cannot be read"):
            read_result(path)


def test_a_result_may_be_many_times_as_large_as_the_cases_own(tmp_path, problem, solution):
    assert room_for_result(problem) == 256 * 1024**2
    path = npz(tmp_path, displacement=solution)
    read_result(path, most_bytes=solution.nbytes)
    with pytest.raises(ResultFileError, match="when unpacked"):
        read_result(path, most_bytes=solution.nbytes - 1)


def sent(problem, path, **arrays):
    """What an .npz file with these arrays is judged as."""
    with path.open("wb") as stream:
        np.savez(stream, **{name: np.asarray(value) for name, value in arrays.items()})
    return state_of_result(read_result(path), problem, "mine", Strain.GREEN)


def error(problem, state, solution):
    everywhere = Part(
        np.arange(problem.mesh.num_cells, dtype=np.int32), np.zeros_like(problem.mesh.points)
    )
    right = make_state(problem.mesh, solution, label="x", simulator="x", strain=Strain.GREEN)
    return measure("stress_l2", problem, state, right, everywhere).value


@pytest.fixture
def stress(problem, solution):
    return Body(problem, Strain.GREEN).stresses(solution)[0]


def test_what_is_sent_is_judged_and_else_what_follows_from_the_displacement(
    problem, solution, stress, tmp_path
):
    file = tmp_path / "r.npz"
    plain = sent(problem, file, displacement=solution)
    assert plain.sent_stress is None
    assert error(problem, plain, solution) <= 1e-14
    for form in (stress, stress.reshape(-1, 9), stress.astype(np.float32)):
        state = sent(problem, file, displacement=solution, cauchy_stress=form)
        assert error(problem, state, solution) <= 1e-6
    # kPa sent for Pa: as far off as can be.
    state = sent(problem, file, displacement=solution, cauchy_stress=stress / 1000.0)
    assert error(problem, state, solution) == pytest.approx(0.999)


def test_numbers_in_another_order_are_put_in_the_cases(problem, solution, stress, tmp_path):
    mesh, rng = problem.mesh, np.random.default_rng(5)
    ids, rows = rng.permutation(mesh.num_points), rng.permutation(mesh.num_cells)
    new = np.empty(mesh.num_points, dtype=np.int64)
    new[ids] = np.arange(mesh.num_points)
    cells = new[mesh.cells[rows]][:, [1, 2, 0, 3]]
    arrays = {"displacement": solution[ids], "cells": cells, "cauchy_stress": stress[rows]}
    by_id = sent(problem, tmp_path / "a.npz", original_id=ids, **arrays)
    by_position = sent(problem, tmp_path / "b.npz", points=mesh.points[ids], **arrays)
    for state in (by_id, by_position):
        assert np.array_equal(state.sent_stress, stress)
        assert error(problem, state, solution) <= 1e-14
    # A file of cells in the case's order of points, and those in another.
    write_mesh(
        tmp_path / "c.vtu",
        TetMesh(mesh.points, mesh.cells[rows]),
        point_data={"displacement": solution},
        cell_data={"cauchy_stress": stress[rows].reshape(-1, 9)},
    )
    state = state_of_result(read_result(tmp_path / "c.vtu"), problem, "mine", Strain.GREEN)
    assert np.array_equal(state.sent_stress, stress)


def test_what_palpate_writes_it_reads(problem, solution, tmp_path):
    found = run_fastsim(problem, Strain.GREEN, in_silence)
    write_solution(tmp_path / "r.vtu", problem, found)
    state = state_of_result(read_result(tmp_path / "r.vtu"), problem, "mine", Strain.GREEN)
    assert (
        np.abs(state.sent_stress - found.stresses.cauchy).max()
        <= 1e-12 * np.abs(found.stresses.cauchy).max()
    )
    assert error(problem, state, solution) <= 1e-9


def test_on_a_mesh_of_its_own_it_is_that_of_its_own_cells(problem, solution, stress, tmp_path):
    own = refine_uniformly(problem.mesh)
    u = locate_points(problem.mesh, own).read(problem.mesh.cells, solution)
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
        assert error(problem, state, solution) == pytest.approx(expected, abs=1e-12)


def test_what_cannot_be_used_is_said(problem, solution, stress, tmp_path):
    file, mesh = tmp_path / "r.npz", problem.mesh
    lopsided = stress.copy()
    lopsided[:, 0, 1] *= -1.0
    others = mesh.cells.copy()
    others[0, 0] = next(p for p in range(mesh.num_points) if p not in others[0])
    lower = mesh.cells.copy()  # no vertex of a sorted cell is larger
    row = int(lower.min(axis=1).argmax())
    lower[row, lower[row].argmin()] = 0
    for arrays, words in (
        ({"cauchy_stress": stress[:-1]}, f"the case has {mesh.num_cells} cells"),
        ({"cauchy_stress": stress[:, :2]}, r"needs \(num_cells, 9\)"),
        ({"cauchy_stress": lopsided}, "not symmetric"),
        ({"cauchy_stress": stress[:-1], "cells": mesh.cells}, "rows of cauchy_stress but"),
        ({"cauchy_stress": np.repeat(stress, 2, 0), "cells": mesh.cells}, "cauchy_stress but"),
        ({"cauchy_stress": stress, "cells": others}, "of other tetrahedra"),
        ({"cauchy_stress": stress, "cells": lower}, "of other tetrahedra"),
        ({"cauchy_stress": np.array(["a"])}, "not numbers"),
    ):
        with pytest.raises(ResultFileError, match=words):
            sent(problem, file, displacement=solution, **arrays)
    for number in (np.nan, np.inf):
        broken = stress.copy()
        broken[3] = number
        with pytest.raises(CandidateFailedError, match=r"in 1 cell\(s\), first 3"):
            sent(problem, file, displacement=solution, cauchy_stress=broken)
    huge = sent(problem, file, displacement=solution, cauchy_stress=np.full_like(stress, 1e308))
    assert error(problem, huge, solution) == np.inf


def test_the_conventions_say_so_and_what_never_to_read():
    words = describe_conventions(Strain.GREEN)
    assert "`cauchy_stress` [Pa]" in words["result"]
    assert "row by row" in words["result"]
    assert "alternate from node to node" in words["conventions"]["smoothed_element"]


def test_stresses_are_of_the_element_that_is_asked_for(problem, solution, tmp_path):
    about = np.array(json.dumps({"element": "smoothed"}))
    linear = sent(problem, tmp_path / "r.npz", displacement=solution, about=about)
    assert linear.element is Element.LINEAR
    assert error(problem, linear, solution) <= 1e-14
    asked = {"element": Element.SMOOTHED}
    sent_again = read_result(tmp_path / "r.npz")
    state = state_of_result(sent_again, problem, "mine", Strain.GREEN, **asked)
    assert error(problem, state, solution) > 0.05
