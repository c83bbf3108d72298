"""Signed distances of tools: closed forms, derivatives, closed surfaces, poses."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.contact.tool_contact import POSE, Gaps, core_shape, gaps_at, poses_at
from palpate.meshes.arrays import Points
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    PlaneShape,
    SphereShape,
    SurfaceShape,
    ToolPath,
    ToolShape,
)
from palpate.meshes.shapes import shape_box, shape_sphere

EPS = np.finfo(float).eps
AT_ORIGIN = np.array((np.zeros(3), np.eye(3)), dtype=POSE)
SHAPES: list[ToolShape] = [
    SphereShape(0.7),
    CapsuleShape(0.4, 0.6),
    BoxShape((0.3, 0.5, 0.8)),
    PlaneShape(),
    SurfaceShape(shape_box((0.6, 1.0, 1.6), edge_length=0.4)),
]
ALL = pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)


def positions(count: int = 400) -> Points:
    return np.random.default_rng(3).uniform(-1.5, 1.5, (count, 3))


def gaps(shape: ToolShape, where: Points, pose: np.ndarray = AT_ORIGIN) -> Gaps:
    return gaps_at(core_shape(shape), where, pose)


def test_closed_forms() -> None:
    x = positions()
    assert np.allclose(
        gaps(SphereShape(0.7), x).distances, np.linalg.norm(x, axis=1) - 0.7, rtol=0, atol=8 * EPS
    )
    off_axis = x - np.stack([0 * x[:, 0], 0 * x[:, 0], np.clip(x[:, 2], -0.6, 0.6)], axis=1)
    assert np.allclose(
        gaps(CapsuleShape(0.4, 0.6), x).distances,
        np.linalg.norm(off_axis, axis=1) - 0.4,
        rtol=0,
        atol=8 * EPS,
    )
    q = np.abs(x) - np.array([0.3, 0.5, 0.8])
    expected = np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0)
    assert np.allclose(gaps(BoxShape((0.3, 0.5, 0.8)), x).distances, expected, rtol=0, atol=8 * EPS)
    assert np.array_equal(gaps(PlaneShape(), x).distances, x[:, 2])


@ALL
def test_normal_and_curvature_are_the_derivatives(shape: ToolShape) -> None:
    x, step = positions(), 1e-5
    at = gaps(shape, x)
    slope = np.empty_like(x)
    bend = np.empty((len(x), 3, 3))
    for axis in range(3):
        d = step * np.eye(3)[axis]
        ahead, behind = gaps(shape, x + d), gaps(shape, x - d)
        slope[:, axis] = (ahead.distances - behind.distances) / (2 * step)
        bend[:, axis] = (ahead.normals - behind.normals) / (2 * step)
    # Places within a step of a ridge, or of an edge's own region, have no derivative.
    smooth = np.abs(bend).max(axis=(1, 2)) < 0.1 / step
    near = np.abs(at.distances) > 0.02
    assert smooth.sum() > 0.9 * len(x)
    assert np.abs(np.linalg.norm(at.normals, axis=1) - 1.0).max() < 8 * EPS
    # Central differences: step^2 times third derivatives of about 1 / 0.02^2, and rounding.
    assert np.abs(slope - at.normals)[smooth & near].max() < 1e-6
    formula = at.curvatures[:, None, None] * (
        np.eye(3)
        - at.normals[:, :, None] * at.normals[:, None, :]
        - at.axes[:, :, None] * at.axes[:, None, :]
    )
    wrong = np.abs(bend - formula).max(axis=(1, 2))[smooth & near]
    # A few straddle the border between a face's and an edge's region, where the bend jumps.
    assert np.quantile(wrong, 0.98) < 1e-4
    if not isinstance(shape, PlaneShape):
        assert np.abs(formula).max() > 0.5


def test_a_closed_surface_is_the_box_it_was_made_of() -> None:
    x = positions()
    box = gaps(BoxShape((0.3, 0.5, 0.8)), x)
    surface = shape_box((0.6, 1.0, 1.6), edge_length=0.4)
    middle = 0.5 * (surface.points.min(axis=0) + surface.points.max(axis=0))
    shifted = np.array((-middle, np.eye(3)), dtype=POSE)
    closed = gaps(SurfaceShape(surface), x, shifted)
    assert (box.distances < 0).sum() > 10
    assert np.abs(closed.distances - box.distances).max() < 32 * EPS
    # On the ridges inside, either side is the nearest.
    assert np.quantile(np.abs(closed.normals - box.normals).max(axis=1), 0.99) < 1e-6


def test_nothing_pops_between_facets() -> None:
    # Just below a sphere of triangles, across many edges: the distance never jumps, and the
    # direction turns at most by the angle between neighbours.
    surface = shape_sphere(1.0, edge_length=0.2)
    angle = np.linspace(0.0, np.pi, 4001)
    for depth in (-0.05, 0.05):
        r = 1.0 + depth
        way = r * np.stack([np.cos(angle), 0.3 * np.sin(angle), np.sin(angle)], axis=1)
        way *= (r / np.linalg.norm(way, axis=1))[:, None]
        found = gaps(SurfaceShape(surface), way)
        step = np.linalg.norm(np.diff(way, axis=0), axis=1)
        # The distance has slope 1 at most.
        assert (np.abs(np.diff(found.distances)) <= step * (1 + 1e-9)).all()
        turn = np.linalg.norm(np.diff(found.normals, axis=0), axis=1)
        # Facets of edge 0.2 on a unit sphere meet at about 0.2 rad.
        assert turn.max() < 0.3
        assert (np.sign(found.distances) == np.sign(depth)).all()


@ALL
def test_a_pose_moves_the_distance_along(shape: ToolShape) -> None:
    path = ToolPath(
        np.array([0.0, 1.0]),
        np.array([[0.0, 0.0, 0.0], [0.3, -0.2, 0.5]]),
        np.array([[1.0, 0.0, 0.0, 0.0], [0.5, 0.5, -0.5, 0.5]]),
    )
    pose = poses_at(path, np.array([0.6]))[0]
    turn = pose["rotation"]
    x = positions()
    own, moved = gaps(shape, x), gaps(shape, x @ turn.T + pose["position"], pose)
    assert np.abs(own.distances - moved.distances).max() < 32 * EPS
    straight = np.abs(own.normals @ turn.T - moved.normals).max(axis=1)
    assert np.quantile(straight, 0.99) < 1e-9


def test_poses_at_many_times_are_the_paths_own() -> None:
    rng = np.random.default_rng(0)
    turns = rng.standard_normal((5, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    path = ToolPath(np.array([0.0, 0.3, 0.4, 1.0, 2.0]), rng.standard_normal((5, 3)), turns)
    times = np.concatenate([rng.uniform(-0.5, 2.5, 60), path.times])
    poses = poses_at(path, times)
    for pose, time in zip(poses, times, strict=True):
        position, rotation = path.pose_at(float(time))
        assert np.allclose(pose["position"], position, rtol=0, atol=16 * EPS)
        # Angles come from an arc cosine: half of the digits are lost near 0.
        assert np.allclose(pose["rotation"], rotation, rtol=0, atol=1e-7)
