"""Case files: what they build, how each mistake is named, and what built-in ones say."""

import math
import os
import re
from typing import get_args

import numpy as np
import pytest
from case_texts import BOX, CHECK, MOVING, moving
from pydantic import BaseModel

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.kidney import KIDNEY_VOLUME
from palpate.meshes.problem import Material, TimeSpan
from palpate.meshes.rigid_tool import CapsuleShape, SphereShape
from palpate.validation.case import CaseError, builtin_cases, load_case
from palpate.validation.case.body_schema import Count, Flag, Number
from palpate.validation.case.schema import CaseSpec
from palpate.validation.case.units import Units
from palpate.validation.references.stored import problem_key


def test_the_block_is_built_in_si_units(write_case):
    units = '\n[units]\nlength = "mm"\nforce = "mN"\nstress = "kPa"\ndensity = "g/cm3"\n'
    units += "\n[geometry]"
    path = write_case(("\n[geometry]", units), ("0.3\n", "0.3\ndensity = 1.05\n"))
    problem = load_case(path).problem
    assert problem.mesh.volume == pytest.approx(2e-9, rel=1e-12)
    assert problem.material.youngs_modulus == 1e6
    assert problem.material.density == pytest.approx(1050.0)
    load = problem.loads[0]
    assert isinstance(load, Traction)
    # 60 mN over 1 mm2.
    assert load.traction == pytest.approx((6e4, 2e4, -1e4), rel=1e-12)
    assert len(problem.supports[0].facets) == 8


def test_every_kind_of_load(write_case):
    others = """
[[load]]
kind = "gravity"
acceleration = [0.0, 0.0, -9.81]

[[load]]
kind = "pressure"
pressure = 5.0
region = { box = { min = [-1, -1, 0.999], max = [9, 9, 1.1] } }

[[load]]
kind = "point_force"
force = [1.0, 2.0, 3.0]
region = { nearest = [2.0, 1.0, 1.0] }
"""
    problem = load_case(write_case((CHECK, others + CHECK))).problem
    loads = problem.loads
    assert isinstance(loads[1], BodyForce)
    assert loads[1].force_density == pytest.approx((0.0, 0.0, -9810.0))
    assert isinstance(loads[2], Pressure)
    corners = problem.mesh.points[loads[2].facets]
    assert (corners[:, :, 2] == 1.0).all()


def test_time_amplitudes_tools_and_inclusions(write_case):
    problem = load_case(write_case(*moving())).problem
    assert problem.time == TimeSpan(0.5, 1e-4, 2.0, 5, stiffness_damping=0.01)
    assert problem.loads[0].amplitude == TabularAmplitude((0.0, 1.0), (0.0, 2.0), is_smooth=True)
    (tool,) = problem.tools
    assert tool.shape == CapsuleShape(0.1, 0.25)
    assert (tool.friction_coefficient, tool.contact) == (0.1, "facets")
    assert len(tool.contact_facets) == 16
    position, rotation = tool.path.pose_at(0.25)
    assert position == pytest.approx([1.0, 0.5, 1.051])
    assert rotation @ [0.0, 0.0, 1.0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-15)
    (inclusion,) = problem.inclusions
    assert inclusion.material == Material(5e3, 0.4, 1200.0)
    centres = problem.mesh.points[problem.mesh.cells].mean(axis=1)
    assert np.array_equal(inclusion.cells, np.flatnonzero(centres[:, 0] <= 1.0))


def test_a_single_tool_needs_no_list_and_may_be_driven_by_a_force(write_case):
    driven = """[tool]
shape = "sphere"
radius = 100.0
pose = [{ time = 0.0, position = [0.0, 0.0, 1101.0] }]
drive = { direction = [0.0, 0.0, -1.0], force = 3.0, mass = 0.02 }
"""
    start, end = MOVING.index("[[tool]]"), MOVING.index(CHECK)
    (tool,) = load_case(write_case(*moving((MOVING[start:end], driven)))).problem.tools
    assert tool.shape == SphereShape(0.1)
    assert (tool.drive.force, tool.drive.mass, tool.drive.amplitude(7.0)) == (3.0, 0.02, 1.0)


