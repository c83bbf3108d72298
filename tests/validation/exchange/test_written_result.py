"""What `solve` writes says what is in it, and can be read back as an answer."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import meshio
import numpy as np
import pytest

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.validation.exchange.result_files import read_result, write_solution
from palpate.validation.metrics import make_state
from palpate.validation.states import CellStresses, State, Trajectory

TIMES = np.array([0.0, 0.25, 0.75])


def moving(problem: Problem) -> State:
    states = np.random.default_rng(5).uniform(-1e-3, 1e-3, (3, *problem.mesh.points.shape))
    return make_state(
        problem.mesh, states[-1], label="mine", simulator="mine", strain=Strain.GREEN,
        trajectory=Trajectory(TIMES, states),
    )  # fmt: skip


def test_a_motion_is_written_whole_and_its_end_is_told(tmp_path: Path, problem: Problem) -> None:
    state = moving(problem)
    line = write_solution(tmp_path / "m.npz", problem, state)
    assert line.endswith(f"of {problem.mesh.num_points} points, green strain, 3 states to 0.75 s")
    found = read_result(tmp_path / "m.npz")
    assert state.trajectory is not None
    np.testing.assert_array_equal(found.values, state.trajectory.displacements)
    np.testing.assert_array_equal(found.times, TIMES)


@pytest.mark.parametrize("kind", ["vtu", "vtk", "msh"])
def test_a_mesh_file_holds_the_stresses_of_cells_row_by_row(
    tmp_path: Path, problem: Problem, kind: str
) -> None:
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
    if kind == "vtu":  # the kind that is an answer too
        read = read_result(path)
        np.testing.assert_allclose(read.values[0], state.displacement, atol=1e-18)
        np.testing.assert_array_equal(read.cauchy_stress, sigma)


def test_a_state_without_stresses_has_no_field_of_them(tmp_path: Path, problem: Problem) -> None:
    line = write_solution(tmp_path / "m.vtu", problem, moving(problem))
    assert "stresses [Pa]" not in line
    assert not meshio.read(tmp_path / "m.vtu").cell_data


def test_a_mesh_file_holds_the_end_and_says_so(tmp_path: Path, problem: Problem) -> None:
    state = moving(problem)
    line = write_solution(tmp_path / "m.vtu", problem, state)
    assert ", at 0.75 s;" in line
    found = read_result(tmp_path / "m.vtu")
    np.testing.assert_allclose(found.values[0], state.displacement, rtol=0.0, atol=1e-18)
    with pytest.raises(InputError, match="unknown kind"):
        write_solution(tmp_path / "m.obj", problem, state)
