"""Rigid tools in implicit motion, against closed forms, equilibrium and explicit steps."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import PlaneShape, RigidTool, SphereShape, ToolPath
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
    bottom = mesh.facet_groups["z0"]
    held = Support(np.unique(bottom).astype(np.int32), bottom)
    places = np.array([[2.8, 1.9, 4.05], [2.8, 1.9, 3.7], [2.8, 1.9, 3.7]])
    tool = RigidTool(SphereShape(2.0), ToolPath(knots, places[: len(knots)]))
    return Problem(mesh, Material(1.0, 0.3, 1.0), (held,), (), time=span, tools=(tool,))


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
