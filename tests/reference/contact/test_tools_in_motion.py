"""Rigid tools in implicit and explicit steps, moved and driven by a force."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from bank import lumped_mass, support

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, InitialVelocity, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import ForceDrive, PlaneShape, RigidTool, SphereShape, ToolPath
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference.dynamics import simulate_implicit
    from palpate.reference.statics import solve_static
    from palpate.reference.stepping import simulate_explicit

pytestmark = pytest.mark.dolfinx


def pushed_bar(box, steps):
    """A bar of 1 m by 0.1 m by 0.1 m at rest, on whose end a plane comes with 0.01 m/s.

    With nu = 0 nothing moves sideways: a plane wave of speed sqrt(E / rho) = 1 m/s, whose force
    is rho c A v = 1e-4 N until its echo from the free end is back, after 2 s.
    """
    mesh = box((20, 1, 1), (1.0, 0.1, 0.1))
    turned = np.array([[math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0]] * 2)  # +z to +x
    path = ToolPath([0.0, 2.0], [[0.0, 0.0, 0.0], [0.02, 0.0, 0.0]], turned)
    tool = RigidTool(PlaneShape(), path, contact_facets=mesh.facet_groups["x0"])
    span = TimeSpan(1.6, 0.2 / steps, num_outputs=8)
    return Problem(mesh, Material(1.0, 0.0, 1.0), (), (), time=span, tools=(tool,))


def test_a_plane_feels_the_impedance_of_a_bar(box):
    problem = pushed_bar(box, 20)
    found = simulate_implicit(problem, strain=Strain.LINEAR, spectral_radius=0.5)
    forces = found.tool_forces[0]
    np.testing.assert_allclose(forces[1:, 0], -1e-4, rtol=0.01)
    np.testing.assert_allclose(forces[1:, 1:], 0.0, atol=1e-8)
    # Behind the front every place moves with the tool, behind its echo twice as fast.
    x = problem.mesh.points[:, 0]
    expected = 0.01 * (np.maximum(0.0, 1.6 - x) + np.maximum(0.0, 1.6 - (2.0 - x)))
    np.testing.assert_allclose(found.displacements[-1][:, 0], expected, atol=0.01 * 0.016)
    # The tool's work is all there is in the body, but for what the method takes from the front.
    assert abs(found.energy_errors[-1]) < 0.02 * found.external_works[-1]


def test_a_body_flies_freely_before_it_meets_a_wall(box):
    # Until then all forces are rounding: none is small beside the others.
    mesh = box((4, 1, 1), (1.0, 0.25, 0.25))
    wall = RigidTool(
        PlaneShape(),
        ToolPath(
            [0.0], [[-0.01, 0.0, 0.0]], np.array([[math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0]])
        ),
        contact_facets=mesh.facet_groups["x0"],
    )
    span = TimeSpan(0.9, 0.1, num_outputs=3)
    flight = InitialVelocity((-0.02, 0.0, 0.0))
    problem = Problem(mesh, Material(1.0, 0.0, 1.0), (), (), span, (wall,), initial_velocity=flight)
    found = simulate_implicit(problem, strain=Strain.LINEAR)
    # It meets the wall at 0.5 s; the front that begins there has gone 0.4 m at 0.9 s.
    np.testing.assert_allclose(found.displacements[1][:, 0], -0.006, rtol=1e-9)
    far = mesh.points[:, 0] > 0.9
    np.testing.assert_allclose(found.displacements[3][far, 0], -0.018, rtol=0.02)


def test_a_force_that_grows_is_told_at_its_time(box):
    """The plane gathers speed: rho c A a t, whose mean is that of the middle between outputs.

    Forces are balanced beyond the middle of a step. Told as if there, they would be a sixth of a
    step's growth too large, at a spectral radius of a half.
    """
    problem, dt, growth = pushed_bar(box, 4), 0.05, 1e-4
    times = np.arange(0.0, 1.6 + dt / 2, dt)
    places = np.outer(0.005 * times**2, [1.0, 0.0, 0.0])
    (tool,) = problem.tools
    path = ToolPath(times, places, np.tile(tool.path.rotations[0], (len(times), 1)))
    gathering = dataclasses.replace(
        problem,
        tools=(dataclasses.replace(tool, path=path),),
        time=TimeSpan(1.6, dt, num_outputs=8),
    )
    found = simulate_implicit(gathering, strain=Strain.LINEAR, spectral_radius=0.5)
    off = -found.tool_forces[0, 1:, 0] - growth * (np.arange(8) + 0.5) * 0.2
    assert abs(off[2:].mean()) < 0.03 * growth * dt


def pressed_slab(box, span, knots):
    """A slab of 6 x 4 x 2 m on a held bottom, and a ball of 2 m that comes 0.3 m deep."""
    mesh = box((3, 2, 1), (6.0, 4.0, 2.0))
    fixed = support(mesh, "z0")
    places = np.array([[2.8, 1.9, 4.05], [2.8, 1.9, 3.7], [2.8, 1.9, 3.7]])
    tool = RigidTool(SphereShape(2.0), ToolPath(knots, places[: len(knots)]))
    return Problem(mesh, Material(1.0, 0.3, 1.0), (fixed,), (), time=span, tools=(tool,))


@pytest.mark.parametrize("strain", list(Strain))
def test_slow_pressing_comes_to_the_equilibrium(box, strain):
    span = TimeSpan(60.0, 1.5, mass_damping=1.0, num_outputs=8)
    problem = pressed_slab(box, span, [0.0, 20.0, 60.0])
    found = simulate_implicit(problem, strain=strain, spectral_radius=0.5)
    still = dataclasses.replace(problem, time=None)
    static = solve_static(still, strain=strain, degree=2)
    force = np.array(static.tools[0].forces[-1])
    np.testing.assert_allclose(found.tool_forces[0, -1], force, atol=1e-4 * np.abs(force).max())
    size = np.abs(static.displacement).max()
    np.testing.assert_allclose(found.displacements[-1], static.displacement, atol=1e-4 * size)


def test_implicit_and_explicit_steps_find_the_same_force(box):
    """The same tetrahedra, lumped masses and nodes: short steps leave little difference.

    A node of 1 kg is caught on the way: the impulse of that is in the force as well.
    """
    span = TimeSpan(4.0, 0.0125, mass_damping=0.5, num_outputs=8)
    problem = pressed_slab(box, span, [0.0, 4.0])
    explicit = simulate_explicit(problem)
    implicit = simulate_implicit(problem, degree=1, is_mass_lumped=True, spectral_radius=0.5)
    largest = np.abs(explicit.tool_forces).max()
    np.testing.assert_allclose(
        implicit.tool_forces, explicit.tool_forces, atol=0.01 * largest, rtol=0.0
    )
    size = np.abs(explicit.displacements).max()
    np.testing.assert_allclose(implicit.displacements, explicit.displacements, atol=1e-3 * size)


def test_a_tool_inside_the_body_at_the_start_is_refused(box):
    problem = pressed_slab(box, TimeSpan(1.0, 0.5, num_outputs=1), [0.0])
    tool = problem.tools[0]
    inside = dataclasses.replace(tool, path=ToolPath([0.0], [[2.8, 1.9, 3.5]]))
    with pytest.raises(InputError, match="deep in the body at the start"):
        simulate_implicit(dataclasses.replace(problem, tools=(inside,)), degree=1)
    # Outside with every point, it is inside by the average that is kept out of it.
    over_facets = dataclasses.replace(tool, contact="facets")
    for simulate in (lambda of: simulate_implicit(of, degree=1), simulate_explicit):
        with pytest.raises(InputError, match="start, by the average over a facet; begin"):
            simulate(dataclasses.replace(problem, tools=(over_facets,)))


FROM_THE_START = TabularAmplitude((0.0,), (1.0,))
DOWN, UP = np.array([[0.0, 1.0, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0, 0.0]])


def pushed(mesh, force, mass, *, side="z1", friction=0.0, amplitude=FROM_THE_START):
    """A plane against a side of a unit cube, across z, driven into it."""
    sign, turn = (-1.0, DOWN) if side == "z1" else (1.0, UP)
    start = ToolPath([0.0], [[0.0, 0.0, 1.0 if side == "z1" else 0.0]], turn)
    drive = ForceDrive((0.0, 0.0, sign), force, amplitude, mass)
    return RigidTool(PlaneShape(), start, friction, mesh.facet_groups[side], drive)


def on_the_bottom(mesh):
    return support(mesh, "z0")


def test_a_mass_on_a_light_column_swings(box):
    """Stiffness E A / H = 1 N/m, and a third of the column moves along (Rayleigh)."""
    mesh = box((1, 1, 2))
    material = Material(1.0, 0.0, 1e-3)
    off = []
    for dt in (0.2, 0.1):
        span = TimeSpan(6.0, dt, num_outputs=6)
        tools = (pushed(mesh, 0.05, 1.0),)
        problem = Problem(mesh, material, (on_the_bottom(mesh),), (), time=span, tools=tools)
        found = simulate_implicit(problem, strain=Strain.LINEAR, degree=1, spectral_radius=0.9)
        top = np.unique(mesh.facet_groups["z1"])
        way = -found.displacements[:, top, 2].mean(axis=1)
        expected = 0.05 * (1.0 - np.cos(found.times / np.sqrt(1.0 + 1e-3 / 3.0)))
        off.append(np.abs(way - expected).max())
    assert off[1] < 0.003 * 0.1
    assert off[1] < 0.3 * off[0]  # second order in time


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_tool_and_free_body_share_the_force(box, friction):
    """They go on as one: F / (m + M) each, and the body pushes back with M F / (m + M)."""
    mesh = box((1, 1, 1))
    force, mass, body = 12.0, 1.0, 2.0
    tools = (pushed(mesh, force, mass, friction=friction),)
    span = TimeSpan(1.0, 0.05, num_outputs=2)
    problem = Problem(mesh, Material(1e6, 0.3, body), (), (), time=span, tools=tools)
    found = simulate_implicit(problem, degree=1, spectral_radius=0.0)
    speed = found.velocities[-1].mean(axis=0)
    np.testing.assert_allclose(speed, [0.0, 0.0, -force / (mass + body)], atol=0.05 * 4.0)
    felt = found.tool_forces[0, -1]
    np.testing.assert_allclose(felt, [0.0, 0.0, body * force / (mass + body)], atol=1e-3 * force)
    # What the force gave is in both: the tool's part is what it did not hand on.
    given = 0.5 * found.tool_forces[0, :, 2].sum()
    assert -body * found.velocities[-1, :, 2].mean() == pytest.approx(given, rel=0.03)


def test_a_ball_comes_to_rest_where_statics_have_it(box):
    mesh = box((3, 2, 1), (6.0, 4.0, 2.0))
    rising = TabularAmplitude((0.0, 10.0), (0.0, 1.0), True)
    drive = ForceDrive((0.0, 0.0, -1.0), 0.4, rising, mass=2.0)
    ball = RigidTool(SphereShape(2.0), ToolPath([0.0], [[2.8, 1.9, 4.05]]), drive=drive)
    span = TimeSpan(60.0, 1.0, mass_damping=1.0, num_outputs=6)
    fixed = (on_the_bottom(mesh),)
    problem = Problem(mesh, Material(1.0, 0.3, 1.0), fixed, (), time=span, tools=(ball,))
    found = simulate_implicit(problem, degree=1, spectral_radius=0.0)
    still = solve_static(dataclasses.replace(problem, time=None), degree=1)
    assert found.tool_forces[0, -1, 2] == pytest.approx(0.4, rel=1e-3)
    size = np.abs(still.displacement).max()
    np.testing.assert_allclose(found.displacements[-1], still.displacement, atol=2e-3 * size)


def test_two_tools_squeeze_a_free_body_in_its_place(box):
    mesh = box((1, 1, 2))
    material = Material(1.0, 0.0, 1.0)
    rising = TabularAmplitude((0.0, 10.0), (0.0, 1.0), True)
    tools = tuple(pushed(mesh, 0.05, 0.5, side=side, amplitude=rising) for side in ("z0", "z1"))
    span = TimeSpan(40.0, 0.5, mass_damping=1.0, num_outputs=2)
    problem = Problem(mesh, material, (), (), time=span, tools=tools)
    found = simulate_implicit(problem, strain=Strain.LINEAR, degree=1, spectral_radius=0.0)
    expected = 0.05 * (0.5 - mesh.points[:, 2])  # F / (E A) = 0.05
    np.testing.assert_allclose(found.displacements[-1][:, 2], expected, atol=1e-3 * 0.05)
    np.testing.assert_allclose(found.tool_forces[:, -1, 2], [-0.05, 0.05], rtol=1e-3)


def test_the_same_mesh_reference_says_what_to_do_instead(box):
    mesh = box((1, 1, 1))
    span = TimeSpan(1.0, 0.1, num_outputs=1)
    tools = (pushed(mesh, 1.0, 1.0),)
    problem = Problem(mesh, Material(1.0, 0.3, 1.0), (), (), time=span, tools=tools)
    with pytest.raises(InputError, match='against = "truth"'):
        simulate_explicit(problem)


SOFT = Material(1e4, 0.3, 1000.0)
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
EPS = np.finfo(float).eps


def path(times, positions):
    return ToolPath(np.array(times), np.array(positions), np.array([UPRIGHT] * len(times)))


@pytest.mark.parametrize("element", list(Element))
def test_a_plane_that_hits_a_free_cube_gives_it_the_momentum_of_its_impulse(box, element):
    mesh = box((3, 3, 3), jitter=0.1)
    # A floor (its inside is z <= 0) that rises by 0.5 m/s into the cube above it.
    floor = RigidTool(PlaneShape(), path([0.0, 1.0], [[0.5, 0.5, -0.01], [0.5, 0.5, 0.49]]))
    span = TimeSpan(0.3, 5e-4, 0.0, 600)
    problem = Problem(mesh, SOFT, (), (), span, (floor,))
    result = simulate_explicit(problem, element=element)
    impulses = np.cumsum(result.tool_forces[0], axis=0) * 5e-4
    # Force on the tool: downwards, and frictionless.
    assert impulses[-1, 2] < 0.0
    assert np.abs(impulses[:, :2]).max() < 1e4 * EPS * np.abs(impulses[-1, 2])
    # Every step is stored: momentum between two is all the impulse before, from lumped masses.
    masses = lumped_mass(problem)
    momentum = np.einsum("p,tpi->ti", masses, np.diff(result.displacements, axis=0)) / 5e-4
    assert momentum[-1, 2] > 0.3 * masses.sum() * 0.5
    assert np.abs(momentum + impulses[1:]).max() < 1e6 * EPS * np.abs(momentum).max()
    height = mesh.points[:, 2] + result.displacements[..., 2]
    lowest = height.min(axis=1)
    floor_at = -0.01 + 0.5 * result.times
    assert (lowest - floor_at).min() > -1e3 * EPS


def test_held_components_stay_and_the_rest_leaves_the_ball(box):
    mesh = box((4, 4, 2), (1.0, 1.0, 0.5))
    bottom = np.flatnonzero(mesh.points[:, 2] == 0.0).astype(np.int32)
    top = np.flatnonzero(mesh.points[:, 2] == 0.5).astype(np.int32)
    supports = (Support(bottom), Support(top, components=(True, False, False)))
    ball = RigidTool(SphereShape(0.4), path([0.0, 0.2], [[0.55, 0.5, 0.91], [0.6, 0.5, 0.8]]))
    span = TimeSpan(0.2, 1e-3, 5.0, 4)
    result = simulate_explicit(Problem(mesh, SOFT, supports, (), span, (ball,)))
    last = result.displacements[-1]
    assert np.abs(last[top, 0]).max() == 0.0
    assert np.abs(last).max() > 0.05
    distances = np.linalg.norm(mesh.points + last - [0.6, 0.5, 0.8], axis=1) - 0.4
    assert distances.min() > -1e-9
    assert (np.abs(distances) < 1e-9).sum() >= 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {
                "drive": ForceDrive((0.0, 0.0, -1.0), 1.0, TabularAmplitude((0.0,), (1.0,)), 0.1),
                "path": path([0.0], [[0.5, 0.5, 1.6]]),
            },
            'checks against = "truth"',
        ),
        ({"path": path([0.0, 1.0], [[0.5, 0.5, 1.3], [0.5, 0.5, 1.0]])}, "0.2 m deep"),
    ],
)
def test_what_the_explicit_reference_cannot_do_is_refused(box, change, words):
    ball = RigidTool(SphereShape(0.5), path([0.0, 1.0], [[0.5, 0.5, 1.6], [0.5, 0.5, 1.5]]))
    tool = dataclasses.replace(ball, **change)
    problem = Problem(box((2, 2, 2)), SOFT, (), (), TimeSpan(0.01, 1e-3, 0.0, 2), (tool,))
    with pytest.raises(InputError, match=words):
        simulate_explicit(problem)
