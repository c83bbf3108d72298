"""Sliding supports at any angle, turned faces and free bodies: both solvers on the same mesh."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from bank import fixed

from palpate.fastsim.dynamics import simulate
from palpate.fastsim.statics import solve_static as fast_static
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Rotation, Traction
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import DisagreeingSupportsError, InputError
from palpate.meshes.problem import Element, InitialVelocity, Material, Problem, Strain, TimeSpan
from palpate.meshes.refinement import refine_problem
from palpate.meshes.transforms import rotation, turn
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference.dynamics import simulate_implicit
    from palpate.reference.result import Formulation
    from palpate.reference.statics import solve_static
    from palpate.reference.stepping import simulate_explicit

pytestmark = pytest.mark.dolfinx

SIZE = (1.0, 0.6, 0.5)
SOFT = Material(1e4, 0.35, 1000.0)
EVERY = pytest.mark.parametrize(
    ("strain", "element"), [(s, e) for s in Strain for e in Element], ids=lambda v: str(v)
)


def plane(mesh, axis, position, **more):
    facets = side(mesh, axis, position)
    normal = [0.0, 0.0, 0.0]
    normal[axis] = 1.0
    return fixed(facets, normal=tuple(normal), **more)


def in_a_corner(divisions=(4, 3, 3), time=None, factor=1.0):
    """A block in the corner of three walls that it slides along, pushed; then all turned."""
    mesh = brick_box(divisions, SIZE, ragged=0.2)
    supports = (
        plane(mesh, 0, 0.0),
        plane(mesh, 1, 0.0, displacement=(0.3, 0.02 * factor, 0.1)),
        plane(mesh, 2, 0.0),
    )
    loads = (
        Traction(side(mesh, 0, SIZE[0]), (-400.0 * factor, 200.0, 300.0)),
        Pressure(side(mesh, 2, SIZE[2]), 500.0),
        BodyForce((0.0, 300.0, -900.0)),
    )
    return Problem(mesh, SOFT, supports, loads, time)


SLANT = rotation((1.0, 2.0, -0.5), 37.0)


@EVERY
def test_both_solvers_slide_along_slanted_walls_alike(strain, element):
    problem = turn(in_a_corner(), SLANT)[0]
    ours = fast_static(problem, strain=strain, element=element).displacement
    theirs = solve_static(problem, strain=strain, element=element).displacement
    assert np.abs(theirs).max() > 0.02
    assert np.abs(ours - theirs).max() < 1e-8 * np.abs(theirs).max()
    for support in problem.supports:
        gap = (theirs[support.points] - support.displacement) @ support.directions[0]
        assert np.abs(gap).max() < 1e-14


@pytest.mark.parametrize("strain", list(Strain))
def test_slanted_walls_are_the_straight_ones_turned(strain):
    straight, turned = in_a_corner(), turn(in_a_corner(), SLANT)
    for solve in (fast_static, solve_static):
        plain, found = solve(straight, strain=strain), solve(turned[0], strain=strain)
        gap = turned[1](found.displacement) - plain.displacement
        assert np.abs(gap).max() < 1e-9 * np.abs(plain.displacement).max()


def test_multigrid_knows_slanted_walls():
    problem = turn(in_a_corner((14, 12, 11)), SLANT)[0]
    assert problem.mesh.num_points > 1500
    many = fast_static(problem, strain=Strain.LINEAR)
    assert many.linear_iterations < 60
    theirs = solve_static(problem, strain=Strain.LINEAR).displacement
    assert np.abs(many.displacement - theirs).max() < 1e-8 * np.abs(theirs).max()


@pytest.mark.long
def test_gamg_knows_slanted_walls():
    from palpate.reference.linear_solver import LARGEST_DIRECT

    problem = turn(in_a_corner((19, 17, 16)), SLANT)[0]
    assert 3 * problem.mesh.num_points > LARGEST_DIRECT
    ours = fast_static(problem, strain=Strain.LINEAR).displacement
    theirs = solve_static(problem, strain=Strain.LINEAR).displacement
    assert np.abs(ours - theirs).max() < 1e-8 * np.abs(theirs).max()


@pytest.mark.parametrize("formulation", list(Formulation) if is_available() else [])
def test_quadratic_tetrahedra_slide_too(formulation):
    straight, (turned, back) = in_a_corner((2, 2, 2)), turn(in_a_corner((2, 2, 2)), SLANT)
    plain = solve_static(straight, degree=2, formulation=formulation)
    found = solve_static(turned, degree=2, formulation=formulation)
    size = np.abs(plain.displacement).max()
    assert np.abs(back(found.displacement) - plain.displacement).max() < 1e-9 * size
    # The walls' pushes turn along, and with the dead loads they add up to nothing.
    assert found.support_forces == pytest.approx(plain.support_forces @ SLANT.T, rel=1e-6, abs=1e-5)


MOVING = TimeSpan(0.1, 1e-4, mass_damping=3.0, num_outputs=10)


@EVERY
def test_explicit_steps_along_slanted_walls_are_the_same(strain, element):
    ramp = TabularAmplitude((0.0, 0.05), (0.0, 1.0), is_smooth=True)
    problem = turn(in_a_corner((3, 2, 2), MOVING), SLANT)[0]
    moved = tuple(dataclasses.replace(s, amplitude=ramp) for s in problem.supports)
    problem = dataclasses.replace(problem, supports=moved)
    ours = simulate(problem, strain=strain, element=element)
    theirs = simulate_explicit(problem, strain=strain, element=element)
    assert ours.num_steps == theirs.num_steps == 1000
    size = np.abs(theirs.displacements).max()
    assert size > 0.02
    assert np.abs(ours.displacements - theirs.displacements).max() < 1e-10 * size


def test_single_precision_and_threads_slide_along_too():
    from palpate.fastsim.explicit_body import Precision

    problem = turn(in_a_corner((3, 2, 2), MOVING), SLANT)[0]
    one = simulate(problem).displacements
    single = simulate(problem, precision=Precision.SINGLE).displacements
    assert 0.0 < np.abs(single - one).max() < 1e-4 * np.abs(one).max()
    two = simulate(problem, num_threads=2).displacements
    assert np.abs(two - one).max() < 1e-11 * np.abs(one).max()


def test_energy_balances_on_moving_slanted_walls():
    ramp = TabularAmplitude((0.0, 0.05), (0.0, 1.0), is_smooth=True)
    problem = turn(in_a_corner((3, 2, 2), MOVING), SLANT)[0]
    moved = tuple(dataclasses.replace(s, amplitude=ramp) for s in problem.supports)
    result = simulate(dataclasses.replace(problem, supports=moved), tracks_energy=True)
    e = result.energies
    given = e.external_work - e.damping_loss
    assert np.abs(e.kinetic + e.strain - given).max() < 1e-3 * np.abs(given).max()


def test_implicit_motion_along_slanted_walls_is_the_straight_one_turned():
    span = TimeSpan(0.02, 2e-3, num_outputs=5)
    straight, (turned, back) = (
        in_a_corner((2, 2, 2), span),
        turn(in_a_corner((2, 2, 2), span), SLANT),
    )
    plain, found = (simulate_implicit(p, degree=2).displacements for p in (straight, turned))
    gap = np.array([back(state) for state in found]) - plain
    assert np.abs(gap).max() < 1e-6 * np.abs(plain).max()


def test_walls_that_ask_for_two_places_are_refused():
    problem = in_a_corner()
    first = problem.supports[0]
    other = dataclasses.replace(first, normal=(-2.0, 0.0, 0.0), displacement=(0.01, 0.0, 0.0))
    with pytest.raises(DisagreeingSupportsError) as caught:
        dataclasses.replace(problem, supports=(*problem.supports, other))
    assert caught.value.supports == (1, 4)
    assert caught.value.points == first.points.tolist()


def test_two_walls_that_are_one_and_a_clamp_beside_them_agree():
    problem = turn(in_a_corner(), SLANT)[0]
    twice = dataclasses.replace(problem, supports=(*problem.supports, problem.supports[1]))
    for solve in (fast_static, solve_static):
        found = solve(twice, strain=Strain.LINEAR).displacement
        once = solve(problem, strain=Strain.LINEAR).displacement
        assert np.abs(found - once).max() < 1e-9 * np.abs(once).max()


# Turned faces.


def twisted_bar(angle=1.2, divisions=(6, 3, 3), time=None):
    """One end clamped, the other turned about the bar's axis and pulled along it."""
    mesh = brick_box(divisions, (2.0, 0.5, 0.5), ragged=0.2)
    root, end = side(mesh, 0, 0.0), side(mesh, 0, 2.0)
    ramp = TabularAmplitude((0.0, 0.05), (0.0, 1.0), is_smooth=True) if time else None
    spin = Rotation((1.0, 0.0, 0.0), (2.0, 0.25, 0.25), angle)
    supports = (
        fixed(root),
        fixed(
            end,
            displacement=(0.1, 0.0, 0.0),
            rotation=spin,
            amplitude=ramp,
        ),
    )
    return Problem(mesh, SOFT, supports, (BodyForce((0.0, 0.0, -100.0)),), time)


