"""Duals of what is read of a displacement at points: exact where the equations are linear."""

from __future__ import annotations

import numpy as np
import pytest
from bank import fixed, support

from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.field_norms import l2_gradient, l2_norm
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.reference.adaptivity.goals import Goal, Quantity
from palpate.reference.availability import is_available
from palpate.reference.result import Formulation

if is_available():
    from palpate.reference import linear_solver
    from palpate.reference.adaptivity.duals import (
        AlongChange,
        PointValue,
        Solved,
        duals_of,
        solve_duals,
        worst_of,
    )
    from palpate.reference.statics import find_equilibrium

pytestmark = pytest.mark.dolfinx
EVERY = (
    (Formulation.DISPLACEMENT, 0.3, False),
    (Formulation.MIXED, 0.499, False),
    (Formulation.DISPLACEMENT, 0.3, True),
)


def solved(box, formulation=Formulation.DISPLACEMENT, nu=0.3, slides=False):
    """A bar that is pulled aside, along a smooth wall or without it."""
    mesh = box((2, 1, 1), (2.0, 1.0, 1.0))
    root, far = mesh.facet_groups["x0"], mesh.facet_groups["x1"]
    supports = (fixed(root),)
    if slides:
        supports += (support(mesh, "y0", normal=(0.0, 1.0, 0.0)),)
    problem = Problem(mesh, Material(3000.0, nu), supports, (Traction(far, (60.0, 0.0, -40.0)),))
    found = find_equilibrium(problem, strain=Strain.LINEAR, degree=2, formulation=formulation)
    return Solved(found, found.result(), None, mesh, np.arange(mesh.num_cells))


def work_of_loads(case, dual):
    """Of the dead loads on a dual, which is flat and along x, y, z."""
    discrete = case.discrete
    return float(discrete.of_displacement(discrete.dead_force) @ dual)


@pytest.mark.parametrize(("formulation", "nu", "slides"), EVERY)
def test_loads_on_a_dual_are_what_the_dual_is_of(box, formulation, nu, slides):
    case = solved(box, formulation, nu, slides)
    moved = case.state.displacement
    corner = int(np.argmax(np.linalg.norm(moved, axis=1)))
    point, norm = PointValue(corner, (0.0, 0.0, 1.0)), AlongChange()
    duals = solve_duals(case, [point, norm])
    largest = np.linalg.norm(moved, axis=1).max()
    # Direct factors: some digits more than were asked for.
    assert work_of_loads(case, duals[point]) == pytest.approx(moved[corner, 2] / largest, rel=1e-6)
    # Nothing before it: the whole displacement, along itself, over itself.
    assert work_of_loads(case, duals[norm]) == pytest.approx(1.0, rel=1e-6)
    case.found.destroy()


def test_a_dual_under_a_tool_is_the_same_by_multigrid_and_by_factors(box, monkeypatch):
    """Penalties are a hundred times stiffer than the body, along a normal that is not an axis.

    A residual over that of the whole right-hand side was small once the nodes in contact were met,
    the body unmoved: the dual of the tool's force had three times its gradient's error, and the
    force had no bar. Smoothed by the diagonal alone, 60 iterations were needed for three digits.
    """
    mesh = box((6, 6, 3), (1.0, 1.0, 0.5))
    top, bottom = mesh.facet_groups["z1"], mesh.facet_groups["z0"]
    way = np.array([[0.45, 0.55, 1.2], [0.45, 0.55, 1.14]])
    ball = RigidTool(SphereShape(0.7), ToolPath(np.arange(2.0), way), contact_facets=top)
    problem = Problem(mesh, Material(3000.0, 0.4), (fixed(bottom),), (), tools=(ball,))
    key = (Quantity.TOOL_FORCE, None)
    found = {}
    for largest in (10**6, 0):
        monkeypatch.setattr(linear_solver, "LARGEST_DIRECT", largest)
        equilibrium = find_equilibrium(problem, strain=Strain.GREEN, degree=2)
        case = Solved(equilibrium, equilibrium.result(), None, mesh, np.arange(mesh.num_cells))
        linear = equilibrium.newton._linear
        found[largest] = solve_duals(case, [key])[key]
        assert ("multigrid" in linear.name) == (largest == 0)
        # Of blocks with an exact level below, to three digits.
        assert linear._ksp.getIterationNumber() <= 20
        equilibrium.destroy()
    apart = np.linalg.norm(found[0] - found[10**6])
    assert apart < 0.003 * np.linalg.norm(found[10**6])


def test_the_points_looked_at_are_where_it_moved_most_and_where_it_is_rough(box):
    case = solved(box)
    moved = case.state.displacement
    cells = case.case_mesh.cells
    rough = np.full(len(cells), 1e-3)
    rough[5] = 1.0
    goal = Goal(Quantity.DISPLACEMENT_MAX, 1.0)
    keys = duals_of(goal, case, rough)
    largest = int(np.argmax(np.linalg.norm(moved, axis=1)))
    assert keys[0].point == largest
    np.testing.assert_allclose(keys[0].along, moved[largest] / np.linalg.norm(moved[largest]))
    moves = np.linalg.norm(moved, axis=1) > 0.0
    assert {key.point for key in keys[1:]} <= set(cells[5][moves[cells[5]]])
    assert len(keys) > 1
    # The largest displacement is that of one point.
    assert duals_of(Goal(Quantity.MAX_DISPLACEMENT, 1.0), case, rough) == keys[:1]
    case.found.destroy()


def test_the_worst_of_several_errors_is_refined_for_all():
    one, other = np.array([4.0, 0.0, 1.0]), np.array([0.0, 2.0, 1.0])
    parts = worst_of([one, other])
    assert parts.sum() == pytest.approx(5.0)
    np.testing.assert_allclose(parts / parts[2], [4.0, 2.0, 1.0])
    assert worst_of([one]) is one
    assert worst_of([0.0 * one, 0.0 * one]).sum() == 0.0


def test_the_norms_gradient_is_its_derivative(box):
    mesh = box((2, 1, 1), jitter=0.2)
    rng = np.random.default_rng(0)
    field, step = rng.standard_normal((2, mesh.num_points, 3))
    h = 1e-6
    slope = (l2_norm(mesh, field + h * step) - l2_norm(mesh, field - h * step)) / (2.0 * h)
    assert np.sum(l2_gradient(mesh, field) * step) == pytest.approx(slope, rel=1e-7)
    assert not l2_gradient(mesh, 0.0 * field).any()
