"""Where a truth begins: on a mesh that sees the tool, and beside the equilibrium that is meant."""

from __future__ import annotations

import numpy as np
import pytest
from bank import support

from palpate.meshes.boundary_conditions import Support
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.meshes.spring import AnchorPath, Spring
from palpate.reference.adaptivity.first_mesh import first_mesh
from palpate.reference.adaptivity.goals import Budget, Goal, Quantity
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference.adaptivity.adaptive import solve_adaptively
    from palpate.reference.statics import solve_static

MATERIAL = Material(3000.0, 0.3, 1000.0)
STRETCH = np.diag([0.02, -0.01, 0.03])


def fixed(mesh, *, tools=(), springs=()):
    return Problem(mesh, MATERIAL, (support(mesh, "z0"),), (), tools=tools, springs=springs)


def ball(radius, top):
    """Comes from far above, in the middle, to where its lowest point is at `top`."""
    positions = np.array([[0.5, 0.5, 9.0], [0.5, 0.5, top + radius]])
    return RigidTool(SphereShape(radius), ToolPath(np.arange(2.0), positions))


def longest_edge(mesh, near):
    """Of the boundary facets that have a corner in a ball."""
    center, radius = near
    corners = mesh.points[mesh.boundary_facets]
    close = (np.linalg.norm(corners - np.array(center), axis=2) < radius).any(axis=1)
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)[close].max()


def test_the_mesh_is_cut_where_the_tool_is_at_the_end(box):
    mesh = box((2, 2, 2))
    moved = mesh.points @ STRETCH
    problem = fixed(mesh, tools=(ball(0.3, 0.95),))
    finer, there, case_cell = first_mesh(problem, moved)
    assert longest_edge(mesh, ((0.5, 0.5, 1.0), 0.2)) > 0.49
    # The circle through a right triangle's corners is half of its longest edge wide.
    assert longest_edge(finer.mesh, ((0.5, 0.5, 1.0), 0.2)) <= 2.0 * 0.43 * 0.3
    assert longest_edge(finer.mesh, ((0.5, 0.5, 0.0), 0.1)) > 0.49
    # The same places first, and a displacement that is linear stays so.
    np.testing.assert_array_equal(finer.mesh.points[: mesh.num_points], mesh.points)
    np.testing.assert_allclose(there, finer.mesh.points @ STRETCH, atol=1e-14)
    volumes = np.bincount(case_cell, finer.mesh.cell_volumes, mesh.num_cells)
    np.testing.assert_allclose(volumes, mesh.cell_volumes, rtol=1e-12)
    # By where the body is, not by where it was.
    far, _, _ = first_mesh(problem, moved - [0.0, 0.0, 0.2])
    assert far.mesh.num_cells == mesh.num_cells


def test_the_mesh_is_cut_in_the_patch_of_a_spring(box):
    mesh = box((2, 2, 2))
    spring = Spring.on(mesh, (0.5, 0.5, 1.0), 0.3, 50.0, AnchorPath([0.0], [[0.0, 0.0, 0.1]]))
    finer, _, _ = first_mesh(fixed(mesh, springs=(spring,)), np.zeros_like(mesh.points))
    assert longest_edge(finer.mesh, ((0.5, 0.5, 1.0), 0.2)) <= 2.0 * 0.43 * 0.3
    # A third of the force was missing or too much: the weights of one vertex, no less.
    (patch,) = finer.springs
    assert len(patch.facets) > len(spring.facets)


def test_a_mesh_that_is_fine_enough_is_left(box):
    mesh = box((6, 6, 6))
    problem = fixed(mesh, tools=(ball(3.0, 0.95),))
    same, there, case_cell = first_mesh(problem, mesh.points @ STRETCH)
    assert same is problem
    np.testing.assert_array_equal(there, mesh.points @ STRETCH)
    np.testing.assert_array_equal(case_cell, np.arange(mesh.num_cells))


def test_a_shallow_dent_of_a_large_ball_has_some_facets_across(box):
    """The first meshes of a slab had one: displacements went apart before they settled."""
    mesh = box((2, 2, 2))
    problem = fixed(mesh, tools=(ball(3.0, 0.95),))
    finer, _, _ = first_mesh(problem, np.zeros_like(mesh.points))
    dent = np.sqrt(3.0 * 0.05)
    assert longest_edge(finer.mesh, ((0.5, 0.5, 1.0), 0.1)) <= 2.0 * 0.5 * dent
    assert longest_edge(finer.mesh, ((0.5, 0.5, 0.0), 0.1)) > 0.49


@pytest.mark.dolfinx
def test_of_two_equilibria_the_one_beside_the_start_is_found(box):
    """A column that is pressed beyond Euler's load gives way to either side."""
    mesh = box((1, 1, 8), (1.0, 1.0, 10.0))
    ends = [mesh.facet_groups[name] for name in ("z0", "z1")]
    low, high = (np.unique(facets) for facets in ends)
    pressed = Support(high, ends[1], displacement=(0.0, 0.0, -1.5))
    supports = (Support(low, ends[0]), pressed)
    problem = Problem(mesh, MATERIAL, supports, ())
    z = mesh.points[:, 2] / 10.0
    found = []
    for side in (1.0, -1.0):
        bow, slope = side * np.sin(np.pi * z) ** 2, side * 0.1 * np.pi * np.sin(2.0 * np.pi * z)
        start = np.column_stack([bow, 0.0 * z, -1.5 * z - (mesh.points[:, 0] - 0.5) * slope])
        state = solve_static(problem, start=start)
        assert state.load_steps == (1.0,)
        found.append(state.displacement[:, 0])
    middle = np.argmin(np.abs(z - 0.5))
    assert found[0][middle] > 0.5
    assert found[1][middle] < -0.5


@pytest.mark.dolfinx
def test_from_a_start_that_leads_nowhere_the_load_is_raised(box):
    mesh = box((2, 2, 2))
    spring = Spring.on(mesh, (0.5, 0.5, 1.0), 0.9, 50.0, AnchorPath([0.0], [[0.1, 0.0, 0.3]]))
    problem = fixed(mesh, springs=(spring,))
    led = solve_static(problem)
    wild = np.random.default_rng(1).standard_normal(mesh.points.shape)
    for start in (wild, 0.9 * led.displacement):
        found = solve_static(problem, start=start)
        np.testing.assert_allclose(found.displacement, led.displacement, atol=1e-10)


@pytest.mark.dolfinx
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.long
def test_the_truth_begins_on_a_mesh_that_sees_the_tool(box, strain):
    """On the case's own mesh a ball as small as a facet sinks in between the nodes."""
    mesh = box((2, 2, 1))
    problem = fixed(mesh, tools=(ball(0.35, 0.93),))
    goal, start = [Goal(Quantity.TOOL_FORCE, 0.3)], np.zeros_like(mesh.points)
    once = Budget(unknowns=1.0)
    found = solve_adaptively(problem, goal, strain=strain, start=start, budget=once)
    blind = solve_adaptively(problem, goal, strain=strain, budget=once)
    assert found.num_cells[0] > 4 * mesh.num_cells
    assert found.displacement.shape == mesh.points.shape
    force, unseen = (state.tools[0].forces[-1][2] for state in (found, blind))
    assert unseen < 0.5 * force