@EVERY
def test_a_turned_end_is_the_same_in_both(strain, element):
    problem = twisted_bar(0.6)
    ours = fast_static(problem, strain=strain, element=element).displacement
    theirs = solve_static(problem, strain=strain, element=element).displacement
    assert np.abs(ours - theirs).max() < 1e-8 * np.abs(theirs).max()
    support = problem.supports[1]
    positions = problem.mesh.points[support.points]
    turned = (positions - support.rotation.center) @ rotation((1, 0, 0), np.rad2deg(0.6)).T
    wanted = turned + support.rotation.center + [0.1, 0.0, 0.0]
    assert np.abs(positions + theirs[support.points] - wanted).max() < 1e-15


def test_a_quarter_turn_is_reached_in_steps_that_turn():
    """Interpolated straight, the face would shrink to cos(45 degrees) of its size half-way."""
    found = solve_static(twisted_bar(np.pi / 2))
    ours = fast_static(twisted_bar(np.pi / 2))
    assert found.smallest_det_f > 0.5
    assert np.abs(ours.displacement - found.displacement).max() < 1e-8


def test_a_body_whose_ends_turn_together_is_only_turned():
    """Green strain: a rigid turn strains nothing, at any ramp value."""
    problem = twisted_bar(2.5)
    both = tuple(
        dataclasses.replace(s, displacement=(0.0, 0.0, 0.0), rotation=problem.supports[1].rotation)
        for s in problem.supports
    )
    problem = dataclasses.replace(problem, supports=both, loads=())
    R = rotation((1, 0, 0), np.rad2deg(2.5))
    r = problem.mesh.points - [2.0, 0.25, 0.25]
    for solve in (fast_static, solve_static):
        found = solve(problem).displacement
        assert np.abs(found - (r @ R.T - r)).max() < 1e-9


