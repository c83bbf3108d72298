"""Equilibria of smoothed tetrahedra: found, and nearer the truth than plain ones."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import clamped

from palpate.fastsim.body import Body
from palpate.fastsim.contact.static_contact import solve_contact
from palpate.fastsim.errors import EquilibriumLostError
from palpate.fastsim.forces import external_force
from palpate.fastsim.newton import MULTIGRID_FROM_POINTS, Iteration
from palpate.fastsim.statics import solve_static
from palpate.fastsim.supports import FixedPoints
from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import TetMesh

SOFT = Material(1e4, 0.3, 1000.0)
STRAINS = pytest.mark.parametrize("strain", list(Strain))


def bar(mesh: TetMesh, material: Material, traction: float = -1.0) -> Problem:
    """Clamped at x = 0, sheared down at its end."""
    clamped = side(mesh, 0, 0.0)
    load = Traction(side(mesh, 0, mesh.points[:, 0].max()), (0.0, 0.0, traction))
    return Problem(mesh, material, (Support(np.unique(clamped), clamped),), (load,))


@STRAINS
def test_internal_forces_balance_the_loads(strain: Strain) -> None:
    problem = bar(brick_box((6, 3, 3), (3.0, 1.0, 1.0), ragged=0.2), SOFT, -60.0)
    half = np.arange(0, problem.mesh.num_cells, 2, dtype=np.int32)
    mixed = Problem(
        problem.mesh, SOFT, problem.supports, problem.loads,
        inclusions=(Inclusion(half, Material(5e4, 0.45)),),
    )  # fmt: skip
    for given in (problem, mixed):
        result = solve_static(given, strain=strain, element=Element.SMOOTHED)
        body = Body.of(given, strain, element=Element.SMOOTHED)
        residual = external_force(given) - body.internal_force(result.displacement)
        free = FixedPoints(given).is_free != 0
        assert np.linalg.norm(residual[free]) < 2e-10 * np.linalg.norm(external_force(given))
        assert np.abs(result.displacement).max() > 0.05


@pytest.mark.parametrize(("nu", "truth", "limit"), [(0.3, 26.41, 0.02), (0.49, 25.72, 0.06)])
def test_a_bar_bends_as_far_as_it_should(nu: float, truth: float, limit: float) -> None:
    """Deflections in mm by P2 (nu 0.3) and the mixed P2-P1 form (nu 0.49) on 12 288 cells."""
    problem = bar(brick_box((16, 4, 4), (4.0, 1.0, 1.0)), Material(1e4, nu))
    deflection = {
        element: -1e3
        * solve_static(problem, strain=Strain.LINEAR, element=element).displacement[:, 2].min()
        for element in Element
    }
    assert abs(deflection[Element.SMOOTHED] - truth) < limit * truth
    assert deflection[Element.LINEAR] < 0.85 * truth


def test_multigrid_serves_the_wider_matrix() -> None:
    """A uniform bar takes about as many iterations on a mesh cut in eight: 20, 25 and 41 seen."""
    problem = bar(brick_box((32, 8, 8), (4.0, 1.0, 1.0)), SOFT)
    assert problem.mesh.num_points >= MULTIGRID_FROM_POINTS
    result = solve_static(problem, strain=Strain.LINEAR, element=Element.SMOOTHED)
    assert result.linear_iterations < 60


def test_the_secant_iteration_is_refused_where_forces_are_not_cubic() -> None:
    problem = bar(brick_box((4, 2, 2), (2.0, 1.0, 1.0)), SOFT, -60.0)
    with pytest.raises(InputError, match=r"cubic.*take linear tetrahedra"):
        solve_static(problem, element=Element.SMOOTHED, iteration=Iteration.SECANT)


def test_lost_equilibrium_is_found_as_softening() -> None:
    """A block pressed beyond what Green strain bears: K has a direction of no stiffness."""
    mesh = brick_box((2, 2, 2), (1.0, 1.0, 1.0))
    clamped = side(mesh, 0, 0.0)
    load = Traction(side(mesh, 0, 1.0), (-0.6 * SOFT.youngs_modulus, 0.0, 0.0))
    problem = Problem(mesh, SOFT, (Support(np.unique(clamped), clamped),), (load,))
    with pytest.raises(EquilibriumLostError) as caught:
        solve_static(problem, element=Element.SMOOTHED)
    assert abs(caught.value.stiffness) < 0.25
    assert 0.1 < caught.value.load_factor < 1.0


def test_a_tool_is_pressed_as_hard_as_the_body_presses_back() -> None:
    mesh = brick_box((4, 4, 3), (1.0, 1.0, 0.6))
    path = ToolPath([0.0, 1.0], [[0.5, 0.5, 1.0], [0.5, 0.5, 0.9]])
    problem = Problem(
        mesh, SOFT, (clamped(mesh, 2),), (), tools=(RigidTool(SphereShape(0.35), path),)
    )
    found = solve_contact(problem, element=Element.SMOOTHED)
    internal = Body(mesh, SOFT, element=Element.SMOOTHED).internal_force(found.displacements[-1])
    free = FixedPoints(problem).is_free[:, 0] != 0
    assert found.forces[-1, 0, 2] > 1.0
    np.testing.assert_allclose(
        internal[free].sum(axis=0), -found.forces[-1, 0], atol=1e-7 * found.forces[-1, 0, 2]
    )
