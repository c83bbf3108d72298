"""Regions, named groups, and the parts of the body that checks look at."""

import numpy as np
import pytest
from case_texts import CHECK, CLAMP, FLOOR, changed

from palpate.meshes.boundary_conditions import PointForce
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import InputError
from palpate.meshes.files import write_mesh
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.case import load_case
from palpate.validation.case.body_schema import RegionSpec
from palpate.validation.case.regions import part_of_check, select_cells, select_points
from palpate.validation.case.units import Units

BOX = "region = { box = { min = [0.6, -1.0, -1.0], max = [1.6, 2.0, 2.0] } }"


def with_check(write_case, metric, *lines):
    check = [f'metric = "{metric}"', "limit = 0.1", 'reason = "r"', *lines]
    text = "\n[[check]]\n" + "\n".join(check) + "\n" + CHECK
    return load_case(write_case((CHECK, text)))


def part(case):
    return part_of_check(case.checks[1], case.problem, case.spec.units, "check 2")


def test_stress_is_looked_at_in_the_cells_of_a_region(write_case):
    case = with_check(write_case, "stress_l2", BOX)
    mesh = case.problem.mesh
    x = mesh.points[mesh.cells].mean(axis=1)[:, 0]
    expected = np.flatnonzero((x >= 0.6) & (x <= 1.6))
    assert 0 < len(expected) < mesh.num_cells
    assert np.array_equal(part(case).cells, expected)
    assert part_of_check(case.checks[0], case.problem, case.spec.units, "check 1") is None


def test_a_support_is_named_by_its_number_and_a_cut_by_one_side(write_case):
    fixed = part(with_check(write_case, "traction_resultant", "support = 1"))
    case = with_check(write_case, "traction_resultant", BOX)
    mesh = case.problem.mesh
    assert fixed.support == 0
    assert np.array_equal(fixed.weights, (mesh.points[:, [0, 0, 0]] < 1e-9).astype(float))
    cut = part(case)
    assert cut.support is None
    inside = (mesh.points[:, 0] >= 0.6) & (mesh.points[:, 0] <= 1.6)
    assert np.array_equal(cut.weights, np.repeat(inside[:, None], 3, axis=1).astype(float))
    # A component that is free is no part of the support.
    rollers = f'\n\n[[support]]\ncomponents = ["z"]\n{FLOOR}'
    check = '\n[[check]]\nmetric = "traction_resultant"\nsupport = 2\nlimit = 0.1\nreason = "r"\n'
    case = load_case(write_case((CLAMP, CLAMP + rollers), (CHECK, check + CHECK)))
    weights = part(case).weights
    assert not weights[:, :2].any()
    assert np.array_equal(weights[:, 2], (mesh.points[:, 2] < 1e-9).astype(float))


def test_named_facets_choose_the_cells_behind_them_and_their_points():
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
region = { group = "fixed" }
[[support]]
region = { group = "pins" }
components = ["y"]
[[load]]
kind = "point_force"
region = { group = "tips" }
force = [0.0, 0.0, 2.0]
"""
PINS, TIPS, STIFF = [14, 17], [8, 11, 26], [0, 1, 2, 9]


def write(folder, *changes):
    mesh = brick_box((2, 2, 2), (2.0, 1.0, 1.0))
    grouped = TetMesh(
        mesh.points, mesh.cells, {"fixed": side(mesh, 0, 0.0)}, {"pins": PINS, "tips": TIPS},
        {"stiff": STIFF},
    )  # fmt: skip
    write_mesh(folder / "body.msh", grouped, groups=True)
    (folder / "case.toml").write_text(changed(CASE, *changes), encoding="utf-8")
    return folder / "case.toml"


def test_each_group_is_what_its_table_needs(tmp_path):
    problem = load_case(write(tmp_path)).problem
    whole = brick_box((2, 2, 2), (2.0, 1.0, 1.0))
    fixed, pins = problem.supports
    assert len(fixed.facets) == 8
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
        (('"stiff"', '"fixed"'), r"inclusion 1: no group of cells 'fixed' .*known: stiff"),
        (('"fixed"', '"stiff"'), "support 1: no facet group 'stiff' .*'stiff' is a group of cells"),
        (('"tips"', '"fixed"'), "load 1: needs region = { nearest"),
        (('components = ["y"]', "sliding = true"), "support 2: single points have no face"),
        (('kind = "point_force"', 'kind = "force"'), "'tips' is a group of points"),
    ],
)  # fmt: skip
def test_a_group_of_another_kind_is_named(tmp_path, change, says):
    with pytest.raises(InputError, match=says):
        _ = load_case(write(tmp_path, change)).problem
