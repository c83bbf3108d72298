"""Tools in explicit steps: nothing inside, momentum is the impulse, and refusals by name."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, TimeSpan
from palpate.meshes.rigid_tool import (
    ForceDrive,
    PlaneShape,
    RigidTool,
    SphereShape,
    ToolPath,
)
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference.stepping import simulate_explicit

pytestmark = pytest.mark.dolfinx

SOFT = Material(1e4, 0.3, 1000.0)
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
EPS = np.finfo(float).eps


def path(times, positions):
    return ToolPath(np.array(times), np.array(positions), np.array([UPRIGHT] * len(times)))


def test_a_plane_that_hits_a_free_cube_gives_it_the_momentum_of_its_impulse(box):
    mesh = box((3, 3, 3), jitter=0.1)
    # A floor (its inside is z <= 0) that rises by 0.5 m/s into the cube above it.
    floor = RigidTool(PlaneShape(), path([0.0, 1.0], [[0.5, 0.5, -0.01], [0.5, 0.5, 0.49]]))
    span = TimeSpan(0.3, 5e-4, 0.0, 600)
    result = simulate_explicit(Problem(mesh, SOFT, (), (), span, (floor,)))
    impulses = np.cumsum(result.tool_forces[0], axis=0) * 5e-4
    # Force on the tool: downwards, and frictionless.
    assert impulses[-1, 2] < 0.0
    assert np.abs(impulses[:, :2]).max() < 1e4 * EPS * np.abs(impulses[-1, 2])
    # Every step is stored: momentum between two is all the impulse before, from lumped masses.
    masses = np.zeros(mesh.num_points)
    corners = mesh.points[mesh.cells]
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    np.add.at(masses, mesh.cells, 1000.0 * volumes[:, None] / 4.0)
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
