"""Multigrid as a preconditioner: same solutions, few iterations, symmetric."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim import newton, statics
from palpate.fastsim.body import Body
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh

SOFT = Material(1e4, 0.3, 1000.0)


def cantilever(mesh: TetMesh) -> Problem:
    fixed = np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32)
    # A roller on one side: components fixed one by one.
    side = np.flatnonzero(mesh.points[:, 1] < 1e-9).astype(np.int32)
    roller = Support(side, components=(False, True, False))
    return Problem(mesh, SOFT, (Support(fixed), roller), (BodyForce((1.0, 0.0, -10.0)),))


@pytest.mark.parametrize("strain", list(Strain))
def test_multigrid_and_diagonal_blocks_find_the_same_equilibrium(
    strain: Strain, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = cantilever(brick_box((16, 4, 4), (4.0, 1.0, 1.0), ragged=0.15))
    found = []
    for threshold in (0, 10**9):
        monkeypatch.setattr(newton, "MULTIGRID_FROM_POINTS", threshold)
        found.append(statics.solve_static(problem, strain=strain))
    multigrid, blocks = found
    difference = np.linalg.norm(multigrid.displacement - blocks.displacement)
    assert difference < 1e-8 * np.linalg.norm(blocks.displacement)
    assert multigrid.linear_iterations < 0.5 * blocks.linear_iterations


def test_iterations_hardly_grow_with_the_mesh() -> None:
    counts = [
        statics.solve_static(
            cantilever(brick_box((4 * n, n, n), (4.0, 1.0, 1.0))), strain=Strain.LINEAR
        ).linear_iterations
        for n in (8, 14)
    ]
    # Eight times fewer unknowns would give 14/8 = 1.75 with diagonal blocks alone.
    assert counts[1] < 1.4 * counts[0]


def test_one_cycle_is_symmetric_and_positive() -> None:
    """What conjugate gradients ask of a preconditioner, by one iteration from chosen sides."""
    mesh = brick_box((12, 5, 5), (2.4, 1.0, 1.0), ragged=0.1)
    core = Body(mesh, SOFT, Strain.LINEAR).core
    u = np.zeros_like(mesh.points)
    core.assemble_tangent(u)
    is_free = np.ones(mesh.points.shape, np.uint8)
    is_free[mesh.points[:, 0] < 1e-9] = 0
    assert core.build_multigrid(is_free) >= 2

    rng = np.random.default_rng(0)
    x, y = (rng.standard_normal(u.shape) * is_free for _ in range(2))
    Mx, My = core.apply_multigrid(x), core.apply_multigrid(y)
    assert np.sum(x * Mx) > 0.0
    assert abs(np.sum(y * Mx) - np.sum(x * My)) < 1e-12 * np.linalg.norm(y) * np.linalg.norm(Mx)
    assert not Mx[is_free == 0].any()


def test_a_body_in_two_parts_and_thin_parts_are_solved() -> None:
    one = brick_box((20, 3, 3), (4.0, 0.5, 0.5))
    other = one.points + np.array([0.0, 5.0, 0.0])
    mesh = TetMesh(
        np.concatenate([one.points, other]), np.concatenate([one.cells, one.cells + one.num_points])
    )
    problem = Problem(
        mesh,
        SOFT,
        (Support(np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32)),),
        (BodyForce((0.0, 0.0, -2.0)),),
    )
    result = statics.solve_static(problem)
    halves = result.displacement.reshape(2, -1, 3)
    assert np.abs(halves[0] - halves[1]).max() < 1e-8 * np.abs(halves).max()
