"""Nodes beside the edges of a box: they leave by the face they came in by, and slide off it."""

from __future__ import annotations

import numpy as np
import pytest
from bank import fixed

from palpate.meshes.boundary_conditions import Support
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_tool import BoxShape, RigidTool, ToolPath
from palpate.reference.availability import is_available
from palpate.reference.contact.tool_distance import ContactFaces, entered_faces, seen_at

if is_available():
    from palpate.reference.statics import solve_static

HALF = np.array([0.3, 0.4, 0.5])
# How far inside a side of the box a row of nodes lies, over its half width.
MARGINS = [0.0, 1e-9, 1e-6, 1e-4, 1e-3, 5e-3, 1e-2]


def test_places_enter_by_the_face_that_small_steps_meet_first() -> None:
    rng = np.random.default_rng(11)
    before, inside = rng.uniform(-1.0, 1.0, (300, 3)), HALF * rng.uniform(-0.99, 0.99, (300, 3))
    before = before[(np.abs(before) > HALF + 0.01).any(axis=1)]
    inside = inside[: len(before)]
    axes, sides = entered_faces(inside, HALF, before)
    for start, end, axis, side in zip(before, inside, axes, sides, strict=True):
        way = start + np.linspace(0.0, 1.0, 20_001)[:, None] * (end - start)
        first = way[np.argmax((np.abs(way) <= HALF).all(axis=1))]
        # One step behind the face: deeper in every other way, but at an edge, for one in 300.
        assert np.abs(side * first[axis] - HALF[axis]) <= np.abs(end - start).max() / 20_000
        assert side == np.sign(start[axis])


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("margin", MARGINS)
def test_a_place_just_inside_an_edge_keeps_to_the_face_it_touched(
    axis: int, side: float, margin: float
) -> None:
    """However deep it then is, and however near to the other face."""
    across = (axis + 1) % 3
    face = np.zeros(3)
    face[axis] = side * HALF[axis]
    face[across] = (1.0 - margin) * HALF[across]
    normal = side * np.eye(3)[axis]
    came_from = seen_at((face + 0.1 * normal)[None], HALF, None)
    for depth in (0.0, 1e-12, 1e-4, 0.05):
        local = (face - depth * normal)[None]
        assert entered_faces(local, HALF, came_from) == (axis, side)
        came_from = seen_at(local, HALF, came_from)


def test_who_slides_off_a_face_goes_to_the_one_round_the_edge_and_only_once() -> None:
    faces = ContactFaces((0.3, 0.4, 0.5))
    faces.keep(np.array([[0.29, 0.0, -0.51], [0.0, 0.0, -0.51], [0.29, 0.0, -0.51]]))
    beyond = np.array([[0.31, 0.0, -0.5], [0.0, 0.0, -0.5], [0.31, 0.0, -0.5]])
    pressed = np.array([True, True, False])
    # Before, all are held against the bottom, those beyond its edge too.
    is_fixed, gap, normal = faces.planes(beyond)
    assert is_fixed.all()
    np.testing.assert_allclose(gap, 0.0, atol=1e-15)
    np.testing.assert_array_equal(normal, np.tile([0.0, 0.0, -1.0], (3, 1)))
    off, again = faces.let_go(beyond, pressed)
    assert (off.tolist(), again) == ([True, False, False], False)
    is_fixed, gap, normal = faces.planes(beyond)
    np.testing.assert_array_equal(normal[:, 0], [1.0, 0.0, 0.0])
    assert gap[0] == pytest.approx(0.01)
    off, again = faces.let_go(beyond, pressed)
    assert not off.any()
    below = beyond - [[0.02, 0.0, 0.1]]
    off, again = faces.let_go(below, pressed)
    assert (off.tolist(), again) == ([True, False, False], True)
    faces.go_back()
    np.testing.assert_array_equal(faces.planes(beyond)[2][:, 2], -1.0)


def block(mesh, half_widths, depth, ratio):
    """A box pressed into the middle of a unit cube's top, in one stretch."""
    base, top = mesh.facet_groups["z0"], mesh.facet_groups["z1"]
    height = 1.0 + half_widths[2]
    path = ToolPath(
        np.array([0.0, 1.0]), np.array([[0.5, 0.5, height + 0.01], [0.5, 0.5, height - depth]])
    )
    return Problem(
        mesh,
        Material(1e4, ratio),
        (fixed(base),),
        (),
        tools=(RigidTool(BoxShape(half_widths), path, contact_facets=top),),
    )


def held_down(problem: Problem, depth: float) -> Problem:
    """Every point under the box held at its depth, and free to slide: no contact is looked for."""
    (tool,) = problem.tools
    assert isinstance(tool.shape, BoxShape)
    points = problem.mesh.points
    a, b, _ = tool.shape.half_widths
    slack = 1e-12
    under = np.flatnonzero(
        (points[:, 2] > 1.0 - slack)
        & (np.abs(points[:, 0] - 0.5) <= a + slack)
        & (np.abs(points[:, 1] - 0.5) <= b + slack)
    ).astype(np.int32)
    down = Support(under, components=(False, False, True), displacement=(0.0, 0.0, -depth))
    return Problem(problem.mesh, problem.material, (*problem.supports, down), ())


@pytest.mark.dolfinx
@pytest.mark.parametrize(
    ("edges", "margin"), [*(("both", margin) for margin in MARGINS), ("x", 1e-6), ("y", 1e-6)]
)
def test_nodes_just_inside_an_edge_are_pressed_down_not_out(box, edges, margin) -> None:
    """A row at 0.25 from the middle, nearer to the side than a step of the tool is deep."""
    mesh, depth = box((4, 4, 3)), 0.05
    near, far = 0.25 * (1.0 + margin), 0.35
    widths = {"x": (near, far, 0.25), "y": (far, near, 0.25), "both": (near, near, 0.25)}[edges]
    problem = block(mesh, widths, depth, 0.0)
    expected = solve_static(held_down(problem, depth))
    found = solve_static(problem)
    np.testing.assert_allclose(found.displacement, expected.displacement, rtol=0.0, atol=1e-10)
    (felt,) = found.tools
    # Nine vertices under it, each with its share of the top: a sixteenth of it.
    assert felt.active_areas[-1] == pytest.approx(9.0 / 16.0)
    # All stay under it, so that the answer held by hand is one of contact.
    moved = np.abs((mesh.points + expected.displacement)[:, :2] - 0.5)
    under = mesh.points[:, 2] == 1.0
    under &= np.abs(mesh.points[:, :2] - 0.5).max(axis=1) < 0.3
    assert (moved[under] < np.array(widths[:2])).all()


@pytest.mark.dolfinx
@pytest.mark.parametrize("strain", list(Strain))
def test_nodes_that_the_body_bulges_past_the_edge_slide_off_it(box, strain) -> None:
    """A wide ratio drives the row outwards: at the end it lies against the sides."""
    mesh, depth = box((4, 4, 1), (1.0, 1.0, 1.0)), 0.05
    half = 0.25 * 1.001
    found = solve_static(block(mesh, (half, half, 0.25), depth, 0.4), strain=strain)
    (felt,) = found.tools
    assert felt.penetrations[-1] < 1e-8
    assert felt.active_areas[-1] < 9.0 / 16.0
    positions = mesh.points + found.displacement
    top = positions[mesh.points[:, 2] == 1.0]
    beyond = np.maximum(np.abs(top[:, :2] - 0.5).max(axis=1) - half, (1.0 - depth) - top[:, 2])
    assert beyond.min() > -1e-8
