"""Friction in statics, at vertices and over facets: Coulomb's law, stick and slip as FEniCSx's."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from palpate.fastsim.body import Body
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.contact.static_contact import solve_contact
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_tool import ContactRule, PlaneShape, RigidTool, SphereShape, ToolPath
from palpate.reference.availability import is_available
from palpate.validation.case import load_case

if is_available():
    from palpate.reference.statics import solve_static

FRICTION, DEPTH = 0.3, 0.05
# In steps that both simulators take whole: what sticks where depends on the steps [mm].
SPHERE = [[24.0 + 0.1 * k, 17.0 + 0.05 * k, 32.0 - 0.5 * min(k, 5)] for k in range(10)]
TURNED = ((1.0, 0.0, 0.0, 0.0), (0.998, 0.0, 0.0, (1.0 - 0.998**2) ** 0.5))


def block_on_a_plane(friction: float, rule: ContactRule = ContactRule.VERTICES) -> Problem:
    """A unit cube clamped at its top; a plane is pressed against its bottom and drawn along x."""
    mesh = brick_box((2, 2, 2), (1.0, 1.0, 1.0))
    top, bottom = side(mesh, 2, 1.0), side(mesh, 2, 0.0)
    ways = DEPTH * np.array([0.0, 0.1, 0.2, 0.4, 0.8, 1.2, 1.6, 1.55])
    knots = np.array([np.zeros(3), *([way, 0.0, DEPTH] for way in ways)])
    path = ToolPath(np.arange(len(knots)), knots)
    tool = RigidTool(PlaneShape(), path, friction, bottom, contact=rule)
    fixed = Support(np.unique(top).astype(np.int32), top)
    return Problem(mesh, Material(1.0, 0.0), (fixed,), (), tools=(tool,))


def drawn_ball(friction: float, rule: ContactRule = ContactRule.VERTICES) -> Problem:
    positions = 1e-3 * np.array(SPHERE)
    turns = np.array([TURNED[0]] * (len(positions) - 1) + [TURNED[1]])
    path = ToolPath(np.arange(len(positions)), positions, turns)
    tool = RigidTool(SphereShape(0.012), path, friction, contact=rule)
    return dataclasses.replace(load_case("press").problem, tools=(tool,))


@pytest.mark.parametrize("rule", list(ContactRule))
@pytest.mark.parametrize("strain", list(Strain))
def test_a_block_sticks_and_then_slips(strain: Strain, rule: ContactRule) -> None:
    forces = solve_contact(block_on_a_plane(FRICTION, rule), strain=strain).forces[1:, 0]
    normal, drag = -forces[:, 2], -forces[:, 0]
    assert np.all(drag <= FRICTION * normal * (1.0 + 1e-8))
    # Stuck, it is as stiff all the way; in the end it slides at mu N, within a thousandth.
    assert drag[2] == pytest.approx(2.0 * drag[1], rel=1e-3)
    assert drag[6] == pytest.approx(FRICTION * normal[6], rel=1e-3)
    assert drag[7] - drag[6] == pytest.approx(-0.5 * drag[1], rel=0.02)
    free = solve_contact(block_on_a_plane(0.0, rule), strain=strain).forces[:, 0]
    assert np.abs(free[:, :2]).max() < 1e-9 * normal[0]


@pytest.mark.dolfinx
@pytest.mark.parametrize("rule", list(ContactRule))
@pytest.mark.parametrize(
    ("problem", "strain"),
    [*((block_on_a_plane, strain) for strain in Strain), (drawn_ball, Strain.GREEN)],
)
def test_both_find_the_same_stick_and_slip(
    problem: Callable[..., Problem], strain: Strain, rule: ContactRule
) -> None:
    posed = problem(FRICTION, rule)
    ours, theirs = solve_contact(posed, strain=strain), solve_static(posed, strain=strain)
    forces = np.array(theirs.tools[0].forces)
    assert np.abs(forces[-1, :2]).max() > 0.02 * np.abs(forces[-1, 2])
    assert len(theirs.load_steps) == len(forces)
    size = np.abs(theirs.displacement).max()
    assert np.abs(ours.forces[:, 0] - forces).max() <= 1e-8 * np.abs(forces).max()
    assert np.abs(ours.displacements[-1] - theirs.displacement).max() <= 1e-8 * size
    # What the tool gives the supports have, or the body would not be at rest.
    internal = Body.of(posed, strain).internal_force(ours.displacements[-1])
    held = internal[posed.supports[0].points].sum(axis=0)
    assert np.abs(held - ours.forces[-1, 0]).max() < 1e-8 * np.abs(held).max()


@pytest.mark.dolfinx
def test_a_tenth_more_friction_is_seen_by_the_reference() -> None:
    posed = block_on_a_plane(FRICTION, ContactRule.FACETS)
    perturbed = solve_contact(block_on_a_plane(1.1 * FRICTION, ContactRule.FACETS)).forces[:, 0]
    apart = np.abs(perturbed - np.array(solve_static(posed).tools[0].forces))
    # The last knots but one slip: there it is a tenth of the drag, in the others less.
    assert apart[7, 0] == pytest.approx(0.1 * FRICTION * abs(perturbed[7, 2]), rel=0.05)
    assert apart.max() > 1e-2 * np.abs(perturbed).max()


def test_a_penalty_knows_no_friction() -> None:
    with pytest.raises(InputError, match="friction"):
        solve_contact(block_on_a_plane(FRICTION), law=ContactLaw(ContactForm.PENALTY))


def test_a_plate_that_only_touches_presses_nothing() -> None:
    """Turned over, by which its normal has roundings; that was refused as not settling."""
    problem = load_case("drag").problem
    forces = solve_contact(problem, times=np.array([0.0, 1.0]), strain=Strain.LINEAR).forces[:, 0]
    assert np.abs(forces[0]).max() < 1e-12
    np.testing.assert_allclose(forces[1], [0.0, 0.0, 0.25], atol=1e-9)


@pytest.mark.parametrize("part", [0.98, 1.02])
def test_the_case_of_a_plate_tells_two_per_cent_of_friction(part: float) -> None:
    case = load_case("drag")
    tool = dataclasses.replace(case.problem.tools[0], friction_coefficient=part * 0.2)
    other = dataclasses.replace(case.problem, tools=(tool,))
    force = solve_contact(other, strain=Strain.LINEAR).forces[-1, 0]
    (check,) = [c for c in case.checks if c.component == "x"]
    assert check.expected is not None
    assert abs(force[0] / check.expected - 1.0) > check.limit
