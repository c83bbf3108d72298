"""A problem in another form: loads multiplied, tools moved; the rest by metamorphic relations."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.fastsim.contact.tool_contact import core_shape, gaps_at, poses_at
from palpate.meshes import transforms
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Traction
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.problem import Material, Problem
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    ForceDrive,
    PlaneShape,
    RigidTool,
    SphereShape,
    SurfaceShape,
    ToolPath,
    ToolShape,
)
from palpate.meshes.shapes import shape_box
from palpate.meshes.transforms import scale_loads
from palpate.meshes.tri_surface import TriSurface


def test_every_kind_of_load_is_multiplied_and_nothing_else():
    mesh = brick_box((1, 1, 1), (1.0, 1.0, 1.0))
    top = side(mesh, 2, 1.0)
    loads = (
        BodyForce((1.0, 0.0, -2.0)),
        Traction(top, (0.0, 3.0, 0.0)),
        Pressure(top, 5.0),
        PointForce(np.array([7], dtype=np.int32), np.array([[0.0, 0.0, 7.0]])),
    )
    foot = support_of(side(mesh, 2, 0.0), displacement=(0.1, 0.0, 0.0))
    problem = Problem(mesh, Material(1.0, 0.3), (foot,), loads)
    body, traction, pressure, point = scale_loads(problem, 0.5).loads
    assert body.force_density == (0.5, 0.0, -1.0)  # type: ignore[union-attr]
    assert traction.traction == (0.0, 1.5, 0.0)  # type: ignore[union-attr]
    assert pressure.pressure == pytest.approx(2.5)  # type: ignore[union-attr]
    assert point.forces.tolist() == [[0.0, 0.0, 3.5]]  # type: ignore[union-attr]
    scaled = scale_loads(problem, 0.5)
    assert dataclasses.replace(scaled, loads=loads).supports == problem.supports
    assert scaled.material == problem.material


_BOX = shape_box((0.6, 1.0, 1.6), edge_length=0.4)
# No mirror image of itself.
_LOPSIDED = TriSurface(
    _BOX.points * (1.0 + 0.3 * np.sin(3.0 * _BOX.points.sum(axis=1)))[:, None], _BOX.facets
)
SHAPES: list[ToolShape] = [
    SphereShape(0.7),
    CapsuleShape(0.4, 0.6),
    BoxShape((0.3, 0.5, 0.8)),
    PlaneShape(),
    SurfaceShape(_LOPSIDED),
]
TIMES = np.array([0.0, 0.4, 1.0, 1.7, 2.0])


@pytest.fixture
def problem() -> Problem:
    mesh = brick_box((4, 2, 2), (2.0, 1.0, 1.0), ragged=0.2)
    return Problem(mesh, Material(1000.0, 0.3), (), ())


def distances(tool: RigidTool, positions: Points) -> Points:
    shape = core_shape(tool.shape)
    return np.array([gaps_at(shape, positions, p).distances for p in poses_at(tool.path, TIMES)])


def tool_of(shape: ToolShape) -> RigidTool:
    rng = np.random.default_rng(7)
    turns = rng.standard_normal((3, 4))
    path = ToolPath(
        np.array([0.0, 1.0, 2.0]),
        rng.uniform(-0.4, 0.4, (3, 3)),
        turns / np.linalg.norm(turns, axis=1)[:, None],
    )
    return RigidTool(shape, path)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
def test_places_are_as_far_from_the_tool_as_before(problem: Problem, shape: ToolShape) -> None:
    given = dataclasses.replace(problem, tools=(tool_of(shape),))
    positions = np.random.default_rng(3).uniform(-1.5, 1.5, (100, 3))
    before = distances(given.tools[0], positions)
    turn = transforms.rotation((1.0, 2.0, 3.0), 50.0)
    half = transforms.rotation((1.0, 0.0, 0.0), 180.0)  # where a quaternion's w is 0
    for matrix in (turn, half, np.diag([1.0, -1.0, 1.0]), turn @ np.diag([1.0, 1.0, -1.0])):
        changed, _ = transforms.turn(given, matrix)
        after = distances(changed.tools[0], positions @ matrix.T)
        np.testing.assert_allclose(after, before, rtol=0.0, atol=1e-13)
        # It has really been moved.
        assert np.abs(distances(given.tools[0], positions @ matrix.T) - before).max() > 0.01
    changed, _ = transforms.change_units(given, 1000.0)
    after = distances(changed.tools[0], 1000.0 * positions)
    np.testing.assert_allclose(after, 1000.0 * before, rtol=0.0, atol=1e-10)


def test_facets_that_may_touch_and_the_drive_go_along(problem: Problem) -> None:
    facets = problem.mesh.boundary_facets[:5]
    drive = ForceDrive((0.0, 0.0, -1.0), 2.0, TabularAmplitude((0.0, 1.0), (0.0, 1.0)), 0.1)
    path = ToolPath(np.array([0.0]), np.array([[0.0, 0.0, 3.0]]))
    tool = RigidTool(SphereShape(0.5), path, contact_facets=facets, drive=drive)
    given = dataclasses.replace(problem, tools=(tool,))
    corners = problem.mesh.points[facets]

    renumbered, _ = transforms.renumber(given)
    np.testing.assert_array_equal(
        renumbered.mesh.points[renumbered.tools[0].contact_facets], corners
    )
    mirror = np.diag([1.0, 1.0, -1.0])
    mirrored, _ = transforms.turn(given, mirror)
    moved = mirrored.tools[0]
    assert moved.drive is not None
    assert moved.drive.direction == (0.0, 0.0, 1.0)
    known = {tuple(row) for row in mirrored.mesh.boundary_facets.tolist()}
    turned_round = {
        tuple(np.roll(row, k).tolist()) for row in moved.contact_facets for k in range(3)
    }
    assert len(known & turned_round) == len(facets)