@EVERY
def test_an_end_that_turns_in_time_takes_the_same_steps(strain, element):
    problem = twisted_bar(1.0, (4, 2, 2), TimeSpan(0.1, 1e-4, 2.0, 10))
    ours = simulate(problem, strain=strain, element=element)
    theirs = simulate_explicit(problem, strain=strain, element=element)
    size = np.abs(theirs.displacements).max()
    assert np.abs(ours.displacements - theirs.displacements).max() < 1e-10 * size


def test_a_turned_end_refines_and_turns_with_its_problem():
    problem = twisted_bar(0.6, (3, 2, 2))
    coarse = solve_static(problem, degree=2)
    turned, back = turn(problem, SLANT @ np.diag([1.0, -1.0, 1.0]))
    again = solve_static(turned, degree=2)
    assert np.abs(back(again.displacement) - coarse.displacement).max() < 1e-8
    fine = refine_problem(problem)
    assert fine.supports[1].rotation == problem.supports[1].rotation
    assert fast_static(fine).smallest_det_f > 0.0


# Free bodies.


def spinning(velocity=(0.3, -0.2, 0.1), omega=(3.0, 1.0, -2.0), time=None):
    mesh = brick_box((3, 2, 2), (0.3, 0.2, 0.1), ragged=0.2)
    start = InitialVelocity(velocity, omega, (0.15, 0.1, 0.05))
    stiff = Material(1e6, 0.3, 1000.0)
    return Problem(mesh, stiff, (), (), time, initial_velocity=start)


