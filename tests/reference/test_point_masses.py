"""Masses on the surface: both solvers on the same mesh, closed forms, balances."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from bank import fixed
from scipy.optimize import brentq

from palpate.fastsim.body import Body
from palpate.fastsim.condensed.condense import condense
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.explicit_body import ExplicitBody
from palpate.fastsim.live_body import LiveBody
from palpate.fastsim.statics import solve_static as fast_static
from palpate.meshes.boundary_conditions import BodyForce
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.point_mass import PointMass
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference.audit import audit_displacement
    from palpate.reference.dynamics import simulate_implicit
    from palpate.reference.motion import MovingBody
    from palpate.reference.schemes import Integrator
    from palpate.reference.statics import solve_static
    from palpate.reference.stepping import simulate_by, simulate_explicit

SIZE = (1.0, 0.6, 0.5)
SOFT = Material(1e4, 0.35, 1000.0)
G = (0.5, 0.0, -1.0)
EVERY = pytest.mark.parametrize(
    ("strain", "element"), [(s, e) for s in Strain for e in Element], ids=lambda v: str(v)
)
SPAN = TimeSpan(0.5, 2e-3, mass_damping=1.0, num_outputs=5, stiffness_damping=1e-3)


def hung(divisions=(3, 2, 2), *, time=None, supports=None, total=60.0):
    """A block of 300 kg that is held on the left, with two masses that share facets on its end."""
    mesh = brick_box(divisions, SIZE, ragged=0.2)
    end = side(mesh, 0, 1.0)
    masses = (PointMass(end, 0.75 * total), PointMass(end[::2], 0.25 * total))
    weights = tuple(mass.weight(mesh.points, G) for mass in masses)
    x, y, z = (SOFT.density * a for a in G)
    held = (fixed(side(mesh, 0, 0.0)),) if supports is None else supports
    loads = (BodyForce((x, y, z)), *weights)
    return Problem(mesh, SOFT, held, loads, time=time, masses=masses)


def apart(mine, theirs):
    return np.abs(mine - theirs).max() / np.abs(theirs).max()


@pytest.mark.dolfinx
def test_the_same_lumped_mass_on_the_same_mesh() -> None:
    """Both spread it by thirds of the facets; the consistent mass has the same total."""
    problem = hung(time=SPAN)
    mass = Body.of(problem).lumped_mass
    assert mass.sum() == pytest.approx(300.0 + 60.0, rel=1e-12)
    moving = MovingBody(problem, Strain.GREEN)
    rows = moving.body.at_points(moving.row_sums)
    assert apart(rows, np.repeat(mass[:, None], 3, axis=1)) < 1e-14
    quadratic = MovingBody(problem, Strain.GREEN, degree=2, is_mass_lumped=False)
    falls = np.tile([0.0, 0.0, 2.0], quadratic.body.space.num_blocks)
    assert quadratic.kinetic_energy(falls) == pytest.approx(0.5 * 360.0 * 4.0, rel=1e-12)


@pytest.mark.dolfinx
@EVERY
def test_the_same_equilibrium_and_the_weight_in_the_support(
    strain: Strain, element: Element
) -> None:
    problem = hung()
    mine = fast_static(problem, strain=strain, element=element, relative_tolerance=1e-13)
    theirs = solve_static(problem, strain=strain, element=element, relative_tolerance=1e-13)
    assert np.abs(theirs.displacement).max() > 0.05
    assert apart(mine.displacement, theirs.displacement) < 1e-12
    reaction = theirs.support_forces.sum(axis=0)
    assert reaction == pytest.approx(-360.0 * np.array(G), rel=1e-9, abs=1e-6)
    audited = audit_displacement(
        problem, mine.displacement, strain=strain, degree=1, element=element
    )
    assert audited.displacement_error < 1e-7
    weightless = dataclasses.replace(problem, loads=problem.loads[:1])
    without = fast_static(weightless, strain=strain, element=element).displacement
    assert apart(without, mine.displacement) > 0.1


@pytest.mark.dolfinx
@EVERY
def test_the_same_steps_on_the_same_mesh(strain: Strain, element: Element) -> None:
    problem = hung(time=SPAN)
    mine = simulate(problem, strain=strain, element=element).displacements
    theirs = simulate_explicit(problem, strain=strain, element=element).displacements
    assert np.abs(theirs).max() > 0.02
    assert apart(mine, theirs) < 1e-12
    inert = dataclasses.replace(problem, masses=())
    assert apart(simulate(inert, strain=strain, element=element).displacements, mine) > 0.01


@pytest.mark.dolfinx
def test_implicit_motion_goes_the_same_way() -> None:
    """Lumped, to the error of its steps; consistent masses and quadratic cells go near it."""
    problem = hung(time=dataclasses.replace(SPAN, stiffness_damping=0.0))
    explicit = simulate(problem).displacements
    lumped = simulate_implicit(problem, degree=1, is_mass_lumped=True).displacements
    assert apart(lumped, explicit) < 2e-3
    by = simulate_by(problem, Integrator.TRAPEZOIDAL).displacements
    assert apart(by, explicit) < 2e-3


@pytest.mark.dolfinx
def test_a_turned_frame_of_a_slanted_plane_has_the_same_mass() -> None:
    problem = hung(time=SPAN)
    wall = fixed(side(problem.mesh, 0, 1.0), normal=(1.0, 0.3, 0.1))
    problem = dataclasses.replace(problem, supports=(*problem.supports, wall))
    mine = simulate(problem).displacements
    assert apart(mine, simulate_explicit(problem).displacements) < 1e-11


# ------------------------------------------------------------------------------------ closed form
# A bar of mass m with a mass M at its end: u = sin(b x/L) cos(w t), w = b sqrt(k/m), and balance
# of the end M w^2 = k b cot b, so that b tan b = m/M (Timoshenko, Vibration Problems in
# Engineering). Rayleigh's sqrt(k / (M + m/3)) is above it.
BAR = Material(1e4, 0.0, 1000.0)
M = 900.0


def bar(num_periods, num_steps):
    """Bar of 300 kg and stiffness E A/L = 3000 N/m, in its first mode with 900 kg; exact b."""
    mesh = brick_box((12, 1, 1), SIZE)
    b = brentq(lambda x: x * math.tan(x) - 300.0 / M, 1e-3, 1.5)
    span = 2.0 * math.pi / (b * math.sqrt(3000.0 / 300.0)) * num_periods
    time = TimeSpan(span, span / num_steps, num_outputs=num_steps)
    sliding = fixed(side(mesh, 0, 0.0), components=(True, False, False))
    lateral = [
        fixed(side(mesh, axis, 0.0), components=tuple(k == axis for k in range(3)))
        for axis in (1, 2)
    ]
    masses = (PointMass(side(mesh, 0, 1.0), M),)
    problem = Problem(mesh, BAR, (sliding, *lateral), (), time=time, masses=masses)
    return problem, b, np.sin(b * mesh.points[:, 0])


def frequency(displacements, times, shape, mass):
    """Of the mode's coordinate: zero crossings, linear between states of some hundred a period."""
    q = displacements[:, :, 0] @ (mass * shape)
    at = np.flatnonzero(q[1:] * q[:-1] < 0.0)
    crossed = times[at] + (times[at + 1] - times[at]) * q[at] / (q[at] - q[at + 1])
    return 0.5 * (len(crossed) - 1) / (crossed[-1] - crossed[0])


