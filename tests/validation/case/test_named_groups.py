"""Groups of the mesh file hold, push and fill: facets, single points and cells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import PointForce
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import InputError
from palpate.meshes.files import write_mesh
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.case import load_case

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
