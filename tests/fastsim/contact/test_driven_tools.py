"""Tools that are driven by a force, in equilibrium: closed form, the reference, and refusals."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.fastsim.contact.errors import ContactLostError
from palpate.fastsim.contact.static_contact import solve_contact
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_tool import ForceDrive, PlaneShape, RigidTool, SphereShape, ToolPath
from palpate.reference.availability import is_available
from palpate.reference.errors import ReferenceNotConvergedError
from palpate.validation.case import load_case

if is_available():
    from palpate.reference.statics import solve_static

ALWAYS = TabularAmplitude((0.0,), (1.0,))
DOWN = (0.0, 0.0, -1.0)


def plate_on_a_column(force: float) -> Problem:
    """A column of 2 x 1 x 1 m at nu = 0 under a plate, of which the plane starts 0.1 m above."""
    mesh = brick_box((2, 2, 3), (1.0, 1.0, 2.0))
    bottom = side(mesh, 2, 0.0)
    fixed = Support(np.unique(bottom).astype(np.int32), bottom)
    path = ToolPath([3.0], [[0.0, 0.0, 2.1]], [[0.0, 1.0, 0.0, 0.0]])
    drive = ForceDrive(DOWN, force, ALWAYS, mass=1.0)
    tool = RigidTool(PlaneShape(), path, contact_facets=side(mesh, 2, 2.0), drive=drive)
    return Problem(mesh, Material(1000.0, 0.0), (fixed,), (), tools=(tool,))


def ball_on_a_slab(
    force: float, position: tuple[float, float, float] = (24.0, 17.0, 34.0)
) -> Problem:
    drive = ForceDrive(DOWN, force, ALWAYS, mass=1.0)
    tool = RigidTool(SphereShape(0.012), ToolPath([0.0], [1e-3 * np.array(position)]), drive=drive)
    return dataclasses.replace(load_case("press").problem, tools=(tool,))


def test_a_plate_goes_as_far_as_its_force_says() -> None:
    found = solve_contact(plate_on_a_column(30.0), strain=Strain.LINEAR)
    # F L / (E A) below the top, which it is 0.1 m above at first.
    np.testing.assert_allclose(found.times, [0.0, 0.1 + 30.0 * 2.0 / 1000.0], rtol=1e-8)
    np.testing.assert_allclose(found.forces[-1, 0], [0.0, 0.0, 30.0], atol=1e-7)
    assert found.displacements[-1][:, 2].min() == pytest.approx(-0.06, rel=1e-8)


@pytest.mark.dolfinx
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize("problem", [plate_on_a_column(30.0), ball_on_a_slab(0.1)])
def test_both_come_to_rest_at_the_same_state(problem: Problem, strain: Strain) -> None:
    ours, theirs = solve_contact(problem, strain=strain), solve_static(problem, strain=strain)
    (felt,) = theirs.tools
    force = problem.tools[0].drive
    assert force is not None
    assert felt.forces[-1][2] == pytest.approx(force.force, rel=1e-8)
    np.testing.assert_allclose(ours.forces[-1, 0], felt.forces[-1], atol=1e-8 * force.force)
    largest = np.abs(theirs.displacement).max()
    assert np.abs(ours.displacements[-1] - theirs.displacement).max() <= 1e-8 * largest


@pytest.mark.dolfinx
def test_both_refuse_what_cannot_be_driven() -> None:
    for solve in (solve_contact, solve_static):
        with pytest.raises(InputError, match=r"tool 1 .* above 0"):
            solve(ball_on_a_slab(-0.1))


@pytest.mark.dolfinx
def test_a_tool_that_misses_the_body_is_told() -> None:
    beside = ball_on_a_slab(0.1, (-30.0, 17.0, 34.0))
    with pytest.raises(ContactLostError, match="aim it at the body"):
        solve_contact(beside)
    with pytest.raises(ReferenceNotConvergedError, match="aim it at the body"):
        solve_static(beside)