def errors(found, b):
    """Over the exact frequency, and over Rayleigh's."""
    exact = b * math.sqrt(10.0) / (2.0 * math.pi)
    rayleigh = math.sqrt(3000.0 / (M + 100.0)) / (2.0 * math.pi)
    return found / exact - 1.0, found / rayleigh - 1.0, rayleigh / exact - 1.0


@pytest.mark.parametrize("element", list(Element))
def test_a_mass_on_a_bar_swings_at_its_frequency(element: Element) -> None:
    """Twelve cells in a row with lumped masses are 1.64e-4 below the exact frequency.

    That is the first eigenvalue of the 12 x 12 problem of a bar; steps of 1/500 of a period add
    (2 pi/500)^2/24 = 7e-6.
    """
    problem, b, shape = bar(3, 1500)
    start = 1e-3 * np.outer(shape, [1.0, 0.0, 0.0])
    body = ExplicitBody(problem, strain=Strain.LINEAR, element=element, displacement=start)
    states, times = [], []
    for _ in range(1500):
        states.append(body.displacement.copy())
        times.append(body.time)
        body.step(body.steps_per_output)
    found = frequency(np.array(states), np.array(times), shape, body.mass)
    exact, rayleigh, known = errors(found, b)
    assert abs(exact + 1.64e-4) < 5e-5
    assert 0.0 < -rayleigh < known + 3e-4
    assert known == pytest.approx(1.03e-3, rel=0.01)
    # Without the bar's own mass, or without the mass, it would be far off.
    assert math.sqrt(3000.0 / M) / (2.0 * math.pi) / found > 1.04


