"""Regions, named groups, and the parts of the body that checks look at."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import PointForce
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import InputError
from palpate.meshes.files import write_mesh
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.case import Case, load_case
from palpate.validation.case.body_schema import RegionSpec
from palpate.validation.case.regions import part_of_check, select_cells, select_points
from palpate.validation.case.units import Units
from palpate.validation.metrics import Part

Write = Callable[..., Path]
_CHECK = '\n[[check]]\nmetric = "smallest_det_f"'
BOX = "region = { box = { min = [0.6, -1.0, -1.0], max = [1.6, 2.0, 2.0] } }"


def with_check(write_case: Write, metric: str, *lines: str) -> Case:
    told = [f'metric = "{metric}"', "limit = 0.1", 'reason = "r"', *lines]
    text = "\n[[check]]\n" + "\n".join(told) + "\n" + _CHECK
    return load_case(write_case((_CHECK, text)))


def part(case: Case) -> Part:
    found = part_of_check(case.checks[1], case.problem, case.spec.units, "check 2")
    assert found is not None
    return found


def test_stress_is_looked_at_in_the_cells_of_a_region(write_case: Write) -> None:
    case = with_check(write_case, "stress_l2", BOX)
    mesh = case.problem.mesh
    x = mesh.points[mesh.cells].mean(axis=1)[:, 0]
    expected = np.flatnonzero((x >= 0.6) & (x <= 1.6))
    assert 0 < len(expected) < mesh.num_cells
    assert np.array_equal(part(case).cells, expected)
    assert part_of_check(case.checks[0], case.problem, case.spec.units, "check 1") is None


def test_a_support_is_named_by_its_number_and_a_cut_by_one_side(write_case: Write) -> None:
    held = part(with_check(write_case, "traction_resultant", "support = 1"))
    case = with_check(write_case, "traction_resultant", BOX)
    mesh = case.problem.mesh
    assert held.support == 0
    assert np.array_equal(held.weights, (mesh.points[:, [0, 0, 0]] < 1e-9).astype(float))
    cut = part(case)
    assert cut.support is None
    inside = (mesh.points[:, 0] >= 0.6) & (mesh.points[:, 0] <= 1.6)
    assert np.array_equal(cut.weights, np.repeat(inside[:, None], 3, axis=1).astype(float))
    # A component that is free is no part of the support.
    text = "normal = [-1.0, 0.0, 0.0] } }\n"
    rollers = '\n[[support]]\ncomponents = ["z"]\nregion = { half_space = { point = [0.0, 0.0, '
    rollers += "0.001], normal = [0.0, 0.0, -1.0] } }\n"
    told = '\n[[check]]\nmetric = "traction_resultant"\nsupport = 2\nlimit = 0.1\nreason = "r"\n'
    case = load_case(write_case((text, text + rollers), (_CHECK, told + _CHECK)))
    weights = part(case).weights
    assert not weights[:, :2].any()
    assert np.array_equal(weights[:, 2], (mesh.points[:, 2] < 1e-9).astype(float))


def test_named_facets_choose_the_cells_behind_them_and_their_points() -> None:
    box = brick_box((3, 2, 2), (3.0, 1.0, 1.0))
    facets = box.boundary_facets
    end = facets[(box.points[facets][:, :, 0] == 3.0).all(axis=1)]
    mesh = TetMesh(box.points, box.cells, facet_groups={"end": end})
    region = RegionSpec(group="end")
    cells = select_cells(mesh, region, Units(), "check 1")
    # Four bricks of six cells have two facets each at the end.
    assert len(cells) == len(end) == 8
    at_end = (mesh.points[mesh.cells[cells]][:, :, 0] == 3.0).sum(axis=1)
    assert (at_end == 3).all()
    points = select_points(mesh, region, Units(), "check 1")
    assert np.array_equal(points, np.flatnonzero(mesh.points[:, 0] == 3.0))
    lower = RegionSpec(group="end", box={"min": (0.0, 0.0, 0.0), "max": (3.0, 0.9, 0.4)})
    assert len(select_points(mesh, lower, Units(), "check 1")) == 2


@pytest.mark.parametrize(
    ("metric", "lines", "words"),
    [
        ("stress_l2", (), "stress_l2 needs region"),
        ("stress_l2", ("support = 1",), "support goes with traction_resultant"),
        ("stress_l2", ("region = { nearest = [1.0, 0.0, 0.0] }",), "not a point"),
        ("traction_resultant", (), "needs support, the number of one, or region"),
        ("traction_resultant", ("support = 1", BOX), "needs support, the number of one, or region"),
        ("traction_resultant", ("support = 0",), "greater than or equal to 1"),
        ("traction_resultant", ("support = 1.5",), "support"),
        ("displacement_l2", (BOX,), "region goes with stress_l2, traction_resultant"),
        ("displacement_l2", ("support = 1",), "support goes with traction_resultant"),
        ("traction_resultant", ("support = 2",), "the case has 1 [[support]]"),
        ("stress_l2", (BOX.replace("0.6", "7.6").replace("1.6", "8.6"),), "selects no cell"),
        (
            "traction_resultant",
            (BOX.replace("0.6", "7.6").replace("1.6", "8.6"),),
            "selects no point",
        ),
        ("traction_resultant", (BOX.replace("0.6", "-9").replace("1.6", "9"),), "nothing is cut"),
        ("stress_l2", ('region = { group = "apex" }',), "no facet group 'apex'"),
        ("stress_l2", ('against = "candidate"', BOX), "candidate"),
    ],
)
def test_what_cannot_be_looked_at_is_said(
    write_case: Write, metric: str, lines: tuple[str, ...], words: str
) -> None:
    with pytest.raises(InputError) as caught:
        with_check(write_case, metric, *lines).problem  # noqa: B018
    assert words in str(caught.value)
    assert str(caught.value).count("\n") <= 1


CASE = """
schema = 1
title = "Named parts"
[geometry]
mesh = "body.msh"
[material]
youngs_modulus = 1000.0
poissons_ratio = 0.3
[[inclusion]]
region = { group = "stiff" }
material = { youngs_modulus = 5000.0, poissons_ratio = 0.3 }
[[support]]
region = { group = "held" }
[[support]]
region = { group = "pins" }
components = ["y"]
[[load]]
kind = "point_force"
region = { group = "tips" }
force = [0.0, 0.0, 2.0]
"""
PINS, TIPS, STIFF = [14, 17], [8, 11, 26], [0, 1, 2, 9]


def write(folder: Path, *changes: tuple[str, str]) -> Path:
    mesh = brick_box((2, 2, 2), (2.0, 1.0, 1.0))
    grouped = TetMesh(
        mesh.points, mesh.cells, {"held": side(mesh, 0, 0.0)}, {"pins": PINS, "tips": TIPS},
        {"stiff": STIFF},
    )  # fmt: skip
    write_mesh(folder / "body.msh", grouped, groups=True)
    text = CASE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "case.toml").write_text(text, encoding="utf-8")
    return folder / "case.toml"


def test_each_group_is_what_its_table_needs(tmp_path: Path) -> None:
    problem = load_case(write(tmp_path)).problem
    whole = brick_box((2, 2, 2), (2.0, 1.0, 1.0))
    held, pins = problem.supports
    assert len(held.facets) == 8
    assert pins.points.tolist() == PINS
    assert len(pins.facets) == 0
    assert pins.components == (False, True, False)
    (push,) = problem.loads
    assert isinstance(push, PointForce)
    assert np.array_equal(push.points, TIPS)
    assert np.array_equal(push.forces, np.tile([0.0, 0.0, 2.0], (3, 1)))
    (part,) = problem.inclusions
    named = np.sort(problem.mesh.cells[part.cells], axis=1)
    assert {*map(tuple, named.tolist())} == {
        *map(tuple, np.sort(whole.cells[STIFF], axis=1).tolist())
    }


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (('"stiff"', '"held"'), r"inclusion 1: no group of cells 'held' .*known: stiff"),
        (('"held"', '"stiff"'), "support 1: no facet group 'stiff' .*'stiff' is a group of cells"),
        (('"tips"', '"held"'), "load 1: needs region = { nearest"),
        (('components = ["y"]', "sliding = true"), "support 2: single points have no face"),
        (('kind = "point_force"', 'kind = "force"'), "'tips' is a group of points"),
    ],
)  # fmt: skip
def test_a_group_of_another_kind_is_named(
    tmp_path: Path, change: tuple[str, str], says: str
) -> None:
    with pytest.raises(InputError, match=says):
        _ = load_case(write(tmp_path, change)).problem
