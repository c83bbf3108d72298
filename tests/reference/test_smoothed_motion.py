"""Explicit motion of smoothed tetrahedra: momentum, energy, tools, and a process of its own."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import PlaneShape, RigidTool, ToolPath
from palpate.reference.availability import is_available
from palpate.reference.child import run_task
from palpate.reference.schemes import Integrator
from palpate.reference.tasks import SteppedTask

if is_available():
    from palpate.reference.stepping import simulate_explicit

pytestmark = pytest.mark.dolfinx

SOFT, HARD = Material(1e4, 0.3, 1000.0), Material(5e4, 0.45, 1500.0)
BOTH = pytest.mark.parametrize("strain", list(Strain))
SMOOTHED = Element.SMOOTHED


def body_of(mesh, span, **more):
    hard = np.flatnonzero(mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.5).astype(np.int32)
    return Problem(mesh, SOFT, (), (), span, inclusions=(Inclusion(hard, HARD),), **more)


def mass_of(problem):
    mesh = problem.mesh
    density = np.full(mesh.num_cells, problem.material.density)
    for inclusion in problem.inclusions:
        density[inclusion.cells] = inclusion.material.density
    x = mesh.points[mesh.cells]
    mass = np.zeros(mesh.num_points)
    np.add.at(mass, mesh.cells, (density * np.linalg.det(x[:, 1:] - x[:, :1]) / 24)[:, None])
    return mass


def test_momentum_and_angular_momentum_stay_and_energy_nearly(box):
    steps, dt = 400, 5e-4
    problem = body_of(box((2, 2, 1), jitter=0.2), TimeSpan(steps * dt, dt, 0.0, steps))
    mass, rest = mass_of(problem)[:, None], problem.mesh.points
    velocity = np.random.default_rng(2).standard_normal(rest.shape)
    result = simulate_explicit(problem, velocity=velocity, element=SMOOTHED)
    u = result.displacements
    middle = (u[1:] - u[:-1]) / dt  # velocities between the outputs, which are the steps
    momentum = (mass * middle).sum(axis=1)
    assert np.abs(np.diff(momentum, axis=0)).max() <= 1e-12 * mass.sum()
    # x_n x m (x_{n+1} - x_n) changes by x_n x f_n, which is nothing: central differences keep it.
    spin = np.cross(rest + u[:-1], mass * middle).sum(axis=1)
    assert np.abs(spin[0]).max() > 0.01
    assert np.abs(np.diff(spin, axis=0)).max() <= 1e-12 * mass.sum()
    kinetic = 0.5 * (mass * ((u[2:] - u[:-2]) / (2 * dt)) ** 2).sum(axis=(1, 2))
    total = kinetic + result.strain_energies[1:-1]
    assert result.strain_energies.max() > 0.2 * total[0]
    # Second order in the step: the highest modes turn by about half a radian in one.
    assert np.ptp(total) < 0.05 * total[0]


@BOTH
def test_an_affine_state_starts_like_that_of_plain_tetrahedra_and_a_bent_one_does_not(box, strain):
    mesh = box((2, 2, 1), jitter=0.2)
    problem = body_of(mesh, TimeSpan(1e-2, 1e-2, 0.0, 1))
    alone = dataclasses.replace(problem, inclusions=())
    stretched = mesh.points @ np.array([[0.1, 0.05, 0.0], [0.0, -0.08, 0.03], [0.04, 0.0, 0.06]])
    moved = {
        element: simulate_explicit(alone, strain=strain, displacement=stretched, element=element)
        for element in Element
    }
    smoothed, plain = (moved[e].displacements[1] - stretched for e in (SMOOTHED, Element.LINEAR))
    assert np.abs(plain).max() > 1e-6
    assert np.abs(smoothed - plain).max() <= 1e-9 * np.abs(plain).max()
    bent = 0.2 * mesh.points[:, [1, 2, 0]] ** 2
    ends = [
        simulate_explicit(alone, strain=strain, displacement=bent, element=e).displacements[1]
        for e in Element
    ]
    assert np.abs(ends[0] - ends[1]).max() > 0.01 * np.abs(ends[0] - bent).max()


def test_a_tool_gives_a_free_body_the_momentum_that_it_loses(box):
    steps, dt = 200, 1e-3
    mesh = box((2, 2, 2), jitter=0.2)
    path = np.array([[0.5, 0.5, 1.01], [0.5, 0.5, 0.9]])
    turns = np.tile((0.0, 1.0, 0.0, 0.0), (2, 1))
    tool = RigidTool(PlaneShape(), ToolPath(np.array([0.0, steps * dt]), path, turns))
    problem = body_of(mesh, TimeSpan(steps * dt, dt, 0.0, steps), tools=(tool,))
    result = simulate_explicit(problem, element=SMOOTHED)
    u, mass = result.displacements, mass_of(problem)[:, None]
    gained = (mass * (u[-1] - u[-2])).sum(axis=0) / dt
    given = -result.tool_forces[0].sum(axis=0) * dt
    assert given[2] < -10.0
    assert np.abs(gained - given).max() <= 1e-10 * np.abs(given).max()
    heights = np.interp(result.times, [0.0, steps * dt], path[:, 2])
    assert ((mesh.points + u)[:, :, 2].max(axis=1) - heights).max() < 1e-12


def test_the_child_gives_the_same_trajectory_bit_for_bit(box):
    mesh = box((3, 1, 1), (0.3, 0.1, 0.1))
    held = mesh.facet_groups["x0"]
    supports = (Support(np.unique(held).astype(np.int32), held),)
    span = TimeSpan(0.05, 1e-3, 1.0, 5)
    swing = Problem(mesh, Material(1e4, 0.35), supports, (BodyForce((0.0, 90.0, -300.0)),), span)
    there = run_task(
        SteppedTask(Integrator.CENTRAL_DIFFERENCES, element=SMOOTHED), swing, time_limit=120
    )
    here = simulate_explicit(swing, element=SMOOTHED)
    assert np.array_equal(there.displacements, here.displacements)
    plain = simulate_explicit(swing)
    assert np.abs(there.displacements[-1] - plain.displacements[-1]).max() > 1e-6
