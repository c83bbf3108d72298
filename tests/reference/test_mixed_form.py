"""Displacement and pressure apart: the same states, and no locking."""

from __future__ import annotations

import numpy as np
import pytest
from bank import beyond, rollers, support

from palpate.meshes.boundary_conditions import Pressure, Support, Traction
from palpate.meshes.problem import Inclusion, Material, Problem, Strain
from palpate.meshes.rigid_tool import PlaneShape, RigidTool, SphereShape, ToolPath
from palpate.reference.availability import is_available
from palpate.reference.result import Formulation, formulation_for

if is_available():
    from palpate.reference.statics import solve_static

pytestmark = pytest.mark.dolfinx

MIXED = Formulation.MIXED


@pytest.mark.parametrize("degree", [2, 3])
def test_pure_bending_is_the_closed_form(box, degree):
    # Quadratic, so both degrees hold it; of degree 3 only where cells agree on which of an edge's
    # two nodes is which. With r = z - 1/2: E u = c (x r, -nu y r, -(x^2 + nu (r^2 - y^2)) / 2).
    mesh = box((2, 2, 2), jitter=0.2)
    nu, c = 0.45, 0.1

    def exact(positions):
        x, y, r = positions[:, 0], positions[:, 1], positions[:, 2] - 0.5
        bent = -0.5 * (x**2 + nu * (r**2 - y**2))
        return c * np.column_stack([x * r, -nu * y * r, bent])

    corner = np.flatnonzero(~mesh.points.any(axis=1))
    at_corner = tuple(exact(mesh.points[corner])[0])
    supports = (
        support(mesh, "x0", (True, False, False)),
        support(mesh, "y0", (False, True, False)),
        Support(corner, components=(False, False, True), displacement=at_corner),
    )
    slope = np.zeros((3, 3))
    slope[0, 2] = c
    load = Traction(mesh.facet_groups["x1"], (-0.5 * c, 0.0, 0.0), gradient=slope)
    problem = Problem(mesh, Material(1.0, nu), supports, (load,))
    result = solve_static(problem, degree=degree, formulation=MIXED, strain=Strain.LINEAR)
    np.testing.assert_allclose(result.displacement, exact(mesh.points), rtol=0.0, atol=1e-12)


def test_follower_pressure_and_layers_agree_with_the_plain_form(box):
    # Homogeneous in each layer: both forms hold the exact state.
    mesh = box((2, 1, 1))
    beyond = np.flatnonzero(mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.5)
    axes = np.eye(3, dtype=bool)
    walls = tuple(support(mesh, f, tuple(axes[k])) for k, f in ((1, "y1"), (2, "z1")))
    problem = Problem(
        mesh,
        Material(1e4, 0.3),
        (*rollers(mesh), *walls),
        (Pressure(mesh.facet_groups["x1"], 1500.0),),
        inclusions=(Inclusion(beyond.astype(np.int32), Material(4e4, 0.45)),),
    )
    plain = solve_static(problem, degree=2)
    mixed = solve_static(problem, degree=2, formulation=MIXED)
    assert np.ptp(plain.displacement[:, 0]) > 0.05
    # The pressure jumps between the layers and is continuous here: no closed form, 5 %.
    assert mixed.volume == pytest.approx(plain.volume, abs=0.05 * (1.0 - plain.volume))


def bent(box, poissons_ratio, fineness, **options):
    mesh = box((6 * fineness, 2 * fineness, 2 * fineness), (3.0, 1.0, 1.0))
    load = Traction(mesh.facet_groups["x1"], (0.0, 0.0, -100.0))
    material = Material(1e4, poissons_ratio)
    problem = Problem(mesh, material, (support(mesh, "x0"),), (load,))
    result = solve_static(problem, **options)
    tip = int(np.argmin(np.abs(mesh.points - [3.0, 0.5, 0.5]).sum(axis=1)))
    return result.displacement[tip, 2]