def test_the_kidney_has_the_papers_volume():
    assert load_case("kidney").problem.mesh.volume == pytest.approx(KIDNEY_VOLUME, rel=1e-12)


def test_names_are_plain(write_case):
    with pytest.raises(InputError, match="letters"):
        load_case(write_case(name="<script>.toml"))
    with pytest.raises(InputError, match="did you mean 'kidney'"):
        load_case("kidny")
    with pytest.raises(InputError, match="no such file"):
        load_case("nothing.toml")


def test_what_is_fitted_is_no_part_of_the_problem(write_case):
    names = '["material.youngs_modulus", "load[0].force", "geometry.size"]'
    path = write_case(("\n[geometry]", f"\n[evidence]\nfitted = {names}\n\n[geometry]"))
    assert load_case(path).spec.evidence.fitted[1] == "load[0].force"
    plain = load_case(write_case(name="plain.toml")).problem
    assert problem_key(load_case(path).problem) == problem_key(plain)


CLOSED_FORM = "Verification alone, against a closed form"
# In a bar of length 1 under 1e-3 per mass: E = 1, nu = 0.3, density 1.
SPEED_SQUARED = 0.7 / (1.3 * 0.4)


@pytest.mark.parametrize("name", builtin_cases())
def test_a_built_in_case_sees_its_faults_and_says_what_it_is_for(name):
    case = load_case(name)
    problem, evidence = case.problem, case.spec.evidence
    # Away from 0.25, where Lamé's constants are one.
    assert abs(problem.material.poissons_ratio - 0.25) > 0.02
    # Ninety cells are for wrong steps: no user needs their distance from the truth.
    wanted = {"same_mesh"} if problem.tools or name == "block" else {"truth"}
    # Where no step is stated, no explicit reference can take the same ones.
    if not problem.tools and not (problem.time and problem.time.time_step is None):
        wanted.add("same_mesh")
    assert wanted <= {check.against for check in case.checks}
    for check in case.checks:
        assert check.reason
        assert not re.search(r"[0-9%] measured|slack", check.reason), check.reason
    assert evidence.question.endswith("?")
    assert evidence.context_of_use.endswith(".")
    assert evidence.model_influence
    assert evidence.decision_consequence
    is_verification = evidence.context_of_use.startswith("Verification alone")
    # What is for a use says what is read from it, and how near it is to that use.
    assert is_verification != bool(evidence.quantities_of_interest and evidence.applicability)
    if is_verification:
        end = "nothing about tissue or a device is decided by it."
        assert evidence.context_of_use.endswith(end)
    if evidence.context_of_use.startswith(CLOSED_FORM):
        assert any(check.about.is_published for check in case.spec.check)


def swing_along(stiffness, damping):
    """Displacement of the bar of wave and decay over five periods, by its series; (times, x)."""
    x, times = np.linspace(0.0, 1.0, 21), np.linspace(0.0, 20.0 / math.sqrt(SPEED_SQUARED), 401)
    moved = np.zeros((len(times), len(x)))
    for k in range(40):
        number = 0.5 * math.pi * (2 * k + 1)
        squared = stiffness * SPEED_SQUARED * number**2
        rate = math.sqrt(squared - damping**2 / 4.0)
        fading = np.exp(-damping * times / 2.0)
        fading *= np.cos(rate * times) + damping / (2.0 * rate) * np.sin(rate * times)
        moved += np.outer(2e-3 / (number * squared) * (1.0 - fading), np.sin(number * x))
    return moved


@pytest.mark.parametrize(("name", "damping", "seen"), [("wave", 0.0, 0.08), ("decay", 0.2, 0.024)])
def test_one_per_cent_of_stiffness_is_seen_in_a_motion(name, damping, seen):
    right, wrong = swing_along(1.0, damping), swing_along(1.01, damping)
    off = np.linalg.norm(wrong - right, axis=1).max() / np.linalg.norm(right, axis=1).max()
    assert off == pytest.approx(seen, rel=0.03)
    (check,) = (
        c for c in load_case(name).checks if (c.metric, c.against) == ("trajectory_l2", "truth")
    )
    assert f"{100.0 * seen:.2g} %" in check.reason
    assert check.limit <= 0.5 * seen


