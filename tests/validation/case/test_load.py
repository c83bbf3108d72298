"""Case files: what they build, how each mistake is named, and what built-in ones say."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.kidney import KIDNEY_VOLUME
from palpate.meshes.problem import Material, TimeSpan
from palpate.meshes.rigid_tool import CapsuleShape, SphereShape
from palpate.validation.case import builtin_cases, load_case
from palpate.validation.references.stored import problem_key

Write = Callable[..., Path]


def test_the_block_is_built_in_si_units(write_case: Write) -> None:
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


def test_every_kind_of_load(write_case: Write) -> None:
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

[[check]]
metric = "smallest"""
    path = write_case(('[[check]]\nmetric = "smallest', others.lstrip("\n")))
    loads = load_case(path).problem.loads
    assert isinstance(loads[1], BodyForce)
    assert loads[1].force_density == pytest.approx((0.0, 0.0, -9810.0))
    assert isinstance(loads[2], Pressure)
    corners = load_case(path).problem.mesh.points[loads[2].facets]
    assert (corners[:, :, 2] == 1.0).all()


MOVING = """
[time]
end_time = 0.5
stiffness_damping = 0.01
time_step = 1e-4
mass_damping = 2.0
num_outputs = 5

[[inclusion]]
region = { box = { min = [-1, -1, -1], max = [1000, 9000, 9000] } }
material = { youngs_modulus = 5.0, poissons_ratio = 0.4, density = 1200.0 }

[[tool]]
shape = "capsule"
radius = 100.0
half_length = 250.0
friction_coefficient = 0.1
region = { half_space = { point = [0.0, 0.0, 999.0], normal = [0.0, 0.0, 1.0] } }

[[tool.pose]]
time = 0.0
position = [1000.0, 500.0, 1101.0]
rotation = { axis = [0.0, 2.0, 0.0], angle_deg = 90.0 }

[[tool.pose]]
time = 0.5
position = [1000.0, 500.0, 1001.0]
rotation = { axis = [0.0, 2.0, 0.0], angle_deg = 90.0 }

[[check]]
metric = "smallest"""


SAME_STEPS = """
[[check]]
metric = "trajectory_l2"
limit = 1e-9
reason = "the same steps"

"""
TRUTH = """[[check]]
metric = "{}"
against = "truth"
limit = 0.1
reason = "no step stated"

[[tool]]"""


def moving_case(write_case: Write, *changes: tuple[str, str]) -> Path:
    tables = MOVING
    for old, new in changes:
        assert old in tables, old
        tables = tables.replace(old, new)
    return write_case(
        ("\n[geometry]", '\n[units]\nlength = "mm"\nstress = "kPa"\n\n[geometry]'),
        ("[2.0, 1.0, 1.0]", "[2000.0, 1000.0, 1000.0]"),
        ("edge_length = 0.5", "edge_length = 500.0"),
        ("[1.999, 0.0, 0.0]", "[1999.0, 0.0, 0.0]"),
        (
            "force = [60",
            "amplitude = { times = [0, 1], factors = [0, 2], smooth = true }\nforce = [60",
        ),
        ('[[check]]\nmetric = "smallest', tables.lstrip("\n")),
    )


def test_time_amplitudes_tools_and_inclusions(write_case: Write) -> None:
    problem = load_case(moving_case(write_case)).problem
    assert problem.time == TimeSpan(0.5, 1e-4, 2.0, 5, stiffness_damping=0.01)
    assert problem.loads[0].amplitude == TabularAmplitude((0.0, 1.0), (0.0, 2.0), is_smooth=True)
    (tool,) = problem.tools
    assert tool.shape == CapsuleShape(0.1, 0.25)
    assert tool.friction_coefficient == 0.1
    assert len(tool.contact_facets) == 16
    position, rotation = tool.path.pose_at(0.25)
    assert position == pytest.approx([1.0, 0.5, 1.051])
    assert rotation @ [0.0, 0.0, 1.0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-15)
    (inclusion,) = problem.inclusions
    assert inclusion.material == Material(5e3, 0.4, 1200.0)
    centres = problem.mesh.points[problem.mesh.cells].mean(axis=1)
    assert np.array_equal(inclusion.cells, np.flatnonzero(centres[:, 0] <= 1.0))


