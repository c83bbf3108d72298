"""Vertices beside the edges of a box: pressed down by the face they came in by, not pushed out."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.contact.static_contact import ContactResult, solve_contact
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import BoxShape, RigidTool, ToolPath
from palpate.reference.availability import is_available

# How far inside a side of the box a row of vertices lies, over its half width.
MARGINS = [0.0, 1e-9, 1e-6, 1e-4, 1e-3, 5e-3, 1e-2]
# Outside, on the edge, within a step of it and beyond: each is another way in.
AGAINST_THE_REFERENCE = [-1e-2, 0.0, 1e-6, 1e-3]
# The row is so far from the middle; the other way the box is wider, and ends between two rows.
ROW, FAR = 0.25, 0.35


def pressed(
    margin: float,
    depth: float,
    ratio: float,
    *,
    counts: tuple[int, int, int] = (4, 4, 4),
    time: TimeSpan | None = None,
    aside: float = 0.0,
) -> Problem:
    """A box pressed into the middle of a unit cube's top, then drawn aside along x."""
    mesh = brick_box(counts, (1.0, 1.0, 1.0))
    height = mesh.points[mesh.boundary_facets][:, :, 2]
    base = mesh.boundary_facets[(height == 0.0).all(axis=1)]
    top = mesh.boundary_facets[(height == 1.0).all(axis=1)]
    low = 1.25 - depth
    knots = np.array([[0.5, 0.5, 1.255], [0.5, 0.5, low], [0.5 + aside, 0.5, low]])
    end = 2.0 if time is None else time.end_time
    count = 3 if aside else 2
    path = ToolPath(np.array([0.0, 0.5 * end, end])[:count], knots[:count])
    tool = RigidTool(BoxShape((ROW * (1.0 + margin), FAR, 0.25)), path, contact_facets=top)
    fixed = (Support(np.unique(base).astype(np.int32), base),)
    return Problem(mesh, Material(1e4, ratio), fixed, (), time, (tool,))


def under(problem: Problem) -> np.ndarray[tuple[int, ...], np.dtype[np.int32]]:
    points = problem.mesh.points
    near = (np.abs(points[:, 0] - 0.5) < ROW + 1e-9) & (np.abs(points[:, 1] - 0.5) < FAR)
    return np.flatnonzero(near & (points[:, 2] == 1.0)).astype(np.int32)


@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize("ratio", [0.0, 0.1])
@pytest.mark.parametrize("margin", MARGINS)
def test_statics_hold_them_at_the_depth_of_the_box(
    margin: float, ratio: float, strain: Strain
) -> None:
    """The same as with these points prescribed on the face, free to slide along it."""
    depth = 0.08
    problem = pressed(margin, depth, ratio)
    down = Support(under(problem), components=(False, False, True), displacement=(0, 0, -depth))
    by_hand = Problem(problem.mesh, problem.material, (*problem.supports, down), ())
    expected = solve_static(by_hand, strain=strain).displacement
    # None slides off, so that this is the solution with contact too.
    reach = np.abs((problem.mesh.points + expected)[under(problem), 0] - 0.5).max()
    assert reach < ROW * (1.0 + margin)
    found = solve_contact(problem, strain=strain)
    np.testing.assert_allclose(found.displacements[-1], expected, rtol=0.0, atol=1e-9)
    assert found.areas[-1, 0] == pytest.approx(len(under(problem)) / 16.0)


def last(result: ContactResult) -> tuple[np.ndarray, np.ndarray]:
    return result.displacements[-1], result.forces[-1]


@pytest.mark.dolfinx
@pytest.mark.skipif(not is_available(), reason="no FEniCSx")
@pytest.mark.parametrize("ratio", [0.0, 0.4])
@pytest.mark.parametrize("margin", AGAINST_THE_REFERENCE)
def test_statics_are_those_of_the_reference_also_where_vertices_slide_off(
    margin: float, ratio: float
) -> None:
    from palpate.reference.statics import solve_static as solve_reference

    problem = pressed(margin, 0.05, ratio, counts=(4, 4, 3), aside=0.03)
    displacement, force = last(solve_contact(problem))
    theirs = solve_reference(problem)
    assert np.abs(displacement - theirs.displacement).max() < 1e-8 * np.abs(displacement).max()
    assert np.abs(force[0] - theirs.tools[0].forces[-1]).max() < 1e-8 * np.abs(force).max()


@pytest.mark.parametrize("form", list(ContactForm))
@pytest.mark.parametrize("margin", MARGINS[3:])
def test_steps_press_them_down(margin: float, form: ContactForm) -> None:
    """A step of the box is 2e-4 deep, so deep or deeper than the first of them lie inside its side.

    Nearer to it than that they may slide off while the body still rings.
    """
    depth = 0.03
    problem = pressed(margin, depth, 0.0, time=TimeSpan(0.175, 1e-3, 50.0, 5))
    motion = simulate(problem, contact=ContactLaw(form))
    moved = motion.displacements[-1][under(problem)]
    # Penalties give: a third is far more than the default leaves.
    assert moved[:, 2].max() < -0.67 * depth
    assert np.abs(moved[:, 0]).max() < 0.2 * depth


@pytest.mark.dolfinx
@pytest.mark.skipif(not is_available(), reason="no FEniCSx")
@pytest.mark.parametrize("ratio", [0.0, 0.4])
@pytest.mark.parametrize("margin", AGAINST_THE_REFERENCE)
def test_steps_are_those_of_the_reference(margin: float, ratio: float) -> None:
    from palpate.reference.stepping import simulate_explicit

    problem = pressed(margin, 0.05, ratio, time=TimeSpan(0.4, 1e-3, 20.0, 10), aside=0.05)
    ours, theirs = simulate(problem), simulate_explicit(problem)
    largest = np.abs(theirs.displacements).max()
    assert np.abs(ours.displacements - theirs.displacements).max() <= 1e-11 * largest
    most = np.abs(theirs.tool_forces).max()
    assert np.abs(ours.tools[0].mean_forces - theirs.tool_forces[0]).max() <= 1e-11 * most
