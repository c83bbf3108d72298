"""Surfaces that touch: balance, gradient, bodies that meet and part, a bar folded onto itself."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.collision.detection import VertexCellDetector
from palpate.fastsim.collision.surface_contact import SurfaceContact, bodies_of
from palpate.fastsim.forces import assemble_internal_force, lumped_mass
from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.tet_mesh import TetMesh

BOX = mesh_surface(shape_box(edge_length=0.25))
BALL = mesh_surface(shape_sphere(0.5, edge_length=0.25))
TISSUE = Material(1e4, 0.3, 1000.0)
THICKNESS = 0.05
STIFFNESS = 1e4 / 0.05


def two_bodies(gap: float) -> TetMesh:
    """A box, and a ball above its middle."""
    ball = BALL.points + np.array([0.53, 0.51, 1.5 + gap])
    return TetMesh(
        np.vstack([BOX.points, ball]), np.vstack([BOX.cells, BALL.cells + BOX.num_points])
    )


def contact_of(mesh: TetMesh) -> SurfaceContact:
    return SurfaceContact(mesh, thickness=THICKNESS, stiffness=STIFFNESS)


def test_bodies_are_told_apart():
    body = bodies_of(two_bodies(1.0))
    assert set(body[: BOX.num_points]) == {0}
    assert set(body[BOX.num_points :]) == {BOX.num_points}


def test_force_and_moment_are_balanced_and_the_force_is_the_gradient():
    mesh = two_bodies(0.0)
    contact = contact_of(mesh)
    rng = np.random.default_rng(5)
    points = mesh.points + 0.01 * rng.standard_normal(mesh.points.shape)
    there = contact.forces(points)
    assert len(there.vertices) > 1
    largest = np.abs(there.force).max()
    assert largest > 0.0
    eps = np.finfo(float).eps
    assert np.abs(there.force.sum(axis=0)).max() < 100.0 * eps * largest
    assert np.abs(np.cross(points, there.force).sum(axis=0)).max() < 1000.0 * eps * largest
    # Energy differs by -force . du, and by the curvature's (h / d)^2.
    way = rng.standard_normal(points.shape)
    h = 1e-6 * THICKNESS
    slope = (contact.forces(points + h * way).energy - contact.forces(points - h * way).energy) / (
        2.0 * h
    )
    assert abs(slope) > 1e-3 * largest
    assert slope == pytest.approx(-float((there.force * way).sum()), rel=1e-6)


def test_nothing_pushes_at_rest_or_apart():
    for mesh in (BOX, two_bodies(2.0 * THICKNESS)):
        found = contact_of(mesh).forces(mesh.points)
        assert not found.force.any()
        assert found.energy == 0.0


def test_bodies_that_touch_at_rest_push_at_once():
    mesh = two_bodies(0.5 * THICKNESS)
    found = contact_of(mesh).forces(mesh.points)
    assert found.energy > 0.0
    # The ball above is pushed up, the box below down.
    assert found.force[BOX.num_points :, 2].sum() > 0.0 > found.force[: BOX.num_points, 2].sum()


def test_two_bodies_meet_and_part():
    mesh = two_bodies(2.0 * THICKNESS)
    contact = contact_of(mesh)
    mass = lumped_mass(mesh, TISSUE.density)[:, None]
    is_ball = np.arange(mesh.num_points) >= BOX.num_points
    velocity = np.where(is_ball[:, None], [0.0, 0.0, -1.0], [0.0, 0.0, 0.0])
    displacement = np.zeros_like(mesh.points)
    # Waves pass at 3.7 m/s: a fifth of the way through the smallest cell's height of about 0.1 m.
    step = 5e-3
    momentum = (mass * velocity).sum(axis=0)
    inside = VertexCellDetector(mesh)
    ball_speeds, most = [], 0
    for _ in range(260):
        found = contact.forces(mesh.points + displacement)
        force = found.force - assemble_internal_force(mesh, displacement, material=TISSUE)
        velocity = velocity + step * force / mass
        assert step * np.abs(velocity).max() < contact.largest_step
        displacement = displacement + step * velocity
        ball_speeds.append(float((mass * velocity)[is_ball, 2].sum() / mass[is_ball].sum()))
        most = max(most, len(found.vertices))
        assert len(inside.find(mesh.points + displacement)) == 0
    assert most > 3
    assert found.energy == 0.0  # parted again
    assert ball_speeds[0] == pytest.approx(-1.0, abs=1e-12)
    assert ball_speeds[-1] > 0.2
    after = (mass * velocity).sum(axis=0)
    # Rounding of some 260 sums over 500 points.
    assert after == pytest.approx(momentum, abs=1e-11 * np.abs(momentum).max())


def test_a_bar_bent_into_a_ring_pushes_itself_where_its_ends_meet():
    bar = mesh_surface(shape_box((6.0, 1.0, 0.5), edge_length=0.25))
    contact = contact_of(bar)
    pushed = []
    for turn in (0.5, 0.9, 0.97, 0.995):
        radius = 6.0 / (2.0 * np.pi * turn)
        angle = bar.points[:, 0] / radius
        r = radius - bar.points[:, 2]
        points = np.column_stack([r * np.sin(angle), bar.points[:, 1], radius - r * np.cos(angle)])
        found = contact.forces(points)
        pushed.append(len(found.vertices))
        # End against end, six lengths apart at rest; the squeezed inner side does not push itself.
        x = bar.points[:, 0]
        assert np.all((x[found.vertices] < 0.3) | (x[found.vertices] > 5.7))
        assert np.all(np.abs(x[found.vertices] - x[bar.boundary_facets[found.facets, 0]]) > 5.0)
        # Outward from the gap: the first end forward along the bar, the last end back.
        ends = [found.force[x < 1e-9, 0].sum(), found.force[x > 6.0 - 1e-9, 0].sum()]
        assert ends[0] >= 0.0 >= ends[1]
    assert pushed[:2] == [0, 0]
    assert pushed[-1] > 10


@pytest.mark.parametrize("option", ["thickness", "stiffness"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_refusals(option: str, value: float):
    options = {"thickness": THICKNESS, "stiffness": STIFFNESS, option: value}
    with pytest.raises(InputError, match=option):
        SurfaceContact(BOX, **options)
