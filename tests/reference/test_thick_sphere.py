"""Lame's thick sphere under pressure, an eighth of it on three symmetry planes, from a case file.

S. P. Timoshenko, J. N. Goodier, Theory of Elasticity, 3rd ed., art. 136: with p inside,
u_r = p a^3 / (E (b^3 - a^3)) ((1 - 2 nu) r + (1 + nu) b^3 / (2 r^2)).
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.fastsim.statics import solve_static as fast_static
from palpate.meshes.bricks import side
from palpate.meshes.problem import Strain
from palpate.meshes.transforms import rotation, turn
from palpate.reference.availability import is_available
from palpate.validation.case import load_case

if is_available():
    from palpate.reference.statics import solve_static

pytestmark = pytest.mark.dolfinx

A, B, E, NU, P = 0.5, 1.0, 1e4, 0.3, 100.0
CASE = """
schema = 1
title = "A thick sphere under pressure"
strain = "linear"

[geometry]
shape = "hollow_octant"
radius = 1.0
inner_radius = 0.5
edge_length = {edge}

[material]
youngs_modulus = 1e4
poissons_ratio = 0.3

[[load]]
kind = "pressure"
pressure = 100.0
region = {{ ball = {{ center = [0, 0, 0], radius = 0.5 }} }}
{supports}
[[check]]
metric = "smallest_det_f"
against = "candidate"
limit = 0.0
reason = "nothing inverted"
"""
WALL = """
[[support]]
sliding = true
region = {{ half_space = {{ point = {point}, normal = {normal} }} }}
"""


def exact(points):
    r = np.linalg.norm(points, axis=1, keepdims=True)
    radial = (1.0 - 2.0 * NU) * r + (1.0 + NU) * B**3 / (2.0 * r**2)
    return P * A**3 / (E * (B**3 - A**3)) * radial * points / r


def octant(tmp_path, edge):
    walls = [
        WALL.format(point=[1e-6 * (k == axis) for k in range(3)], normal=normal)
        for axis, normal in enumerate(([-1, 0, 0], [0, -1, 0], [0, 0, -1]))
    ]
    path = tmp_path / "octant.toml"
    path.write_text(CASE.format(edge=edge, supports="".join(walls)))
    return load_case(path).problem


def error(problem, displacement):
    wanted = exact(problem.mesh.points)
    return float(np.linalg.norm(displacement - wanted) / np.linalg.norm(wanted))


def test_the_reference_comes_to_lames_solution(tmp_path):
    problem = octant(tmp_path, 0.25)
    assert [sum(s.components) for s in problem.supports] == [1, 1, 1]
    assert len(problem.loads[0].facets) > 10
    coarse = error(problem, solve_static(problem, strain=Strain.LINEAR, degree=2).displacement)
    finer = octant(tmp_path, 0.125)
    fine = error(finer, solve_static(finer, strain=Strain.LINEAR, degree=2).displacement)
    # What is left is that facets are flat: second order.
    assert fine < 0.4 * coarse < 0.02


def test_turned_the_planes_slant_and_the_sphere_is_the_same(tmp_path):
    problem = octant(tmp_path, 0.25)
    turned, back = turn(problem, rotation((1.0, 2.0, 3.0), 50.0))
    assert all(s.normal is not None for s in turned.supports)
    plain = fast_static(problem, strain=Strain.LINEAR).displacement
    ours = fast_static(turned, strain=Strain.LINEAR).displacement
    theirs = solve_static(turned, strain=Strain.LINEAR).displacement
    size = np.abs(plain).max()
    assert np.abs(back(ours) - plain).max() < 1e-8 * size
    assert np.abs(ours - theirs).max() < 1e-8 * size


def test_a_wedge_of_a_sphere_has_the_same_solution_on_planes_that_meet_at_any_angle(tmp_path):
    """Half the octant by the plane x = y: cut by holding its normal at points on it."""
    problem = octant(tmp_path, 0.25)
    mesh = problem.mesh
    on_plane = np.flatnonzero(np.abs(mesh.points[:, 0] - mesh.points[:, 1]) < 1e-12)
    assert len(on_plane) > 3
    plane = dataclasses.replace(
        problem.supports[0],
        points=on_plane.astype(np.int32),
        facets=np.zeros((0, 3), dtype=np.int32),
        components=(True, True, True),
        normal=(1.0, -1.0, 0.0),
    )
    more = dataclasses.replace(problem, supports=(*problem.supports, plane))
    found = fast_static(more, strain=Strain.LINEAR).displacement
    theirs = solve_static(more, strain=Strain.LINEAR).displacement
    assert np.abs(found - theirs).max() < 1e-8 * np.abs(found).max()
    assert np.abs(found[on_plane] @ [1.0, -1.0, 0.0]).max() < 1e-15
    # Two linear cells across the wall.
    assert error(problem, found) < 0.2


def test_a_slab_that_slides_on_both_sides_is_in_plane_strain(tmp_path):
    """A tube under pressure between two smooth plates: Lame's ring, u_z = 0 on both."""
    text = CASE.replace("hollow_octant", "tube").replace(
        "inner_radius = 0.5", "inner_radius = 0.5\nheight = 0.3"
    )
    text = text.replace(
        "ball = {{ center = [0, 0, 0], radius = 0.5 }}",
        "box = {{ min = [-0.4999, -0.4999, 0.01], max = [0.4999, 0.4999, 0.29] }}",
    )
    plates = "[[support]]\nsliding = true\nregion = { box = { min = [-2, -2, 0.299], "
    plates += "max = [2, 2, 0.301] } }\n"
    plates += plates.replace("0.299", "-0.001").replace("0.301", "0.001")
    pins = "".join(
        f"[[support]]\ncomponents = ['{c}']\nregion = {{ nearest = {p} }}\n"
        for c, p in (("y", [1, 0, 0]), ("y", [-1, 0, 0]), ("x", [0, 1, 0]))
    )
    path = tmp_path / "tube.toml"
    path.write_text(text.format(edge=0.2, supports=plates + pins))
    problem = load_case(path).problem
    found = solve_static(problem, strain=Strain.LINEAR, degree=2).displacement
    for z in (0.0, 0.3):
        points = np.unique(side(problem.mesh, 2, z))
        assert np.abs(found[points, 2]).max() < 1e-15
    x, y, _ = problem.mesh.points.T
    r = np.hypot(x, y)
    # Timoshenko and Goodier, art. 28, with plane strain's constants.
    radial = P * A**2 * (1 + NU) / (E * (B**2 - A**2)) * ((1 - 2 * NU) * r + B**2 / r)
    ours = (found[:, 0] * x + found[:, 1] * y) / r
    assert np.linalg.norm(ours - radial) < 0.05 * np.linalg.norm(radial)
