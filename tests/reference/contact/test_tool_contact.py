"""Tools pressed into a block: closed forms, balance, energy, and honest ends."""

from __future__ import annotations

import numpy as np
import pytest
from bank import KINDS, rollers, support

from palpate.meshes import bricks
from palpate.meshes.boundary_conditions import BodyForce
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    PlaneShape,
    RigidTool,
    SphereShape,
    ToolPath,
)
from palpate.reference.availability import is_available
from palpate.reference.errors import ReferenceNotConvergedError

if is_available():
    from palpate.reference.audit import audit_displacement
    from palpate.reference.discrete_problem import DiscreteProblem, internal_force
    from palpate.reference.statics import find_equilibrium, solve_static

pytestmark = pytest.mark.dolfinx

MATERIAL = Material(1e4, 0.3)
DOWN = (0.0, 1.0, 0.0, 0.0)  # half a turn about x: the tool's +z looks down
LYING = (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)  # a quarter turn about y: along x


def pressed(shape, heights, position=(0.5, 0.5), rotation=DOWN, **more):
    """A tool that goes down along z, one knot for each height."""
    knots = np.array([[*position, z] for z in heights])
    turns = np.tile(rotation, (len(knots), 1))
    return RigidTool(shape, ToolPath(np.arange(len(knots)) * 1.0, knots, turns), **more)


def solve(mesh, tool, *, supports=None, loads=(), **options):
    fixed = (support(mesh, "z0"),) if supports is None else supports
    return solve_static(Problem(mesh, MATERIAL, fixed, loads, tools=(tool,)), **options)


@pytest.mark.parametrize(
    ("shape", "height", "rotation", "kind"),
    [
        pytest.param(SphereShape(0.5), 1.5, DOWN, "quadratic", id="sphere"),
        pytest.param(CapsuleShape(0.3, 0.4), 1.3, LYING, "smoothed", id="lying"),
        pytest.param(BoxShape((0.3, 0.3, 0.2)), 1.2, DOWN, "linear", id="box"),
    ],
)
def test_force_balances_reactions_and_is_the_slope_of_energy(box, shape, height, rotation, kind):
    mesh = box((4, 4, 3), jitter=0.1)
    depths = (0.08, 0.081, 0.082)
    energies, felt = [], None
    for depth in depths:
        tool = pressed(shape, (height, height - depth), rotation=rotation)
        result = solve(mesh, tool, **KINDS[kind])
        energies.append(result.strain_energy)
        if depth == depths[1]:
            felt = result.tools[0]
            at_points = result.displacement
    force = np.array(felt.forces[-1])
    assert force[2] > 1.0
    # dW/ds = F: the body pushes the tool back up. Central difference, and kinks of the contact.
    slope = (energies[2] - energies[0]) / (depths[2] - depths[0])
    assert slope == pytest.approx(force[2], rel=1e-3)
    if kind != "quadratic":
        internal = internal_force(mesh, at_points, material=MATERIAL, **KINDS[kind])
        fixed = np.unique(mesh.facet_groups["z0"])
        np.testing.assert_allclose(internal[fixed].sum(axis=0), force, atol=1e-8 * force[2])
        # Moments about the tool's origin: what the support gives, the tool takes.
        arms = mesh.points + at_points - [0.5, 0.5, height - depths[1]]
        moment = np.cross(arms[fixed], internal[fixed]).sum(axis=0)
        np.testing.assert_allclose(moment, felt.moments[-1], atol=1e-8 * force[2])
        assert felt.penetrations[-1] < 1e-8


