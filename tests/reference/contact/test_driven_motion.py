"""Tools that a force drives in motion: their own inertia, what they carry, where they rest."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import ForceDrive, PlaneShape, RigidTool, SphereShape, ToolPath
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference.dynamics import simulate_implicit
    from palpate.reference.statics import solve_static
    from palpate.reference.stepping import simulate_explicit

pytestmark = pytest.mark.dolfinx

FROM_THE_START = TabularAmplitude((0.0,), (1.0,))
DOWN, UP = np.array([[0.0, 1.0, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0, 0.0]])


def pushed(mesh, force, mass, *, side="z1", friction=0.0, amplitude=FROM_THE_START):
    """A plane against a side of a unit cube, across z, driven into it."""
    sign, turn = (-1.0, DOWN) if side == "z1" else (1.0, UP)
    start = ToolPath([0.0], [[0.0, 0.0, 1.0 if side == "z1" else 0.0]], turn)
    drive = ForceDrive((0.0, 0.0, sign), force, amplitude, mass)
    return RigidTool(PlaneShape(), start, friction, mesh.facet_groups[side], drive)


def on_the_bottom(mesh):
    bottom = mesh.facet_groups["z0"]
    return Support(np.unique(bottom).astype(np.int32), bottom)


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
    held = (on_the_bottom(mesh),)
    problem = Problem(mesh, Material(1.0, 0.3, 1.0), held, (), time=span, tools=(ball,))
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