@pytest.mark.dolfinx
@pytest.mark.parametrize("degree", [1, 2])
def test_the_reference_swings_at_that_frequency_too(degree: int) -> None:
    problem, b, shape = bar(2, 400)

    def start(x):
        return 1e-3 * np.outer(np.sin(b * x[:, 0]), [1.0, 0.0, 0.0])

    found = simulate_implicit(
        problem, strain=Strain.LINEAR, degree=degree, displacement=start, spectral_radius=1.0
    )
    mass = Body.of(problem).lumped_mass
    exact, _, _ = errors(frequency(found.displacements, found.times, shape, mass), b)
    # Trapezoidal steps of 1/200 of a period are slow by (2 pi/200)^2/12 = 8.2e-5, consistent masses
    # of twelve cells fast by 9e-6.
    assert abs(exact + 8.2e-5) < 2e-5


# ------------------------------------------------------------------------------------ balances
def test_a_free_body_falls_as_a_whole_and_its_momentum_is_its_weight_times_time() -> None:
    problem = hung(time=TimeSpan(0.1), supports=())
    body = ExplicitBody(problem)
    body.step(50)
    momentum = body.mass @ body.velocity()
    assert momentum == pytest.approx(360.0 * body.time * np.array(G), rel=1e-10, abs=1e-9)
    assert body.displacement == pytest.approx(
        np.tile(0.5 * body.time**2 * np.array(G), (problem.mesh.num_points, 1)), abs=1e-9
    )


def test_energy_with_its_weight_and_its_inertia_is_kept() -> None:
    span = TimeSpan(0.5, num_outputs=5)
    body = ExplicitBody(hung(time=span), tracks_energy=True)
    body.step(300)
    kinetic, work, _ = body.energies()
    stored = body.elastic.strain_energy(body.displacement)
    assert kinetic > 1.0
    assert kinetic == pytest.approx(0.5 * body.mass @ (body.velocity() ** 2).sum(axis=1), rel=0.02)
    assert kinetic + stored == pytest.approx(work, rel=0.01)


@EVERY
def test_the_stable_step_does_not_get_shorter(strain: Strain, element: Element) -> None:
    heavy, light = (Body.of(hung(total=m), strain, element=element) for m in (600.0, 0.0))
    assert heavy.critical_time_step() >= light.critical_time_step()
    assert heavy.critical_time_step_bound() >= light.critical_time_step_bound()
    assert heavy.critical_time_step() >= heavy.critical_time_step_bound()


def test_a_live_body_swings_with_it() -> None:
    problem = hung(time=SPAN)
    live, run = LiveBody(problem), ExplicitBody(problem)
    live.step(100)
    run.step(100)
    assert np.array_equal(live.displacement, run.displacement)
    inert = LiveBody(dataclasses.replace(problem, masses=()))
    inert.step(100)
    assert apart(inert.displacement, live.displacement) > 0.01
    assert live.recording().masses == problem.masses


def test_the_condensed_body_bears_its_weight() -> None:
    """It is quasi-static: a mass counts by its weight alone, and that is among the loads."""
    problem = hung()
    model = condense(problem, seen=np.arange(problem.mesh.num_points))
    expected = fast_static(problem, strain=Strain.LINEAR).displacement
    assert apart(model.displacement(), expected[model.seen]) < 1e-9


def test_the_same_steps_on_a_device() -> None:
    pytest.importorskip("warp")
    problem = hung(time=dataclasses.replace(SPAN, stiffness_damping=0.0))
    mine = ExplicitBody(problem, device="warp:cpu")
    mine.step(100)
    host = ExplicitBody(problem)
    host.step(100)
    assert apart(mine.displacement, host.displacement) < 1e-12
