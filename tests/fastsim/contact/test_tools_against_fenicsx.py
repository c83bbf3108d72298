"""Tools in explicit steps against the explicit steps on FEniCSx: motion and force on the tool."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.contact.errors import FacetContactError, ToolInsideError
from palpate.fastsim.contact.static_contact import solve_contact
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.explicit_body import ExplicitBody
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    ContactRule,
    PlaneShape,
    RigidTool,
    SphereShape,
    SurfaceShape,
    ToolError,
    ToolPath,
    ToolShape,
    smooth_path,
)
from palpate.meshes.shapes import shape_sphere
from palpate.reference.availability import is_available
from palpate.validation.case import load_case

if is_available():
    from palpate.reference.contact import explicit_tools
    from palpate.reference.dynamics import simulate_implicit
    from palpate.reference.statics import solve_static
    from palpate.reference.stepping import simulate_explicit

pytestmark = pytest.mark.dolfinx

# Rounding, step upon step; a contact that is switched otherwise would show as 1e-4 and more.
ALIKE = 1e-11
LYING = (0.5**0.5, 0.0, 0.5**0.5, 0.0)
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
DOWN = (0.0, 1.0, 0.0, 0.0)


def tool(shape: ToolShape, positions: list[list[float]], turn: tuple[float, ...]) -> RigidTool:
    """Positions [mm] at 0, 0.1 and 0.2 s."""
    places = 1e-3 * np.array(positions)
    return RigidTool(shape, ToolPath(np.array([0.0, 0.1, 0.2]), places, np.array([turn] * 3)))


TOOLS = {
    "sphere": tool(SphereShape(0.012), [[24, 17, 32.5], [25, 18, 29], [36, 22, 29]], UPRIGHT),
    "capsule": tool(CapsuleShape(0.006, 0.01), [[24, 17, 26.5], [25, 18, 23], [36, 22, 23]], LYING),
    "plane": tool(PlaneShape(), [[24, 17, 20.5], [25, 18, 18], [25, 18, 18.5]], DOWN),
    "surface": tool(
        SurfaceShape(shape_sphere(0.012, edge_length=0.006)),
        [[24, 17, 32.5], [25, 18, 29.5], [30, 20, 29.5]],
        UPRIGHT,
    ),
    "box": tool(BoxShape((0.008,) * 3), [[24, 17, 28.5], [25, 18, 25], [25, 18, 26]], UPRIGHT),
}
SECOND = tool(SphereShape(0.006), [[46, 30, 26.5], [45, 29, 24], [45, 29, 24.5]], UPRIGHT)


def slab(*tools: RigidTool, supports: tuple[Support, ...] = ()) -> Problem:
    problem = load_case("press").problem
    return dataclasses.replace(
        problem,
        tools=tools,
        supports=(*problem.supports, *supports),
        time=TimeSpan(0.2, 5e-4, 5.0, 20),
    )


def over(rule: ContactRule, given: RigidTool) -> RigidTool:
    """Over facets it begins 3 mm farther out: averages look ahead of a tool of few edges."""
    if rule is ContactRule.FACETS:
        places = given.path.positions.copy()
        places[0, 2] += 0.003
        given = dataclasses.replace(given, path=dataclasses.replace(given.path, positions=places))
    return dataclasses.replace(given, contact=rule)


def assert_alike(problem: Problem, strain: Strain, element: Element = Element.LINEAR) -> None:
    ours = simulate(problem, strain=strain, element=element)
    theirs = simulate_explicit(problem, strain=strain, element=element)
    assert ours.num_steps == theirs.num_steps
    largest = np.abs(theirs.displacements).max()
    assert largest > 1e-3
    assert np.abs(ours.displacements - theirs.displacements).max() <= ALIKE * largest
    for track, forces in zip(ours.tools, theirs.tool_forces, strict=True):
        most = np.abs(forces).max()
        assert most > 1e-2
        assert np.abs(track.mean_forces - forces).max() <= ALIKE * most


@pytest.mark.parametrize(
    ("name", "strain"), [("sphere", Strain.LINEAR), *((name, Strain.GREEN) for name in TOOLS)]
)
def test_one_tool(name: str, strain: Strain) -> None:
    assert_alike(slab(TOOLS[name]), strain)


@pytest.mark.parametrize("strain", list(Strain))
def test_a_surface_in_equilibrium(strain: Strain) -> None:
    places = 1e-3 * np.array([[24, 17, 32.2], [24.5, 17.3, 31], [25, 17.6, 30], [26, 18, 29]])
    pressed = dataclasses.replace(TOOLS["surface"], path=ToolPath(np.arange(4.0), places))
    problem = dataclasses.replace(slab(pressed), time=None)
    ours, theirs = solve_contact(problem, strain=strain), solve_static(problem, strain=strain)
    forces = np.array(theirs.tools[0].forces)
    assert forces[-1, 2] > 0.1
    assert np.abs(ours.forces[:, 0] - forces).max() <= 1e-8 * forces[-1, 2]
    largest = np.abs(theirs.displacement).max()
    assert np.abs(ours.displacements[-1] - theirs.displacement).max() <= 1e-8 * largest


def rough(rule: ContactRule, given: RigidTool, friction: float = 0.3) -> RigidTool:
    return dataclasses.replace(over(rule, given), friction_coefficient=friction)


@pytest.mark.parametrize(
    ("name", "rule", "element"),
    [
        ("sphere", ContactRule.VERTICES, Element.LINEAR),
        ("box", ContactRule.VERTICES, Element.LINEAR),
        ("sphere", ContactRule.FACETS, Element.LINEAR),
        ("sphere", ContactRule.FACETS, Element.SMOOTHED),
        ("plane", ContactRule.FACETS, Element.LINEAR),
    ],
)
def test_friction(name: str, rule: ContactRule, element: Element) -> None:
    assert_alike(slab(rough(rule, TOOLS[name])), Strain.GREEN, element)


@pytest.mark.parametrize("fault", ["a tenth more", "reversed"])
def test_a_fault_of_friction_is_seen(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = slab(rough(ContactRule.FACETS, TOOLS["sphere"]))
    problem = dataclasses.replace(problem, time=TimeSpan(0.15, 5e-4, 5.0, 6))
    ours = simulate(problem)
    if fault == "reversed":
        right = explicit_tools._SteppedTool._drag

        def reversed_drag(*args: object) -> Points:
            return -right(*args)  # type: ignore[arg-type]

        monkeypatch.setattr(explicit_tools._SteppedTool, "_drag", reversed_drag)
    else:
        problem = dataclasses.replace(
            problem, tools=(rough(ContactRule.FACETS, TOOLS["sphere"], 0.33),)
        )
    theirs = simulate_explicit(problem)
    forces = ours.tools[0].mean_forces
    assert np.abs(theirs.tool_forces[0] - forces).max() > 1e-3 * np.abs(forces).max()
    apart = np.abs(theirs.displacements - ours.displacements).max()
    assert apart > 1e8 * ALIKE * np.abs(ours.displacements).max()


@pytest.mark.parametrize("rule", list(ContactRule))
def test_friction_of_a_tool_that_turns_on_vertices_held_in_part(rule: ContactRule) -> None:
    """Vertices stick to the roller and slip on it; along y they are fixed."""
    path = TOOLS["capsule"].path
    half = np.array([0.0, 0.1, 0.4])[:, None]
    # First onto its side, then about its axis, which then lies along y.
    lying, rolled = np.array([1.0, -1.0, 0.0, 0.0]) * 0.5**0.5, np.zeros((3, 4))
    rolled[:, :] = np.cos(half) * lying + np.sin(half) * np.array([0.0, 0.0, 1.0, 1.0]) * 0.5**0.5
    roller = dataclasses.replace(
        rough(rule, TOOLS["capsule"], 0.4),
        path=ToolPath(path.times, over(rule, TOOLS["capsule"]).path.positions, rolled),
    )
    mesh = load_case("press").problem.mesh
    top = np.flatnonzero(mesh.points[:, 2] > 0.0199).astype(np.int32)
    rail = Support(top, components=(False, True, False))
    assert_alike(slab(roller, supports=(rail,)), Strain.GREEN)


def test_averages_that_are_inside_before_the_tool_touches_are_refused_by_both() -> None:
    near = slab(dataclasses.replace(TOOLS["sphere"], contact=ContactRule.FACETS))
    with pytest.raises(ToolInsideError) as refused:
        simulate(near)
    with pytest.raises(InputError, match=f"{refused.value.depth:g} m deep"):
        simulate_explicit(near)


@pytest.mark.parametrize(
    ("first", "second"), [*itertools.combinations_with_replacement(ContactRule, 2)]
)
def test_two_tools_at_once(first: ContactRule, second: ContactRule) -> None:
    assert_alike(slab(over(first, TOOLS["sphere"]), over(second, SECOND)), Strain.GREEN)


@pytest.mark.parametrize("rule", list(ContactRule))
def test_vertices_that_are_held_in_part(rule: ContactRule) -> None:
    mesh = load_case("press").problem.mesh
    top = np.flatnonzero(mesh.points[:, 2] > 0.0199).astype(np.int32)
    assert_alike(
        slab(
            over(rule, TOOLS["sphere"]), supports=(Support(top, components=(False, True, False)),)
        ),
        Strain.GREEN,
    )


@pytest.mark.parametrize(
    ("name", "element"),
    [*itertools.product(("sphere", "capsule", "plane"), Element), ("surface", Element.LINEAR)],
)
def test_averages_over_facets(name: str, element: Element) -> None:
    """The multipliers of neighbours are found by two algorithms: the same ones."""
    problem = slab(over(ContactRule.FACETS, TOOLS[name]))
    if name == "surface":  # the reference takes 40 ms a step here: pressed, and a little of its way
        problem = dataclasses.replace(problem, time=TimeSpan(0.11, 5e-4, 5.0, 11))
    assert_alike(problem, Strain.GREEN, element)


def test_what_is_known_at_vertices_only_is_refused_by_both() -> None:
    with pytest.raises(ToolError, match='or contact = "vertices"'):
        simulate_explicit(slab(over(ContactRule.FACETS, TOOLS["box"])))
    with pytest.raises(FacetContactError, match="friction"):
        ExplicitBody(
            slab(rough(ContactRule.FACETS, TOOLS["sphere"])),
            contact=ContactLaw(ContactForm.PENALTY),
        )
    with pytest.raises(FacetContactError, match="box"):
        ExplicitBody(
            slab(over(ContactRule.FACETS, TOOLS["box"])), contact=ContactLaw(ContactForm.CONSTRAINT)
        )


def plate_drawn_over_a_block(
    number: int, time_step: float, rule: ContactRule = ContactRule.VERTICES
) -> Problem:
    """20 x 20 x 10 mm in bricks, `number` high; a plate presses it and is drawn 2 mm along."""
    mesh = brick_box((2 * number, 2 * number, number), (0.02, 0.02, 0.01))
    places = 1e-3 * np.array([[0, 0, 10.01], [0, 0, 9.6], [2, 0, 9.6]])
    path = smooth_path(ToolPath(np.array([0.0, 0.06, 0.12]), places, np.array([DOWN] * 3)))
    plate = RigidTool(PlaneShape(), path, 0.3, side(mesh, 2, 0.01), contact=rule)
    span = TimeSpan(0.12, time_step, mass_damping=200.0, num_outputs=6)
    bottom = support_of(side(mesh, 2, 0.0))
    return Problem(mesh, Material(1e4, 0.3, 1000.0), (bottom,), (), time=span, tools=(plate,))


def test_over_facets_a_plate_sticks_and_slips_as_at_vertices() -> None:
    """What is linear is averaged to its value at the vertex; in the end it slides at mu N.

    A vertex slides a thousandth of its way across, too: along it is mu N up to its square.
    """
    found = [
        simulate(plate_drawn_over_a_block(2, 2.5e-4, rule), strain=Strain.LINEAR)
        for rule in ContactRule
    ]
    force = found[1].tools[0].mean_forces
    assert abs(force[3, 0]) < 0.01 * force[3, 2]
    assert force[-1, 0] == pytest.approx(-0.3 * force[-1, 2], rel=1e-5)
    size = np.abs(found[0].displacements).max()
    assert np.abs(found[1].displacements - found[0].displacements).max() < ALIKE * size
    assert np.abs(force - found[0].tools[0].mean_forces).max() < ALIKE * force.max()


def test_finer_meshes_and_steps_come_to_the_truth_with_friction() -> None:
    truth = simulate_implicit(
        plate_drawn_over_a_block(2, 0.005),
        strain=Strain.LINEAR,
        spectral_radius=0.0,
        relative_tolerance=1e-6,
    ).tool_forces[0]
    # It sticks, and then slides at mu N.
    assert abs(truth[3, 0]) < 0.01 * truth[3, 2]
    assert truth[-1, 0] == pytest.approx(-0.3 * truth[-1, 2], rel=1e-3)
    off = []
    for number, time_step in ((2, 2.5e-4), (4, 1.25e-4), (8, 6.25e-5)):
        problem = plate_drawn_over_a_block(number, time_step)
        ours = simulate(problem, strain=Strain.LINEAR).tools[0].mean_forces
        off.append(np.abs(ours - truth).max(axis=0)[[0, 2]] / np.abs(truth).max(axis=0)[[0, 2]])
    assert (off[1] < 0.5 * off[0]).all()
    assert (off[2] < 0.6 * off[1]).all()
    assert (off[2] < 0.015).all()
