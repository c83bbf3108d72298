"""Equilibrium with tools: closed forms, derivatives, complementarity, order in 1/k, lost paths."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from palpate.fastsim.body import Body
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.contact.contact_term import ContactTerm
from palpate.fastsim.contact.errors import ContactLostError, ToolInsideError
from palpate.fastsim.contact.static_contact import ContactResult, solve_contact
from palpate.fastsim.contact.tool_contact import ToolContact, poses_at
from palpate.fastsim.dynamic_relaxation import relax
from palpate.fastsim.statics import solve_static
from palpate.fastsim.supports import FixedPoints
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    ContactRule,
    PlaneShape,
    RigidTool,
    SphereShape,
    SurfaceShape,
    ToolPath,
)
from palpate.meshes.shapes import shape_sphere
from palpate.meshes.tet_mesh import TetMesh

MakeBox = Callable[..., TetMesh]
SOFT = Material(1e4, 0.3, 1000.0)
BOTH = pytest.mark.parametrize("strain", list(Strain))


def down(start: list[float], depths: list[float]) -> ToolPath:
    positions = np.array(start) - np.array(depths)[:, None] * [0.0, 0.0, 1.0]
    return ToolPath(np.arange(len(depths), dtype=float), positions)


@pytest.fixture(scope="module")
def slab(make_box: MakeBox) -> TetMesh:
    return make_box((8, 8, 4), (1.0, 1.0, 0.5))


def standing(mesh: TetMesh, tool: RigidTool) -> Problem:
    fixed = np.flatnonzero(mesh.points[:, 2] < 1e-9).astype(np.int32)
    return Problem(mesh, SOFT, (Support(fixed),), (), tools=(tool,))


SPHERE = RigidTool(SphereShape(0.4), down([0.5, 0.5, 0.9], [0.0, 0.03, 0.06]))


def column(make_box: MakeBox, sink: float) -> Problem:
    """Rollers on three sides of a column, a plane that comes down on it."""
    mesh = make_box((3, 3, 4), (0.3, 0.3, 0.4))
    rollers = []
    for axis in range(3):
        points = np.flatnonzero(mesh.points[:, axis] < 1e-9).astype(np.int32)
        fixed = [k == axis for k in range(3)]
        rollers.append(Support(points, components=(fixed[0], fixed[1], fixed[2])))
    half_turn = np.repeat([[0.0, 1.0, 0.0, 0.0]], 2, axis=0)
    path = ToolPath(np.array([0.0, 1.0]), np.array([[0, 0, 0.4], [0, 0, 0.4 - sink]]), half_turn)
    top = (mesh.points[mesh.boundary_facets][:, :, 2] > 0.4 - 1e-9).all(axis=1)
    tool = RigidTool(PlaneShape(), path, contact_facets=mesh.boundary_facets[top])
    return Problem(mesh, SOFT, tuple(rollers), (), tools=(tool,))


@BOTH
def test_a_plane_presses_a_column_evenly(make_box: MakeBox, strain: Strain) -> None:
    # Uniaxial stress. Linear: F = E A e. Green: S = E (s^2 - 1) / 2, force S s A.
    sink = 0.04
    found = solve_contact(column(make_box, sink), strain=strain)
    s = 1.0 - sink / 0.4
    stress = 1e4 * (1.0 - s) if strain is Strain.LINEAR else -1e4 * 0.5 * (s * s - 1.0) * s
    assert found.forces[-1, 0, 2] == pytest.approx(stress * 0.09, rel=1e-8)
    assert found.areas[-1, 0] == pytest.approx(0.09)
    assert np.abs(found.forces[-1, 0, :2]).max() < 1e-8 * stress * 0.09
    points = column(make_box, sink).mesh.points
    side = 1.0 + 0.3 * (1.0 - s) if strain is Strain.LINEAR else (1 + 0.3 * (1 - s * s)) ** 0.5
    expected = points * (np.array([side, side, s]) - 1.0)
    assert np.abs(found.displacements[-1] - expected).max() < 1e-8 * sink


def test_a_penalty_of_known_stiffness_is_a_spring_in_series(make_box: MakeBox) -> None:
    # The column yields by e, the penalty by sink - e: E A e / L = k A (sink - e), linear strain.
    law = ContactLaw(ContactForm.PENALTY, 5e4)
    found = solve_contact(column(make_box, 0.01), strain=Strain.LINEAR, law=law)
    gives = 1e4 / 0.4
    assert found.forces[-1, 0, 2] == pytest.approx(0.09 * 0.01 / (1 / gives + 1 / 5e4), rel=1e-9)
    assert found.penetrations[-1, 0] == pytest.approx(0.01 * gives / (gives + 5e4), rel=1e-9)


@BOTH
@pytest.mark.parametrize("form", list(ContactForm))
def test_equilibrium_and_complementarity(slab: TetMesh, strain: Strain, form: ContactForm) -> None:
    problem = standing(slab, SPHERE)
    found = solve_contact(problem, strain=strain, law=ContactLaw(form))
    u = found.displacements[-1]
    internal = Body(slab, SOFT, strain).internal_force(u)
    free = FixedPoints(problem).is_free.astype(bool)
    contact = ToolContact(problem, SPHERE)
    gaps = contact.gaps(u, poses_at(SPHERE.path, np.array([2.0]))[0])
    push = np.where(free, internal, 0.0)
    size = np.abs(push).max()
    assert size > 1.0
    # What the body asks for is pushed along the normals, at vertices that touch, nowhere else.
    along = np.sum(push[contact.vertices] * gaps.normals, axis=1)
    rest = push.copy()
    rest[contact.vertices] -= along[:, None] * gaps.normals
    assert np.abs(rest).max() < 1e-8 * size
    touching = along > 1e-7 * size
    assert 4 < touching.sum() < 30
    assert (along > -1e-8 * size).all()
    if form is ContactForm.CONSTRAINT:
        assert np.abs(gaps.distances[touching]).max() < 1e-9
        assert gaps.distances.min() > -1e-9
    else:
        expected = found.stiffnesses[0] * contact.areas * np.maximum(0.0, -gaps.distances)
        assert np.abs(along - expected).max() < 1e-7 * size
    # The tool feels minus the sum; the supports feel the rest.
    assert np.abs(found.forces[-1, 0] + (push.sum(axis=0))).max() < 1e-7 * size
    supports = internal[~free.all(axis=1)].sum(axis=0)
    assert np.abs(supports - found.forces[-1, 0]).max() < 1e-7 * size


def test_contact_force_is_minus_the_slope_of_its_energy(slab: TetMesh) -> None:
    problem = standing(slab, replace(SPHERE, shape=CapsuleShape(0.35, 0.05)))
    contact = ToolContact(problem, problem.tools[0])
    term = ContactTerm([contact], [3e5])
    term.poses = [poses_at(SPHERE.path, np.array([2.0]))[0]]
    u = 0.02 * np.random.default_rng(0).standard_normal(slab.points.shape)
    way = np.random.default_rng(1).standard_normal(slab.points.shape)

    def energy(at: Points) -> float:
        depth = np.minimum(contact.gaps(at, term.poses[0]).distances, 0.0)
        return float(0.5 * 3e5 * np.sum(contact.areas * depth**2))

    step = 1e-6
    slope = (energy(u + step * way) - energy(u - step * way)) / (2 * step)
    work = float(np.sum(term.force(u) * way))
    assert abs(work) > 0.1
    # Third derivatives of the energy times step^2 over the work: 3e5 / 0.4 * 1e-12.
    assert slope == pytest.approx(-work, rel=1e-6)


def test_the_tangent_is_the_slope_of_the_force(slab: TetMesh) -> None:
    problem = standing(slab, SPHERE)
    contact = ToolContact(problem, SPHERE)
    term = ContactTerm([contact], [3e5])
    term.poses = [poses_at(SPHERE.path, np.array([2.0]))[0]]
    u = np.zeros_like(slab.points)
    term.settle(u)
    way = np.random.default_rng(1).standard_normal(slab.points.shape)
    body = Body(slab, SOFT, Strain.LINEAR)
    body.core.assemble_tangent(u)
    without = body.core.multiply(way)
    assert term.add_tangent(body, u)  # other vertices touch than before
    with_tool = body.core.multiply(way) - without
    step = 1e-6
    ahead, behind = (term.force(s * step * way) for s in (1, -1))
    slope = -(ahead - behind) / (2 * step)
    assert np.abs(with_tool - slope).max() < 1e-6 * np.abs(slope).max()
    assert np.abs(term.force(u)).max() > 1.0
    assert not term.add_tangent(body, u)


def test_a_stiffer_penalty_comes_nearer_to_the_constraint(slab: TetMesh) -> None:
    problem = standing(slab, SPHERE)
    force = solve_contact(problem).forces[-1, 0, 2]
    lack = []
    for stiffness in (2e6, 4e6, 8e6):
        law = ContactLaw(ContactForm.PENALTY, stiffness)
        lack.append(force - solve_contact(problem, law=law).forces[-1, 0, 2])
    rates = np.log2(np.array(lack[:-1]) / lack[1:])
    assert lack[-1] > 1e-4 * force
    # First order in 1/k.
    assert np.abs(rates - 1.0).max() < 0.1


def test_the_constraint_does_not_depend_on_its_penalty(slab: TetMesh) -> None:
    problem = standing(slab, SPHERE)
    one, other = (
        solve_contact(problem, law=ContactLaw(stiffness=k)).displacements[-1] for k in (3e6, 3e7)
    )
    assert np.abs(one - other).max() < 1e-8 * np.abs(one).max()


def test_a_sphere_of_triangles_is_nearly_a_sphere(slab: TetMesh) -> None:
    round_one = solve_contact(standing(slab, SPHERE)).forces[-1, 0, 2]
    errors = []
    for edge in (0.1, 0.05):
        surface = SurfaceShape(shape_sphere(0.4, edge_length=edge))
        tool = replace(SPHERE, shape=surface)
        errors.append(abs(solve_contact(standing(slab, tool)).forces[-1, 0, 2] / round_one - 1))
    assert errors[0] < 0.2
    assert errors[1] < errors[0]


@BOTH
@pytest.mark.parametrize("law", [ContactLaw(), ContactLaw(ContactForm.PENALTY, 3e5)])
def test_explicit_steps_come_to_rest_at_the_same_state(
    slab: TetMesh, strain: Strain, law: ContactLaw
) -> None:
    problem = standing(slab, SPHERE)
    rest = relax(problem, strain=strain, contact=law)
    found = solve_contact(problem, strain=strain, law=law)
    assert found.forces[-1, 0, 2] > 50.0
    assert np.abs(rest.tool_forces - found.forces[-1]).max() < 1e-7 * found.forces[-1, 0, 2]
    assert np.abs(rest.displacement - found.displacements[-1]).max() < 1e-8 * 0.06


@BOTH
def test_from_nearby_the_same_state_is_found_without_the_way_there(
    slab: TetMesh, strain: Strain
) -> None:
    problem = standing(slab, SPHERE)
    found = solve_contact(problem, strain=strain)
    size = np.abs(found.displacements[-1]).max()
    near = found.displacements[-1] * (1.0 + 0.1 * np.cos(np.arange(3)))
    again = solve_contact(problem, strain=strain, start=near)
    assert again.times.tolist() == [found.times[-1]]
    assert again.iterations < found.iterations
    rest = relax(problem, strain=strain, start=near)
    for state in (again.displacements[-1], rest.displacement):
        assert np.abs(state - found.displacements[-1]).max() < 1e-7 * size
    warm = solve_static(problem, strain=strain, start=near)
    assert np.array_equal(warm.displacement, again.displacements[-1])


def test_a_flat_punch_touches_what_lies_below_it(slab: TetMesh) -> None:
    # Vertices 0.125 apart: 5 x 5 of them below the punch, at its middle.
    tool = RigidTool(BoxShape((0.26, 0.26, 0.3)), down([0.5, 0.5, 0.8], [0.0, 0.05]))
    found = solve_contact(standing(slab, tool))
    assert found.areas[-1, 0] == pytest.approx(25 * 0.125**2, rel=1e-9)
    top = np.flatnonzero(
        (slab.points[:, 2] > 0.5 - 1e-9) & (np.abs(slab.points[:, :2] - 0.5) < 0.26).all(axis=1)
    )
    assert np.abs(found.displacements[-1][top, 2] + 0.05).max() < 1e-8


def test_the_body_may_come_to_the_tool(slab: TetMesh) -> None:
    # Weight upwards presses the slab against a ceiling.
    half_turn = np.array([[0.0, 1.0, 0.0, 0.0]])
    tool = RigidTool(PlaneShape(), ToolPath(np.zeros(1), np.array([[0.0, 0.0, 0.505]]), half_turn))
    fixed = np.flatnonzero(slab.points[:, 2] < 1e-9).astype(np.int32)
    weight = BodyForce((0.0, 0.0, 2000.0))
    problem = Problem(slab, SOFT, (Support(fixed),), (weight,), tools=(tool,))
    found = solve_contact(problem)
    assert (slab.points + found.displacements[-1])[:, 2].max() == pytest.approx(0.505, abs=1e-9)
    assert found.forces[-1, 0, 2] > 10.0
    result = solve_static(problem)
    assert np.array_equal(result.displacement, found.displacements[-1])
    alone = solve_static(replace(problem, tools=()))
    assert (slab.points + alone.displacement)[:, 2].max() > 0.51


def test_a_lost_path_says_how_far_it_went(slab: TetMesh) -> None:
    tool = replace(SPHERE, path=down([0.5, 0.5, 0.9], [0.0, 0.05, 0.2]))
    with pytest.raises(ContactLostError) as caught:
        solve_contact(standing(slab, tool))
    partial = caught.value.partial
    assert isinstance(partial, ContactResult)
    assert 1.0 < caught.value.time < 2.0
    assert partial.times[-1] == caught.value.time
    assert partial.smallest_det_f[-1] > 0.0
    assert partial.forces[-1, 0, 2] > partial.forces[1, 0, 2] > 0.0
    # Linear strain knows no limit.
    assert len(solve_contact(standing(slab, tool), strain=Strain.LINEAR).times) == 3


def test_a_smoothed_cell_that_folds_is_named_with_the_law_that_bears_it(
    make_box: MakeBox,
) -> None:
    mesh = make_box((4, 4, 3), (0.04, 0.04, 0.02))
    path = down([0.0172, 0.0184, 0.046], [0.0, 0.012])
    tool = RigidTool(SphereShape(0.02), path, contact=ContactRule.FACETS)
    problem = replace(standing(mesh, tool), material=Material(5e3, 0.4))
    with pytest.raises(ContactLostError, match='law = "neo-hookean-stable"') as caught:
        solve_contact(problem, element=Element.SMOOTHED)
    partial, crushed = caught.value.partial, caught.value.crushed
    assert isinstance(partial, ContactResult)
    assert crushed is not None
    assert crushed.det_f == partial.smallest_det_f[-1]
    values = Body(mesh, problem.material).det_f(partial.displacements[-1])
    assert values[crushed.cell] == crushed.det_f < 0.5 * crushed.around
    assert str(crushed) in str(caught.value)
    # What is advised is what helps, without a cell that stands out.
    stable = replace(problem, material=Material(5e3, 0.4, law=Law.NEO_HOOKEAN_STABLE))
    found = solve_contact(stable, element=Element.SMOOTHED)
    borne = Body(mesh, stable.material).crushed_cell(found.displacements[-1])
    assert borne.det_f > 0.5 * borne.around


def test_small_smoothed_cells_under_a_tool_do_not_fold() -> None:
    """Without what goes back to plain cells under pressure: 0.42 after 88 iterations."""
    from palpate.fastsim.grading.near_tools import refine_near_tools
    from palpate.validation.case import load_case

    found = solve_contact(
        refine_near_tools(load_case("press").problem, 0.0039), element=Element.SMOOTHED
    )
    # Linear tetrahedra: 0.88 after 29 iterations.
    assert found.smallest_det_f[-1] > 0.8
    assert found.iterations <= 50


def test_what_statics_do_not_know_is_told(slab: TetMesh) -> None:
    with pytest.raises(ToolInsideError):
        solve_contact(standing(slab, replace(SPHERE, path=down([0.5, 0.5, 0.8], [0.0, 0.1]))))
    with pytest.raises(InputError, match="above 0"):
        ContactLaw(stiffness=-1.0)


def test_nothing_goes_through_a_round_tool_however_far_its_knots_are_apart(
    make_box: MakeBox,
) -> None:
    """In one leap the vertices under it would come out on top, and pull it down."""
    mesh = make_box((9, 7, 5), (0.06, 0.045, 0.04))
    lying = np.array([0.5**0.5, 0.0, 0.5**0.5, 0.0])
    found = []
    for knots in (2, 21):
        path = ToolPath(
            np.linspace(0.0, 1.0, knots),
            np.linspace([0.031, 0.0232, 0.048], [0.031, 0.0232, 0.042], knots),
            np.tile(lying, (knots, 1)),
        )
        found.append(solve_contact(standing(mesh, RigidTool(CapsuleShape(0.006, 0.02), path))))
    once, often = found
    assert once.forces[-1, 0, 2] > 0.0
    assert np.abs(once.displacements[-1] - often.displacements[-1]).max() < 1e-9
