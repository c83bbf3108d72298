"""`palpate solve` reaches each way to equilibrium, and refuses one that does not fit."""

from __future__ import annotations

import dataclasses
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import palpate
from palpate.meshes.files import read_result_arrays

MOVING = palpate.TimeSpan(end_time=0.1, num_outputs=2)


Run = Callable[..., subprocess.CompletedProcess[str]]


def written(path: Path) -> np.ndarray:
    displacement: np.ndarray = read_result_arrays(path)[2]["displacement"]
    return displacement


@pytest.mark.long
def test_relaxation_finds_what_newton_finds_by_many_more_steps(
    palpate_run: Run, tmp_path: Path
) -> None:
    for method in ("newton", "relaxation"):
        done = palpate_run("solve", "block", "--method", method, "-o", tmp_path / f"{method}.vtu")
        assert done.returncode == 0, done.stderr
    newton, relaxed = written(tmp_path / "newton.vtu"), written(tmp_path / "relaxation.vtu")
    assert np.abs(relaxed - newton).max() < 1e-7 * np.abs(newton).max()
    assert not np.array_equal(relaxed, newton)
    state = palpate.solve(palpate.load_case("block").problem, method="relaxation")
    assert state.details["steps"] > 500  # the load alone is raised over so many
    np.testing.assert_array_equal(state.displacement, relaxed)


def test_a_relaxation_that_finds_no_rest_is_a_failed_candidate() -> None:
    problem = palpate.load_case("block").problem
    jelly = palpate.Material(youngs_modulus=1.0, poissons_ratio=0.4)
    with pytest.raises(palpate.CandidateFailedError, match="fastsim"):
        palpate.solve(dataclasses.replace(problem, material=jelly), method="relaxation")


def test_relaxation_shows_the_forces_on_the_tools() -> None:
    problem = palpate.load_case("press").problem
    with pytest.raises(palpate.InputError, match="at vertices only, so solve by Newton"):
        palpate.solve(problem, method="relaxation")
    at_vertices = [dataclasses.replace(tool, contact="vertices") for tool in problem.tools]
    problem = dataclasses.replace(problem, tools=tuple(at_vertices))
    newton, relaxed = palpate.solve(problem), palpate.solve(problem, method="relaxation")
    assert relaxed.tool_forces is not None
    np.testing.assert_allclose(relaxed.tool_forces, newton.tool_forces, rtol=1e-5, atol=1e-9)


@pytest.mark.dolfinx
@pytest.mark.long
@pytest.mark.nightly
def test_near_incompressibility_the_mixed_formulation_bends_further(
    palpate_run: Run, tmp_path: Path
) -> None:
    problem = palpate.load_case("block").problem
    stiff = dataclasses.replace(problem, material=palpate.Material(3e4, 0.4999))
    plain = palpate.solve(stiff, with_="reference", degree=2, formulation="displacement")
    # By itself, from Poisson's ratios of 0.49 on.
    mixed = palpate.solve(stiff, with_="reference", degree=2)
    assert mixed.details["formulation"] == "mixed"
    assert mixed.max_displacement > plain.max_displacement
    done = palpate_run(
        "solve",
        *("block", "--with", "reference", "--degree", 3, "--formulation", "mixed"),
        *("-o", tmp_path / "u.vtu"),
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.dolfinx
def test_the_mixed_formulation_of_linear_cells_says_which_degree_it_needs(
    palpate_run: Run, tmp_path: Path
) -> None:
    words = ("block", "--with", "reference", "--formulation", "mixed")
    done = palpate_run("solve", *words, "-o", tmp_path / "u.vtu")
    assert done.returncode == 2
    assert "degree 2" in done.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"with_": "reference", "method": "relaxation"}, "fastsim's"),
        ({"formulation": "mixed"}, "the reference's"),
        ({"method": "secant"}, "newton, relaxation"),
        ({"formulation": "stress"}, "displacement, mixed"),
    ],
)
def test_a_way_that_the_solver_does_not_know_is_refused(
    options: dict[str, str], words: str
) -> None:
    with pytest.raises(palpate.InputError, match=words):
        palpate.solve(palpate.load_case("block").problem, **options)


@pytest.mark.parametrize(
    "options",
    [{"method": "relaxation"}, {"with_": "reference", "degree": 2, "formulation": "mixed"}],
)
def test_a_motion_has_no_equilibrium_to_look_for(options: dict[str, str]) -> None:
    moving = dataclasses.replace(palpate.load_case("block").problem, time=MOVING)
    with pytest.raises(palpate.InputError, match="a motion"):
        palpate.solve(moving, **options)
