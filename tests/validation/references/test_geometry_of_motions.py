"""What a polyhedron leaves out of a curved body that swings, or that a tool presses."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from bank import made_state

from palpate.meshes.errors import InputError
from palpate.meshes.files import write_mesh
from palpate.meshes.problem import Strain
from palpate.reference.errors import ReferenceStepError
from palpate.validation.case import load_case
from palpate.validation.judging.checks import CaseJudge
from palpate.validation.references import geometry
from palpate.validation.references.bars import GEOMETRY, PARTS
from palpate.validation.references.geometry import geometry_notes, shape_of, with_geometry
from palpate.validation.references.motions import solve_motion_set
from palpate.validation.references.reference_set import QUADRATIC, ReferenceSet
from palpate.validation.states import Trajectory

CASE = """
schema = 1
title = "A curved body"
strain = "linear"

[geometry]
{geometry}

[material]
youngs_modulus = 1000.0
poissons_ratio = 0.3
density = 1.0
{acting}
[[check]]
metric = "{metric}"
against = "truth"
limit = 0.05
reason = "what a hand feels"
"""
HEIGHT = 8.0
CYLINDER = f'shape = "cylinder"\nradius = 1.0\nheight = {HEIGHT}\nedge_length = 1.1'
HELD = """
[[support]]
region = { half_space = { point = [0.0, 0.0, 1e-3], normal = [0.0, 0.0, -1.0] } }
"""
PUSHED = f"""
[[load]]
kind = "force"
region = {{ half_space = {{ point = [0.0, 0.0, {HEIGHT - 1e-3}], normal = [0.0, 0.0, 1.0] }} }}
force = [1.0, 0.0, 0.0]
"""
# Of Euler and Bernoulli's cantilever, E I / (rho A) = E R^2 / (4 rho).
SWING = 1.8751041**2 / (2.0 * math.pi) * math.sqrt(250.0 / HEIGHT**4)
TIME = f"""
[time]
end_time = {1.8 / SWING}
num_outputs = 16
"""
OCTANT = 'shape = "hollow_octant"\nradius = 1.0\ninner_radius = 0.3\nedge_length = 0.5'
SLIDING = "".join(
    f"""
