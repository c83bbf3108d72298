"""Contact over facets in motion: at rest that of statics, balances, critical step, refusals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from palpate.fastsim.body import Body
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.contact.contact_term import ContactTerm
from palpate.fastsim.contact.errors import FacetContactError
from palpate.fastsim.contact.static_contact import solve_contact
from palpate.fastsim.contact.tool_contact import ToolContact, poses_at
from palpate.fastsim.dynamic_relaxation import relax
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.errors import UnstableStepError
from palpate.fastsim.explicit_body import Precision
from palpate.fastsim.gpu.devices import UnsupportedOnDeviceError, known_devices
from palpate.fastsim.live_body import LiveBody
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    ContactRule,
    RigidTool,
    SphereShape,
    SurfaceShape,
    ToolPath,
)
from palpate.meshes.shapes import shape_sphere
from palpate.meshes.tet_mesh import TetMesh

MakeBox = Callable[..., TetMesh]
SOFT = Material(1e4, 0.3, 1000.0)
PENALTY = ContactLaw(ContactForm.PENALTY, 3e5)
EPS = {Precision.SINGLE: 2.0**-23, Precision.DOUBLE: 2.0**-52}
PATH = ToolPath(np.array([0.0, 0.3]), np.array([[0.5, 0.5, 0.905], [0.52, 0.5, 0.84]]))
BALL = RigidTool(SphereShape(0.4), PATH, contact=ContactRule.FACETS)
# Averages are inside before a ball of few edges touches.
FARTHER = ToolPath(PATH.times, PATH.positions + np.array([[0.0, 0.0, 0.03], [0.0, 0.0, 0.0]]))


@pytest.fixture(scope="module")
def slab(make_box: MakeBox) -> TetMesh:
    return make_box((6, 6, 3), (1.0, 1.0, 0.5))


def pressed(mesh: TetMesh, *tools: RigidTool, **span: float) -> Problem:
    fixed = Support(np.flatnonzero(mesh.points[:, 2] < 1e-9).astype(np.int32))
    time = replace(TimeSpan(0.35, num_outputs=15, mass_damping=2.0), **span)
    return Problem(mesh, SOFT, (fixed,), (), time, tools)


SHAPES = {
    "ball": (BALL.shape, (0.5, 0.5, 0.9)),
    "rod": (CapsuleShape(0.3, 0.2), (0.5, 0.5, 1.0)),
    "surface": (SurfaceShape(shape_sphere(0.4, edge_length=0.15)), (0.5, 0.5, 0.9)),
    "box": (BoxShape((0.3, 0.26, 0.3)), (0.5, 0.5, 0.8)),
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("element", list(Element))
def test_it_comes_to_rest_where_statics_are(slab: TetMesh, name: str, element: Element) -> None:
    shape, start = SHAPES[name]
    down = np.array(start) - np.outer([0.0, 0.06], [0.0, 0.0, 1.0])
    tool = replace(BALL, shape=shape, path=ToolPath(np.array([0.0, 1.0]), down))
    problem = replace(pressed(slab, tool), time=None)
    rest = relax(problem, element=element, contact=PENALTY)
    found = solve_contact(problem, element=element, law=PENALTY)
    force = found.forces[-1, 0, 2]
    assert force > 20.0
    assert np.abs(rest.tool_forces - found.forces[-1]).max() < 1e-7 * force
    assert np.abs(rest.displacement - found.displacements[-1]).max() < 1e-8 * 0.06


def test_beside_the_edge_of_a_box_points_stay_at_the_face_they_came_by(slab: TetMesh) -> None:
    """The bottom pushes down alone; at the nearest face they would be pushed out sideways."""
    path = ToolPath(np.array([0.0, 0.5]), np.array([[0.52, 0.5, 0.802], [0.52, 0.5, 0.75]]))
    tool = RigidTool(
        BoxShape((0.3, 0.26, 0.3)),
        path,
        contact_facets=slab.boundary_facets[
            (slab.points[slab.boundary_facets][:, :, 2] > 0.5 - 1e-9).all(axis=1)
        ],
        contact=ContactRule.FACETS,
    )
    found = solve_contact(replace(pressed(slab, tool), time=None), law=PENALTY)
    still = simulate(pressed(slab, tool, end_time=2.0, mass_damping=20.0), contact=PENALTY)
    force = found.forces[-1, 0]
    assert force[2] > 100.0
    assert np.abs(force[:2]).max() < 1e-12 * force[2]
    assert np.abs(still.tools[0].forces[:, :2]).max() < 1e-12 * force[2]
    assert np.abs(still.tools[0].forces[-1] - force).max() < 1e-3 * force[2]


def test_no_point_of_a_facet_pulls(slab: TetMesh) -> None:
    """Each pushes along its own normal, by its area and its own depth."""
    contact = ToolContact(pressed(slab, BALL), BALL, is_penalty=True)
    term = ContactTerm([contact], [PENALTY.stiffness or 0.0])
    term.poses = [poses_at(PATH, np.array([0.3]))[0]]
    u = np.zeros_like(slab.points)
    gaps = contact.gaps(u, term.poses[0])
    expected = (
        3e5 * (contact.sampling.areas * np.maximum(0.0, -gaps.distances))[:, None] * gaps.normals
    )
    assert np.abs(term.vectors(u)[0] - expected).max() < 1e-14 * np.abs(expected).max()
    assert 20 < (gaps.distances < 0.0).sum() < 400
    assert contact.sampling.areas.sum() == pytest.approx(contact.sampling.patch_areas.sum())


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("precision", list(Precision))
def test_the_tool_feels_what_a_free_body_gains(
    make_box: MakeBox, precision: Precision, friction: float
) -> None:
    mesh = make_box((4, 4, 4), (0.5, 0.5, 0.5))
    lying = np.repeat([[np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]], 2, axis=0)
    path = ToolPath(np.array([0.0, 0.4]), np.array([[0.2, 0.3, 0.701], [0.23, 0.3, 0.62]]), lying)
    tool = RigidTool(CapsuleShape(0.2, 0.3), path, friction, contact=ContactRule.FACETS)
    span = TimeSpan(0.4, time_step=2e-3, num_outputs=2)
    run = simulate(Problem(mesh, SOFT, (), (), span, (tool,)), precision=precision, num_threads=2)
    momentum = (Body(mesh, SOFT).lumped_mass[:, None] * run.velocity).sum(axis=0)
    impulse = (run.tools[0].mean_forces * (run.times[1] - run.times[0])).sum(axis=0)
    impulse += 0.5 * run.time_step * run.tools[0].forces[-1]
    assert np.linalg.norm(momentum) > 0.5
    scale = run.num_steps * mesh.num_points * EPS[precision]
    assert np.abs(momentum + impulse).max() < scale * np.linalg.norm(momentum)


@pytest.mark.parametrize(
    ("law", "friction"), [(PENALTY, 0.0), (ContactLaw(), 0.0), (ContactLaw(), 0.4)]
)
@pytest.mark.parametrize("element", list(Element))
def test_energy_balances_with_the_tools_work(
    slab: TetMesh, element: Element, law: ContactLaw, friction: float
) -> None:
    left = []
    problem = pressed(slab, replace(BALL, path=FARTHER, friction_coefficient=friction))
    for step in (4e-3, 1e-3):
        timed = replace(problem, time=replace(problem.time, time_step=step))
        run = simulate(timed, element=element, tracks_energy=True, contact=law)
        assert run.energies is not None
        work = np.abs(run.energies.external_work).max()
        left.append(np.abs(run.energies.balance).max() / work)
    assert left[1] < 3e-3
    # With the constraint a vertex that comes to the tool stops within a step, however short.
    assert law is not PENALTY or left[1] < 0.5 * left[0]


@pytest.mark.parametrize("element", list(Element))
def test_friction_takes_energy_and_never_gives_any(slab: TetMesh, element: Element) -> None:
    """A free body is thrown against a ball that rests, and rebounds along it."""
    still = ToolPath(np.zeros(1), np.array([[0.5, 0.5, 0.94]]))
    thrown = np.tile([0.3, 0.0, 0.4], (slab.num_points, 1))
    lost = []
    for friction in (0.0, 0.3):
        ball = RigidTool(SphereShape(0.4), still, friction, contact=ContactRule.FACETS)
        problem = Problem(slab, SOFT, (), (), TimeSpan(0.4, num_outputs=40), (ball,))
        run = simulate(problem, velocity=thrown, element=element, tracks_energy=True)
        energies = run.energies
        assert energies is not None
        whole = energies.strain + energies.kinetic
        lost.append(whole[0] - whole[-1])
        # Nothing else takes or gives energy; what comes to the ball stops within a step.
        off = np.abs(energies.balance - energies.balance[0]).max()
        assert off < 2e-3 * whole[0]
        impulse = run.tools[0].mean_forces.sum(axis=0)
    assert np.diff(whole).max() <= 1e-12 * whole[0]
    assert lost[1] > 2.0 * lost[0] > 0.0
    assert 0.2 * impulse[2] < impulse[0] < 0.4 * impulse[2]


@pytest.mark.parametrize("precision", list(Precision))
def test_threads_change_no_constraint(slab: TetMesh, precision: Precision) -> None:
    problem = pressed(slab, replace(BALL, path=FARTHER))
    one, two = (simulate(problem, precision=precision, num_threads=n) for n in (1, 2))
    largest = np.abs(one.displacements).max()
    apart = np.abs(one.displacements - two.displacements).max()
    assert apart < one.num_steps * 10.0 * EPS[precision] * largest
    assert one.tools[0].stiffness is None
    # What touches at rest is on the tool, up to the curvature of one step's way.
    assert one.tools[0].mean_forces[-1, 2] > 5.0


def test_threads_change_no_more_than_roundings(slab: TetMesh) -> None:
    other = replace(BALL, contact=ContactRule.VERTICES, path=PATH)
    problem = pressed(slab, BALL, other)
    one, two = (simulate(problem, contact=PENALTY, num_threads=n) for n in (1, 2))
    again = simulate(problem, contact=PENALTY, num_threads=2)
    assert np.array_equal(two.displacements, again.displacements)
    largest = np.abs(one.displacements).max()
    assert np.abs(one.displacements - two.displacements).max() < 1e-9 * largest
    # Both tools push, each by its own rule.
    forces = [track.forces[-1, 2] for track in one.tools]
    assert min(forces) > 1.0
    alone = simulate(pressed(slab, BALL), contact=PENALTY).tools[0].forces[-1, 2]
    assert alone == pytest.approx(sum(forces), rel=0.5)


def test_the_critical_step_is_that_of_the_penalty(slab: TetMesh) -> None:
    stiff = ContactLaw(ContactForm.PENALTY, 3e6)
    alone = simulate(replace(pressed(slab, BALL), tools=())).critical_time_step
    critical = simulate(pressed(slab, BALL, end_time=0.05), contact=stiff).critical_time_step
    assert critical < 0.7 * alone
    with pytest.raises(UnstableStepError):
        simulate(pressed(slab, BALL, time_step=1.05 * critical), contact=stiff)
    run = simulate(pressed(slab, BALL, time_step=0.97 * critical), contact=stiff)
    assert 10.0 < run.tools[0].mean_forces[-1, 2] < 200.0


def test_a_live_body_is_pushed_over_facets(slab: TetMesh) -> None:
    body = LiveBody(pressed(slab, replace(BALL, path=FARTHER)))
    body.tools[0].move_to([0.5, 0.5, 0.86])
    body.step(round(0.4 / body.time_step))
    assert body.tools[0].force[2] > 5.0


def test_what_knows_vertices_only_says_so(slab: TetMesh) -> None:
    problem = pressed(slab, replace(BALL, path=FARTHER))
    box = replace(BALL, shape=SHAPES["box"][0])
    with pytest.raises(FacetContactError, match="beside a box is known at vertices only") as caught:
        simulate(pressed(slab, box), contact=ContactLaw())
    assert caught.value.tool == 0
    assert 'contact = "vertices"' in str(caught.value)
    for law, shape in ((PENALTY, BALL.shape), (None, SHAPES["box"][0])):
        with pytest.raises(FacetContactError, match=r"a penalty, .* has no friction there"):
            simulate(
                pressed(slab, replace(BALL, shape=shape, friction_coefficient=0.1)), contact=law
            )
    if "warp:cpu" in known_devices():
        with pytest.raises(UnsupportedOnDeviceError, match="contact over facets"):
            simulate(problem, device="warp:cpu")
    assert simulate(problem, strain=Strain.LINEAR).tools[0].forces[-1, 2] > 5.0
