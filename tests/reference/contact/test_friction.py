"""Coulomb friction of tools at rest and in motion: stopping, sticking, slipping."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from bank import support

from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import ContactRule, PlaneShape, RigidTool, ToolPath
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference.dynamics import simulate_implicit
    from palpate.reference.statics import solve_static

pytestmark = pytest.mark.dolfinx

FRICTION, DEPTH = 0.3, 0.05
# Along x, in parts of the depth: out until it slips for long, and a little back.
WAYS = (0.0, 0.05, 0.1, 0.2, 0.4, 0.8, 1.2, 1.6, 1.55)


def block_on_a_plane(box, friction, turn=0.0, rule=ContactRule.VERTICES):
    """A unit cube held at its top; a plane is pressed against its bottom and drawn along."""
    mesh = box((2, 2, 2))
    fixed = support(mesh, "z1")
    along = np.array([np.cos(turn), np.sin(turn), 0.0])
    pressed = np.array([0.0, 0.0, DEPTH])
    knots = np.array([np.zeros(3), *(pressed + DEPTH * way * along for way in WAYS)])
    path = ToolPath(np.arange(len(knots)), knots)
    tool = RigidTool(PlaneShape(), path, friction, mesh.facet_groups["z0"], contact=rule)
    return Problem(mesh, Material(1.0, 0.0), (fixed,), (), tools=(tool,)), along


def felt(problem, along, strain, degree):
    """Normal force and drag at the knots after the press, shape (n,) each."""
    forces = np.array(solve_static(problem, strain=strain, degree=degree).tools[0].forces)[1:]
    return -forces[:, 2], -forces @ along


def glued(problem, along, way, strain, degree):
    """Drag where the bottom is not pressed but held, moved by a way along."""
    bottom = problem.tools[0].contact_facets
    moved = DEPTH * way * along + [0.0, 0.0, DEPTH]
    points = np.unique(bottom).astype(np.int32)
    fixed = (*problem.supports, Support(points, bottom, displacement=tuple(moved.tolist())))
    found = solve_static(
        dataclasses.replace(problem, supports=fixed, tools=()), strain=strain, degree=degree
    )
    return float(found.support_forces[1] @ along)


@pytest.mark.parametrize(
    ("strain", "degree", "turn", "rule"),
    [
        (Strain.LINEAR, 1, 0.0, ContactRule.VERTICES),
        (Strain.LINEAR, 1, 0.0, ContactRule.FACETS),
        (Strain.LINEAR, 2, 0.0, ContactRule.VERTICES),
        (Strain.GREEN, 1, 0.7, ContactRule.VERTICES),
        (Strain.GREEN, 1, 0.7, ContactRule.FACETS),
        (Strain.GREEN, 2, 0.0, ContactRule.VERTICES),
    ],
)
def test_a_block_sticks_and_then_slips_at_mu_times_the_normal_force(
    box, strain, degree, turn, rule
):
    problem, along = block_on_a_plane(box, FRICTION, turn, rule)
    normal, drag = felt(problem, along, strain, degree)
    # Pressed by e at nu = 0: E e, or E (e + e^2 / 2) (1 + e) of Saint-Venant-Kirchhoff, e = -DEPTH.
    green = (DEPTH - 0.5 * DEPTH**2) * (1.0 - DEPTH)
    np.testing.assert_allclose(normal[0], DEPTH if strain is Strain.LINEAR else green, rtol=1e-8)
    # Stuck, it is as stiff as a block that is held there; of degree 2 vertices are free to follow.
    stuck = glued(problem, along, WAYS[2], strain, degree)
    np.testing.assert_allclose(drag[2], stuck, rtol=1e-6 if degree == 1 else 0.03)
    # It never takes more than mu N, and in the end slips under that.
    assert np.all(drag <= FRICTION * normal * (1.0 + 1e-8))
    np.testing.assert_allclose(drag[7], FRICTION * normal[7], rtol=1e-3)
    assert glued(problem, along, WAYS[7], strain, degree) > 1.5 * drag[7]
    # On the way back it sticks again.
    step = (drag[8] - drag[7]) / (WAYS[8] - WAYS[7])
    np.testing.assert_allclose(step, stuck / WAYS[2], rtol=0.02 if degree == 1 else 0.2)


def test_without_friction_nothing_drags(box):
    problem, along = block_on_a_plane(box, 0.0)
    _, drag = felt(problem, along, Strain.GREEN, 1)
    np.testing.assert_allclose(drag, 0.0, atol=1e-12)


GRAVITY, COEFFICIENT, DENSITY = 10.0, 0.25, 1000.0
WAY = np.array([0.6, 0.8, 0.0])


def thrown(box, friction, dt, *, degree=1, rule=ContactRule.VERTICES):
    """A cube of 1 m, nearly rigid, thrown along the floor it lies on: its run."""
    mesh = box((1, 1, 1))
    path = ToolPath([0.0], [[0.0, 0.0, 0.0]])
    floor = RigidTool(PlaneShape(), path, friction, mesh.facet_groups["z0"], contact=rule)
    weight = BodyForce((0.0, 0.0, -GRAVITY * DENSITY))
    span = TimeSpan(0.5, dt, num_outputs=5)
    problem = Problem(mesh, Material(1e9, 0.3, DENSITY), (), (weight,), time=span, tools=(floor,))
    return simulate_implicit(
        problem,
        degree=degree,
        velocity=lambda x: np.tile(WAY, (len(x), 1)),
        spectral_radius=0.0,
    )


def along(found):
    """Mean displacement along the way [m]."""
    return found.displacements.mean(axis=1) @ WAY


@pytest.mark.parametrize(
    ("degree", "rule"),
    [(1, ContactRule.VERTICES), (1, ContactRule.FACETS), (2, ContactRule.VERTICES)],
)
def test_a_thrown_body_slows_by_mu_g_and_stops(box, degree, rule):
    coarse, fine = (thrown(box, COEFFICIENT, dt, degree=degree, rule=rule) for dt in (0.02, 0.01))
    # It stops after v / (mu g) = 0.4 s, v^2 / (2 mu g) = 0.2 m away, and stays.
    times = np.minimum(fine.times, 0.4)
    expected = times - 0.5 * COEFFICIENT * GRAVITY * times**2
    off, less = along(coarse) - expected, along(fine) - expected
    assert abs(less[-1]) < 0.02 * expected[-1]
    # What drags it sets in at once, which makes the steps first order: half of them, half of it.
    np.testing.assert_allclose(less[1:] / off[1:], 0.5, atol=0.2)
    np.testing.assert_allclose(2.0 * less - off, 0.0, atol=2e-3 * expected[-1])
    assert np.abs(fine.displacements[-1] @ [0.8, -0.6, 0.0]).max() < 1e-4
    assert fine.kinetic_energies[-1] < 1e-6 * fine.kinetic_energies[0]
    # While it slides it is dragged by mu N, N its weight.
    drag = fine.tool_forces[0, 2:4]
    weight = GRAVITY * DENSITY
    np.testing.assert_allclose(drag[:, 2], -weight, rtol=1e-6)
    np.testing.assert_allclose(drag @ WAY, COEFFICIENT * weight, rtol=1e-6)
    # Nothing else takes its energy: mu N times the way, once the weight rests on the floor.
    work, way = -np.diff(fine.external_works), np.diff(along(fine))
    np.testing.assert_allclose(work[1:], COEFFICIENT * weight * way[1:], atol=0.1)
    lost = fine.kinetic_energies[0] - fine.kinetic_energies[-1]
    limit = 2.0 * along(fine)[-1] - along(coarse)[-1]
    assert lost == pytest.approx(COEFFICIENT * weight * limit, rel=2e-3)


def test_next_to_no_friction_is_none(box):
    none, little = (thrown(box, friction, 0.05) for friction in (0.0, 1e-13))
    np.testing.assert_allclose(along(none), none.times, rtol=1e-5)
    np.testing.assert_allclose(little.displacements, none.displacements, atol=1e-11)
    np.testing.assert_allclose(none.tool_forces[0, :, :2], 0.0, atol=1e-6)


def drawn_block(box, friction, rule, *, speed=0.01):
    """A unit cube held at its top; a plane presses its bottom for 10 s, then draws it for 20 s."""
    mesh = box((2, 2, 2))
    fixed = support(mesh, "z1")
    depth, way = 0.05, 20.0 * speed
    knots = [[0.0, 0.0, 0.0], [0.0, 0.0, depth], [0.0, 0.0, depth], [way, 0.0, depth]]
    path = ToolPath([0.0, 10.0, 20.0, 40.0], knots)
    tool = RigidTool(PlaneShape(), path, friction, mesh.facet_groups["z0"], contact=rule)
    span = TimeSpan(40.0, 0.5, mass_damping=1.0, num_outputs=8)
    return Problem(mesh, Material(1.0, 0.0, 1.0), (fixed,), (), time=span, tools=(tool,))


@pytest.mark.parametrize(
    ("strain", "rule"),
    [(Strain.LINEAR, ContactRule.FACETS), (Strain.GREEN, ContactRule.VERTICES)],
)
def test_a_drawn_block_sticks_and_then_slips_at_mu_times_the_normal_force(box, strain, rule):
    fast, slow = drawn_block(box, 0.3, rule), drawn_block(box, 0.3, rule, speed=1e-4)
    found = simulate_implicit(fast, strain=strain, degree=1, spectral_radius=0.0)
    force = -found.tool_forces[0]
    assert force[-1, 0] == pytest.approx(0.3 * force[-1, 2], rel=0.01)
    # Drawn by less than makes it slip, it comes along, and is as it would be at rest.
    found = simulate_implicit(slow, strain=strain, degree=1, spectral_radius=0.0)
    bottom = np.unique(slow.tools[0].contact_facets)
    moved = found.displacements[-1, bottom] - found.displacements[4, bottom]
    np.testing.assert_allclose(moved, np.tile([2e-3, 0.0, 0.0], (len(bottom), 1)), atol=1e-6)
    still = solve_static(dataclasses.replace(slow, time=None), strain=strain, degree=1)
    np.testing.assert_allclose(found.displacements[-1], still.displacement, atol=4e-5)
    middle = found.tool_forces[0, -2:, 0]  # of the last two spans of 5 s; drag grows evenly
    *_, pressed, drawn = still.tools[0].forces
    assert middle[1] - middle[0] == pytest.approx(0.25 * (drawn[0] - pressed[0]), rel=0.02)
    assert 1e-4 < -found.tool_forces[0, -1, 0] < 0.1 * 0.05


def test_a_plate_that_arrives_on_a_whole_face_is_followed_by_short_steps(box):
    """Many nodes come at once, stick or slip, and change that from step to step."""
    mesh = box((2, 2, 1), (0.02, 0.02, 0.01))
    fixed = support(mesh, "z0")
    over = np.tile([0.0, 1.0, 0.0, 0.0], (2, 1))
    path = ToolPath([0.0, 0.01], [[0.0, 0.0, 0.01001], [1e-5, 0.0, 0.0099]], over)
    plate = RigidTool(PlaneShape(), path, 0.3, mesh.facet_groups["z1"])
    span = TimeSpan(0.01, 6.25e-4, mass_damping=200.0, num_outputs=2)
    material = Material(1e4, 0.3, 1000.0)
    problem = Problem(mesh, material, (fixed,), (), time=span, tools=(plate,))
    found = simulate_implicit(
        problem, strain=Strain.LINEAR, spectral_radius=0.0, relative_tolerance=1e-6
    )
    # Nothing was cut in two for want of an answer.
    assert found.newton_iterations < 20 * 16
    force = found.tool_forces[0, -1]
    assert 0.0 < np.linalg.norm(force[:2]) < 0.3 * force[2]
