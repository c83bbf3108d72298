"""Signed distances: right on the surface, with the derivatives they claim."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    PlaneShape,
    SphereShape,
    SurfaceShape,
    rotation_matrix,
)
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.tri_surface import OpenSurfaceError, TriSurface
from palpate.reference.contact.tool_distance import tool_distance

SHAPES = [
    SphereShape(0.3),
    CapsuleShape(0.2, 0.4),
    BoxShape((0.3, 0.4, 0.5)),
    PlaneShape(),
]
POSITION = np.array([0.1, -0.2, 0.3])
QUATERNION = np.array([0.8, 0.2, -0.4, 0.4])
ROTATION = rotation_matrix(QUATERNION / np.linalg.norm(QUATERNION))


def positions(count=400):
    return POSITION + np.random.default_rng(3).uniform(-1.0, 1.0, (count, 3))


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
def test_a_step_of_the_gap_against_the_normal_ends_on_the_surface(shape):
    x = positions()
    found = tool_distance(shape, POSITION, ROTATION, x)
    assert (found.gap < 0.0).any()
    assert (found.gap > 0.0).any()
    np.testing.assert_allclose(np.linalg.norm(found.normal, axis=1), 1.0, rtol=1e-14)
    foot = tool_distance(shape, POSITION, ROTATION, x - found.gap[:, None] * found.normal)
    np.testing.assert_allclose(foot.gap, 0.0, atol=1e-14)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
def test_normal_and_curvature_are_the_derivatives(shape):
    x, h = positions(), 1e-6
    found = tool_distance(shape, POSITION, ROTATION, x)
    for axis in range(3):
        step = h * np.eye(3)[axis]
        ahead = tool_distance(shape, POSITION, ROTATION, x + step)
        behind = tool_distance(shape, POSITION, ROTATION, x - step)
        # Away from where the nearest face, edge or corner changes.
        smooth = np.linalg.norm(ahead.normal - behind.normal, axis=1) < 1e-3
        assert smooth.mean() > 0.95
        normal = (ahead.gap - behind.gap) / (2.0 * h)
        np.testing.assert_allclose(normal[smooth], found.normal[smooth, axis], atol=1e-8)
        curvature = (ahead.normal - behind.normal) / (2.0 * h)
        scale = 1.0 + np.abs(found.curvature).max(axis=(1, 2))[:, None]
        wrong = np.abs(curvature - found.curvature[:, axis]) / scale
        assert np.quantile(wrong[smooth], 0.99) < 1e-6
    if not isinstance(shape, PlaneShape):
        assert np.abs(found.curvature).max() > 1.0


def test_distances_by_hand():
    turned = rotation_matrix(np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]))  # z onto -y
    x = np.array([[0.0, -2.0, 0.0], [0.0, 0.0, 1.0]])
    capsule = tool_distance(CapsuleShape(0.25, 1.0), np.zeros(3), turned, x)
    np.testing.assert_allclose(capsule.gap, [0.75, 0.75], rtol=1e-15)
    plane = tool_distance(PlaneShape(), np.zeros(3), turned, x)
    np.testing.assert_allclose(plane.gap, [2.0, 0.0], atol=1e-15)
    corner = tool_distance(BoxShape((1.0, 1.0, 1.0)), np.zeros(3), np.eye(3), 2.0 * np.ones((1, 3)))
    assert corner.gap[0] == pytest.approx(np.sqrt(3.0), rel=1e-15)


def test_a_surface_of_a_box_is_the_box():
    half = np.array([0.3, 0.2, 0.25])
    box = shape_box(tuple(2.0 * half), edge_length=0.2)
    centred = TriSurface(box.points - box.points.mean(axis=0), box.facets)
    x = 0.6 * np.random.default_rng(3).uniform(-1.0, 1.0, (400, 3))
    mine = tool_distance(SurfaceShape(centred), POSITION, ROTATION, POSITION + x @ ROTATION.T)
    its = tool_distance(BoxShape(tuple(half)), POSITION, ROTATION, POSITION + x @ ROTATION.T)
    assert (its.gap < 0.0).sum() > 20
    for name in ("gap", "normal", "curvature"):
        np.testing.assert_allclose(getattr(mine, name), getattr(its, name), atol=1e-13)


def test_a_hollow_edge_of_a_surface_bends_the_other_way():
    """A wedge cut out of a prism: inside, the nearest place is the wedge's edge."""
    profile = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [0.0, 0.0], [-1.0, 1.0]])
    points = np.array([[x, y, z] for y in (-2.0, 2.0) for x, z in profile])
    caps = [[0, 1, 3], [1, 2, 3], [0, 3, 4]]
    sides = [[[i, i + 5, j], [j, i + 5, j + 5]] for i, j in ((i, (i + 1) % 5) for i in range(5))]
    facets = [*caps, *([5 + a, 5 + c, 5 + b] for a, b, c in caps), *np.reshape(sides, (-1, 3))]
    prism = SurfaceShape(TriSurface(points, np.array(facets, dtype=np.int32)))
    x = np.array([[0.05, 0.3, -0.2]])
    found = tool_distance(prism, np.zeros(3), np.eye(3), x)
    length = np.hypot(0.05, 0.2)
    normal = np.array([-0.05, 0.0, 0.2]) / length
    np.testing.assert_allclose(found.gap, [-length], rtol=1e-14)
    np.testing.assert_allclose(found.normal, [normal], atol=1e-14)
    across = np.array([0.2, 0.0, 0.05]) / length
    np.testing.assert_allclose(found.curvature, [-np.outer(across, across) / length], atol=1e-13)


def test_a_surface_with_a_hole_is_refused():
    whole = shape_sphere(0.1, edge_length=0.05)
    holed = SurfaceShape(TriSurface(whole.points, whole.facets[1:]))
    with pytest.raises(OpenSurfaceError):
        tool_distance(holed, POSITION, ROTATION, positions(3))
