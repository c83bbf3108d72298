"""case.json suffices: a program written from its words alone gives the reference's numbers."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from palpate.fastsim.dynamics import simulate
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Support
from palpate.meshes.problem import Material, Strain, TimeSpan
from palpate.meshes.spring import AnchorPath, Spring
from palpate.validation.case import builtin_cases, load_case
from palpate.validation.exchange.case_folder import describe_conventions, write_case_folder
from palpate.validation.references.reference_set import SAME_MESH
from palpate.validation.references.stored import load_stored

PROGRAM = Path(__file__).parent / "simulator_from_words.py"
# Relative to the largest displacement.
TOLERANCE = 1e-10


def solution(folder, problem, strain):
    write_case_folder(folder, problem, strain, name="case")
    subprocess.run(
        [sys.executable, "-I", str(PROGRAM), str(folder), str(folder / "solution.npz")],
        check=True,
        timeout=300,
    )
    with np.load(folder / "solution.npz") as stored:
        return np.array(stored["displacement"])


def test_the_program_knows_nothing_of_palpate():
    imports = {
        line.split()[1]
        for line in PROGRAM.read_text("utf-8").splitlines()
        if line.startswith(("import ", "from "))
    }
    assert imports == {"json", "sys", "pathlib", "numpy"}


@pytest.mark.parametrize("strain", Strain)
@pytest.mark.long
def test_it_solves_the_block_under_pressure_weight_and_pull(tmp_path, strain):
    problem = load_case("block").problem
    assert any(isinstance(load, Pressure) for load in problem.loads)
    expected = load_stored("block", problem).states[SAME_MESH, strain].displacement
    found = solution(tmp_path, problem, strain)
    assert np.abs(found - expected).max() <= TOLERANCE * np.abs(expected).max()


@pytest.mark.parametrize("strain", Strain)
def test_it_steps_through_the_motion_of_the_block(tmp_path, strain):
    problem = load_case("block-motion").problem
    expected = load_stored("block-motion", problem).states[SAME_MESH, strain].trajectory
    found = solution(tmp_path, problem, strain)
    largest = np.abs(expected.displacements).max()
    assert np.abs(found - expected.displacements).max() <= TOLERANCE * largest


@pytest.mark.parametrize("strain", Strain)
def test_it_knows_springs_over_patches(tmp_path, problem, strain):
    path = AnchorPath(np.array([0.0, 0.1]), np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.3]]), True)
    gripped = TabularAmplitude((0.0, 0.05, 0.15), (0.2, 1.0, 0.0))
    spring = Spring.on(problem.mesh, (1.5, 0.5, 1.0), 0.6, 300.0, path, gripped)
    moving = dataclasses.replace(
        problem,
        material=Material(1000.0, 0.3, 2.0),
        springs=(spring,),
        time=TimeSpan(0.1, 2e-4, 3.0, 10),
    )
    expected = simulate(moving, strain=strain).displacements
    without = simulate(dataclasses.replace(moving, springs=()), strain=strain).displacements
    largest = np.abs(expected).max()
    assert np.abs(expected - without).max() > 0.2 * largest
    found = solution(tmp_path, moving, strain)
    assert np.abs(found - expected).max() <= TOLERANCE * largest


@pytest.mark.parametrize("strain", Strain)
def test_it_knows_amplitudes_of_dead_loads_pressures_and_supports(tmp_path, problem, strain):
    """Against fastsim: what differs is who wrote it."""
    right = problem.loads[0]
    end = np.unique(right.facets).astype(np.int32)
    moving = dataclasses.replace(
        problem,
        material=Material(1000.0, 0.3, 2.0),
        supports=(
            *problem.supports,
            Support(
                end,
                components=(True, False, False),
                displacement=(0.1, 0.0, 0.0),
                amplitude=TabularAmplitude((0.01, 0.1), (0.0, 1.0), is_smooth=True),
            ),
        ),
        loads=(
            BodyForce((0.0, 0.0, -20.0)),
            BodyForce((0.0, 30.0, 0.0), TabularAmplitude((0.02, 0.05, 0.15), (0.5, 1.0, -0.5))),
            Pressure(
                problem.mesh.boundary_facets[:12],
                40.0,
                TabularAmplitude((0.0, 0.08), (0.0, 1.0), is_smooth=True),
            ),
            Pressure(problem.mesh.boundary_facets[30:34], -25.0),
        ),
        time=TimeSpan(0.2, 2e-4, 3.0, 10, stiffness_damping=3e-4),
    )
    expected = simulate(moving, strain=strain).displacements
    assert np.abs(expected).max() > 0.05
    found = solution(tmp_path, moving, strain)
    assert np.abs(found - expected).max() <= TOLERANCE * np.abs(expected).max()


def paths_of(item, prefix=""):
    """Keys of a JSON document, with dots; lists by their entries."""
    found = set()
    for key, value in item.items():
        path = f"{prefix}{key}"
        found.add(path)
        if path in ("arrays", "conventions", "keys", "units", "material"):
            continue
        for entry in value if isinstance(value, list) else [value]:
            inside = f"{path}[]." if isinstance(value, list) else f"{path}."
            if isinstance(entry, dict) and path.count(".") < 1:
                found |= paths_of(entry, inside)
    return found


@pytest.mark.parametrize("name", builtin_cases())
def test_every_key_and_every_array_is_explained(tmp_path, name):
    case = load_case(name)
    write_case_folder(tmp_path, case.problem, case.strain, name=name)
    document = json.loads((tmp_path / "case.json").read_text("utf-8"))
    words = describe_conventions(case.strain)
    assert paths_of(document) <= set(words["keys"])
    assert document["keys"] == words["keys"]
    assert document["conventions"]["integrator"]
    num_points, num_cells = document["num_points"], document["num_cells"]
    with np.load(tmp_path / "rest.npz") as stored:
        for array_name in stored.files:
            general = "external_force_K" if array_name[-1].isdigit() else array_name
            described = words["arrays"][general]
            shape = stored[array_name].shape
            pressed = len(stored["pressure"])
            sizes = {"num_points": num_points, "num_cells": num_cells, "num_pressed": pressed}
            named = described["shape"].strip("()").rstrip(",").split(", ")
            assert shape == tuple(sizes[size] if size in sizes else int(size) for size in named), (
                described
            )


def test_what_a_facet_or_component_belongs_to_is_said(tmp_path, problem):
    facets = problem.mesh.boundary_facets
    loads = (Pressure(facets[:2], 1.0), BodyForce((0.0, 0.0, 1.0)), Pressure(facets[:1], 2.0))
    supports = (*problem.supports, Support(np.array([7], np.int32), components=(False, True, True)))
    described = dataclasses.replace(problem, loads=loads, supports=supports)
    write_case_folder(tmp_path, described, Strain.GREEN, name="case")
    with np.load(tmp_path / "rest.npz") as stored:
        assert stored["pressure_load"].tolist() == [0, 0, 2]
        assert (stored["support"] >= 0).tolist() == (stored["fixed"] == 1).tolist()
        assert set(stored["support"][problem.supports[0].points].ravel()) <= {0, 1}
