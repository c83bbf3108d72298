"""Loads and supports as arrays over points: by hand, and against fastsim's own."""

import numpy as np
import pytest

from palpate.fastsim import forces
from palpate.fastsim.body import Body
from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Support, Traction
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Inclusion, Material, Problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.exchange import nodal_arrays
from palpate.validation.exchange.nodal_arrays import (
    are_among,
    area_vectors,
    facet_areas,
    fixed_components,
)

ONE_CELL = TetMesh(
    np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), np.array([[0, 1, 2, 3]])
)


def test_a_body_force_on_one_cell_is_a_quarter_each():
    # Volume 1/6, a quarter of it 1/24.
    force = nodal_arrays.nodal_force(ONE_CELL, BodyForce((24.0, 0.0, -48.0)))
    np.testing.assert_allclose(force, np.tile([1.0, 0.0, -2.0], (4, 1)), rtol=1e-15)


def test_a_traction_on_one_facet_is_a_third_each():
    facet = np.array([[0, 2, 1]], dtype=np.int32)  # area 1/2, a third of it 1/6
    force = nodal_arrays.nodal_force(ONE_CELL, Traction(facet, (0.0, 6.0, 0.0)))
    np.testing.assert_allclose(force[:3], np.tile([0.0, 1.0, 0.0], (3, 1)), rtol=1e-15)
    assert not force[3].any()


def test_loads_and_mass_agree_with_fastsims_own():
    mesh = brick_box((2, 3, 2), (1.0, 1.2, 0.9), ragged=0.2)
    facets = mesh.boundary_facets[:7]
    loads = (
        BodyForce((1.0, -2.0, 3.0)),
        Traction(facets, (4.0, 5.0, -6.0)),
        PointForce(np.array([3, 3], dtype=np.int32), np.array([[1.0, 0, 0], [2.0, 1, 0]])),
    )
    problem = Problem(mesh, Material(1e3, 0.3, 900.0), (), loads)
    ours = sum(nodal_arrays.nodal_force(mesh, load) for load in loads)
    theirs = forces.external_force(problem)
    scale = np.abs(theirs).max()
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=50 * np.finfo(float).eps * scale)
    mass = Body(mesh, problem.material).lumped_mass
    np.testing.assert_allclose(nodal_arrays.lumped_mass(problem), mass, rtol=1e-13)


def test_pressure_follows_the_surface_and_is_no_nodal_force():
    load = Pressure(ONE_CELL.boundary_facets, 5.0)
    assert not nodal_arrays.nodal_force(ONE_CELL, load).any()


def test_fixed_components_are_those_of_the_supports():
    support = Support(
        np.array([1], dtype=np.int32), components=(True, False, True), displacement=(0.1, 0.2, 0.3)
    )
    problem = Problem(ONE_CELL, Material(1.0, 0.3), (support,), ())
    fixed, moved = fixed_components(problem)
    assert fixed.tolist() == [[0, 0, 0], [1, 0, 1], [0, 0, 0], [0, 0, 0]]
    np.testing.assert_array_equal(moved[1], [0.1, 0.0, 0.3])


def test_an_inclusion_has_its_own_row():
    mesh = brick_box((1, 1, 1), (1.0, 1.0, 1.0))
    inclusion = Inclusion(np.array([2], dtype=np.int32), Material(5.0, 0.1, 7.0))
    rows = nodal_arrays.cell_materials(
        Problem(mesh, Material(1.0, 0.3), (), (), None, (), (inclusion,))
    )
    assert rows[2].tolist() == [5.0, 0.1, 7.0]
    assert rows[1].tolist() == [1.0, 0.3, 1000.0]


POINTS = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 1.0]])


def test_areas_and_outward_vectors():
    facets = np.array([[0, 1, 2], [0, 2, 1], [0, 3, 1]])
    # Half of 3 times 4 along z and against it; half of 1 times 3 along y.
    assert area_vectors(POINTS, facets).tolist() == [[0, 0, 6], [0, 0, -6], [0, 1.5, 0]]
    assert facet_areas(POINTS, facets) == pytest.approx([6.0, 6.0, 1.5])


def test_facets_are_found_by_their_corners_in_any_order():
    facets = np.array([[5, 1, 3], [0, 9, 7], [9, 2, 4]])
    others = np.array([[4, 9, 2], [3, 5, 1], [9, 1, 7]])
    assert are_among(facets, others).tolist() == [True, False, True]
    assert are_among(others, facets).tolist() == [True, True, False]