def momenta(problem, mass, displacement, velocity):
    positions = problem.mesh.points + displacement
    carried = mass[:, None] * velocity
    return carried.sum(axis=0), np.cross(positions, carried).sum(axis=0)


def test_a_free_body_keeps_its_momenta_and_flies_alike_in_both():
    problem = spinning(time=TimeSpan(0.05, 5e-5, num_outputs=5))
    ours, theirs = simulate(problem), simulate_explicit(problem)
    size = np.abs(theirs.displacements).max()
    assert size > 0.02
    assert np.abs(ours.displacements - theirs.displacements).max() < 1e-10 * size
    from palpate.fastsim.body import Body

    mass = Body.of(problem).lumped_mass
    before = momenta(problem, mass, 0.0, problem.initial_velocity.at(problem.mesh.points))
    after = momenta(problem, mass, ours.displacements[-1], ours.velocity)
    assert after[0] == pytest.approx(before[0], rel=1e-10)
    # Central differences keep x(t) x d(t + dt), not x(t) x v(t): second order in the step.
    assert np.abs(after[1] - before[1]).max() < 1e-4 * np.abs(before[1]).max()


@pytest.mark.long
def test_a_free_body_tumbles_as_euler_says():
    """A stiff brick: the attitude from Euler's equations, integrated to 1e-10.

    d(J omega)/dt = -omega x J omega in the body's frame, J by the lumped masses.
    """
    omega = np.array([0.5, 20.0, 0.3])  # near the middle axis: it turns over
    problem = spinning((0.0, 0.0, 0.0), tuple(omega), TimeSpan(0.3, 2e-5, num_outputs=3))
    mesh = problem.mesh
    stiff = dataclasses.replace(problem, material=Material(2e6, 0.3, 1000.0))
    from palpate.fastsim.body import Body

    mass = Body.of(stiff).lumped_mass
    centre = mass @ mesh.points / mass.sum()
    start = InitialVelocity((0.0, 0.0, 0.0), tuple(omega), tuple(centre.tolist()))
    found = simulate(dataclasses.replace(stiff, initial_velocity=start)).displacements[-1]
    r = mesh.points - centre
    J = np.einsum(
        "n,nij->ij", mass, (r**2).sum(1)[:, None, None] * np.eye(3) - r[:, :, None] * r[:, None]
    )
    turned = attitude(J, omega, 0.3)
    # The attitude of the moved body: the nearest rotation (Kabsch).
    moved = r + found
    left, _, right = np.linalg.svd((moved - mass @ moved / mass.sum()).T @ (mass[:, None] * r))
    angle = np.arccos(min(1.0, (np.trace(left @ right @ turned.T) - 1.0) / 2.0))
    assert np.arccos((np.trace(turned) - 1.0) / 2.0) > 0.5
    assert angle < 0.02


def attitude(J, omega, end, steps=20_000):
    def rates(R, w):
        K = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        return R @ K, np.linalg.solve(J, -np.cross(w, J @ w))

    R, w, h = np.eye(3), omega.copy(), end / steps
    for _ in range(steps):
        a = rates(R, w)
        b = rates(R + 0.5 * h * a[0], w + 0.5 * h * a[1])
        c = rates(R + 0.5 * h * b[0], w + 0.5 * h * b[1])
        d = rates(R + h * c[0], w + h * c[1])
        R = R + h / 6.0 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
        w = w + h / 6.0 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
    return R


def test_free_bodies_under_implicit_steps_keep_their_momentum():
    problem = spinning(time=TimeSpan(0.01, 5e-4, num_outputs=4))
    found = simulate_implicit(problem, degree=2, spectral_radius=1.0)
    assert np.ptp(found.kinetic_energies + found.strain_energies) < 1e-3 * found.kinetic_energies[0]
    speed = found.velocities[-1]
    assert np.abs(speed).max() > 0.5


def test_statics_of_a_free_body_are_refused():
    problem = dataclasses.replace(spinning(time=MOVING), time=None, initial_velocity=None)
    for solve in (fast_static, solve_static):
        with pytest.raises(InputError, match="floats"):
            solve(problem)