@pytest.mark.slow
def test_both_forms_converge_to_one_bending(box):
    gaps = []
    for fineness in (1, 2):
        plain = bent(box, 0.4, fineness, degree=2)
        mixed = bent(box, 0.4, fineness, degree=2, formulation=MIXED)
        assert mixed < plain < -0.9  # the mixed form is the softer one
        gaps.append(mixed / plain - 1.0)
    assert gaps[1] < 0.5 * gaps[0]
    assert gaps[1] < 0.003


@pytest.mark.slow
def test_tissue_locks_linear_cells_and_not_the_mixed_form(box):
    truth = bent(box, 0.4999, 2, degree=2, formulation=MIXED)
    coarse = bent(box, 0.4999, 1, degree=2, formulation=MIXED)
    assert coarse == pytest.approx(truth, rel=0.03)
    # Softer still at 0.3, by little: a beam bends by E, not by nu.
    assert bent(box, 0.3, 1, degree=2) == pytest.approx(truth, rel=0.05)
    linear = [bent(box, nu, 1, degree=1) / truth for nu in (0.3, 0.49, 0.4999)]
    assert linear[0] > 0.5 > 0.25 > linear[1] > linear[2]
    assert linear[2] < 0.15
    # Quadratic displacements lock too, less.
    assert 0.7 < bent(box, 0.4999, 1, degree=2) / truth < 0.85


@pytest.mark.parametrize("strain", list(Strain))
def test_both_strains(box, strain):
    small = bent(box, 0.3, 1, degree=2, strain=strain)
    mixed = bent(box, 0.3, 1, degree=2, strain=strain, formulation=MIXED)
    assert mixed == pytest.approx(small, rel=0.01)


def test_a_plane_presses_two_materials_side_by_side(box):
    """They stretch alike and share the force; the pressure is continuous, its jump spread out."""
    mesh, stretch, nu, E = box((4, 3, 3)), 0.9, 0.4999, 1e4
    down = np.array([[1.0, 1.0, 1.1], [1.0, 1.0, stretch]])
    path = ToolPath(np.arange(2.0), down, np.tile([0.0, 1.0, 0.0, 0.0], (2, 1)))
    stiff = (Inclusion(beyond(mesh, 0.5), Material(2.0 * E, nu)),)
    tools = (RigidTool(PlaneShape(), path),)
    problem = Problem(mesh, Material(E, nu), rollers(mesh), (), inclusions=stiff, tools=tools)
    assert formulation_for(problem, 2) is MIXED
    result = solve_static(problem, degree=2, strain=Strain.LINEAR, formulation=MIXED)
    lateral = 1 - nu * (stretch - 1)
    exact = mesh.points * [lateral - 1, lateral - 1, stretch - 1]
    np.testing.assert_allclose(result.displacement, exact, rtol=0.0, atol=2e-3)
    (felt,) = result.tools
    force = -1.5 * (stretch - 1) * E
    np.testing.assert_allclose(felt.forces[-1], [0.0, 0.0, force], rtol=5e-3, atol=1e-4)
    # Of degree 2 the tool meets the middles of edges, and vertices follow.
    assert felt.penetrations[-1] < 1e-3


@pytest.mark.long
def test_a_ball_presses_tissue_without_locking(box):
    """The force is the slope of the energy, and the plain form's is too large on the same mesh."""
    mesh = box((4, 4, 3), jitter=0.1)
    fixed, nu = (support(mesh, "z0"),), 0.499

    def press(depth, form):
        positions = np.array([[0.5, 0.5, 1.5], [0.5, 0.5, 1.5 - depth]])
        ball = RigidTool(SphereShape(0.5), ToolPath(np.arange(2.0), positions))
        problem = Problem(mesh, Material(1e4, nu), fixed, (), tools=(ball,))
        result = solve_static(problem, degree=2, formulation=form)
        return result.tools[0].forces[-1][2], result.strain_energy

    force, _ = press(0.081, MIXED)
    energies = [press(depth, MIXED)[1] for depth in (0.08, 0.082)]
    assert (energies[1] - energies[0]) / 0.002 == pytest.approx(force, rel=1e-3)
    plain, _ = press(0.081, Formulation.DISPLACEMENT)
    assert force < 0.98 * plain
