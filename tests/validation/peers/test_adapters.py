"""Adapters: installed tools agree with fastsim; nodes, loads, kinetic damping and steps."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from palpate.fastsim.body import Body
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce, Load, PointForce, Traction
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.point_mass import PointMass
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan, with_law
from palpate.meshes.rigid_tool import BoxShape, RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.candidates.candidate import fastsim_candidate, outside_candidate
from palpate.validation.candidates.outside import CannotPoseError, OutsideSimulator
from palpate.validation.exchange.nodal_arrays import rest_arrays
from palpate.validation.exchange.time_reading import read_at
from palpate.validation.peers.adapters import harness, nodes
from palpate.validation.peers.registry import read_peers
from palpate.validation.references.runs import solve_state
from palpate.validation.states import CandidateFailedError, State, in_silence

MESH = brick_box((3, 2, 2), (0.3, 0.2, 0.2), ragged=0.15)
FACE, END = side(MESH, 0, 0.0), side(MESH, 0, 0.3)
PULL = Traction(END, (40.0, 10.0, -20.0))
TISSUE = Material(2e4, 0.3, 1000.0)
BODY = Problem(MESH, TISSUE, (support_of(FACE),), (PULL,))
# One component of the end stays free.
MOVED = Problem(
    MESH, TISSUE, (support_of(FACE), support_of(END, (True, False, True), (0.02, 0.0, 0.01))), ()
)
FALLING = dataclasses.replace(
    BODY,
    loads=(BodyForce((0.0, 0.0, -300.0)),),
    time=TimeSpan(0.1, time_step=5e-4, num_outputs=5, mass_damping=2.0),
)
# Largest distance from fastsim on the same mesh under the same law, over the largest displacement:
# seven digits in a text file, a residual of 1e-7 or, in single precision, of 1e-3.
STATICS = {
    "numpy-dense": 1e-9,
    "calculix-c3d4": 1e-5,
    "felupe-tetra4": 1e-8,
    "scikit-fem-p1": 1e-8,
    "kratos-tl": 1e-8,
    "getfem-p1": 1e-8,
    "ngsolve-p1": 1e-8,
    "tatva-tet4": 1e-8,
    "akantu-tet4": 1e-8,
    "febio-tet4": 1e-8,
    "sofa-tetrahedra": 1e-8,
    "mujoco-flex": 1e-5,
    "newton-semi-implicit": 5e-3,
    "drake-corotated": 1e-6,
}
# Its supports do not move.
STILL = {"drake-corotated"}
# Their own schemes and steps; a flex spreads its mass evenly over its points.
MOTIONS = {"mujoco-flex": 0.3, "newton-semi-implicit": 0.05, "newton-vbd": 0.05}


def solved_by(name: str, problem: Problem, words: str = "") -> tuple[State, Problem]:
    """By a simulator of the registry, where it is installed, and the problem under its law.

    `words` go to the adapter.
    """
    peer = next(peer for peer in read_peers() if peer.name == name)
    command = peer.command_line()
    if command is None:
        pytest.skip(f"{name}: {peer.why_missing()}")
    posed = with_law(problem, peer.law)
    candidate = outside_candidate(OutsideSimulator(command + words, 120.0))
    return candidate.solve(posed, Strain.GREEN, in_silence), posed


@pytest.mark.parametrize("name", STATICS)
@pytest.mark.parametrize("is_moved", [False, True], ids=["pulled", "moved"])
def test_an_adapter_agrees_with_fastsim(problem: Problem, name: str, is_moved: bool) -> None:
    if is_moved and name in STILL:
        with pytest.raises(CandidateFailedError, match="only whole points can be fixed"):
            solved_by(name, MOVED)
        return
    found, posed = solved_by(name, MOVED if is_moved else problem)
    expected = solve_static(posed).displacement
    apart = np.abs(found.displacement - expected).max() / np.abs(expected).max()
    assert apart <= STATICS[name]
    assert {"tool", "version", "law", "method", "seconds"} <= set(found.says)


@pytest.mark.parametrize("name", ["drake-corotated", "akantu-tet4", "sofa-tetrahedra"])
def test_the_weight_of_a_mass_on_the_surface_is_not_left_out(name: str) -> None:
    """Spread as its mass is, it looks like the weight of a body of another density."""
    down = (0.0, 0.0, -3.0)
    mass = PointMass(END, 4.0)
    loads = BodyForce((0.0, 0.0, -3000.0)), mass.weight(MESH.points, down)
    found, posed = solved_by(name, dataclasses.replace(BODY, masses=(mass,), loads=loads))
    expected = solve_static(posed).displacement
    assert np.abs(found.displacement - expected).max() <= 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize(("constants", "is_asked"), [("", True), (" constants=documented", False)])
def test_drakes_neo_hookean_is_that_of_other_constants(constants: str, is_asked: bool) -> None:
    """Lamé's lambda of what it is given stands in its formula for lambda + mu."""
    peer = next(peer for peer in read_peers() if peer.name == "drake-neo-hookean")
    command = peer.command_line()
    if command is None:
        pytest.skip(peer.why_missing())
    body = with_law(dataclasses.replace(BODY, loads=(BodyForce((0.0, 0.0, -600.0)),)), peer.law)
    candidate = outside_candidate(OutsideSimulator(command + constants, 120.0))
    found = candidate.solve(body, Strain.GREEN, in_silence).displacement
    if not is_asked:  # lambda is mu less
        E, nu = body.material.youngs_modulus, body.material.poissons_ratio
        mu = E / (2.0 * (1.0 + nu))
        lmbda = 2.0 * mu * nu / (1.0 - 2.0 * nu) - mu
        assert np.abs(found - solve_static(body).displacement).max() > 0.1 * np.abs(found).max()
        nu = lmbda / (2.0 * (lmbda + mu))
        other = Material(2.0 * mu * (1.0 + nu), nu, 1000.0, peer.law)
        body = dataclasses.replace(body, material=other)
    expected = solve_static(body).displacement
    assert np.abs(found - expected).max() <= 1e-6 * np.abs(expected).max()


