"""Paths past limit points, beside displacement control and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import PointForce, Pressure, Support, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem
from palpate.meshes.rigid_tool import PlaneShape, RigidTool, ToolPath
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference.continuation import follow_path
    from palpate.reference.residual import internal_force
    from palpate.reference.statics import solve_static

pytestmark = pytest.mark.dolfinx

MATERIAL = Material(1e6, 0.3)


def clamp(mesh, face, components=(True, True, True)):
    facets = mesh.facet_groups[face]
    return Support(np.unique(facets).astype(np.int32), facets, components)


@pytest.fixture
def arch(box):
    """A shallow arch between two walls, and the point in its middle that is pushed."""
    flat = box((24, 1, 1), (1.0, 0.05, 0.02))
    points = flat.points + np.outer(0.1 * np.sin(np.pi * flat.points[:, 0]), [0.0, 0.0, 1.0])
    mesh = TetMesh(points, flat.cells, flat.facet_groups)
    top = int(np.argmin(np.abs(points - [0.5, 0.0, 0.12]).sum(axis=1)))
    return mesh, (clamp(mesh, "x0"), clamp(mesh, "x1")), np.array([top], dtype=np.int32)


def test_an_arch_snaps_through_as_it_does_under_a_prescribed_displacement(arch):
    mesh, supports, top = arch
    force = -10.0
    pushed = PointForce(top, np.array([[0.0, 0.0, force]]))
    path = follow_path(Problem(mesh, MATERIAL, supports, (pushed,)))
    assert path.reason == ""
    assert path.points[-1].load_factor == 1.0
    first, second = path.limit_points
    assert path.points[first].load_factor > path.points[second].load_factor + 0.01
    # Stable up to the first limit point, not between the two, stable beyond.
    stable = [p.is_stable for p in path.points]
    assert all(stable[:first])
    assert not any(stable[first + 1 : second])
    assert stable[-1]
    # The same discrete bodies, found another way: the point is moved instead of pushed.
    for point in (path.points[1], path.points[first + 1], path.points[-1]):
        sunk = float(point.displacement[top[0], 2])
        moved = Support(top, components=(False, False, True), displacement=(0.0, 0.0, sunk))
        twin = solve_static(Problem(mesh, MATERIAL, (*supports, moved), ()))
        # Near a limit point the residual's 1e-9 counts a few hundred times.
        np.testing.assert_allclose(twin.displacement, point.displacement, rtol=0.0, atol=1e-6)
        reaction = internal_force(mesh, twin.displacement, material=MATERIAL)[top[0], 2]
        assert reaction == pytest.approx(point.load_factor * force, rel=1e-5)


def test_compression_has_its_limit_at_the_closed_form_and_no_way_on(box):
    # Dead P/E = -0.25; the peak of l (l^2 - 1) / 2 is 0.1924501 at l = 1/sqrt(3).
    mesh = box((1, 1, 1))
    axes = np.eye(3, dtype=bool)
    rollers = tuple(clamp(mesh, f, tuple(axes[k])) for k, f in enumerate(("x0", "y0", "z0")))
    load = Traction(mesh.facet_groups["x1"], (-0.25e6, 0.0, 0.0))
    path = follow_path(Problem(mesh, MATERIAL, rollers, (load,)))
    assert path.reason != ""
    (limit,) = path.limit_points[:1]
    assert path.points[limit].load_factor == pytest.approx(0.1924501 / 0.25, rel=0.01)
    stretch = np.array([1.0 + p.displacement[:, 0].min() for p in path.points])
    factor = np.array([p.load_factor for p in path.points])
    np.testing.assert_allclose(factor * -0.25, stretch * (stretch**2 - 1) / 2, atol=1e-8)
    assert stretch[limit] == pytest.approx(1 / np.sqrt(3), abs=0.05)
    assert stretch[-1] < 0.5
    assert path.points[-1].smallest_det_f > 0.0
    assert path.points[-1].is_stable is False


@pytest.mark.parametrize("degree", [1, 2])
def test_an_easy_load_ends_where_plain_steps_do(box, degree):
    mesh = box((4, 1, 1), (1.0, 0.3, 0.3))
    load = Pressure(mesh.facet_groups["z1"], 300.0)
    problem = Problem(mesh, Material(1e5, 0.3), (clamp(mesh, "x0"),), (load,))
    path = follow_path(problem, degree=degree)
    plain = solve_static(problem, degree=degree)
    assert path.reason == ""
    assert path.points[-1].is_stable is None  # a follower's tangent is not symmetric
    np.testing.assert_allclose(
        path.points[-1].displacement, plain.displacement, rtol=0.0, atol=1e-7
    )


def test_prescribed_displacements_are_followed_too(box):
    mesh = box((4, 1, 1), (1.0, 0.3, 0.3))
    end = mesh.facet_groups["x1"]
    moved = Support(np.unique(end).astype(np.int32), end, displacement=(0.0, 0.0, 0.3))
    problem = Problem(mesh, MATERIAL, (clamp(mesh, "x0"), moved), ())
    path = follow_path(problem)
    assert path.reason == ""
    plain = solve_static(problem)
    np.testing.assert_allclose(
        path.points[-1].displacement, plain.displacement, rtol=0.0, atol=1e-7
    )


def test_it_gives_up_after_as_many_points_as_told(arch):
    mesh, supports, top = arch
    pushed = PointForce(top, np.array([[0.0, 0.0, -10.0]]))
    path = follow_path(Problem(mesh, MATERIAL, supports, (pushed,)), most_points=3)
    assert len(path.points) == 3
    assert "3 points" in path.reason


def test_tools_are_refused(arch):
    mesh, supports, _ = arch
    tool = RigidTool(PlaneShape(), ToolPath(np.array([0.0]), np.array([[0.0, 0.0, 1.0]])))
    with pytest.raises(InputError, match="knows no tools"):
        follow_path(Problem(mesh, MATERIAL, supports, (), tools=(tool,)))