def test_a_wide_box_presses_like_a_plane(box):
    mesh = box((3, 3, 3), jitter=0.2)
    wide = solve(mesh, pressed(BoxShape((3.0, 3.0, 1.0)), (2.0, 1.85)))
    flat = solve(mesh, pressed(PlaneShape(), (1.0, 0.85)))
    # Both to the same contact forces within 1e-9 of them.
    np.testing.assert_allclose(wide.displacement, flat.displacement, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(wide.tools[0].forces, flat.tools[0].forces, rtol=1e-7, atol=1e-5)


def test_a_box_goes_in_by_its_face_however_far_its_knots_are_apart(box):
    # In one leap the points near its edges would leave it sideways.
    mesh = box((4, 4, 3), jitter=0.1)
    shape = BoxShape((0.3, 0.3, 0.2))
    once = solve(mesh, pressed(shape, (1.2, 1.12)))
    often = solve(mesh, pressed(shape, 1.2 - 0.01 * np.arange(9)))
    np.testing.assert_allclose(once.displacement, often.displacement, rtol=0.0, atol=1e-9)


def test_tangent_is_symmetric_and_the_derivative(box):
    mesh = box((3, 3, 3), jitter=0.2)
    tool = pressed(SphereShape(0.5), (1.4,))
    problem = Problem(mesh, MATERIAL, (support(mesh, "z0"),), (), tools=(tool,))
    eq = DiscreteProblem(problem, strain=Strain.GREEN, degree=1)
    rng = np.random.default_rng(5)
    u, du, h = *(s * rng.standard_normal(eq.num_dofs) for s in (1e-2, 1.0)), 1e-7
    eq.contacts[0].pressure[:] = 500.0
    assert np.linalg.norm(eq.contact_force(u)) > 1.0
    tangent = np.array(eq.tangent(u, 1.0).convert("dense").getDenseArray())
    np.testing.assert_allclose(tangent, tangent.T, atol=1e-12 * np.abs(tangent).max())

    def residual(at):
        return eq.internal_force(at) - eq.contact_force(at)

    slope = (residual(u + h * du) - residual(u - h * du)) / (2.0 * h)
    np.testing.assert_allclose(tangent @ du, slope, atol=1e-7 * np.abs(slope).max())


@pytest.mark.parametrize("degree", [1, 2])
def test_far_from_equilibrium_the_tangent_of_a_round_tool_is_definite(box, degree):
    """A step puts nodes deep into a ball, whose curvature then pulls them round it."""
    mesh = box((4, 4, 3), jitter=0.1)
    problem = Problem(
        mesh, MATERIAL, (support(mesh, "z0"),), (), tools=(pressed(SphereShape(0.9), (1.6,)),)
    )
    lowest = {}
    for is_near in (True, False):
        eq = DiscreteProblem(problem, strain=Strain.GREEN, degree=degree)
        (contact,) = eq.contacts
        contact.is_near = is_near
        dense = eq.tangent(np.zeros(eq.num_dofs), 1.0).convert("dense").getDenseArray()
        free = np.setdiff1d(np.arange(eq.num_dofs), eq.fixed.dofs)
        lowest[is_near] = np.linalg.eigvalsh(np.array(dense)[np.ix_(free, free)])[0]
    assert lowest[True] < 0.0 < lowest[False]


def test_a_tool_that_goes_through_ends_its_way_sooner_where_less_is_asked(box):
    """As exact where it can; and of where it cannot only so much is found out."""
    mesh = box((4, 4, 2), jitter=0.05)
    deep = pressed(SphereShape(0.6), (1.6, 1.1))
    gentle = pressed(SphereShape(0.6), (1.6, 1.5))
    exact = solve(mesh, gentle, degree=2)
    rough = solve(mesh, gentle, degree=2, relative_tolerance=1e-6)
    np.testing.assert_allclose(rough.displacement, exact.displacement, rtol=0.0, atol=1e-6)
    reached, tried = [], []
    for tolerance in (1e-10, 1e-6):
        lines: list[str] = []
        with pytest.raises(ReferenceNotConvergedError) as caught:
            solve(mesh, deep, relative_tolerance=tolerance, progress=lines.append)
        reached.append(caught.value.load_factor)
        tried.append(len(lines))
    assert 0.75 * reached[0] < reached[1] <= reached[0] + 1e-9
    assert tried[1] < 0.8 * tried[0]


def test_the_derivative_of_the_force_along_a_direction(box):
    mesh = box((3, 3, 3), jitter=0.2)
    tool = pressed(SphereShape(0.5), (1.4,))
    problem = Problem(mesh, MATERIAL, (support(mesh, "z0"),), (), tools=(tool,))
    eq = DiscreteProblem(problem, strain=Strain.GREEN, degree=2)
    (contact,) = eq.contacts
    rng = np.random.default_rng(6)
    u, du, h = *(s * rng.standard_normal(eq.num_dofs) for s in (1e-3, 1.0)), 1e-7
    contact.pressure[:] = 500.0
    along = np.array([0.6, 0.0, 0.8])
    slope = (contact.state(u + h * du).force - contact.state(u - h * du).force) @ along / (2.0 * h)
    assert abs(slope) > 1.0
    assert contact.derivative_of_force(u, along) @ du == pytest.approx(slope, rel=1e-6)


@pytest.mark.parametrize("strain", list(Strain))
def test_from_nearby_it_comes_to_where_its_way_leads(box, strain):
    mesh = box((3, 3, 3))
    tool = pressed(SphereShape(0.5), (1.5, 1.4))
    problem = Problem(mesh, MATERIAL, (support(mesh, "z0"),), (), tools=(tool,))
    led = solve_static(problem, strain=strain, degree=2)

    def arrive(make_guess):
        found = find_equilibrium(problem, strain=strain, degree=2, guess=make_guess)
        try:
            return found.result(), found.path.load_factors
        finally:
            found.destroy()

    near = solve(mesh, pressed(SphereShape(0.5), (1.5, 1.42)), strain=strain, degree=2)

    def guess(discrete):
        start = np.zeros((discrete.space.num_blocks, 3))
        at = discrete.space.owned_dofs(np.arange(mesh.num_points, dtype=np.int32))
        start[at] = near.displacement
        return start.ravel()

    # Of a guess that leads nowhere the way is gone after all.
    for start, is_short in ((guess, True), (lambda d: np.full(d.num_dofs, np.nan), False)):
        found, factors = arrive(start)
        assert (factors == (1.0,)) == is_short
        np.testing.assert_allclose(
            found.tools[0].forces[-1],
            led.tools[0].forces[-1],
            atol=1e-8 * led.tools[0].forces[-1][2],
        )
        largest = np.abs(led.displacement).max()
        np.testing.assert_allclose(found.displacement, led.displacement, atol=1e-8 * largest)


def test_loads_come_before_the_tool_moves(box):
    mesh = box((3, 3, 3))
    tool = pressed(PlaneShape(), (1.0, 0.95))
    weight = (BodyForce((0.0, 0.0, -800.0)),)
    result = solve(mesh, tool, supports=rollers(mesh), loads=weight)
    # A column under its own weight, top pressed by what the tool adds: sigma = P + rho g (h - z).
    (felt,) = result.tools
    assert felt.forces[0][2] == pytest.approx(0.0, abs=1e-6)  # the top has sunk away from it
    assert 0.0 < felt.forces[1][2] < 0.05 * 1e4
    top = np.unique(mesh.facet_groups["z1"])
    np.testing.assert_allclose(result.displacement[top, 2], -0.05, atol=1e-10)


def test_a_tool_pressed_through_the_body_ends_honestly(box):
    mesh = box((3, 3, 3))
    with pytest.raises(ReferenceNotConvergedError, match="on the way of the tools") as caught:
        solve(mesh, pressed(PlaneShape(), (1.0, 0.3)))
    error = caught.value
    assert 0.3 < error.load_factor < 1.0
    assert error.smallest_det_f > 0.0
    # The last good state: the plane has come down to where the top is.
    top = np.unique(mesh.facet_groups["z1"])
    depth = 0.7 * error.load_factor
    assert error.displacement[top, 2].mean() == pytest.approx(-depth, rel=0.05)


def test_what_is_not_modelled_is_refused(box):
    mesh = box((2, 2, 2))
    inside = np.array([[0, 1, 13]], dtype=np.int32)
    with pytest.raises(InputError, match="not on the boundary"):
        solve(mesh, pressed(PlaneShape(), (1.0,), contact_facets=inside))
    problem = Problem(
        mesh, MATERIAL, (support(mesh, "z0"),), (), tools=(pressed(PlaneShape(), (1.0,)),)
    )
    with pytest.raises(InputError, match="knows no tools"):
        audit_displacement(problem, np.zeros_like(mesh.points))


def test_a_large_ball_that_barely_touches_settles_at_the_digits_of_its_place() -> None:
    """Gaps of 1e-5 m beside a radius of 0.1 m: their last digits are 3e-10 of the force."""
    mesh = brick_box((4, 4, 3), (8e-3, 8e-3, 6e-3))
    positions = np.array([[0.0, 0.0, 0.106], [0.0, 0.0, 0.10599]])
    path = ToolPath(np.arange(2.0), positions)
    ball = RigidTool(SphereShape(0.1), path, contact_facets=side(mesh, 2, 6e-3))
    supports = bricks.rollers(mesh, ((0, 0.0), (1, 0.0), (2, 0.0)))
    problem = Problem(mesh, Material(5e3, 0.3), supports, (), tools=(ball,))
    (felt,) = solve_static(problem, strain=Strain.LINEAR, degree=2).tools
    # A quarter of Hertz' force has 1.83e-5 N; a dozen nodes touch, and the block is no half space.
    assert felt.forces[-1][2] == pytest.approx(1.83e-5, rel=0.1)
