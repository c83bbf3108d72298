"""The simulator's forces and trajectories against UFL, node for node."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.fastsim.dynamics import simulate
from palpate.fastsim.forces import assemble_internal_force, external_force, lumped_mass
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh

pytestmark = pytest.mark.dolfinx

MakeBox = Callable[..., TetMesh]
BOTH = pytest.mark.parametrize("strain", list(Strain))
SOFT = Material(1e4, 0.4, 1000.0)


@BOTH
@pytest.mark.parametrize("poissons_ratio", [0.0, 0.3, 0.49])
def test_internal_force_is_the_ufl_residual(
    make_box: MakeBox, strain: Strain, poissons_ratio: float
) -> None:
    from palpate.reference.residual import internal_force

    mesh = make_box((5, 4, 4), (1.0, 0.8, 0.8), ragged=0.2)
    material = Material(1e4, poissons_ratio)
    # About 10 % of the cell size, 0.2.
    u = 0.02 * np.random.default_rng(7).standard_normal(mesh.points.shape)
    ours = assemble_internal_force(mesh, u, material=material, strain=strain)
    theirs = internal_force(mesh, u, material=material, strain=strain)
    assert np.abs(ours).max() > 1.0
    assert np.abs(ours - theirs).max() < 1e-12 * np.abs(theirs).max()


@BOTH
def test_trajectory_is_the_one_of_the_ufl_residual(make_box: MakeBox, strain: Strain) -> None:
    """1 000 steps of eq. 12 with UFL's residual, the same lumped mass and the same steps."""
    from palpate.reference.equilibrium import ElasticBody
    from palpate.reference.mesh_transfer import create_space, transfer

    mesh = make_box((4, 1, 1), (2.0, 0.5, 0.5))
    held = np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32)
    span = TimeSpan(5.0, time_step=5e-3, mass_damping=2.0, num_outputs=10)
    load = BodyForce((0.0, 40.0, -200.0))
    problem = Problem(mesh, SOFT, (Support(held),), (load,), span)
    ours = simulate(problem, strain=strain)
    assert ours.num_steps == 1000

    body = ElasticBody(create_space(transfer(mesh), 1), SOFT, strain)
    mass = lumped_mass(mesh, SOFT.density)[:, None]
    force = external_force(problem)
    dt, half = ours.time_step, 0.5 * span.mass_damping * ours.time_step
    now = np.zeros_like(mesh.points)
    before = 0.5 * dt**2 * force / mass
    before[held] = 0.0
    largest = 0.0
    for step in range(1, 1001):
        internal = body.space.at_points(body.internal_force(body.space.from_points(now)))
        ahead = (dt**2 * (force - internal) / mass + 2.0 * now - (1.0 - half) * before) / (
            1.0 + half
        )
        ahead[held] = 0.0
        now, before = ahead, now
        if step % 100 == 0:
            theirs = ours.displacements[step // 100]
            largest = max(largest, float(np.abs(theirs - now).max() / np.abs(now).max()))
    assert np.abs(now).max() > 0.01
    assert largest < 1e-10
