"""`palpate audit`: a result is measured against its equations without solving them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from palpate.meshes.files import read_mesh, write_mesh
from palpate.meshes.problem import Strain
from palpate.validation.case import load_case
from palpate.validation.cli import main
from palpate.validation.references.stored import load_stored

pytestmark = pytest.mark.dolfinx


@pytest.fixture
def solved(tmp_path):
    """The block's stored equilibrium as a result file, and its problem."""
    problem = load_case("block").problem
    state = load_stored("block", problem).states["reference P1", Strain.GREEN]
    path = tmp_path / "answer.vtu"
    write_mesh(path, problem.mesh, point_data={"displacement": state.displacement})
    return path, problem, state.displacement


def palpate(monkeypatch, *arguments):
    monkeypatch.setattr("sys.argv", ["palpate", *map(str, arguments)])
    with pytest.raises(SystemExit) as caught:
        main()
    return caught.value.code


def test_an_equilibrium_passes_and_a_softer_answer_does_not(solved, tmp_path, monkeypatch):
    path, problem, displacement = solved
    numbers = tmp_path / "audit.json"
    tight = ("--degree", 1, "--limit", 1e-7, "--json", numbers)
    assert palpate(monkeypatch, "audit", "block", path, *tight) == 0
    exact = json.loads(numbers.read_text())
    assert exact["relative_residual_norm"] < 1e-7
    assert abs(exact["volume_error"]) < 1e-7
    write_mesh(path, problem.mesh, point_data={"displacement": 1.02 * displacement})
    assert palpate(monkeypatch, "audit", "block", path, *tight) == 1
    softer = json.loads(numbers.read_text())
    # Two per cent too far everywhere, held points included, which do not move.
    assert softer["displacement_error"] == pytest.approx(0.02, rel=0.1)


def test_degree_two_tells_the_error_of_the_mesh(solved, tmp_path, monkeypatch):
    path, problem, _ = solved
    numbers, cells = tmp_path / "audit.json", tmp_path / "cells.vtu"
    assert palpate(monkeypatch, "audit", "block", path, "--json", numbers, "--cells", cells) == 0
    assert json.loads(numbers.read_text())["displacement_error"] > 0.01
    assert read_mesh(cells).num_cells == problem.mesh.num_cells


def test_what_cannot_be_audited(solved, tmp_path, monkeypatch):
    path, problem, displacement = solved
    assert palpate(monkeypatch, "audit", "block-motion", path) == 2
    assert palpate(monkeypatch, "audit", "block", tmp_path / "none.vtu") == 2
    spoiled = displacement.copy()
    spoiled[3] = np.nan
    write_mesh(path, problem.mesh, point_data={"displacement": spoiled})
    assert palpate(monkeypatch, "audit", "block", path) == 1
    write_mesh(path, problem.mesh, point_data={"displacement": -60.0 * displacement})
    assert palpate(monkeypatch, "audit", "block", path) == 1
