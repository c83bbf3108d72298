"""Displacement and pressure apart: the same states, and no locking."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bank import beyond, rollers, support
from calibration_recipe.plane import Plane, PlaneLoads, Section, stress_of

from palpate.meshes.boundary_conditions import Pressure, Support, Traction
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.bricks import rollers as rollers_of
from palpate.meshes.problem import Inclusion, Material, Problem, Strain
from palpate.meshes.rigid_tool import PlaneShape, RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.adaptivity.goals import Budget, Goal, Quantity
from palpate.reference.availability import is_available
from palpate.reference.result import Formulation, formulation_for

if is_available():
    from palpate.reference.adaptivity.adaptive import solve_adaptively
    from palpate.reference.laws import lame_parameters
    from palpate.reference.mixed_form import colours_of
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


class OfTwoMaterials(Plane):
    """A section whose elements beyond x = 0.5 m are of another material."""

    def __init__(self, other: Material, *given: Any, **options: Any) -> None:
        super().__init__(*given, **options)
        self.other = other
        self.is_other = self.positions[self.elements].mean(axis=1)[:, 0] > 0.5

    def stress(self, H):
        P, A = stress_of(self.material, self.strain, H)
        Q, B = stress_of(self.other, self.strain, H)
        chosen = self.is_other[:, None, None, None]
        return np.where(chosen, Q, P), np.where(chosen[..., None, None], B, A)


@pytest.mark.parametrize(
    ("other", "lean"), [(0.4, 0.0), pytest.param(0.3, 0.2, marks=pytest.mark.nightly)]
)
def test_the_pressure_jumps_where_materials_meet(other: float, lean: float) -> None:
    """Against polynomials of degree 6 and 8 on graded quadrilaterals: another kind of solver."""
    near, far = Material(1.0, other, 1.0), Material(1.0, 0.499, 1.0)
    push = (0.01, 0.0, -0.02)

    def moved(grid):
        # Beside x = 0.5, which stays.
        return grid + lean * (grid[..., :1] - 0.5) * grid[..., 1:] * [1.0, 0.0]

    lines = np.array([0.0, 0.5, 1.0])
    section = Section(lines, np.array([0.0, 1.0]), np.ones((2, 1), dtype=bool), moved)
    loads = PlaneLoads({"under": lambda X, s: 0.0 * s * X}, tractions={"top": (push[0], push[2])})
    wanted = []
    for degree, layers in ((5, 4), (7, 5)):
        plane = OfTwoMaterials(
            far, section, near, Strain.LINEAR, loads, degree=degree, layers=layers
        )
        wanted.append(0.25 * plane.energy(plane.solve()))
    assert wanted[1] == pytest.approx(wanted[0], rel=3e-4)
    box = brick_box((4, 1, 4), (1.0, 0.25, 1.0))
    points = box.points.copy()
    points[:, ::2] = moved(box.points[:, ::2])
    mesh = TetMesh(points, box.cells)
    beyond = box.points[box.cells].mean(axis=1)[:, 0] > 0.5
    problem = Problem(
        mesh,
        near,
        (support_of(side(box, 2, 0.0)), *rollers_of(mesh, ((1, 0.0), (1, 0.25)))),
        (Traction(side(box, 2, 1.0), push),),
        inclusions=(Inclusion(np.flatnonzero(beyond).astype(np.int32), far),),
    )
    goals = (Goal(Quantity.STRAIN_ENERGY, 1e-3),)
    found = solve_adaptively(
        problem, goals, budget=Budget(unknowns=40_000.0), strain=Strain.LINEAR, formulation=MIXED
    )
    assert abs(found.strain_energy / wanted[1] - 1.0) <= found.bar("strain_energy")
    assert found.strain_energy == pytest.approx(wanted[1], rel=1e-3)


def test_colours_are_few_and_differ_where_materials_meet() -> None:
    box = brick_box((6, 1, 1), (6.0, 1.0, 1.0))
    x = box.points[box.cells].mean(axis=1)[:, 0].astype(int)
    layers = [np.flatnonzero(x == k).astype(np.int32) for k in range(6)]
    # Every second layer is of one and the same material; the others are three more.
    moduli = (1.0, 2.0, 1.0, 3.0, 1.0, 2.0)
    inclusions = tuple(
        Inclusion(cells, Material(E, 0.49)) for cells, E in zip(layers, moduli, strict=True)
    )
    problem = Problem(box, Material(1.0, 0.49), (), (), inclusions=inclusions)
    colours = colours_of(problem)
    assert [sorted({int(c) for c in colours[cells]}) for cells in layers] == [[0], [1]] * 3


def parted(mesh: TetMesh, *materials: Material, lift: float, degree: int = 2, form=MIXED):
    """Left, right below and right above of a unit box between smooth walls, raised on top."""
    x, _, z = mesh.points[mesh.cells].mean(axis=1).T
    number = np.where(x < 0.5, 0, np.where(z < 0.5, 1, len(materials) - 1))
    sides = ((0, 0.0), (0, 1.0), (1, 0.0), (1, 1.0), (2, 0.0))
    problem = Problem(
        mesh,
        materials[0],
        (
            *rollers_of(mesh, sides),
            support_of(side(mesh, 2, 1.0), (False, False, True), (0.0, 0.0, lift)),
        ),
        (),
        inclusions=tuple(
            Inclusion(np.flatnonzero(number == k).astype(np.int32), material)
            for k, material in enumerate(materials)
            if k > 0
        ),
    )
    return solve_static(problem, degree=degree, strain=Strain.LINEAR, formulation=form)


@pytest.mark.parametrize("degree", [2, pytest.param(3, marks=pytest.mark.nightly)])
def test_columns_side_by_side_have_pressures_of_their_own(degree: int) -> None:
    # Uniform strains e_z = -e, e_y = 0, e_x = a and -a, with (l1 + 2 m1) a - l1 e = -(l2 + 2 m2) a
    # - l2 e: a linear displacement, and a pressure that jumps.
    first, second, e = Material(1.0, 0.4), Material(1.0, 0.499), 0.01
    (l1, m1), (l2, m2) = (lame_parameters(m) for m in (first, second))
    a = (l1 - l2) * e / (l1 + 2 * m1 + l2 + 2 * m2)
    energy = 0.25 * sum(
        lmbda * (ex - e) ** 2 + 2 * mu * (ex**2 + e**2)
        for lmbda, mu, ex in ((l1, m1, a), (l2, m2, -a))
    )
    found = parted(brick_box((2, 1, 2), (1.0, 1.0, 1.0)), first, second, lift=-e, degree=degree)
    assert found.strain_energy == pytest.approx(energy, rel=1e-9)


def test_three_materials_may_meet_at_one_edge() -> None:
    box = brick_box((4, 2, 4), (1.0, 1.0, 1.0))
    materials = [Material(E, nu) for E, nu in ((1.0, 0.3), (2.0, 0.4), (0.5, 0.45))]
    energies = [
        parted(box, *materials, lift=-0.01, form=form).strain_energy
        for form in (Formulation.DISPLACEMENT, MIXED)
    ]
    # From two sides of the limit, by little.
    assert energies[1] == pytest.approx(energies[0], rel=2e-3)