def test_a_single_tool_needs_no_list_and_may_be_driven_by_a_force(write_case: Write) -> None:
    driven = """[tool]
shape = "sphere"
radius = 100.0
pose = [{ time = 0.0, position = [0.0, 0.0, 1101.0] }]
drive = { direction = [0.0, 0.0, -1.0], force = 3.0, mass = 0.02 }
"""
    start, end = MOVING.index("[[tool]]"), MOVING.index("[[check]]")
    (tool,) = load_case(moving_case(write_case, (MOVING[start:end], driven))).problem.tools
    assert tool.shape == SphereShape(0.1)
    assert tool.drive is not None
    assert (tool.drive.force, tool.drive.mass, tool.drive.amplitude(7.0)) == (3.0, 0.02, 1.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("radius = 100.0", "radius = 0.0"), ["tool.1.radius", "greater than 0"]),
        (("radius = 100.0", "radios = 100.0"), ["radios", "'radius'"]),
        (("half_length = 250.0", ""), ["needs half_length"]),
        (("half_length", "half_widths = [1, 1, 1]\nhalf_length"), ["takes no half_widths"]),
        (("time = 0.5\npos", "time = -0.5\npos"), ["backwards at knot 1"]),
        (("position = [1000.0, 500.0, 1101.0]", "position = [nan, 0, 0]"), ["finite"]),
        (("[0.0, 2.0, 0.0]", "[0.0, 0.0, 0.0]"), ["axis"]),
        (
            ("time_step = 1e-4\nmass_damping = 2.0\nnum_outputs = 5\n", SAME_STEPS),
            ["step by step", "give time_step", 'against = "truth"'],
        ),
        (("[[tool]]", TRUTH.format("volume")), ["trajectory_l2", "volume", "same_mesh"]),
        (("[[tool]]", TRUTH.format("published_oscillation")), ["needs at, component, quantity"]),
        (("end_time = 0.5", "end_time = 0.0"), ["end_time", "greater than 0"]),
        (("stiffness_damping = 0", "stiffness_damping = -0"), ["stiffness_damping", "equal"]),
        (("max = [1000, 9", "max = [-1, 9"), ["inclusion 1", "selects no cell"]),
        (
            ("region = { box", "region = { group = 'a', box"),
            ["inclusion 1", "no group of cells 'a'"],
        ),
    ],
)
def test_mistakes_in_what_moves_are_named(
    write_case: Write, change: tuple[str, str], words: list[str]
) -> None:
    with pytest.raises(InputError) as caught:
        load_case(moving_case(write_case, change)).problem  # noqa: B018
    for word in words:
        assert word in str(caught.value), str(caught.value)


def test_built_in_cases_are_whole() -> None:
    assert {"beam", "block", "block-motion", "kidney"} <= set(builtin_cases())
    for name in builtin_cases():
        case = load_case(name)
        problem = case.problem
        # The cases must see their faults: away from 0.25, and not symmetric.
        assert abs(problem.material.poissons_ratio - 0.25) > 0.02
        kinds = {(check.against, check.metric) for check in case.checks}
        # Ninety cells are for slips: no user needs their distance from the truth.
        wanted = {"same_mesh"} if problem.tools or name == "block" else {"truth"}
        # Where no step is stated, no explicit reference can take the same ones.
        if not problem.tools and not (problem.time and problem.time.time_step is None):
            wanted.add("same_mesh")
        assert wanted <= {against for against, _ in kinds}
        assert all(check.reason for check in case.checks)


def test_the_kidney_has_the_papers_volume() -> None:
    assert load_case("kidney").problem.mesh.volume == pytest.approx(KIDNEY_VOLUME, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("title =", "titel ="), ["unknown key 'titel'", "'title'"]),
        (("poissons_ratio = 0.3", "poisons_ratio = 0.3"), ["block.toml:12", "'poissons_ratio'"]),
        (("poissons_ratio = 0.3", ""), ["missing key 'material.poissons_ratio'"]),
        (("poissons_ratio = 0.3", "poissons_ratio = 0.5"), ["poissons_ratio = 0.5"]),
        (("1000.0", "-3.0"), ["youngs_modulus = -3"]),
        (("1000.0", "nan"), ["youngs_modulus", "finite"]),
        (("0.3\n", "0.3\ndensity = -1.0\n"), ["density = -1"]),
        (("[1.999, 0.0, 0.0]", "[7.0, 0.0, 0.0]"), ["load 1", "selects no", "[2.0, 1.0, 1.0]"]),
        (('kind = "force"', 'kind = "froce"'), ["froce"]),
        (("edge_length = 0.5", ""), ["edge_length"]),
        (('shape = "box"', 'shape = "bxo"'), ["shape", "bxo"]),
        (('shape = "box"', 'surface = "../x.stl"\nshape = "box"'), ["exactly one"]),
        (("limit = 1e-8", "limit = -1.0"), ["limit"]),
        (('reason = "same equations"', 'reason = ""'), ["reason"]),
        (("schema = 1", "schema = 2"), ["schema"]),
        (("schema = 1", "schema = [1"), ["not TOML"]),
        (("region = { half_space", "region = { halfspace"), ["halfspace", "half_space"]),
    ],
)
def test_mistakes_are_named_in_at_most_two_lines(
    write_case: Write, change: tuple[str, str], words: list[str]
) -> None:
    path = write_case(change)
    with pytest.raises(InputError) as caught:
        load_case(path).problem  # noqa: B018
    message = str(caught.value)
    assert message.count("\n") <= 1
    for word in words:
        assert word in message, message


