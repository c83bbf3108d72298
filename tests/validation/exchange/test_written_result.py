"""What `solve` writes says what is in it, and can be read back as an answer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.validation.exchange.result_files import read_result
from palpate.validation.exchange.written_result import write_solution
from palpate.validation.metrics import make_state
from palpate.validation.states import State, Trajectory

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


def test_a_mesh_file_holds_the_end_and_says_so(tmp_path: Path, problem: Problem) -> None:
    state = moving(problem)
    line = write_solution(tmp_path / "m.vtu", problem, state)
    assert ", at 0.75 s;" in line
    found = read_result(tmp_path / "m.vtu")
    np.testing.assert_allclose(found.values[0], state.displacement, rtol=0.0, atol=1e-18)
    with pytest.raises(InputError, match="unknown kind"):
        write_solution(tmp_path / "m.obj", problem, state)
