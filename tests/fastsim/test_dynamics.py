"""Explicit dynamics: the plain loop as oracle, time-step order, balances, and loud failure."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bodies import clamped

from palpate.fastsim.body import Body
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.errors import UnstableStepError
from palpate.fastsim.explicit_body import Precision
from palpate.fastsim.forces import external_force
from palpate.fastsim.statics import solve_static
from palpate.fastsim.supports import FixedPoints
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Support
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh

SOFT, TISSUE = Material(1e4, 0.3, 1000.0), Material(1e4, 0.45, 1000.0)
BOTH = pytest.mark.parametrize("strain", list(Strain))


def beam(mesh: TetMesh, span: TimeSpan, weight: float = 2000.0) -> Problem:
    load = BodyForce((0.0, 0.2 * weight, -weight))
    return Problem(mesh, SOFT, (clamped(mesh),), (load,), span)


def free_body(mesh: TetMesh, span: TimeSpan) -> Problem:
    return Problem(mesh, SOFT, (), (), span)


@pytest.mark.parametrize("element", list(Element))
@BOTH
def test_a_run_follows_the_plain_loop(
    ragged_box: TetMesh, strain: Strain, element: Element
) -> None:
    """200 steps with damping, load and support, against the corrected eq. 12 as it is printed."""
    problem = beam(ragged_box, TimeSpan(0.5, mass_damping=3.0, num_outputs=4))
    result = simulate(problem, strain=strain, element=element)
    body, dt = Body(ragged_box, SOFT, strain, element=element), result.time_step
    supports = FixedPoints(problem)
    is_free, fixed = supports.is_free, supports.at(1.0)
    M, F = body.lumped_mass[:, None], external_force(problem)
    D = 3.0 * M
    now = fixed.copy()
    before = 0.5 * dt**2 * F / M  # eq. 13 from rest: a(-dt) = dt^2 a'' / 2
    before[is_free == 0] = 0.0
    for output in range(1, 5):
        for _ in range(result.num_steps // 4):
            right_side = F - body.internal_force(now) + (2.0 / dt**2) * M * now
            right_side -= (M / dt**2 - D / (2.0 * dt)) * before
            ahead = right_side / (M / dt**2 + D / (2.0 * dt))
            before, now = now, np.where(is_free != 0, ahead, now)
        error = np.abs(result.displacements[output] - now).max()
        assert error < 1e-12 * np.abs(now).max()
    assert np.abs(now).max() > 0.05


@pytest.mark.parametrize("element", list(Element))
@pytest.mark.parametrize("precision", list(Precision))
@pytest.mark.parametrize("num_threads", [1, 2])
def test_a_run_repeats_bit_for_bit(
    ragged_box: TetMesh, precision: Precision, num_threads: int, element: Element
) -> None:
    problem = beam(ragged_box, TimeSpan(0.3, num_outputs=2))
    first, second = (
        simulate(
            problem, element=element, precision=precision, num_threads=num_threads
        ).displacements
        for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("element", list(Element))
def test_the_number_of_threads_changes_rounding_only(ragged_box: TetMesh, element: Element) -> None:
    problem = beam(ragged_box, TimeSpan(0.3, num_outputs=2))
    one, three = (simulate(problem, element=element, num_threads=n).displacements for n in (1, 3))
    assert np.abs(one - three).max() < 1e-12 * np.abs(one).max()


def test_error_falls_with_the_square_of_the_time_step() -> None:
    mesh = brick_box((3, 1, 1), (3.0, 1.0, 1.0))
    coarse = 0.5 * Body(mesh, SOFT).critical_time_step_bound()
    end = 64 * coarse

    def last(step: float) -> np.ndarray:
        problem = beam(mesh, TimeSpan(end, time_step=step, mass_damping=1.0, num_outputs=1))
        return simulate(problem).displacements[-1]

    exact = last(coarse / 32)
    steps = coarse / np.array([1.0, 2.0, 4.0])
    errors = [np.linalg.norm(last(step) - exact) for step in steps]
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(2.0, abs=0.1)


def test_element_bound_lies_below_the_sharp_step_and_that_is_the_dense_one(
    ragged_box: TetMesh,
) -> None:
    body = Body(ragged_box, SOFT)
    body.core.assemble_tangent(np.zeros_like(ragged_box.points))
    units = np.eye(ragged_box.points.size)
    columns = [body.core.multiply(unit.reshape(-1, 3)).ravel() for unit in units]
    root = np.repeat(1.0 / np.sqrt(body.lumped_mass), 3)
    dense = 2.0 / np.sqrt(np.linalg.eigvalsh(root[:, None] * np.array(columns) * root)[-1])
    sharp, bound = body.critical_time_step(), body.critical_time_step_bound()
    assert sharp == pytest.approx(dense, rel=2e-4)
    assert 0.4 * dense < bound <= dense


def test_a_step_just_below_the_critical_stays_bounded_and_above_is_refused() -> None:
    mesh = brick_box((4, 2, 2), (2.0, 1.0, 1.0))
    sharp = Body(mesh, SOFT).critical_time_step(relative_tolerance=1e-10)
    good = TimeSpan(2000 * 0.99 * sharp, time_step=0.99 * sharp, num_outputs=1)
    result = simulate(beam(mesh, good, weight=20.0), strain=Strain.LINEAR)
    assert np.abs(result.displacements[-1]).max() < 0.1
    with pytest.raises(UnstableStepError) as caught:
        simulate(beam(mesh, TimeSpan(1.0, time_step=1.01 * sharp), weight=20.0))
    assert caught.value.critical_time_step == pytest.approx(sharp, rel=1e-3)


def test_damped_motion_comes_to_rest_at_the_static_solution() -> None:
    mesh = brick_box((6, 2, 2), (3.0, 1.0, 1.0), ragged=0.1)
    span = TimeSpan(90.0, mass_damping=0.7, num_outputs=1)  # near critical: 2 omega_1
    problem = beam(mesh, span, weight=30.0)
    static = solve_static(problem).displacement
    for precision, limit in ((Precision.DOUBLE, 1e-9), (Precision.SINGLE, 1e-5)):
        moved = simulate(problem, precision=precision).displacements[-1]
        assert np.linalg.norm(moved - static) < limit * np.linalg.norm(static)


@pytest.mark.slow
def test_single_precision_is_safe_in_a_beam_that_hangs_by_half_its_length() -> None:
    """The quasi-static beam of TARGETS.md: 6 000 cells, 15 000 steps, tip down by 53 %.

    An update by 2 a(t) - a(t-dt) rounds to 1e-2 here; increments keep the digits.
    """
    mesh = brick_box((40, 5, 5), (0.4, 0.05, 0.05))
    assert mesh.num_cells == 6000
    problem = Problem(
        mesh,
        Material(5e5, 0.3, 1000.0),
        (clamped(mesh),),
        (BodyForce((0.0, 0.0, -9810.0)),),
        TimeSpan(3.0, mass_damping=14.2, num_outputs=1),
    )
    single, double = (simulate(problem, precision=p).displacements[-1] for p in Precision)
    assert double[:, 2].min() == pytest.approx(-0.53 * 0.4, rel=0.02)
    assert 0.0 < np.linalg.norm(single - double) < 1e-5 * np.linalg.norm(double)
    # And it is the static solution that both come to rest at.
    static = solve_static(problem).displacement
    assert np.linalg.norm(double - static) < 1e-8 * np.linalg.norm(static)


def test_mass_damping_slows_a_rigid_motion_exponentially(ragged_box: TetMesh) -> None:
    velocity = np.tile([1.0, -2.0, 0.5], (ragged_box.num_points, 1))
    span = TimeSpan(1.0, time_step=1e-3, mass_damping=2.0, num_outputs=1)
    result = simulate(free_body(ragged_box, span), velocity=velocity)
    # v = v0 exp(-2 t), a = v0 (1 - exp(-2 t)) / 2; the scheme's error is about (2 dt)^2 / 12.
    expected = velocity * (1.0 - np.exp(-2.0)) / 2.0
    np.testing.assert_allclose(result.displacements[-1], expected, rtol=1e-6)
    np.testing.assert_allclose(result.velocity, velocity * np.exp(-2.0), rtol=1e-5)


def confined_wave_error(mesh: TetMesh, courant: float = 0.8) -> float:
    """u = A sin(pi x / 2L) from rest, sides confined; largest relative L2 error in a period."""
    material = Material(1.0, 0.3, 1.0)
    width = mesh.points[:, 1].max()
    sides = [
        np.flatnonzero((mesh.points[:, k] < 1e-9) | (mesh.points[:, k] > width - 1e-9))
        for k in (1, 2)
    ]
    supports = (
        Support(np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32)),
        Support(sides[0].astype(np.int32), components=(False, True, False)),
        Support(sides[1].astype(np.int32), components=(False, False, True)),
    )
    speed = 1.16023870  # sqrt((lmbda + 2 mu) / rho)
    step = courant * Body(mesh, material).critical_time_step()
    span = TimeSpan(4.0 / speed, step, num_outputs=32)
    start = np.zeros_like(mesh.points)
    start[:, 0] = 1e-3 * np.sin(0.5 * np.pi * mesh.points[:, 0])
    result = simulate(
        Problem(mesh, material, supports, (), span), strain=Strain.LINEAR, displacement=start
    )
    exact = start * np.cos(0.5 * np.pi * speed * result.times)[:, None, None]
    mass = Body(mesh, material).lumped_mass[:, None]
    errors = np.sqrt((mass * (result.displacements - exact) ** 2).sum(axis=(1, 2)))
    return float(errors.max() / np.sqrt((mass * start**2).sum()))


def test_confined_wave_keeps_its_period_to_second_order() -> None:
    """P-wave of TARGETS.md. 40 x 4 x 4 cubes, each cut in six: below 1e-3; order 2 in size."""
    sizes = np.array([1 / 20, 1 / 40, 1 / 80])
    errors = [
        confined_wave_error(
            brick_box((round(1 / h), round(0.1 / h), round(0.1 / h)), (1.0, 0.1, 0.1))
        )
        for h in sizes
    ]
    assert errors[1] <= 1e-3
    slope = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert slope == pytest.approx(2.0, abs=0.1)


def test_pressure_agrees_with_the_static_solution_after_damping() -> None:
    mesh = brick_box((4, 2, 2), (2.0, 1.0, 1.0), ragged=0.1)
    problem = Problem(
        mesh,
        SOFT,
        (clamped(mesh),),
        (Pressure(side(mesh, 2, 1.0), 150.0),),
        TimeSpan(50.0, None, 1.6, 1),
    )
    static = solve_static(problem).displacement
    moved = simulate(problem).displacements[-1]
    assert np.linalg.norm(moved - static) < 1e-8 * np.linalg.norm(static)


def test_no_time_span_is_refused(ragged_box: TetMesh) -> None:
    with pytest.raises(InputError, match="time span"):
        simulate(Problem(ragged_box, SOFT, (), ()))


@pytest.mark.parametrize("element", list(Element))
def test_a_free_body_keeps_its_momentum_and_turns_on(element: Element) -> None:
    """Spun and stretched, over 2000 steps in double precision.

    Central differences conserve both: what is left is one rounding a step at positions up to
    eight lengths from the origin, at random root(2000) * 8 * eps / 2 = 4e-14.
    """
    mesh = brick_box((6, 3, 3), (1.0, 0.5, 0.5), ragged=0.2)
    centred = mesh.points - mesh.points.mean(axis=0)
    speed = np.cross([0.0, 0.3, 0.5], centred) + np.array([0.4, 0.0, 0.1])
    speed[:, 0] += 0.2 * centred[:, 0]
    step = 0.5 * Body(mesh, TISSUE, element=element).critical_time_step()
    span = TimeSpan(2000 * step, step, num_outputs=2)
    run = simulate(Problem(mesh, TISSUE, (), (), span), element=element, velocity=speed)
    mass = Body(mesh, TISSUE).lumped_mass[:, None]
    assert run.num_steps == 2000
    # How far it went: neither sum is of a body at rest.
    assert np.abs(run.displacements[-1]).max() > 5.0
    assert distance(mass * run.velocity, mass * speed) < 1e-13
    spun = np.cross(mesh.points + run.displacements[-1], mass * run.velocity)
    assert distance(spun, np.cross(mesh.points, mass * speed)) < 1e-13


def distance(after: np.ndarray, before: np.ndarray) -> float:
    """Between the sums of two tables, summed without rounding, over the sizes of all before."""
    change = [math.fsum(column) for column in np.vstack([after, -before]).T]
    return float(np.abs(change).max() / np.abs(before).sum())


def test_a_bar_swings_as_slowly_as_it_should() -> None:
    """Its weight, let go, bends it to twice the static deflection; plain cells stop far before."""
    mesh = brick_box((12, 3, 3), (4.0, 1.0, 1.0))
    fixed = Support(np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32))
    deepest = {}
    for element in Element:
        span = TimeSpan(17.0, num_outputs=100)
        problem = Problem(mesh, TISSUE, (fixed,), (BodyForce((0.0, 0.0, -10.0)),), span)
        run = simulate(problem, element=element, strain=Strain.LINEAR)
        deepest[element] = -float(run.displacements[:, :, 2].min())
    # E = 1e4, I = 1/12, q = 10 over 4 m: q L^4 / 8 E I = 0.384 by beam theory, and 4 % for shear;
    # half a period is pi / (3.516 root(E I / (rho A L^4))) = 15.7 s.
    assert deepest[Element.SMOOTHED] == pytest.approx(2 * 0.384 * 1.04, rel=0.07)
    assert deepest[Element.LINEAR] < 0.6 * deepest[Element.SMOOTHED]
