"""`palpate solve` solves what the case asks for, and what it writes can be judged."""

from __future__ import annotations

import dataclasses
import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.files import read_result_arrays
from palpate.meshes.problem import Element, Strain
from palpate.validation.case import load_case
from palpate.validation.references.runs import solve_reference, solve_state
from palpate.validation.states import in_silence

Run = Callable[..., subprocess.CompletedProcess[str]]


def verdicts(palpate_run: Run, case: str, result: Path, folder: Path) -> set[str]:
    """Of the checks on the same mesh."""
    reported = folder / "judged.json"
    palpate_run("compare", case, result, "--json", reported)
    checks = json.loads(reported.read_text("utf-8"))["cases"][0]["checks"]
    return {c["verdict"] for c in checks if c["against"] == "same_mesh" and c["strain"] == "green"}


@pytest.mark.parametrize(
    ("case", "who", "states"),
    [
        ("slide", "fastsim", 16),
        pytest.param("slide", "reference", 16, marks=pytest.mark.dolfinx),
        pytest.param("block-motion", "reference", 51, marks=pytest.mark.dolfinx),
        pytest.param("press", "reference", 1, marks=pytest.mark.dolfinx),
    ],
)
def test_motions_and_tools_are_solved_and_the_file_passes_the_case(
    palpate_run: Run, tmp_path: Path, case: str, who: str, states: int
) -> None:
    written = tmp_path / f"{case}.npz"
    done = palpate_run("solve", case, "--with", who, "-o", written)
    assert done.returncode == 0, done.stderr
    span = load_case(case).problem.time
    if span is not None:
        assert f"{states} states to {span.end_time:g} s" in done.stdout
    with np.load(written) as stored:
        moves = stored["displacement"]
    assert moves.reshape(-1, *moves.shape[-2:]).shape[0] == states
    assert verdicts(palpate_run, case, written, tmp_path) == {"passed"}


@pytest.mark.dolfinx
@pytest.mark.long
def test_a_mesh_file_holds_the_end_of_the_motion_not_the_equilibrium(
    palpate_run: Run, tmp_path: Path
) -> None:
    written, moving = tmp_path / "u.vtu", tmp_path / "u.npz"
    for path in (written, moving):
        done = palpate_run("solve", "block-motion", "--with", "reference", "-o", path)
        assert done.returncode == 0, done.stderr
    found = read_result_arrays(written)[2]["displacement"]
    with np.load(moving) as stored:
        np.testing.assert_array_equal(found, stored["displacement"][-1])
        assert stored["times"][-1] == 0.5
    assert np.abs(equilibrium() - found).max() > 1e-3 * np.abs(found).max()


@pytest.mark.dolfinx
@pytest.mark.parametrize("element", ["linear", "smoothed"])
def test_either_simulator_writes_the_same_stresses(
    palpate_run: Run, tmp_path: Path, element: str
) -> None:
    found = {}
    for who in ("fastsim", "reference"):
        path = tmp_path / f"{who}.vtu"
        done = palpate_run("solve", "block", "--with", who, "--element", element, "-o", path)
        assert done.returncode == 0, done.stderr
        assert "stresses [Pa] of 90 cells" in done.stdout
        found[who] = meshio.read(path).cell_data
    names = {"second_piola_kirchhoff_stress", "cauchy_stress", "von_mises_stress"}
    for name in names:
        ours, theirs = found["fastsim"][name][0], found["reference"][name][0]
        assert np.abs(ours - theirs).max() <= 1e-8 * np.abs(theirs).max()
    assert set(found["fastsim"]) == set(found["reference"]) == names


def equilibrium() -> Points:
    problem = dataclasses.replace(load_case("block-motion").problem, time=None)
    return solve_reference(problem, Strain.GREEN, 1, in_silence).displacement


@pytest.mark.dolfinx
def test_degree_two_is_implicit_and_so_is_a_motion_without_a_step() -> None:
    problem = load_case("block-motion").problem
    assert problem.time is not None
    lines: list[str] = []
    found = solve_reference(problem, Strain.LINEAR, 2, lines.append)
    assert found.degree == 2
    assert "implicit" in lines[0]
    free = dataclasses.replace(problem, time=dataclasses.replace(problem.time, time_step=None))
    found = solve_reference(free, Strain.LINEAR, 1, lines.append)
    assert found.degree == 1
    assert found.trajectory is not None
    assert "implicit" in lines[-1]


def test_what_the_reference_cannot_move_is_refused_with_the_way_out() -> None:
    problem = load_case("slide").problem
    with pytest.raises(InputError, match="take degree 1"):
        solve_reference(problem, Strain.GREEN, 2, in_silence, element=Element.SMOOTHED)
    with pytest.raises(InputError, match="solve its motion"):
        solve_state(problem, Strain.GREEN, 1, in_silence)


def test_a_kind_of_file_that_holds_no_solution_is_refused_before_solving(
    palpate_run: Run, tmp_path: Path
) -> None:
    done = palpate_run("solve", "kidney", "-o", tmp_path / "u.csv")
    assert done.returncode == 2
    assert ".npz" in done.stderr
    assert "fastsim" not in done.stderr
