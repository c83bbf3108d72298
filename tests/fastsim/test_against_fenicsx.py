"""The simulator's forces and trajectories against UFL, node for node."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from bodies import clamped

from palpate.fastsim.body import Body
from palpate.fastsim.dynamics import simulate
from palpate.meshes.boundary_conditions import (
    BodyForce,
    Load,
    PointForce,
    Pressure,
    Support,
    Traction,
)
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh

pytestmark = pytest.mark.dolfinx

BOTH = pytest.mark.parametrize("strain", list(Strain))
SOFT = Material(1e4, 0.4, 1000.0)


@BOTH
@pytest.mark.parametrize("poissons_ratio", [0.0, 0.3, 0.49])
def test_internal_force_is_the_ufl_residual(strain: Strain, poissons_ratio: float) -> None:
    from palpate.reference.discrete_problem import internal_force

    mesh = brick_box((5, 4, 4), (1.0, 0.8, 0.8), ragged=0.2)
    material = Material(1e4, poissons_ratio)
    # About 10 % of the cell size, 0.2.
    u = 0.02 * np.random.default_rng(7).standard_normal(mesh.points.shape)
    ours = Body(mesh, material, strain).internal_force(u)
    theirs = internal_force(mesh, u, material=material, strain=strain)
    assert np.abs(ours).max() > 1.0
    assert np.abs(ours - theirs).max() < 1e-12 * np.abs(theirs).max()


def shaken(mesh: TetMesh, span: TimeSpan, follower: bool) -> Problem:
    """Held at one end with damping; weight, a point force, a traction, perhaps a pressure."""
    end, top = side(mesh, 0, 2.0), side(mesh, 2, 0.5)
    loads: list[Load] = [
        BodyForce((0.0, 40.0, -200.0)),
        PointForce(np.array([int(top[0, 0])], dtype=np.int32), np.array([[1.0, -2.0, -6.0]])),
        Traction(end, (60.0, 20.0, -10.0)),
    ]
    if follower:
        loads.append(Pressure(top, 60.0))
    return Problem(mesh, SOFT, (clamped(mesh),), tuple(loads), span)


@BOTH
@pytest.mark.parametrize("follower", [False, True])
def test_trajectory_is_that_of_the_explicit_reference(strain: Strain, follower: bool) -> None:
    """1 000 steps with supports, damping, weight, point and surface loads."""
    from palpate.reference.stepping import simulate_explicit

    mesh = brick_box((4, 1, 1), (2.0, 0.5, 0.5), ragged=0.1)
    problem = shaken(mesh, TimeSpan(5.0, 5e-3, mass_damping=2.0, num_outputs=10), follower)
    ours = simulate(problem, strain=strain)
    assert (ours.num_steps, ours.time_step) == (1000, 5e-3)
    theirs = simulate_explicit(problem, strain=strain)
    largest = np.abs(theirs.displacements[1:]).max(axis=(1, 2))
    assert largest.min() > 0.01
    error = np.abs(ours.displacements - theirs.displacements)[1:].max(axis=(1, 2))
    assert (error / largest).max() < 1e-10


@BOTH
def test_moving_supports_and_loads_over_time_are_those_of_the_explicit_reference(
    strain: Strain,
) -> None:
    from palpate.reference.stepping import simulate_explicit

    mesh = brick_box((4, 1, 1), (2.0, 0.5, 0.5), ragged=0.1)
    problem = shaken(mesh, TimeSpan(5.0, 5e-3, mass_damping=1.0, num_outputs=10), follower=True)
    tip = np.flatnonzero(mesh.points[:, 0] > 2.0 - 1e-9).astype(np.int32)
    moved = Support(tip, components=(True, False, True), displacement=(0.05, 0.0, 0.1))
    problem = dataclasses.replace(problem, supports=(*problem.supports, moved))
    over_time = {
        "amplitude": [None, lambda t: np.sin(2.0 * t), None, lambda t: 1.0 - np.exp(-t)],
        "support_amplitude": [None, lambda t: np.sin(3.0 * t)],
    }
    ours = simulate(problem, strain=strain, **over_time)
    theirs = simulate_explicit(problem, strain=strain, **over_time)
    largest = np.abs(theirs.displacements[1:]).max(axis=(1, 2))
    assert largest.min() > 0.005
    error = np.abs(ours.displacements - theirs.displacements)[1:].max(axis=(1, 2))
    assert (error / largest).max() < 1e-10


@BOTH
def test_a_thrown_and_bent_start_is_that_of_the_explicit_reference(strain: Strain) -> None:
    from palpate.reference.stepping import simulate_explicit

    mesh = brick_box((4, 1, 1), (2.0, 0.5, 0.5), ragged=0.1)
    span = TimeSpan(1.0, 5e-3, mass_damping=0.5, num_outputs=20)
    x = mesh.points[:, :1]
    begun = {"displacement": 0.02 * x**2 * [0.0, 0.3, 1.0], "velocity": 0.4 * x * [0.2, 1.0, 0.0]}
    problem = Problem(mesh, SOFT, shaken(mesh, span, False).supports, (), span)
    ours = simulate(problem, strain=strain, tracks_energy=True, **begun)
    theirs = simulate_explicit(problem, strain=strain, **begun)
    scale = np.abs(theirs.displacements).max()
    assert np.abs(ours.displacements - theirs.displacements).max() < 1e-10 * scale
    assert ours.energies is not None
    strained = theirs.strain_energies.max()
    assert np.abs(ours.energies.strain - theirs.strain_energies).max() < 1e-10 * strained
