"""[[mass]] of a case: units, weight, what is refused, and everything that carries it on."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce, Traction
from palpate.meshes.problem import Problem, Strain
from palpate.validation.case import Case, CaseError, load_case
from palpate.validation.case.schema_keys import editor_schema
from palpate.validation.case.writing import annotated_case
from palpate.validation.diagnosis import Cause, diagnose
from palpate.validation.exchange.case_folder import write_case_folder
from palpate.validation.exchange.nodal_arrays import facet_areas, lumped_mass, rest_arrays
from palpate.validation.metrics.own_mesh import problem_on
from palpate.validation.peers import adapters
from palpate.validation.references.true_bodies import on_moved, true_body
from palpate.validation.report.preview import describe_case
from palpate.validation.solving import simulate

HEAD = """
schema = 1
title = "A bar with a mass"
units = { length = "mm", mass = "g" }
material = { youngs_modulus = 30e3, poissons_ratio = 0.4, density = 1000.0 }
"""
BOX = """
[geometry]
shape = "box"
size = [60.0, 20.0, 20.0]
edge_length = 10.0
[[support]]
region = { half_space = { point = [0.1, 0.0, 0.0], normal = [-1.0, 0.0, 0.0] } }
"""
GRAVITY = """
[[load]]
kind = "gravity"
acceleration = [0.0, 0.0, -9.81]
"""
END = "{ half_space = { point = [59.9, 0.0, 0.0], normal = [1.0, 0.0, 0.0] } }"
MASS = f"""
[[mass]]
name = "weight"
mass = 10.0
region = {END}
"""
TIME = """
[time]
end_time = 0.02
time_step = 2e-4
num_outputs = 4
"""


def case_of(folder: Path, text: str) -> Case:
    path = folder / "hung.toml"
    path.write_text(HEAD + text, "utf-8")
    return load_case(path)


def test_it_is_in_its_unit_and_gravity_pulls_it(tmp_path: Path) -> None:
    problem = case_of(tmp_path, BOX + GRAVITY + MASS).problem
    (mass,) = problem.masses
    assert (mass.name, mass.mass) == ("weight", pytest.approx(0.010, rel=1e-15))
    assert [type(load) for load in problem.loads] == [BodyForce, Traction]
    arrays = rest_arrays(problem)
    # 24 cm3 of 1 g/cm3, and 10 g.
    assert arrays["lumped_mass"].sum() == pytest.approx(0.034, rel=1e-12)
    weight = np.outer(arrays["lumped_mass"], [0.0, 0.0, -9.81])
    assert arrays["external_force"] == pytest.approx(weight, abs=1e-15)


def test_weights_stand_after_the_loads_that_the_case_numbers(tmp_path: Path) -> None:
    """Two gravities, one of them over time, and a pressure between; two masses."""
    pressed = f'[[load]]\nkind = "pressure"\npressure = 1.0\nregion = {END}\n'
    text = GRAVITY.replace("[[load]]", pressed + "[[load]]")
    more = GRAVITY + "amplitude = { times = [0.0, 1.0], factors = [0.0, 1.0] }\n"
    problem = case_of(tmp_path, BOX + text + more + MASS + MASS.replace("weight", "ring")).problem
    kinds = [type(load).__name__ for load in problem.loads]
    assert kinds == ["Pressure", "BodyForce", "BodyForce", *["Traction"] * 4]
    amplitudes = [load.amplitude is not None for load in problem.loads]
    assert amplitudes == [False, False, True, False, False, True, True]


def test_without_gravity_it_is_inert_and_weighs_nothing(tmp_path: Path) -> None:
    problem = case_of(tmp_path, BOX + MASS + TIME).problem
    assert problem.loads == ()
    assert lumped_mass(problem).sum() == pytest.approx(0.034, rel=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("mass = 10.0", "mass = -1.0", r"mass.1.mass = -1.0: .*greater than or equal to 0"),
        ("mass = 10.0", "mass = inf", r"mass.1.mass = inf"),
        ("mass = 10.0", "mass = 1e200", r"mass 1: 1e\+197 kg is too large to compute with"),
        ("mass = 10.0\n", "", r"missing key 'mass.1.mass'; add it"),
        ("mass = 10.0", "mas = 10.0", r"unknown key 'mass.1.mas'; did you mean 'mass'\?"),
        ('"weight"', '"a weight"', r"mass.1.name = 'a weight'"),
        (END, "{ nearest = [60.0, 0.0, 0.0] }", "mass 1: `nearest` selects a point, not facets"),
        (END, '{ group = "end" }', "mass 1: no facet group 'end' in the mesh"),
        (END, "{ ball = { center = [0, 0, 90], radius = 1 } }", "mass 1: the region selects no"),
        ('"weight"', f'"weight"\nmass = 1.0\nregion = {END}\n[[mass]]\nname = "weight"',
         "two masses are named 'weight'; give each its own name"),
    ],
)  # fmt: skip
def test_what_is_refused(old: str, new: str, says: str, tmp_path: Path) -> None:
    assert old in MASS
    with pytest.raises((CaseError, ValueError), match=says):
        _ = case_of(tmp_path, BOX + GRAVITY + MASS.replace(old, new)).problem


def test_a_unit_of_mass_that_is_not_known_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "hung.toml"
    path.write_text(HEAD.replace('"g"', '"lb"') + BOX + GRAVITY + MASS, "utf-8")
    with pytest.raises(CaseError, match=r"units.mass = 'lb': use kg, g"):
        load_case(path)


def test_it_is_described_with_its_weight(tmp_path: Path) -> None:
    lines = describe_case(case_of(tmp_path, BOX + GRAVITY + MASS)).lines
    assert any(line.startswith("weight     force on a surface [0, 0, -0.0981] N") for line in lines)
    assert any(line.startswith("mass 1     weight 10 g over 8 facets, 400 mm2") for line in lines)
    about = describe_case(case_of(tmp_path, BOX + MASS))
    assert any("[[mass]] does nothing in statics without gravity" in w for w in about.warnings)


def test_schema_and_first_case_show_it() -> None:
    assert "mass" in editor_schema()["properties"]
    shown = annotated_case({"schema": 1}, {})
    assert "#[[mass]]" in shown
    assert '#mass = "kg"' in shown


def test_its_size_can_be_fitted_and_varied(tmp_path: Path) -> None:
    case = case_of(tmp_path, BOX + GRAVITY + MASS + '[evidence]\nfitted = ["mass[0].mass"]\n')
    assert case.spec.evidence.fitted == ("mass[0].mass",)


def test_a_folder_for_other_simulators_has_it(tmp_path: Path) -> None:
    problem = case_of(tmp_path, BOX + GRAVITY + MASS + TIME).problem
    write_case_folder(tmp_path / "out", problem, Strain.GREEN, name="hung")
    given = json.loads((tmp_path / "out" / "case.json").read_text("utf-8"))
    (mass,) = given["masses"]
    assert (mass["mass"], mass["name"]) == (pytest.approx(0.01), "weight")
    assert len(mass["facets"]) == len(problem.masses[0].facets)
    assert {f"masses[].{key}" for key in mass} <= set(given["keys"])


@pytest.mark.parametrize(("takes", "refused"), [((), True), (("masses in motion",), False)])
def test_an_adapter_that_has_no_masses_refuses_it_in_motion(
    takes: tuple[str, ...], refused: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(Path(adapters.__file__).parent))
    import harness

    def refuse(why: str) -> None:
        raise SystemExit(why)

    class Motion:
        tool, version = "still", "1"

        def __init__(self, job: dict) -> None:
            self.result = {"displacement": np.zeros((5, *job["points"].shape))}

        def advance(self, _count: int) -> dict:
            return {}

    Motion.takes = takes
    problem = case_of(tmp_path, BOX + GRAVITY + MASS + TIME).problem
    write_case_folder(tmp_path / "out", problem, Strain.GREEN, name="hung")
    monkeypatch.setattr(harness, "refuse", refuse)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["tool", str(tmp_path / "out"), str(tmp_path / "r.npz")])
    if refused:
        with pytest.raises(SystemExit, match="masses in motion: not handed to this simulator"):
            harness.solve_case(None, Motion)
    else:
        harness.solve_case(None, Motion)
        assert (tmp_path / "r.npz").is_file()


def test_another_mesh_of_the_body_has_none(tmp_path: Path) -> None:
    """Facets of the case's mesh are none of the other: it is measured by its materials alone."""
    problem = case_of(tmp_path, BOX + GRAVITY + MASS + TIME).problem
    path = tmp_path / "fine.toml"
    path.write_text(HEAD + BOX.replace("10.0\n[[", "8.0\n[["), "utf-8")
    other = problem_on(load_case(path).problem.mesh, problem)
    assert other.masses == ()


