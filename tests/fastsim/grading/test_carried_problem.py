"""Supports and loads survive refinement: the same total force, the same fixed region."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.forces import external_force
from palpate.fastsim.grading.graded_mesh import GradedMesh, carry_problem
from palpate.fastsim.mesher import mesh_surface
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Support, Traction
from palpate.meshes.problem import Inclusion, Material, Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.meshes.shapes import shape_box
from palpate.meshes.tet_mesh import signed_volumes


def make_problem() -> Problem:
    mesh = mesh_surface(shape_box((2.0, 1.0, 1.0), edge_length=0.5))
    facets, points = mesh.boundary_facets, mesh.points
    left = facets[(points[facets][:, :, 0] == 0.0).all(axis=1)]
    right = facets[(points[facets][:, :, 0] == 2.0).all(axis=1)]
    top = facets[(points[facets][:, :, 2] == 1.0).all(axis=1)]
    corner = np.flatnonzero((points == [2.0, 1.0, 1.0]).all(axis=1))
    return Problem(
        mesh,
        Material(1e3, 0.3),
        (Support(np.unique(left), left),),
        (
            Traction(right, (1.0, -2.0, 0.5)),
            Pressure(top, 3.0),
            BodyForce((0.0, 0.0, -4.0)),
            PointForce(corner, np.array([[0.1, 0.2, 0.3]])),
        ),
    )


def test_forces_and_the_fixed_region_are_the_same() -> None:
    problem = make_problem()
    graded = GradedMesh(problem.mesh)
    for k in range(6):
        middle = graded.points[graded.cells].mean(axis=1)
        graded.refine(np.linalg.norm(middle - [2.0, 1.0, 1.0], axis=1) < 1.5 * 0.8**k)
    carried = carry_problem(problem, graded)
    fixed = carried.supports[0].points
    assert np.array_equal(fixed, np.flatnonzero(carried.mesh.points[:, 0] == 0.0))
    before = external_force(problem)
    after = external_force(carried)
    assert after.sum(axis=0) == pytest.approx(before.sum(axis=0), rel=1e-12)
    turn = np.cross(problem.mesh.points, before).sum(axis=0)
    assert np.cross(carried.mesh.points, after).sum(axis=0) == pytest.approx(turn, rel=1e-12)


def test_refinement_lets_the_body_yield_more() -> None:
    # By the principle of least potential energy: nested spaces, linear strain, dead loads.
    problem = make_problem()
    graded = GradedMesh(problem.mesh)
    work = []
    for _ in range(4):
        carried = carry_problem(problem, graded)
        displacement = solve_static(carried, strain=Strain.LINEAR).displacement
        work.append(float((external_force(carried) * displacement).sum()))
        graded.refine(np.ones(len(graded.cells), dtype=bool))
    assert np.all(np.diff(work) > 0.0)


def test_tools_touch_the_same_facets_and_inclusions_fill_the_same_place() -> None:
    mesh = make_problem().mesh
    facets, points = mesh.boundary_facets, mesh.points
    top = facets[(points[facets][:, :, 2] == 1.0).all(axis=1)]
    soft = np.flatnonzero(points[mesh.cells].mean(axis=1)[:, 0] < 0.7).astype(np.int32)
    tool = RigidTool(SphereShape(0.2), ToolPath([0.0], [[1.0, 0.5, 1.2]]), contact_facets=top)
    problem = Problem(
        mesh, Material(1e3, 0.3), (), (), tools=(tool,),
        inclusions=(Inclusion(soft, Material(10.0, 0.3)),),
    )  # fmt: skip
    graded = GradedMesh(mesh)
    rng = np.random.default_rng(4)
    for _ in range(3):
        graded.refine(rng.random(len(graded.cells)) < 0.3)
    volume = signed_volumes(points, mesh.cells)[soft].sum()
    for fine in (carry_problem(problem, graded), refine_problem(problem)):
        corners = fine.mesh.points[fine.tools[0].contact_facets]
        assert (corners[:, :, 2] == 1.0).all()
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert 0.5 * across[:, 2].sum() == pytest.approx(2.0, rel=1e-12)
        cells = fine.mesh.cells[fine.inclusions[0].cells]
        assert signed_volumes(fine.mesh.points, cells).sum() == pytest.approx(volume, rel=1e-12)
        assert len(cells) > len(soft)
