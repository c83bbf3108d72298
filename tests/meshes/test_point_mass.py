"""Masses on the surface as plain data: sizes, other forms of the problem, files, hashes."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes import transforms
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import FacetNotOnBoundaryError, IndexRangeError, InputError
from palpate.meshes.point_mass import PointMass
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.problem_files import load_problem, problem_arrays, save_problem
from palpate.meshes.refinement import refine_problem
from palpate.validation.exchange.case_folder import case_key
from palpate.validation.exchange.nodal_arrays import lumped_mass, nodal_force

SIZE = (1.0, 0.6, 0.5)
MESH = brick_box((4, 3, 2), SIZE, ragged=0.2)
END = side(MESH, 0, 1.0)
HUNG = PointMass(END, 3.0, "weight")


def problem(*masses: PointMass, loads: tuple[Traction, ...] = ()) -> Problem:
    return Problem(MESH, Material(1e4, 0.3, 1000.0), (), loads, masses=masses)


def test_density_and_weight_are_those_of_the_whole_mass() -> None:
    assert HUNG.density(MESH.points) == pytest.approx(3.0 / (0.6 * 0.5), rel=1e-12)
    weight = HUNG.weight(MESH.points, (1.0, 0.0, -9.81))
    total = nodal_force(MESH, weight).sum(axis=0)
    assert total == pytest.approx([3.0, 0.0, -29.43], rel=1e-12)


def test_each_corner_has_a_third_of_its_facets() -> None:
    """0.3 m2 in 12 facets of a brick's end: a corner of one facet has a third of m A_f / A."""
    added = lumped_mass(problem(HUNG)) - lumped_mass(problem())
    assert added.sum() == pytest.approx(3.0, rel=1e-12)
    assert np.array_equal(np.flatnonzero(added > 1e-12), np.unique(END))
    by_hand = np.zeros(MESH.num_points)
    for a, b, c in END.tolist():
        p, q, r = MESH.points[[a, b, c]]
        area = 0.5 * np.linalg.norm(np.cross(q - p, r - p))
        by_hand[[a, b, c]] += 3.0 * area / 0.3 / 3.0
    assert added == pytest.approx(by_hand, abs=1e-12)


@pytest.mark.parametrize("form", ["turned", "mirrored", "renumbered", "refined", "other units"])
def test_in_other_forms_it_is_the_same_mass_at_the_same_place(form: str) -> None:
    given = problem(HUNG, PointMass(END[:3], 1.0))
    matrix = transforms.rotation((1.0, 2.0, 3.0), 40.0)
    other = {
        "turned": lambda: transforms.turn(given, matrix)[0],
        "mirrored": lambda: transforms.turn(given, np.diag([1.0, -1.0, 1.0]))[0],
        "renumbered": lambda: transforms.renumber(given)[0],
        "refined": lambda: refine_problem(given),
        "other units": lambda: transforms.change_units(given)[0],
    }[form]()
    assert [mass.mass for mass in other.masses] == [3.0, 1.0]
    bare = dataclasses.replace(other, masses=())
    added = lumped_mass(other) - lumped_mass(bare)
    middle = added @ other.mesh.points / added.sum()
    before = lumped_mass(given) - lumped_mass(problem())
    expected = before @ MESH.points / before.sum()
    if form == "turned":
        expected = matrix @ expected
    if form == "mirrored":
        expected = expected * [1.0, -1.0, 1.0]
    if form == "other units":
        expected = 1e3 * expected
    assert added.sum() == pytest.approx(4.0, rel=1e-12)
    assert middle == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_a_file_of_a_problem_has_it(tmp_path: Path) -> None:
    given = problem(HUNG, PointMass(END[:2], 0.0))
    save_problem(tmp_path / "p.npz", given)
    read = load_problem(tmp_path / "p.npz")
    assert [(m.mass, m.name) for m in read.masses] == [(3.0, "weight"), (0.0, "")]
    assert np.array_equal(read.masses[0].facets, END)
    assert case_key(read, Strain.GREEN) == case_key(given, Strain.GREEN)


def test_it_changes_the_hash_of_a_problem_and_none_leaves_it_as_it_was() -> None:
    keys = {
        case_key(problem(*masses), Strain.GREEN)
        for masses in ((), (HUNG,), (dataclasses.replace(HUNG, mass=3.1),), (HUNG, HUNG))
    }
    assert len(keys) == 4
    header = json.loads(str(problem_arrays(problem())["header"]))
    assert set(header) == {"schema", "supports", "loads", "material", "time"}


@pytest.mark.parametrize("mass", [-1.0, float("nan"), float("inf"), 1e101])
def test_a_mass_that_is_no_mass_is_refused_with_its_name(mass: float) -> None:
    with pytest.raises(InputError, match=r"kg of 'weight': needs a value >= 0"):
        PointMass(END, mass, "weight")


def test_facets_that_are_refused() -> None:
    with pytest.raises(InputError, match="a mass of 'weight' has no facets"):
        problem(dataclasses.replace(HUNG, facets=END[:0]))
    inside = np.setdiff1d(np.arange(MESH.num_points), MESH.boundary_facets)[0]
    cell = next(row for row in MESH.cells if inside in row)
    inner = np.array([[inside, *cell[cell != inside][:2]]], dtype=np.int32)
    with pytest.raises(FacetNotOnBoundaryError, match="facets of mass 1"):
        problem(dataclasses.replace(HUNG, facets=np.vstack([END, inner])))
    with pytest.raises(FacetNotOnBoundaryError, match="facets of mass 1"):
        problem(dataclasses.replace(HUNG, facets=np.vstack([END, END[:1]])))
    with pytest.raises(IndexRangeError, match="facets of mass 2"):
        problem(HUNG, dataclasses.replace(HUNG, facets=END + 1000))
