"""A body stepped from outside: the same motion however it is stepped, pushed and read."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from bodies import clamped

from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.contact.errors import ToolTooFastError
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.errors import BlowUpError, UnstableStepError
from palpate.fastsim.explicit_body import ExplicitBody, Precision
from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, TimeSpan
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import TetMesh

SOFT = Material(1e4, 0.3, 1000.0)
SPAN = TimeSpan(1.0, mass_damping=2.0, num_outputs=4)
PRECISIONS = pytest.mark.parametrize("precision", list(Precision))
THREADS = pytest.mark.parametrize("num_threads", [1, 2])


def loaded(mesh: TetMesh, *tools: RigidTool) -> Problem:
    top = (mesh.points[mesh.boundary_facets][:, :, 2] > mesh.points[:, 2].max() - 1e-9).all(axis=1)
    loads = (BodyForce((0.0, 150.0, -300.0)), Pressure(mesh.boundary_facets[top], 40.0))
    return Problem(mesh, SOFT, (clamped(mesh, 2),), loads, SPAN, tools)


def ball(sink: float) -> RigidTool:
    """Over the middle of the top of a box of 1.6 x 1 x 1.2; comes down within 0.8 s."""
    positions = np.array([[0.8, 0.5, 1.81], [0.8, 0.5, 1.81 - sink]])
    return RigidTool(SphereShape(0.6), ToolPath(np.array([0.0, 0.8]), positions))


@PRECISIONS
@THREADS
@pytest.mark.parametrize("form", list(ContactForm))
def test_one_step_at_a_time_is_the_same_run_bit_for_bit(
    ragged_box: TetMesh, precision: Precision, num_threads: int, form: ContactForm
) -> None:
    problem = loaded(ragged_box, ball(0.12))
    law = ContactLaw(form)
    whole = simulate(problem, precision=precision, num_threads=num_threads, contact=law)
    assert np.abs(whole.tools[0].forces).max() > 1.0
    body = ExplicitBody(problem, precision=precision, num_threads=num_threads, contact=law)
    for number in range(whole.num_steps):
        if number % 3 == 0:
            body.look()  # what it finds is left to the next step
        body.step()
    assert body.time == pytest.approx(1.0)
    np.testing.assert_array_equal(body.displacement, whole.displacements[-1])
    np.testing.assert_array_equal(body.velocity(), whole.velocity)


def test_a_force_applied_is_the_load_it_stands_for(ragged_box: TetMesh) -> None:
    problem = loaded(ragged_box)
    points, forces = np.array([40, 41, 40], np.int32), np.array([[9.0, 0, 1], [0, 5, 0], [1, 1, 1]])
    pushed = dataclasses.replace(problem, loads=(*problem.loads, PointForce(points, forces)))
    body, other = ExplicitBody(problem), ExplicitBody(pushed)
    body.apply_force(forces, points=points)
    body.set_state(np.zeros_like(ragged_box.points))  # as if it had acted before the start
    for one in (body, other):
        one.step(20)
    assert np.abs(body.displacement).max() > 1e-3
    np.testing.assert_array_equal(body.displacement, other.displacement)
    # It ends when another one replaces it.
    body.apply_force(np.zeros_like(ragged_box.points))
    assert np.abs(body.load() - ExplicitBody(problem).load()).max() < 1.0


def test_a_force_changes_the_momentum_of_a_free_body(ragged_box: TetMesh) -> None:
    body = ExplicitBody(Problem(ragged_box, SOFT, (), ()))
    body.step(5)
    body.apply_force([[3.0, -2.0, 1.0]], points=[7])
    body.step(10)
    body.apply_force([[0.0, 0.0, 0.0]], points=[7])
    body.step(5)
    momentum = (body.elastic.lumped_mass[:, None] * body.velocity()).sum(axis=0)
    given = 10 * body.time_step * np.array([3.0, -2.0, 1.0])
    assert np.abs(momentum - given).max() < 1e-12 * np.abs(given).max()


@pytest.mark.parametrize("turn", [None, (np.cos(0.1), 0.0, np.sin(0.1), 0.0)])
def test_a_tool_that_is_sent_goes_the_same_way_as_one_on_that_path(
    ragged_box: TetMesh, turn: tuple[float, float, float, float] | None
) -> None:
    still = dataclasses.replace(ball(0.0))
    body = ExplicitBody(loaded(ragged_box, still))
    body.step(2)
    start, target = body.time, np.array([0.8, 0.5, 1.68])
    body.move_tool(0, target, turn)
    body.step(20)
    ends = np.array([start, body.time])
    turns = np.array([[1.0, 0, 0, 0], turn or (1.0, 0.0, 0.0, 0.0)])
    way = ToolPath(ends, np.array([[0.8, 0.5, 1.81], target]), turns)
    other = ExplicitBody(loaded(ragged_box, dataclasses.replace(still, path=way)))
    other.step(22)
    np.testing.assert_array_equal(body.displacement, other.displacement)
    assert body.tools is not None
    np.testing.assert_array_equal(
        body.tools.steps(np.array([9.0]))["pose"]["position"][0, 0], target
    )
    force = body.take_tool_records()["force"][0]
    assert force[2] > 1.0
    np.testing.assert_array_equal(force, other.take_tool_records()["force"][0])


def test_a_tool_is_not_sent_faster_than_vertices_can_follow(ragged_box: TetMesh) -> None:
    body = ExplicitBody(loaded(ragged_box, ball(0.0)))
    body.move_tool(0, [0.8, 0.5, 1.4])
    with pytest.raises(ToolTooFastError) as caught:
        body.step()
    assert caught.value.speed == pytest.approx(0.41 / body.time_step)


@PRECISIONS
def test_a_body_is_started_anew_from_any_state(ragged_box: TetMesh, precision: Precision) -> None:
    body = ExplicitBody(loaded(ragged_box, ball(0.05)), precision=precision)
    body.step(7)
    first = body.displacement.copy()
    velocity = np.random.default_rng(0).standard_normal(first.shape) * 0.01
    body.set_state(0.1 * first, velocity)
    assert body.steps == 0
    body.step(9)
    body.set_state(np.zeros_like(first))
    body.step(7)
    np.testing.assert_array_equal(body.displacement, first)


def test_the_state_is_read_into_one_array_that_cannot_be_written(ragged_box: TetMesh) -> None:
    body = ExplicitBody(loaded(ragged_box))
    fixed = body.displacement
    before = fixed.copy()
    body.step(5)
    assert body.displacement is fixed
    assert np.abs(fixed - before).max() > 0.0
    with pytest.raises(ValueError, match="read-only"):
        fixed[0] = 1.0


def test_a_look_sees_the_cell_that_the_last_step_inverted(ragged_box: TetMesh) -> None:
    problem = loaded(ragged_box)
    right = (problem.mesh.points[problem.mesh.boundary_facets][:, :, 2] > 1.2 - 1e-9).all(axis=1)
    crush = Traction(problem.mesh.boundary_facets[right], (0.0, 0.0, -3e4))
    body = ExplicitBody(dataclasses.replace(problem, loads=(crush,)))

    def step_and_look() -> None:
        for _ in range(1000):
            body.step()
            body.look()

    with pytest.raises(BlowUpError, match="a cell inverted") as caught:
        step_and_look()
    assert body.steps == caught.value.step
    assert body.elastic.smallest_det_f(body.displacement)[0] > 0.0
    np.testing.assert_array_equal(caught.value.displacement, body.displacement)


def test_what_cannot_be_is_refused(ragged_box: TetMesh) -> None:
    problem = loaded(ragged_box)
    body = ExplicitBody(problem)
    for force, points in (
        (np.zeros(3), None),
        ([[0.0, 0.0, 1.0]], [10_000]),
        ([[0.0, 0.0, np.nan]], [0]),
    ):
        with pytest.raises(InputError, match="force"):
            body.apply_force(force, points=points)
    with pytest.raises(InputError, match="no tools"):
        body.move_tool(0, [0.0, 0.0, 0.0])
    with_tool = ExplicitBody(loaded(ragged_box, ball(0.0)))
    with pytest.raises(InputError, match="from 0"):
        with_tool.move_tool(1, [0.0, 0.0, 0.0])
    for position in ([0.0, 0.0], [0.0, 0.0, np.nan], 1.0, [[0.0, 0.0, 0.0]], "abc"):
        with pytest.raises(InputError, match="position of tool 1: needs 3 finite numbers"):
            with_tool.move_tool(0, position)
    with pytest.raises(InputError, match="rotation of tool 1: needs 4"):
        with_tool.move_tool(0, [0.0, 0.0, 2.0], [1.0, 0.0, 0.0])
    with pytest.raises(InputError, match="length 2;"):
        with_tool.move_tool(0, [0.0, 0.0, 2.0], [0.0, 2.0, 0.0, 0.0])
    with pytest.raises(InputError, match="displacement"):
        body.set_state(np.zeros((3, 3)))
    with pytest.raises(UnstableStepError):
        ExplicitBody(problem, time_step=1.0)