[[support]]
sliding = true
region = {{ half_space = {{ point = [{p}], normal = [{n}] }} }}
"""
    for p, n in (
        ("1e-6, 0.0, 0.0", "-1.0, 0.0, 0.0"),
        ("0.0, 1e-6, 0.0", "0.0, -1.0, 0.0"),
        ("0.0, 0.0, 1e-6", "0.0, 0.0, -1.0"),
    )
)
DEPTH = 0.1
TURNED = "rotation = { axis = [1.0, 0.0, 0.0], angle_deg = 180.0 }"
PLANE = f"""
[tool]
shape = "plane"
pose = [
    {{ time = 0.0, position = [0.0, 0.0, 1.01], {TURNED} }},
    {{ time = 1.0, position = [0.0, 0.0, {1.0 - DEPTH}], {TURNED} }},
]
"""


@pytest.fixture
def case_of(tmp_path):
    def write(geometry, acting, metric):
        path = tmp_path / "curved.toml"
        path.write_text(CASE.format(geometry=geometry, acting=acting, metric=metric))
        return load_case(path)

    return write


@pytest.fixture
def swinging(case_of):
    return case_of(CYLINDER, HELD + PUSHED + TIME, "trajectory_l2")


def references_of(truth, metrics):
    bars = {(metric, Strain.LINEAR): 0.01 for metric in metrics}
    return ReferenceSet({(QUADRATIC, Strain.LINEAR): truth}, bars, "here")


def geometry_of(case, metrics, truth=None, **words):
    truth = truth or stretched(case.problem)
    references = references_of(truth, metrics)
    found = with_geometry(case, references, lambda _line: None, strains=[Strain.LINEAR], **words)
    return found, {m: found.bar_parts(m, Strain.LINEAR).geometry for m in metrics}


def stretched(problem):
    points = problem.mesh.points
    return made_state(problem.mesh, 0.01 * points, strain=Strain.LINEAR, degree=2)


def swing_as_one(problem):
    times = np.linspace(0.0, problem.time.end_time, problem.time.num_outputs + 1)
    moved = np.sin(2.0 * np.pi * SWING * times)[:, None, None] * problem.mesh.points
    return dataclasses.replace(stretched(problem), trajectory=Trajectory(times, moved))


@pytest.mark.dolfinx
@pytest.mark.once
def test_a_coarse_cylinder_swings_tens_of_per_cent_too_far_and_too_slowly(swinging, monkeypatch):
    """A true one as fast as Timoshenko's beam: 1 / f^2 = 1 / f_bending^2 + 1 / f_shear^2.

    (Dunkerley's rule, some 1 % here; f_shear = sqrt(k G / rho) / (4 L), k as Cowper's.) The
    polyhedron swings at 0.1249 Hz (quadratic, cells cut in eight).
    """
    monkeypatch.setattr(geometry, "_LARGEST_QUADRATIC_MOVING", 0)
    metrics = ("trajectory_l2", "oscillation_amplitude", "oscillation_frequency")
    truth = swing_as_one(swinging.problem)
    found, parts = geometry_of(swinging, metrics, truth)
    assert found.provenance[GEOMETRY]["degree"] == 1
    shear = math.sqrt(0.886 * 1000.0 / 2.6) / (4.0 * HEIGHT)
    true = (SWING**-2 + shear**-2) ** -0.5
    slower = true / 0.1249 - 1.0
    assert slower == pytest.approx(0.076, abs=0.001)
    # Linear tetrahedra leave a tenth, and more, of the part; 1.25 is for safety, and covers it.
    assert slower < parts["oscillation_frequency"] < 1.25 * slower
    # As far as in statics, a quarter; and out of step.
    assert parts["oscillation_amplitude"] == pytest.approx(1.25 * 0.256, rel=0.05)
    assert parts["trajectory_l2"] > 0.4
    # Beside the bar of a check, and named.
    shown = CaseJudge(swinging, found).check(swinging.checks[0], truth)
    assert shown.bar_parts["geometry"] == parts["trajectory_l2"]
    assert shown.reference_error == pytest.approx(0.01)
    assert "a polyhedron of a cylinder: its geometry adds up to" in shown.message


@pytest.mark.dolfinx
@pytest.mark.long
def test_a_coarse_ball_feels_a_plane_a_quarter_too_late(case_of):
    """An eighth of a ball on its symmetry planes; the plane's place is given in space.

    The polyhedron takes 9.4 N, the ball 12.66 N (edges of 0.15, 4 161 quadratic cells), Hertz's
    E* sqrt(R) d^1.5 / 3 = 11.6 N for a shallow dent in a half space.
    """
    case = case_of(OCTANT, SLIDING + PLANE, "tool_force")
    found, parts = geometry_of(case, ("tool_force", "displacement_max"))
    hertz = 1000.0 / 0.91 * DEPTH**1.5 / 3.0
    assert hertz == pytest.approx(12.66, rel=0.1)
    true = 12.66 / 9.4 - 1.0
    assert true < parts["tool_force"] < 1.4 * true
    assert parts["displacement_max"] > 0.1
    (note,) = geometry_notes(case, found)
    assert note.startswith("Tools keep their paths in space")


def without_parts(case, monkeypatch, error):
    def fail(*_args, **_words):
        raise error

    monkeypatch.setattr(geometry, "solve_implicit", fail)
    found, parts = geometry_of(case, ("trajectory_l2", "oscillation_phase"))
    assert set(parts.values()) == {math.inf}
    assert found.bar_parts("trajectory_l2", Strain.LINEAR).whole == pytest.approx(0.01)
    return geometry_notes(case, found)[0]


def test_a_tool_that_starts_in_the_true_body_is_reported_with_the_way_out(swinging, monkeypatch):
    deep = InputError("tool 1 is 0.002 m deep in the body at the start; begin its path outside")
    note = without_parts(swinging, monkeypatch, deep)
    assert note == (
        "What a cylinder adds (linear strain) is not known: there tool 1 is 0.002 m deep in the "
        "body at the start; begin its path outside."
    )


def test_a_motion_without_a_result_is_reported(swinging, monkeypatch):
    lost = ReferenceStepError(0.1, 0.01, "a cell would invert", swinging.problem.mesh.points)
    assert "a cell would invert" in without_parts(swinging, monkeypatch, lost)


def test_what_a_motion_is_solved_with_is_kept_and_reported(swinging, monkeypatch):
    asked = []

    def still(problem, _strain, steps, _progress, *, degree, at, time_limit):
        assert at is swinging.problem.mesh
        asked.append((problem.mesh.num_cells, steps, degree, time_limit))
        return swing_as_one(swinging.problem)

    monkeypatch.setattr(geometry, "solve_implicit", still)
    monkeypatch.setattr(geometry, "_LARGEST_QUADRATIC_MOVING", 10)
    found, parts = geometry_of(swinging, ("trajectory_l2",), seconds=50.0)
    cells = 8 * swinging.problem.mesh.num_cells
    assert [row[:3] for row in asked] == 2 * [(cells, 2, 1)]
    assert all(0.0 < row[3] <= 50.0 for row in asked)
    assert found.provenance[GEOMETRY] == {
        "of": "a cylinder",
        "cells": cells,
        "degree": 1,
        "steps_per_output": 2,
    }
    assert parts["trajectory_l2"] == 0.0
    assert "two runs of linear tetrahedra with 2 steps" in geometry_notes(swinging, found)[0]


def test_a_distance_is_for_motions_and_under_tools_too(case_of, tmp_path):
    mesh = case_of(OCTANT, SLIDING + PLANE, "tool_force").problem.mesh
    write_mesh(tmp_path / "octant.vtu", mesh)
    case = case_of(
        'mesh = "octant.vtu"', f"[truth]\ngeometry_distance = 0.005\n{SLIDING}{PLANE}", "tool_force"
    )
    body = geometry.true_body(case)
    assert len(body.others) == 2
    assert body.factor == 1.0


def test_a_stored_part_goes_with_the_stored_truth_of_a_motion(swinging):
    truth = swing_as_one(swinging.problem)
    kept = {
        PARTS: {"trajectory_l2|linear": {"discretisation": 0.01, "geometry": 0.3}},
        GEOMETRY: {"of": "a cylinder"},
    }
    stored = dataclasses.replace(references_of(truth, ["trajectory_l2"]), provenance=kept)
    found = solve_motion_set(
        swinging.problem, lambda _line: None, wanted=("truth",), stored=stored, strains=[]
    )
    assert found.bar_parts("trajectory_l2", Strain.LINEAR).geometry == 0.3
    assert shape_of(found) == "a cylinder"