def test_a_floating_body_is_refused(write_case: Write) -> None:
    text = "region = { half_space = { point = [0.001, 0.0, 0.0], normal = [-1.0, 0.0, 0.0] } }"
    with pytest.raises(InputError, match="6 of 6 rigid motions"):
        load_case(write_case(("[[support]]\n" + text + "\n", ""))).problem  # noqa: B018
    with pytest.raises(InputError, match="3 of 6 rigid motions"):
        load_case(write_case((text, text + '\ncomponents = ["x"]'))).problem  # noqa: B018


def test_names_are_plain(write_case: Write) -> None:
    with pytest.raises(InputError, match="letters"):
        load_case(write_case(name="<script>.toml"))
    with pytest.raises(InputError, match="did you mean 'kidney'"):
        load_case("kidny")
    with pytest.raises(InputError, match="no such file"):
        load_case("nothing.toml")


def test_fitted_values_are_named_and_there(write_case: Write) -> None:
    def fitted(names: str) -> Path:
        return write_case(("\n[geometry]", f"\n[evidence]\nfitted = {names}\n\n[geometry]"))

    path = fitted('["material.youngs_modulus", "load[0].force", "geometry.size"]')
    assert load_case(path).spec.evidence.fitted[1] == "load[0].force"
    plain = load_case(write_case(name="plain.toml")).problem
    # What is said of a problem does not change it.
    assert problem_key(load_case(path).problem) == problem_key(plain)
    for name, hint in (
        ("load[1].force", "did you mean 'load[0].force'"),
        ("load[0].forse", "did you mean 'load[0].force'"),
        ("material.density", "the case gives no number"),  # a default is nobody's fit
        ("check[0].limit", "the case gives no number"),
        ("title", "the case gives no number"),
        ("load[0].region", "the case gives no number"),
    ):
        with pytest.raises(InputError, match=r"evidence\.fitted") as caught:
            load_case(fitted(f'["material.youngs_modulus", "{name}"]'))
        assert hint in str(caught.value)
        assert name in str(caught.value)


CLOSED_FORM = "Verification alone, against a closed form"
# In a bar of length 1 under 1e-3 per mass: E = 1, nu = 0.3, density 1.
SPEED_SQUARED = 0.7 / (1.3 * 0.4)


@pytest.mark.parametrize("name", builtin_cases())
def test_a_reason_says_what_is_needed_not_what_was_measured(name: str) -> None:
    for check in load_case(name).checks:
        assert not re.search(r"[0-9%] measured|slack", check.reason), check.reason


@pytest.mark.parametrize("name", builtin_cases())
def test_a_built_in_case_says_what_it_is_for(name: str) -> None:
    spec = load_case(name).spec
    said = spec.evidence
    assert said.question.endswith("?")
    assert said.context_of_use.endswith(".")
    assert said.model_influence
    assert said.decision_consequence
    is_verification = said.context_of_use.startswith("Verification alone")
    # What is for a use says what is read from it, and how near it is to that use.
    assert is_verification != bool(said.quantities_of_interest and said.applicability)
    if is_verification:
        assert said.context_of_use.endswith("nothing about tissue or a device is decided by it.")
    if said.context_of_use.startswith(CLOSED_FORM):
        assert any(check.about.is_published for check in spec.check)


def swing_along(stiffness: float, damping: float) -> Points:
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


@pytest.mark.parametrize(("name", "damping", "told"), [("wave", 0.0, 0.08), ("decay", 0.2, 0.024)])
def test_one_per_cent_of_stiffness_is_seen_in_a_motion(
    name: str, damping: float, told: float
) -> None:
    right, wrong = swing_along(1.0, damping), swing_along(1.01, damping)
    off = np.linalg.norm(wrong - right, axis=1).max() / np.linalg.norm(right, axis=1).max()
    assert off == pytest.approx(told, rel=0.03)
    (check,) = (
        c for c in load_case(name).checks if (c.metric, c.against) == ("trajectory_l2", "truth")
    )
    assert f"{100.0 * told:.2g} %" in check.reason
    assert check.limit <= 0.5 * told


def test_what_tells_the_strain_measures_apart_in_table_one() -> None:
    published = load_case("kidney").spec.published
    reasons = {c.metric: c.reason for c in load_case("kidney").checks if c.against == "truth"}
    for what, metric in (("volume", "volume"), ("area", "surface_area")):
        original, linear, green = (
            published[f"{state}_{what}"] for state in ("original", "linear", "green")
        )
        apart = (linear - green) / (green - original)
        assert f"{100.0 * apart:.0f} %" in reasons[metric]