def pressed(*tools: RigidTool) -> Problem:
    """A slab of 0.3 x 0.2 x 0.2 m on a rigid base, under tools."""
    base = support_of(side(FINER, 2, 0.0))
    return Problem(FINER, TISSUE, (base,), (), tools=tools)


FINER = brick_box((6, 4, 4), (0.3, 0.2, 0.2))
DOWN = ToolPath([0.0, 1.0], [[0.16, 0.09, 0.5], [0.16, 0.09, 0.485]])
BALL = RigidTool(SphereShape(0.3), DOWN, contact="facets")


@pytest.mark.parametrize("words", ["", " turned=60"])
def test_mujocos_contacts_carry_what_the_body_bears(words: str) -> None:
    """The force on the ball is minus what the cells pull at all points that are not fixed."""
    found, problem = solved_by("mujoco-flex", pressed(BALL), words)
    assert found.tool_forces is not None
    inner = Body(FINER, TISSUE).internal_force(found.displacement)  # balanced by what pushes
    on_body = inner[FINER.points[:, 2] > 1e-9].sum(axis=0)
    assert np.linalg.norm(on_body) > 1.0
    np.testing.assert_allclose(found.tool_forces[0], -on_body, atol=1e-4)
    # No point of a facet may be in the ball, where the average over facets lets some in: stiffer.
    ours = fastsim_candidate().solve(problem, Strain.GREEN, in_silence).tool_forces
    assert ours is not None
    assert found.tool_forces[0, 2] == pytest.approx(ours[0, 2], rel=0.1)
    assert 0.0 < float(str(found.says["penetration"])) < 1e-5 * 0.015


def test_a_ball_that_moves_bears_the_means_of_mujocos_steps() -> None:
    """Also where points slide on a plane, off which contact does not push them."""
    y = -0.05  # the ball's middle is beyond the plane
    slides = support_of(side(FINER, 1, 0.0), (False, True, False))
    still = pressed(BALL)
    span = TimeSpan(0.4, time_step=1e-3, num_outputs=8, mass_damping=20.0)
    path = ToolPath([0.0, 0.2, 0.4], [[0.16, y, 0.502], [0.16, y, 0.485], [0.17, y, 0.485]])
    ball = dataclasses.replace(BALL, path=path)
    posed = dataclasses.replace(still, supports=(*still.supports, slides), tools=(ball,))
    rested, _ = solved_by("mujoco-flex", posed)
    assert 0.0 < float(str(rested.says["penetration"])) < 1e-5 * 0.015
    found, problem = solved_by("mujoco-flex", dataclasses.replace(posed, time=span))
    ours = fastsim_candidate().solve(problem, Strain.GREEN, in_silence)
    assert found.tool_forces is not None
    assert ours.tool_forces is not None
    assert found.tool_forces.shape == ours.tool_forces.shape == (1, 9, 3)
    assert not found.tool_forces[0, 0].any()
    apart = np.linalg.norm(found.tool_forces - ours.tool_forces, axis=2).max()
    assert apart < 0.15 * np.linalg.norm(ours.tool_forces, axis=2).max()
    assert not found.displacements[:, FINER.points[:, 1] < 1e-9, 1].any()


def test_tools_that_an_adapter_does_not_know_are_refused_with_the_reason() -> None:
    box = RigidTool(BoxShape((0.1, 0.1, 0.1)), DOWN)
    rough = dataclasses.replace(BALL, friction_coefficient=0.3)
    for tool, why in {box: "shape BoxShape, only SphereShape", rough: "friction"}.items():
        with pytest.raises(CannotPoseError, match=f"tool 2: {why}"):
            solved_by("mujoco-flex", pressed(BALL, tool))


