"""Motion by the schemes of simulators: exact motions, energy, laws, elements, and refusals."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from bank import SPEED, beyond, confined_bar, first_mode, fixed, lumped_mass, support

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Support
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import PlaneShape, RigidTool, ToolPath
from palpate.reference.availability import is_available
from palpate.reference.child import run_task
from palpate.reference.errors import ReferenceBlowUpError, ReferenceStepError, ReferenceTimeoutError
from palpate.reference.schemes import Integrator, numerical_damping_ratio
from palpate.reference.tasks import SteppedTask
from palpate.validation.diagnosis.law_simulators import example_material

if is_available():
    from palpate.reference.statics import solve_static
    from palpate.reference.stepping import simulate_by, simulate_explicit

pytestmark = pytest.mark.dolfinx

SOFT = Material(1e4, 0.3, 1000.0)
BOTH = pytest.mark.parametrize("strain", list(Strain))
EPS = np.finfo(float).eps


def span_of(num_steps, step=1e-3, *, damping=0.0, num_outputs=2):
    return TimeSpan(num_steps * step, step, damping, num_outputs)


@BOTH
def test_a_free_body_falls_by_half_g_t_squared(box, strain):
    """Central differences are exact for a motion that is quadratic in time."""
    mesh = box((2, 1, 1), jitter=0.2)
    load = BodyForce((0.0, 1000.0 * 3.0, -1000.0 * 9.81))
    result = simulate_explicit(Problem(mesh, SOFT, (), (load,), span_of(100)), strain=strain)
    fall = 0.5 * np.array([0.0, 3.0, -9.81]) * 0.1**2
    assert np.abs(result.displacements[-1] - fall).max() < 1e4 * EPS
    assert result.num_steps == 100


def test_the_first_step_of_a_stretched_cube_obeys_newtons_second_law(box):
    """Eq. 13 and one step of eq. 11: a(dt) - a(0) = dt^2 a'' / 2."""
    mesh = box((1, 1, 1))
    stretch = np.zeros_like(mesh.points)
    stretch[:, 0] = 1e-3 * mesh.points[:, 0]
    sides = tuple(
        Support(np.flatnonzero(mesh.points[:, k] >= 0.0).astype(np.int32), components=c)
        for k, c in ((1, (False, True, False)), (2, (False, False, True)))
    )
    held = Support(
        np.flatnonzero(mesh.points[:, 0] == 0.0).astype(np.int32), components=(True, False, False)
    )
    result = simulate_explicit(
        Problem(mesh, SOFT, (*sides, held), (), span_of(1, step=1e-4, num_outputs=1)),
        strain=Strain.LINEAR,
        displacement=stretch,
    )
    modulus = 1e4 * 0.7 / (1.3 * 0.4)  # lmbda + 2 mu
    far = mesh.points[:, 0] == 1.0
    mass = lumped_mass(Problem(mesh, SOFT, (), ()))
    moved = result.displacements[1][far, 0] - 1e-3
    # Confined stretch 1e-3 over a unit area: the pulls on the far face add up to modulus x 1e-3.
    assert np.sum(mass[far] * moved) == pytest.approx(-0.5 * 1e-8 * modulus * 1e-3, rel=1e-9)


def test_supports_follow_their_amplitude_and_loads_theirs(box):
    mesh = box((2, 1, 1))
    left = np.flatnonzero(mesh.points[:, 0] == 0.0).astype(np.int32)
    right = np.flatnonzero(mesh.points[:, 0] == 1.0).astype(np.int32)
    supports = (Support(left), Support(right, displacement=(0.1, 0.0, 0.0)))
    problem = Problem(mesh, SOFT, supports, (), span_of(100, num_outputs=10))
    result = simulate_explicit(problem, support_amplitude=[None, lambda t: 10.0 * t])
    assert result.displacements[:, right, 0] == pytest.approx(
        np.tile(result.times[:, None], (1, len(right))), rel=1e-12
    )
    assert not result.displacements[:, left].any()
    own = TabularAmplitude((0.0, 1.0), (0.0, 10.0))
    pulled = Support(right, displacement=(0.1, 0.0, 0.0), amplitude=own)
    itself = simulate_explicit(dataclasses.replace(problem, supports=(supports[0], pulled)))
    assert itself.displacements == pytest.approx(result.displacements, rel=1e-12)

    def impulse(t):
        return 1.0 if t < 0.5e-3 else 0.0

    kicked = Problem(mesh, SOFT, (), (BodyForce((0.0, 0.0, 1000.0)),), span_of(10, num_outputs=1))
    # F for the start-up and the first step only: v = dt / 2, then uniform motion.
    final = simulate_explicit(kicked, amplitude=impulse).displacements[-1]
    assert final[:, 2] == pytest.approx(10 * 1e-3 * 0.5e-3, rel=1e-9)


def test_what_cannot_be_stepped_is_refused(box):
    mesh = box((1, 1, 1))
    for span in (None, TimeSpan(1.0), TimeSpan(1.0, 0.3, 0.0, 1)):
        with pytest.raises(InputError):
            simulate_explicit(Problem(mesh, SOFT, (), (), span))
    loads = (
        PointForce(np.array([0], np.int32), np.ones((1, 3))),
        Pressure(mesh.boundary_facets, 1.0),
    )
    with pytest.raises(InputError, match="1 amplitudes for 2 loads"):
        simulate_explicit(Problem(mesh, SOFT, (), loads, span_of(2)), amplitude=[None])


@pytest.mark.parametrize("element", list(Element))
def test_momentum_and_angular_momentum_stay_and_energy_nearly(box, element):
    steps, dt = 400, 5e-4
    mesh, span = box((2, 2, 1), jitter=0.2), TimeSpan(steps * dt, dt, 0.0, steps)
    hard = (Inclusion(beyond(mesh, 0.5), Material(5e4, 0.45, 1500.0)),)
    problem = Problem(mesh, SOFT, (), (), span, inclusions=hard)
    mass, rest = lumped_mass(problem)[:, None], problem.mesh.points
    velocity = np.random.default_rng(2).standard_normal(rest.shape)
    result = simulate_explicit(problem, velocity=velocity, element=element)
    u = result.displacements
    middle = (u[1:] - u[:-1]) / dt  # velocities between the outputs, which are the steps
    momentum = (mass * middle).sum(axis=1)
    assert np.abs(np.diff(momentum, axis=0)).max() <= 1e-12 * mass.sum()
    # x_n x m (x_{n+1} - x_n) changes by x_n x f_n, which is nothing: central differences keep it.
    spin = np.cross(rest + u[:-1], mass * middle).sum(axis=1)
    assert np.abs(spin[0]).max() > 0.01
    assert np.abs(np.diff(spin, axis=0)).max() <= 1e-12 * mass.sum()
    kinetic = 0.5 * (mass * ((u[2:] - u[:-2]) / (2 * dt)) ** 2).sum(axis=(1, 2))
    total = kinetic + result.strain_energies[1:-1]
    assert result.strain_energies.max() > 0.2 * total[0]
    # Second order in the step: the highest modes turn by about half a radian in one.
    assert np.ptp(total) < 0.05 * total[0]


@pytest.fixture
def swing(box):
    mesh = box((3, 1, 1), (0.3, 0.1, 0.1))
    supports = (support(mesh, "x0"),)
    span = TimeSpan(0.05, 1e-3, 1.0, 5)
    return Problem(mesh, Material(1e4, 0.35), supports, (BodyForce((0.0, 90.0, -300.0)),), span)


@pytest.mark.parametrize(
    ("integrator", "element"),
    [
        (Integrator.CENTRAL_DIFFERENCES, Element.LINEAR),
        (Integrator.CENTRAL_DIFFERENCES, Element.SMOOTHED),
        (Integrator.BDF2, Element.LINEAR),
    ],
)
def test_the_child_gives_the_same_trajectory_bit_for_bit(swing, integrator, element):
    task = SteppedTask(integrator, element=element)
    there, here = run_task(task, swing, time_limit=120), task(swing, print)
    for name in ("displacements", "strain_energies", "times"):
        assert np.array_equal(getattr(there, name), getattr(here, name))
    assert (there.time_step, there.num_steps, there.integrator) == (1e-3, 50, integrator)
    other = simulate_explicit(swing, element=next(e for e in Element if e is not element))
    assert np.abs(there.displacements[-1] - other.displacements[-1]).max() > 1e-6


def test_failures_come_back_typed(swing):
    with pytest.raises(InputError, match="time_step given"):
        run_task(
            SteppedTask(Integrator.CENTRAL_DIFFERENCES),
            dataclasses.replace(swing, time=TimeSpan(1.0)),
            time_limit=60,
        )
    wild = dataclasses.replace(swing, time=TimeSpan(100.0, 0.1, 0.0, 10))
    for explicit in (Integrator.CENTRAL_DIFFERENCES, Integrator.SEMI_IMPLICIT_EULER):
        with pytest.raises(ReferenceBlowUpError, match="shorten the time step") as caught:
            run_task(SteppedTask(explicit), wild, time_limit=120)
        assert caught.value.displacement.shape == swing.mesh.points.shape
        assert np.isfinite(caught.value.displacement).all()
        assert 1 < caught.value.step < 1000
    with pytest.raises(ReferenceTimeoutError):
        run_task(SteppedTask(Integrator.CENTRAL_DIFFERENCES), swing, time_limit=0.2)


IMPLICIT = [i for i in Integrator if i.is_implicit]
STEPPED = [*IMPLICIT, Integrator.SEMI_IMPLICIT_EULER]


def heavy_bar(box, span, **more):
    mesh = box((3, 1, 1), (0.3, 0.1, 0.1))
    supports = (support(mesh, "x0"),)
    more = {"loads": (BodyForce((0.0, 90.0, -300.0)),), **more}
    return Problem(mesh, Material(1e4, 0.35), supports, more.pop("loads"), span, **more)


@pytest.mark.parametrize("integrator", STEPPED)
def test_energy_of_a_wave_decays_stays_or_is_bounded_as_the_scheme_has_it(integrator):
    periods, steps = 3, 60
    dt = 4.0 / SPEED / steps
    problem = confined_bar(8, TimeSpan(periods * steps * dt, dt, 0.0, periods * steps))
    found = simulate_by(
        problem, integrator, strain=Strain.LINEAR, displacement=first_mode(problem.mesh.points)
    )
    energies = found.kinetic_energies + found.strain_energies
    # After the first period: BDF2 starts by backward Euler.
    lost = 1.0 - energies[-1] / energies[steps]
    omega_dt = 2.0 * math.pi / steps
    ratio = numerical_damping_ratio(integrator, omega_dt)
    if ratio:
        # exp(-2 xi omega t); the mesh's frequency is 0.2 % off.
        expected = 1.0 - math.exp(-4.0 * math.pi * (periods - 1) * ratio)
        assert expected > 5e-3
        assert lost == pytest.approx(expected, rel=0.02)
    elif integrator.is_implicit:
        assert np.ptp(energies) < 1e-8 * energies[0]
    else:
        # It keeps (v^2 + omega^2 u^2 - omega^2 dt u v) / 2: the energy to omega dt / 2.
        assert 0.1 * omega_dt < np.ptp(energies) / energies[0] < 1.1 * omega_dt
        assert abs(energies[::steps] / energies[0] - 1.0).max() < 0.1 * omega_dt


@pytest.mark.parametrize("law", [Law.SAINT_VENANT_KIRCHHOFF, Law.NEO_HOOKEAN, Law.COROTATIONAL])
def test_every_kind_of_law_settles_by_backward_euler_where_statics_has_it(box, law):
    mesh = box((3, 1, 1), (0.3, 0.1, 0.1))
    material = example_material(law, 0.35)
    # Long steps with damping: it creeps to rest.
    problem = heavy_bar(box, TimeSpan(30.0, 0.3, 20.0, 1))
    problem = dataclasses.replace(problem, mesh=mesh, material=material)
    found = simulate_by(problem, Integrator.BACKWARD_EULER)
    rest = solve_static(dataclasses.replace(problem, time=None), degree=1)
    size = np.abs(rest.displacement).max()
    assert size > 0.01
    assert np.abs(found.displacements[-1] - rest.displacement).max() < 1e-7 * size
    assert found.largest_residual <= 1e-10


@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize("element", list(Element))
def test_steps_end_at_rounding_where_no_tolerance_is_left(box, strain, element):
    problem = heavy_bar(box, TimeSpan(0.04, 0.01, 1.0, 2))
    options = {"strain": strain, "element": element, "relative_tolerance": 1e-16}
    found = simulate_by(problem, Integrator.BACKWARD_EULER, **options)
    # Strains of I + grad u are rounded as numbers of the size of 1, forces of 1e-3 of that.
    assert found.largest_residual < 1e-11
    assert found.newton_iterations < 10 * found.num_steps


@pytest.mark.parametrize(
    ("integrator", "element"),
    [*((i, Element.LINEAR) for i in STEPPED), (Integrator.BDF2, Element.SMOOTHED)],
)
def test_short_steps_come_to_the_explicit_trajectory(box, integrator, element):
    ends = []
    for steps in (40, 80):
        problem = heavy_bar(box, TimeSpan(0.04, 0.04 / steps, 1.0, 1))
        found = simulate_by(problem, integrator, element=element)
        ends.append(found.displacements[-1])
    fine = simulate_explicit(heavy_bar(box, TimeSpan(0.04, 0.04 / 640, 1.0, 1)), element=element)
    errors = [np.linalg.norm(end - fine.displacements[-1]) for end in ends]
    size = np.linalg.norm(fine.displacements[-1])
    assert errors[0] > 1e-6 * size
    assert math.log2(errors[0] / errors[1]) == pytest.approx(integrator.order, abs=0.2)


@pytest.mark.parametrize("integrator", [Integrator.BACKWARD_EULER, Integrator.BDF2])
def test_supports_move_and_pressure_follows(box, integrator):
    mesh = box((3, 1, 1), (0.3, 0.1, 0.1))
    held, pushed = mesh.facet_groups["x0"], mesh.facet_groups["z1"]
    ramp = TabularAmplitude((0.0, 1.0), (0.0, 1.0))
    moved = fixed(held, displacement=(0.0, 0.0, 0.02), amplitude=ramp)
    problem = Problem(
        mesh,
        Material(1e4, 0.35),
        (moved,),
        (Pressure(pushed, 30.0),),
        TimeSpan(12.0, 0.2, 20.0, 12),
    )
    found = simulate_by(problem, integrator)
    still = fixed(held, displacement=(0.0, 0.0, 0.02))
    rest = solve_static(dataclasses.replace(problem, supports=(still,), time=None), degree=1)
    size = np.abs(rest.displacement).max()
    assert found.displacements[1][held[0, 0], 2] == pytest.approx(0.02, rel=1e-12)
    assert np.abs(found.displacements[-1] - rest.displacement).max() < 1e-3 * size


def test_what_it_does_not_know_is_refused(box):
    problem = heavy_bar(box, TimeSpan(0.05, 1e-2, 1.0, 5))
    path = ToolPath(
        np.array([0.0, 1.0]), np.full((2, 3), 9.0), np.tile((1.0, 0.0, 0.0, 0.0), (2, 1))
    )
    with pytest.raises(InputError, match="tool"):
        simulate_by(
            dataclasses.replace(problem, tools=(RigidTool(PlaneShape(), path),)), Integrator.BDF2
        )


def test_a_step_without_a_solution_says_when(box):
    # Crushed to nothing within one step: no displacement balances it.
    problem = heavy_bar(box, TimeSpan(1.0, 1.0, 0.0, 1), loads=(BodyForce((-3e6, 0.0, 0.0)),))
    with pytest.raises(ReferenceStepError) as caught:
        simulate_by(problem, Integrator.BACKWARD_EULER)
    assert caught.value.time == 0.0
    assert caught.value.displacement.shape == problem.mesh.points.shape