def test_on_a_true_surface_it_keeps_its_mass_and_its_weight(tmp_path: Path) -> None:
    upright = "{ half_space = { point = [0.0, 0.0, 39.9], normal = [0.0, 0.0, 1.0] } }"
    column = """
    [geometry]
    shape = "cylinder"
    radius = 10.0
    height = 40.0
    edge_length = 8.0
    [[support]]
    region = { half_space = { point = [0.0, 0.0, 0.1], normal = [0.0, 0.0, -1.0] } }
    """
    case = case_of(tmp_path, column + GRAVITY + MASS.replace(END, upright))
    body = true_body(case)
    assert body is not None
    moved = on_moved(case.spec.load, case.spec.units, body.base, body.others[0])
    mass, weight = moved.masses[0], moved.loads[1]
    assert isinstance(weight, Traction)
    areas = facet_areas(moved.mesh.points, weight.facets)
    before = facet_areas(body.base.mesh.points, weight.facets)
    assert areas.sum() > 1.001 * before.sum()
    assert areas.sum() * np.array(weight.traction) == pytest.approx([0.0, 0.0, -0.0981])
    assert mass.density(moved.mesh.points) * areas.sum() == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda p: dataclasses.replace(p, masses=()), "masses on the surface left out"),
        (
            lambda p: dataclasses.replace(
                p, masses=(dataclasses.replace(p.masses[0], mass=0.013),)
            ),
            "masses on the surface 1.3 times what was asked",
        ),
        (
            lambda p: dataclasses.replace(
                p, material=dataclasses.replace(p.material, density=2000.0)
            ),
            "density counted twice",
        ),
    ],
)
def test_a_motion_with_other_masses_is_explained(change, name: str, tmp_path: Path) -> None:
    asked: Problem = case_of(tmp_path, BOX + GRAVITY + MASS + TIME).problem
    cause = diagnose(asked, simulate(change(asked)), None).first
    assert cause is not None
    assert (cause.name, cause.cause) == (name, Cause.MASS)
