"""`palpate audit`: a result is measured against its equations without solving them."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

import palpate
from palpate.meshes.files import read_mesh, write_mesh
from palpate.meshes.problem import Strain
from palpate.meshes.refinement import refine_uniformly
from palpate.reference.child import run_task
from palpate.reference.tasks import AuditTask
from palpate.validation.case import load_case
from palpate.validation.commands.solve import failures
from palpate.validation.references.stored import load_stored

pytestmark = pytest.mark.dolfinx


@pytest.fixture
def solved(tmp_path):
    """The block's stored equilibrium as a result file, and its problem."""
    problem = load_case("block").problem
    state = load_stored("block", problem).states["reference P1", Strain.GREEN]
    path = tmp_path / "solution.vtu"
    write_mesh(path, problem.mesh, point_data={"displacement": state.displacement})
    return path, problem, state.displacement


def test_an_equilibrium_passes_and_a_softer_solution_does_not(solved, tmp_path, command_line):
    path, problem, displacement = solved
    numbers = tmp_path / "audit.json"
    tight = ("--degree", 1, "--limit", 1e-7, "--json", numbers)
    assert command_line("audit", "block", path, *tight) == 0
    exact = json.loads(numbers.read_text())
    assert exact["relative_residual_norm"] < 1e-7
    assert abs(exact["volume_error"]) < 1e-7
    write_mesh(path, problem.mesh, point_data={"displacement": 1.02 * displacement})
    assert command_line("audit", "block", path, *tight) == 1
    softer = json.loads(numbers.read_text())
    # Two per cent too far everywhere, fixed points included, which do not move.
    assert softer["displacement_error"] == pytest.approx(0.02, rel=0.1)


@pytest.mark.parametrize("degree", [1, 2])
def test_a_result_on_a_mesh_of_its_own_is_refused_with_its_numbers_of_points(
    solved, tmp_path, command_line, capsys, degree
):
    """At the case's points it is the equilibrium; between them it is garbage, or none at all."""
    _, problem, displacement = solved
    finer = refine_uniformly(problem.mesh)
    own = np.zeros((finer.num_points, 3))
    own[: len(displacement)] = displacement
    rng = np.random.default_rng(1)
    own[len(displacement) :] = (
        0.3 * np.abs(displacement).max() * rng.standard_normal(own[len(displacement) :].shape)
    )
    path = tmp_path / "finer.vtu"
    write_mesh(path, finer, point_data={"displacement": own})
    assert command_line("audit", "block", path, "--degree", degree, "--limit", 1e-6) == 2
    reported = capsys.readouterr()
    words = " ".join(reported.err.split())
    assert f"mesh of its own, of {finer.num_points} points" in words
    assert f"the case has {problem.mesh.num_points}" in words
    assert "palpate compare" in words
    assert "judged there" not in reported.out
    with pytest.raises(palpate.InputError, match="mesh of its own"):
        palpate.audit("block", path, degree=degree)


def test_degree_two_shows_the_error_of_the_mesh(solved, tmp_path, command_line):
    path, problem, _ = solved
    numbers, cells = tmp_path / "audit.json", tmp_path / "cells.vtu"
    assert command_line("audit", "block", path, "--json", numbers, "--cells", cells) == 0
    assert json.loads(numbers.read_text())["displacement_error"] > 0.01
    assert read_mesh(cells).num_cells == problem.mesh.num_cells


def test_what_cannot_be_audited(solved, tmp_path, command_line):
    path, problem, displacement = solved
    assert command_line("audit", "block-motion", path) == 2
    assert command_line("audit", "block", tmp_path / "none.vtu") == 2
    perturbed = displacement.copy()
    perturbed[3] = np.nan
    write_mesh(path, problem.mesh, point_data={"displacement": perturbed})
    assert command_line("audit", "block", path) == 1
    write_mesh(path, problem.mesh, point_data={"displacement": -60.0 * displacement})
    assert command_line("audit", "block", path) == 1
    # Finite, but no volume, and no stiffness, can be made of it: a failure, no crash.
    write_mesh(path, problem.mesh, point_data={"displacement": np.full_like(displacement, 1e308)})
    assert command_line("audit", "block", path) == 1


def test_a_limit_holds_the_supports_as_well(solved, tmp_path, command_line, capsys):
    path, problem, displacement = solved
    numbers = tmp_path / "audit.json"
    judged = ("audit", "block", path, "--degree", 1, "--limit", 1e-6, "--json", numbers)
    assert command_line(*judged) == 0
    assert json.loads(numbers.read_text())["failures"] == []
    # Moved as a whole, far or hardly, nothing is strained: the residual sees only the free parts.
    for shift in (1.0, 1e-5 * np.abs(displacement).max()):
        moved = displacement + np.array([0.0, shift, 0.0])
        write_mesh(path, problem.mesh, point_data={"displacement": moved})
        capsys.readouterr()
        assert command_line(*judged) == 1
        reported = json.loads(numbers.read_text())
        assert reported["relative_residual_norm"] < 1e-6
        assert reported["support_gap"] == pytest.approx(shift)
        gap = shift / np.linalg.norm(moved, axis=1).max()
        assert reported["relative_support_gap"] == pytest.approx(gap)
        assert len(reported["failures"]) == 1
        assert "failed: supports missed by" in capsys.readouterr().out


def test_an_inverted_cell_fails_under_either_strain_without_a_limit(solved, command_line, capsys):
    path, problem, displacement = solved
    write_mesh(path, problem.mesh, point_data={"displacement": -60.0 * displacement})
    for strain in Strain:
        assert command_line("audit", "block", path, "--strain", strain) == 1
        assert "failed: a cell is inverted" in capsys.readouterr().out


def test_no_number_of_an_audit_may_be_other_than_finite(solved):
    _, problem, displacement = solved
    good = run_task(AuditTask(displacement, Strain.GREEN, 1), problem)
    assert failures(good) == failures(good, 1e-6) == []
    measured = [
        field.name for field in dataclasses.fields(good)
        if isinstance(getattr(good, field.name), float) and field.name != "largest_displacement"
    ]  # fmt: skip
    assert len(measured) == 10
    for name in measured:
        for value in (np.nan, np.inf, -np.inf):
            (reason, *more) = failures(dataclasses.replace(good, **{name: value}))
            assert "no finite number" in reason or name == "smallest_det_f"
            assert len(more) <= 1
    for changes, word in (
        ({"is_stable": False}, "not stable"),
        ({"displacement_error": None}, "singular"),
        ({"support_gap": 1.0}, "supports"),
        ({"relative_residual_norm": 1e-5}, "residual"),
    ):
        perturbed = dataclasses.replace(good, **changes)
        assert failures(perturbed) == []
        (reason,) = failures(perturbed, 1e-6)
        assert word in reason


@pytest.mark.parametrize("limit", ["0", "-1", "nan", "inf", "1", "2.5"])
def test_a_limit_that_holds_nothing_is_refused(solved, command_line, limit):
    assert command_line("audit", "block", solved[0], f"--limit={limit}") == 2