@pytest.mark.parametrize("name", MOTIONS)
def test_an_adapter_moves_as_fastsim_does(name: str) -> None:
    found, posed = solved_by(name, FALLING)
    expected = simulate(posed, strain=Strain.GREEN).displacements
    apart = np.abs(found.displacements - expected).max() / np.abs(expected).max()
    assert apart <= MOTIONS[name]
    assert found.steps is not None


def test_kinetic_damping_brings_a_spring_to_rest_and_gives_up() -> None:
    # k = m = 1, pulled by 1: rest at x = 1; steps of 0.1 s.
    position, velocity, force = np.zeros(1), np.zeros(1), 1.0

    def step() -> None:
        velocity[:] += 0.1 * (force - position)
        position[:] += 0.1 * velocity

    count, residual = harness.relax(step, lambda: velocity, 10.0, force, 1e-6, 10_000)
    assert residual <= 1e-6
    assert position[0] == pytest.approx(1.0, abs=1e-5)
    assert count < 2000

    def speed_up() -> None:
        velocity[:] += 1.0

    velocity[:] = 0.0
    # 1 m/s more in each step of 0.1 s: 10 N out of balance of 1 N.
    assert harness.relax(speed_up, lambda: velocity, 10.0, force, 1e-6, 7) == (
        7, pytest.approx(10.0),
    )  # fmt: skip
    # Who creeps at one speed is not at rest where forces say otherwise.
    velocity[:] = 1.0

    def half_out() -> object:
        return np.array([0.5])

    assert harness.relax(lambda: None, lambda: velocity, 10.0, force, 1e-6, 7) == (1, 0.0)
    assert harness.relax(lambda: None, lambda: velocity, 10.0, force, 1e-6, 7, half_out) == (
        7,
        0.5,
    )
    with pytest.raises(SystemExit, match="blew up after 1 steps"):
        harness.relax(lambda: None, lambda: np.array([np.nan]), 10.0, force, 1e-6, 7)
    # No result then, and the reason is the last line.
    harness.require_rest(1e-6, 1e-6)
    for left in (1.01e-6, np.inf, np.nan):
        with pytest.raises(SystemExit, match="not at rest at its last step"):
            harness.require_rest(left, 1e-6)


def test_the_stable_step_is_below_the_limit_of_the_matrix(problem: Problem) -> None:
    from palpate.validation.exchange.nodal_arrays import cell_materials, lumped_mass

    materials = cell_materials(problem)
    rest = {
        "points": problem.mesh.points,
        "cells": problem.mesh.cells,
        "youngs_modulus": materials[:, 0],
        "poissons_ratio": materials[:, 1],
    }
    step = harness.stable_step(rest, lumped_mass(problem))
    limit = Body(problem.mesh, problem.material).critical_time_step()
    assert 0.1 * limit < step < limit


def job_of(*loads: Load) -> dict[str, Any]:
    problem = dataclasses.replace(BODY, loads=loads)
    return rest_arrays(problem) | {"load_kinds": [type(load).__name__ for load in loads]}


def test_the_nodes_are_the_points_and_the_middles_of_edges() -> None:
    body = nodes.Quadratic.of(job_of(PULL))
    assert np.array_equal(body.points[: MESH.num_points], MESH.points)
    for middle, (a, b) in enumerate(nodes.EDGES, start=4):
        ends = body.points[body.cells[:, [a, b]]]
        np.testing.assert_allclose(body.points[body.cells[:, middle]], ends.mean(axis=1))
    # Eight parts of an eighth each, all the right way round.
    parts = signed_volumes(body.points, body.parts.astype(np.int32))
    whole = signed_volumes(MESH.points, MESH.cells)
    np.testing.assert_allclose(parts.reshape(-1, 8), np.repeat(whole[:, None] / 8, 8, axis=1))


def test_middles_are_fixed_between_fixed_corners_of_the_boundary_only() -> None:
    body = nodes.Quadratic.of(job_of(PULL))
    # All of the fixed face, and nothing else.
    on_face = np.isclose(body.points[:, 0], 0.0)
    assert np.array_equal(body.fixed.all(axis=1), on_face)
    assert np.array_equal(body.fixed.any(axis=1), on_face)


@pytest.mark.parametrize(
    "load", [PULL, BodyForce((3.0, -2.0, 1.0)), PointForce(np.array([5]), np.array([[1.0, 2, 3]]))]
)
def test_force_and_moment_of_the_nodes_are_those_of_the_points(load: Load) -> None:
    job = job_of(load)
    body = nodes.Quadratic.of(job)
    given = job["external_force"]
    np.testing.assert_allclose(body.force.sum(axis=0), given.sum(axis=0), rtol=1e-12)
    np.testing.assert_allclose(
        np.cross(body.points, body.force).sum(axis=0),
        np.cross(MESH.points, given).sum(axis=0),
        rtol=1e-9,
    )


