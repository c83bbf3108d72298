"""Coulomb friction of tools in the reference's statics: stick, slip, and the load between."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Support
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_tool import PlaneShape, RigidTool, ToolPath
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference.statics import solve_static

pytestmark = pytest.mark.dolfinx

FRICTION, DEPTH = 0.3, 0.05
# Along x, in parts of the depth: out until it slips for long, and a little back.
WAYS = (0.0, 0.05, 0.1, 0.2, 0.4, 0.8, 1.2, 1.6, 1.55)


def block_on_a_plane(box, friction, turn=0.0):
    """A unit cube held at its top; a plane is pressed against its bottom and drawn along."""
    mesh = box((2, 2, 2))
    top = mesh.facet_groups["z1"]
    held = Support(np.unique(top).astype(np.int32), top)
    along = np.array([np.cos(turn), np.sin(turn), 0.0])
    pressed = np.array([0.0, 0.0, DEPTH])
    knots = np.array([np.zeros(3), *(pressed + DEPTH * way * along for way in WAYS)])
    path = ToolPath(np.arange(len(knots)), knots)
    tool = RigidTool(PlaneShape(), path, friction, mesh.facet_groups["z0"])
    return Problem(mesh, Material(1.0, 0.0), (held,), (), tools=(tool,)), along


def felt(problem, along, strain, degree):
    """Normal force and drag at the knots after the press, shape (n,) each."""
    forces = np.array(solve_static(problem, strain=strain, degree=degree).tools[0].forces)[1:]
    return -forces[:, 2], -forces @ along


def glued(problem, along, way, strain, degree):
    """Drag where the bottom is not pressed but held, moved by a way along."""
    bottom = problem.tools[0].contact_facets
    moved = DEPTH * way * along + [0.0, 0.0, DEPTH]
    points = np.unique(bottom).astype(np.int32)
    held = (*problem.supports, Support(points, bottom, displacement=tuple(moved.tolist())))
    found = solve_static(
        dataclasses.replace(problem, supports=held, tools=()), strain=strain, degree=degree
    )
    return float(found.support_forces[1] @ along)


@pytest.mark.parametrize(
    ("strain", "degree", "turn"),
    [
        (Strain.LINEAR, 1, 0.0),
        (Strain.LINEAR, 2, 0.0),
        (Strain.GREEN, 1, 0.7),
        (Strain.GREEN, 2, 0.0),
    ],
)
def test_a_block_sticks_and_then_slips_at_mu_times_the_normal_force(box, strain, degree, turn):
    problem, along = block_on_a_plane(box, FRICTION, turn)
    normal, drag = felt(problem, along, strain, degree)
    # Pressed by e at nu = 0: E e, or E (e + e^2 / 2) (1 + e) of Saint-Venant-Kirchhoff, e = -DEPTH.
    green = (DEPTH - 0.5 * DEPTH**2) * (1.0 - DEPTH)
    np.testing.assert_allclose(normal[0], DEPTH if strain is Strain.LINEAR else green, rtol=1e-8)
    # Stuck, it is as stiff as a block that is held there; of degree 2 vertices are free to follow.
    stuck = glued(problem, along, WAYS[2], strain, degree)
    np.testing.assert_allclose(drag[2], stuck, rtol=1e-6 if degree == 1 else 0.03)
    # It never takes more than mu N, and in the end slips under that.
    assert np.all(drag <= FRICTION * normal * (1.0 + 1e-8))
    np.testing.assert_allclose(drag[7], FRICTION * normal[7], rtol=1e-3)
    assert glued(problem, along, WAYS[7], strain, degree) > 1.5 * drag[7]
    # On the way back it sticks again.
    step = (drag[8] - drag[7]) / (WAYS[8] - WAYS[7])
    np.testing.assert_allclose(step, stuck / WAYS[2], rtol=0.02 if degree == 1 else 0.2)


def test_without_friction_nothing_drags(box):
    problem, along = block_on_a_plane(box, 0.0)
    _, drag = felt(problem, along, Strain.GREEN, 1)
    np.testing.assert_allclose(drag, 0.0, atol=1e-12)