def test_what_distinguishes_the_strain_measures_in_table_one():
    published = load_case("kidney").spec.published
    reasons = {c.metric: c.reason for c in load_case("kidney").checks if c.against == "truth"}
    for what, metric in (("volume", "volume"), ("area", "surface_area")):
        original, linear, green = (
            published[f"{state}_{what}"] for state in ("original", "linear", "green")
        )
        apart = (linear - green) / (green - original)
        assert f"{100.0 * apart:.0f} %" in reasons[metric]


def test_lengths_of_a_message_are_converted_and_nothing_else():
    convert = Units(length="mm").in_case_units
    message = "at (0.06, -1.5e-3, 0) m; at most 0.003 m is"
    assert convert(message) == "at (60, -1.5, 0) mm; at most 3 mm is"
    assert convert("[0.1, 0.2] m") == "[100, 200] mm"
    for same in ("2 m/s", "1e-9 m3", "3 mm", "9.8 m/s2", "4 more", 'it said "moved 0.003 m"'):
        assert convert(same) == same
    assert Units().in_case_units("0.003 m") == "0.003 m"


@pytest.mark.parametrize("name", ["loop.stl", "a\\u0000b.stl", "x" * 5000, ".", "/dev/zero"])
def test_a_path_that_cannot_be_followed_is_an_input_error(write_case, name):
    path = write_case((BOX, f'surface = "{name}"'))
    (path.parent / "loop.stl").symlink_to("loop.stl")
    with pytest.raises(InputError):
        _ = load_case(path).problem


def test_a_case_that_is_no_plain_text_is_an_input_error(tmp_path):
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    (tmp_path / "deep.toml").write_text("x = " + "[" * 1000 + "]" * 1000, encoding="utf-8")
    (tmp_path / "keys.toml").write_text(".".join(["a"] * 1000) + " = 1", encoding="utf-8")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xff")
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "folder.toml").mkdir()
    for name in ("loop", "deep", "keys", "bytes", "pipe", "folder", "missing"):
        with pytest.raises(CaseError):
            load_case(tmp_path / f"{name}.toml")


def models(annotation):
    """Every type that an annotation is made of."""
    yield annotation
    for part in get_args(annotation):
        yield from models(part)


def test_no_key_of_the_schema_takes_a_bare_number_type():
    seen = set()
    bare, waiting = [], [CaseSpec]
    while waiting:
        model = waiting.pop()
        seen.add(model)
        for name, field in model.model_fields.items():
            # Annotated[float, validator] is taken apart by pydantic where it is the whole type.
            whole = field.metadata and any(m in field.metadata for m in _checks())
            for part in models(field.annotation):
                if isinstance(part, type) and issubclass(part, BaseModel) and part not in seen:
                    waiting.append(part)
                if part in (float, int, bool) and not whole and not _is_within(field.annotation):
                    bare.append(f"{model.__name__}.{name}")
    assert len(seen) > 15
    assert bare == []


def _checks():
    return [get_args(kind)[1] for kind in (Number, Count, Flag)]


def _is_within(annotation):
    """Whether a checked number is among the parts."""
    return any(
        check in getattr(part, "__metadata__", ()) for part in models(annotation)
        for check in _checks()
    )  # fmt: skip


def test_published_keeps_text_numbers_truth_values_and_tables(write_case):
    entry = 'volume = 1.5\nwho = "me"\nis_old = true\nrows = [[1, 2.5]]\ndeep.key = 3'
    case = load_case(write_case(("[geometry]", f"[published]\n{entry}\n[geometry]")))
    assert case.spec.published == {
        "volume": 1.5, "who": "me", "is_old": True, "rows": [[1, 2.5]], "deep": {"key": 3},
    }  # fmt: skip