def test_loads_are_work_on_quadratic_fields() -> None:
    """Of u = x^2 e_x: t_x L^2 A on the end face, and b_x times the integral of x^2."""

    def work(load: Load) -> float:
        body = nodes.Quadratic.of(job_of(load))
        square = np.zeros_like(body.points)
        square[:, 0] = body.points[:, 0] ** 2
        return float((body.force * square).sum())

    assert work(PULL) == pytest.approx(40.0 * 0.3**2 * 0.04, rel=1e-12)
    assert work(BodyForce((3.0, 0.0, 0.0))) == pytest.approx(3.0 * 0.3**3 / 3 * 0.04, rel=1e-12)


def test_loads_that_cannot_be_separated_are_refused() -> None:
    with pytest.raises(ValueError, match="more than one kind"):
        nodes.Quadratic.of(job_of(PULL, BodyForce((1.0, 0.0, 0.0))))
    other = Traction(side(MESH, 1, 0.2), (0.0, 7.0, 0.0))
    with pytest.raises(ValueError, match="not the same everywhere"):
        nodes.Quadratic.of(job_of(PULL, other))


@pytest.mark.dolfinx
@pytest.mark.parametrize("name", [peer.name for peer in read_peers() if peer.is_quadratic])
@pytest.mark.long
def test_a_quadratic_adapter_agrees_with_the_quadratic_reference(name: str) -> None:
    found, _ = solved_by(name, BODY)
    truth = solve_state(BODY, Strain.GREEN, 2, in_silence).displacement
    # Four points of integration, where the reference has more: as far apart as that makes them.
    apart = np.abs(found.displacement - truth).max() / np.abs(truth).max()
    assert apart < 5e-3
    # Linear ones are ten times as far.
    plain = solve_state(BODY, Strain.GREEN, 1, in_silence).displacement
    assert np.abs(plain - truth).max() / np.abs(truth).max() > 10.0 * apart


class Counting(harness.Stepped):
    """A point that is at the cube of its time, by steps of 0.03 s."""

    taken, time_step = 0, 0.03

    def step(self, part: float = 1.0) -> None:
        self.taken += round(part)

    def velocity(self) -> Any:
        return np.zeros(3)

    def displacement(self) -> Any:
        return np.full((1, 3), (self.taken * self.time_step) ** 3)


@pytest.mark.parametrize(("substeps", "count"), [(None, 7), ("2", 14)])
def test_a_motion_keeps_its_own_step_and_sends_the_steps_that_it_has(
    substeps: str | None, count: int
) -> None:
    """No step of 0.03 s is at 0.1 or 0.2 s: the judge reads there, from four steps around each."""
    tool, outputs = Counting(), np.array([0.0, 0.1, 0.2])
    tool.job = {"output_times": outputs} | ({} if substeps is None else {"substeps": substeps})
    says = tool.advance(1)
    assert tool.taken == count
    assert says["time_step"] == pytest.approx(0.21 / count)
    times, states = tool.result["times"], tool.result["displacement"]
    np.testing.assert_allclose(states[:, 0, 0], times**3, rtol=1e-12)
    assert times[-2] < 0.2 < times[-1]
    # A cubic is read as it is, so the steps that are needed were sent.
    read = read_at(times, states, outputs, slack=2e-10)
    np.testing.assert_allclose(read.states[:, 0, 0], outputs**3, atol=1e-15)
    assert read.were_sent.tolist() == [True, False, False]


@pytest.mark.parametrize("seed", range(8))
def test_the_judge_reads_the_same_of_the_steps_sent_as_of_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    outputs = np.linspace(0.0, 1.0, int(rng.integers(2, 9)))
    time_step = float(10.0 ** rng.uniform(-3.0, -0.5))
    sent = harness.steps_to_send(outputs, time_step)
    every = time_step * np.arange(max(sent) + 1)
    np.testing.assert_allclose(every[list(sent)], list(sent.values()), rtol=1e-15)
    assert every[-1] >= 1.0 > every[-2]
    states = rng.normal(size=(len(every), 2, 3))
    few, all_ = (
        read_at(t, u, outputs, slack=1e-9)
        for t, u in ((every[list(sent)], states[list(sent)]), (every, states))
    )
    np.testing.assert_array_equal(few.states, all_.states)
    np.testing.assert_array_equal(few.others, all_.others)


def test_outputs_that_are_steps_are_sent_alone() -> None:
    sent = harness.steps_to_send(np.linspace(0.0, 0.3, 4), 0.1 / 3.0)
    assert list(sent) == [0, 3, 6, 9]
