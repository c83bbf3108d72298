"""Tools in motion: balance of momentum and energy, closed forms, order in 1/k, loud failure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from palpate.fastsim.body import Body
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.contact.errors import ToolInsideError, ToolTooFastError, ToolTooSmallError
from palpate.fastsim.dynamics import DynamicResult, simulate
from palpate.fastsim.errors import BlowUpError, UnstableStepError
from palpate.fastsim.explicit_body import Precision
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    ForceDrive,
    PlaneShape,
    RigidTool,
    SphereShape,
    ToolPath,
    ToolShape,
)
from palpate.meshes.tet_mesh import TetMesh

MakeBox = Callable[..., TetMesh]
SOFT = Material(1e4, 0.3, 1000.0)
LAWS = [ContactLaw(), ContactLaw(ContactForm.PENALTY)]
BOTH = pytest.mark.parametrize("law", LAWS, ids=lambda law: law.form.value)
EPS = {Precision.SINGLE: 2.0**-23, Precision.DOUBLE: 2.0**-52}


def straight(start: Points | list[float], end: Points | list[float], duration: float) -> ToolPath:
    return ToolPath(np.array([0.0, duration]), np.array([start, end]))


def standing(mesh: TetMesh) -> Support:
    return Support(np.flatnonzero(mesh.points[:, 2] < 1e-9).astype(np.int32))


@pytest.fixture(scope="module")
def slab(make_box: MakeBox) -> TetMesh:
    return make_box((6, 6, 3), (1.0, 1.0, 0.5))


def pressed(mesh: TetMesh, tool: RigidTool, end_time: float = 0.35, **span: float) -> Problem:
    time = TimeSpan(end_time, num_outputs=15, mass_damping=2.0)
    return Problem(mesh, SOFT, (standing(mesh),), (), replace(time, **span), (tool,))


SPHERE = RigidTool(SphereShape(0.4), straight([0.5, 0.5, 0.905], [0.5, 0.5, 0.84], 0.3))


@BOTH
@pytest.mark.parametrize("precision", list(Precision))
@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("element", list(Element))
def test_the_tool_feels_what_a_free_body_gains(
    make_box: MakeBox,
    law: ContactLaw,
    precision: Precision,
    friction: float,
    element: Element,
) -> None:
    # Nothing else acts on the body: its momentum is minus the tool's impulse.
    mesh = make_box((4, 4, 4), (0.5, 0.5, 0.5))
    lying = np.repeat([[np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]], 2, axis=0)
    path = ToolPath(np.array([0.0, 0.4]), np.array([[0.2, 0.3, 0.701], [0.23, 0.3, 0.62]]), lying)
    tool = RigidTool(CapsuleShape(0.2, 0.3), path, friction)
    # More steps to an output than are done at one go: impulses are summed over the pieces.
    span = TimeSpan(0.4, time_step=2e-3, num_outputs=2)
    problem = Problem(mesh, SOFT, (), (), span, (tool,))
    run = simulate(problem, element=element, contact=law, precision=precision, num_threads=2)
    mass = Body(mesh, SOFT).lumped_mass
    momentum = (mass[:, None] * run.velocity).sum(axis=0)
    impulse = (run.tools[0].mean_forces * (run.times[1] - run.times[0])).sum(axis=0)
    # The velocity at the end is halfway into the next step.
    impulse += 0.5 * run.time_step * run.tools[0].forces[-1]
    assert np.linalg.norm(momentum) > 0.5
    scale = run.num_steps * mesh.num_points * EPS[precision]
    assert np.abs(momentum + impulse).max() < scale * np.linalg.norm(momentum)


@BOTH
@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("element", list(Element))
def test_energy_balances_with_the_tools_work(
    slab: TetMesh, law: ContactLaw, friction: float, element: Element
) -> None:
    # A vertex that the constraint stops loses its speed in one step, whose middle is not known to
    # the sums: what is left over is first order there.
    tool = replace(SPHERE, friction_coefficient=friction)
    left = []
    for step in (4e-3, 1e-3):
        run = simulate(
            pressed(slab, tool, time_step=step), element=element, contact=law, tracks_energy=True
        )
        assert run.energies is not None
        work = np.abs(run.energies.external_work).max()
        left.append(np.abs(run.energies.balance).max() / work)
    assert left[1] < 3e-3
    assert left[1] < (0.8 if law.form is ContactForm.CONSTRAINT else 0.5) * left[0]


@BOTH
def test_threads_change_no_more_than_roundings(slab: TetMesh, law: ContactLaw) -> None:
    problem = pressed(slab, SPHERE)
    one, two = (simulate(problem, contact=law, num_threads=n) for n in (1, 2))
    again = simulate(problem, contact=law, num_threads=2)
    assert np.array_equal(two.displacements, again.displacements)
    assert np.array_equal(two.tools[0].forces, again.tools[0].forces)
    largest = np.abs(one.displacements).max()
    assert np.abs(one.displacements - two.displacements).max() < 1e-9 * largest


def test_the_constraint_lets_no_vertex_in(slab: TetMesh) -> None:
    run = simulate(pressed(slab, SPHERE))
    for time, u in zip(run.times, run.displacements, strict=True):
        centre = SPHERE.path.pose_at(float(time))[0]
        distance = np.linalg.norm(slab.points + u - centre, axis=1) - 0.4
        assert distance.min() > -1e-12
    assert run.tools[0].forces[-1, 2] > 10.0


def test_a_stiffer_penalty_comes_nearer_to_the_constraint(slab: TetMesh) -> None:
    end = simulate(pressed(slab, SPHERE, 1.0, mass_damping=30.0)).displacements[-1]
    errors = []
    for stiffness in (1e6, 4e6):
        law = ContactLaw(ContactForm.PENALTY, stiffness)
        u = simulate(pressed(slab, SPHERE, 1.0, mass_damping=30.0), contact=law).displacements[-1]
        errors.append(np.abs(u - end).max())
    assert errors[0] > 1e-5
    # First order in 1/k.
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.3)


def test_a_plane_presses_a_column_evenly(make_box: MakeBox) -> None:
    # Rollers on three sides, a plane on top: uniaxial stress, F = E A strain with linear strain.
    mesh = make_box((3, 3, 4), (0.3, 0.3, 0.4))
    rollers = []
    for axis in range(3):
        points = np.flatnonzero(mesh.points[:, axis] < 1e-9).astype(np.int32)
        fixed = [k == axis for k in range(3)]
        rollers.append(Support(points, components=(fixed[0], fixed[1], fixed[2])))
    top = np.flatnonzero((mesh.points[mesh.boundary_facets][:, :, 2] > 0.4 - 1e-9).all(axis=1))
    turned = np.array([[0.0, 1.0, 0.0, 0.0]])  # half a turn about x: the plane's outside is below
    path = ToolPath(
        np.array([0.0, 0.3]), np.array([[0, 0, 0.4], [0, 0, 0.396]]), np.repeat(turned, 2, axis=0)
    )
    tool = RigidTool(PlaneShape(), path, contact_facets=mesh.boundary_facets[top])
    time = TimeSpan(3.0, num_outputs=1, mass_damping=8.0)
    problem = Problem(mesh, SOFT, tuple(rollers), (), time, (tool,))
    run = simulate(problem, strain=Strain.LINEAR)
    strain = 0.004 / 0.4
    force = 1e4 * 0.09 * strain
    assert run.tools[0].mean_forces[-1, 2] > 0.5 * force
    assert run.tools[0].forces[-1, 2] == pytest.approx(force, rel=1e-5)
    u = run.displacements[-1]
    expected = mesh.points * np.array([0.3 * strain, 0.3 * strain, -strain])
    assert np.abs(u - expected).max() < 1e-5 * 0.004


@BOTH
def test_friction_drags_at_most_mu_times_the_pressure(slab: TetMesh, law: ContactLaw) -> None:
    # A plane on top, pressed and then moved aside: every vertex slides.
    flat = np.repeat([[0.0, 1.0, 0.0, 0.0]], 3, axis=0)
    path = ToolPath(
        np.array([0.0, 0.3, 1.8]),
        np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.49], [0.5, 0.0, 0.49]]),
        flat,
    )
    tool = RigidTool(PlaneShape(), path, 0.2)
    run = simulate(pressed(slab, tool, 1.4, mass_damping=20.0), contact=law)
    force = run.tools[0].mean_forces[-1]
    assert force[2] > 50.0
    assert force[0] == pytest.approx(-0.2 * force[2], rel=1e-3)
    assert abs(force[1]) < 1e-3 * force[2]


def test_a_driven_tool_drags_what_it_slides_over(slab: TetMesh) -> None:
    # A plane on top, pushed down and along: friction is against its own way.
    rising = TabularAmplitude((0.0, 0.3), (0.0, 1.0), True)
    drive = ForceDrive((0.8, 0.0, -0.6), 100.0, rising, 5.0)
    start = ToolPath(np.zeros(1), np.array([[0.0, 0.0, 0.5]]), np.array([[0.0, 1.0, 0.0, 0.0]]))
    tool = RigidTool(PlaneShape(), start, 0.2, drive=drive)
    force = simulate(pressed(slab, tool, 0.3)).tools[0].mean_forces
    assert force[-1, 2] > 10.0
    assert force[-1, 0] == pytest.approx(-0.2 * force[-1, 2], rel=0.05)


def test_a_tool_driven_by_a_force_comes_to_rest_under_it(slab: TetMesh) -> None:
    drive = ForceDrive((0.0, 0.0, -1.0), 60.0, TabularAmplitude((0.0, 0.3), (0.0, 1.0), True), 5.0)
    start = ToolPath(np.array([0.0]), np.array([[0.5, 0.5, 0.901]]))
    tool = RigidTool(SphereShape(0.4), start, drive=drive)
    run = simulate(pressed(slab, tool, 3.0, mass_damping=12.0))
    track = run.tools[0]
    assert track.stiffness is not None
    assert track.mean_forces[-5:, 2].mean() == pytest.approx(60.0, rel=0.05)
    assert 0.8 < track.positions[-1, 2] < 0.9
    with pytest.raises(InputError, match="penalty"):
        simulate(pressed(slab, tool), contact=ContactLaw())


def test_the_penalty_shortens_the_critical_step(slab: TetMesh) -> None:
    alone = simulate(replace(pressed(slab, SPHERE), tools=())).critical_time_step
    law = ContactLaw(ContactForm.PENALTY, 2e7)
    critical = simulate(pressed(slab, SPHERE, 0.05), contact=law).critical_time_step
    assert critical < 0.2 * alone
    with pytest.raises(UnstableStepError):
        simulate(pressed(slab, SPHERE, time_step=1.05 * critical), contact=law)
    # The bound is not idle: well above it the run does blow up, if it is let.
    with pytest.raises(UnstableStepError):
        simulate(pressed(slab, SPHERE, time_step=alone), contact=LAWS[1])


@BOTH
@pytest.mark.parametrize("shape", [SphereShape(0.3), BoxShape((0.3, 0.3, 0.3))])
def test_nothing_tunnels_up_to_the_stated_speed(
    make_box: MakeBox, law: ContactLaw, shape: ToolShape
) -> None:
    # A sheet of one layer of cells, free in space, shot at.
    mesh = make_box((6, 6, 1), (1.2, 1.2, 0.1))

    def shot(speed: float) -> tuple[DynamicResult, float]:
        path = straight([0.6, 0.6, 0.45], [0.6, 0.6, 0.45 - 0.8], 0.8 / speed)
        problem = Problem(
            mesh, SOFT, (), (), TimeSpan(0.8 / speed, num_outputs=10), (RigidTool(shape, path),)
        )
        run = simulate(problem, contact=law, strain=Strain.LINEAR)
        return run, run.tools[0].largest_speed

    allowed = shot(0.1)[1]
    run, _ = shot(0.99 * allowed)
    bottom = 0.45 - 0.8 - 0.3
    # The middle of the sheet is still ahead of the tool.
    middle = np.flatnonzero(np.linalg.norm(mesh.points[:, :2] - 0.6, axis=1) < 1e-9)
    slack = 0.15 if law.form is ContactForm.PENALTY else 1e-9
    assert (mesh.points + run.displacements[-1])[middle, 2].max() < bottom + slack
    with pytest.raises(ToolTooFastError) as caught:
        shot(2.0 * allowed)
    # Outputs cut the time step a little.
    assert caught.value.allowed == pytest.approx(allowed, rel=0.5)


def test_a_flying_body_that_is_too_fast_is_told(make_box: MakeBox) -> None:
    # The tool stands still; the body passes half of it in a step.
    mesh = make_box((6, 6, 1), (1.2, 1.2, 0.1))
    path = ToolPath(np.array([0.0]), np.array([[0.6, 0.6, -0.31]]))
    problem = Problem(
        mesh, SOFT, (), (), TimeSpan(0.05, num_outputs=5), (RigidTool(SphereShape(0.3), path),)
    )
    speed = np.zeros_like(mesh.points)
    speed[:, 2] = -60.0
    with pytest.raises(BlowUpError, match="through a tool"):
        simulate(problem, strain=Strain.LINEAR, velocity=speed)


def test_tools_that_cannot_be_used_are_told(slab: TetMesh) -> None:
    deep = replace(SPHERE, path=straight([0.5, 0.5, 0.85], [0.5, 0.5, 0.8], 1.0))
    with pytest.raises(ToolInsideError) as caught:
        simulate(pressed(slab, deep))
    assert caught.value.depth == pytest.approx(0.05)
    # No vertex in it, but it is in a cell.
    hidden = RigidTool(SphereShape(0.01), straight([0.52, 0.51, 0.22], [0.52, 0.51, 0.21], 1.0))
    with pytest.raises((ToolInsideError, ToolTooSmallError)):
        simulate(pressed(slab, hidden))
    small = RigidTool(SphereShape(0.02), straight([0.52, 0.51, 0.6], [0.52, 0.51, 0.4], 5.0))
    with pytest.raises(ToolTooSmallError) as too_small:
        simulate(pressed(slab, small))
    assert too_small.value.spacing == pytest.approx(np.sqrt(0.5) / 6.0, rel=0.1)
