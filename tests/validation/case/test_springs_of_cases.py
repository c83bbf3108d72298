"""Springs in case files: what they build, what is refused, what is told, written out and judged."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.fastsim.springs import PatchSprings
from palpate.fastsim.statics import solve_static
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Strain
from palpate.validation.case import Case, load_case
from palpate.validation.case.load import CaseError
from palpate.validation.diagnosis.diagnose import diagnose
from palpate.validation.exchange.case_folder import write_case_folder
from palpate.validation.metrics.audit import audit_on_own_mesh
from palpate.validation.metrics.body import Body, spring_force, spring_stiffness_times
from palpate.validation.metrics.difference import make_state
from palpate.validation.report.pictures import draw_case
from palpate.validation.report.preview import look_at

Write = Callable[..., Path]
LOAD = "[[load]]"
SPRING = """[[spring]]
center = [1.5, 0.5, 1.0]
radius = 0.6
stiffness = 80.0
displacement = [0.1, 0.0, 0.3]

[[load]]"""


def case_of(write_case: Write, spring: str = SPRING, units: str = "") -> Case:
    return load_case(write_case((LOAD, spring), ("\n[geometry]", units + "\n[geometry]")))


def test_what_it_builds(write_case: Write) -> None:
    (spring,) = case_of(write_case).problem.springs
    assert spring.path.end.tolist() == [0.1, 0.0, 0.3]
    assert spring.stiffness == 80.0
    path = SPRING.replace(
        "displacement = [0.1, 0.0, 0.3]",
        "smooth = true\npath = [{ time = 0.0, displacement = [0, 0, 0] }, "
        "{ time = 2.0, displacement = [0, 0, 1] }]\n"
        "amplitude = { times = [0, 1], factors = [0.5, 1] }",
    )
    (moved,) = case_of(write_case, path).problem.springs
    assert moved.path.at(1.0).tolist() == [0.0, 0.0, 0.5]
    assert moved.path.is_smooth
    assert moved.amplitude is not None
    milli = '\n[units]\nlength = "mm"\nforce = "mN"\nstress = "kPa"\n'
    (small,) = case_of(write_case, units=milli).problem.springs
    assert small.stiffness == pytest.approx(80.0)  # mN/mm
    assert small.path.end == pytest.approx([1e-4, 0.0, 3e-4])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("stiffness = 80.0", "stiffness = 0.0"), "spring.*stiffness"),
        (("radius = 0.6", "radius = -1"), "spring.*radius"),
        (("displacement = [0.1, 0.0, 0.3]", ""), "needs displacement or path"),
        (("radius = 0.6", "radius = 0.6\nsmooth = true"), "smooth goes with path"),
        (("radius = 0.6", "radius = 0.6\nregion = 1"), "region"),
    ],
)
def test_what_the_schema_refuses(write_case: Write, change: tuple[str, str], says: str) -> None:
    with pytest.raises(CaseError, match=says):
        case_of(write_case, SPRING.replace(*change))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("center = [1.5, 0.5, 1.0]", "center = [1.5, 0.5, 9.0]"), "spring 1: .*8 m away"),
        (("center = [1.5, 0.5, 1.0]\nradius = 0.6", "center = [1.3, 0.3, 1]\nradius = 0.01"),
         "spring 1: .*larger radius"),
        (("stiffness = 80.0", "stiffness = 1e300"), "spring 1: .*too large"),
        (("stiffness = 80.0", "stiffness = 80.0\namplitude = { times = [0], factors = [3] }"),
         "between 0 and 1"),
    ],
)  # fmt: skip
def test_what_the_mesh_refuses(write_case: Write, change: tuple[str, str], says: str) -> None:
    case = case_of(write_case, SPRING.replace(*change))
    with pytest.raises(InputError, match=says):
        _ = case.problem


def test_the_judge_has_the_same_force_by_its_own_quadrature(write_case: Write) -> None:
    problem = case_of(write_case).problem
    mesh, spring = problem.mesh, problem.springs[0]
    patches = PatchSprings(mesh.points, problem.springs)
    u = 0.1 * np.random.default_rng(0).standard_normal(mesh.points.shape)
    fast = patches.force(u, spring.path.end[None], np.ones(1))
    assert spring_force(mesh, spring, u) == pytest.approx(fast, abs=1e-13 * np.abs(fast).max())
    pushed = patches.multiply(u)
    assert spring_stiffness_times(mesh, problem.springs, u) == pytest.approx(pushed, abs=1e-12)


@pytest.mark.parametrize("element", list(Element))
def test_the_judge_finds_the_answer_in_balance(write_case: Write, element: Element) -> None:
    problem = case_of(write_case).problem
    found = solve_static(problem, element=element).displacement
    body = Body(problem, Strain.GREEN, element)
    left, scale = body.out_of_balance(found)
    assert np.abs(left).max() < 1e-9 * scale
    assert body.support_reactions(found).sum(axis=0) == pytest.approx(
        -body.pull_of_springs(found).sum(axis=0) - sum(body.loads(found)).sum(axis=0)
    )
    audit = audit_on_own_mesh(problem, found, Strain.GREEN, element)
    assert audit.displacement_error is not None
    assert audit.displacement_error < 1e-8
    halfway = audit_on_own_mesh(problem, 0.99 * found, Strain.LINEAR, Element.LINEAR)
    assert halfway.relative_residual_norm > 1e-3


def test_what_is_told_drawn_and_written_out(write_case: Write, tmp_path: Path) -> None:
    case = case_of(write_case)
    told = look_at(case).lines
    assert any(line.startswith("spring 1") and "80 N/m over" in line for line in told), told
    draw_case(case, tmp_path / "case.png")
    write_case_folder(tmp_path / "out", case.problem, Strain.GREEN, name="block")
    (spring,) = json.loads((tmp_path / "out" / "case.json").read_text())["springs"]
    assert spring["stiffness"] == 80.0
    assert spring["path"]["displacements"] == [[0.1, 0.0, 0.3]]


def test_a_wrong_answer_is_not_explained_by_slips_that_know_no_spring(write_case: Write) -> None:
    problem = case_of(write_case).problem
    found = solve_static(problem).displacement
    state = make_state(problem.mesh, 1.3 * found, label="x", simulator="x", strain=Strain.GREEN)
    assert "springs" in diagnose(problem, state, None).hint
