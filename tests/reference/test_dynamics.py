"""Implicit dynamics and stiffness damping against closed forms and explicit steps."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from bank import SPEED, confined_bar, first_mode, fixed, support

from palpate.fastsim.dynamics import simulate
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce, Pressure
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain, TimeSpan
from palpate.reference.availability import is_available
from palpate.reference.errors import ReferenceStepError
from palpate.reference.schemes import Integrator
from palpate.validation.diagnosis.law_simulators import example_material

if is_available():
    from palpate.reference import dynamics
    from palpate.reference.dynamics import Motion, simulate_implicit
    from palpate.reference.schemes import AlphaMethod
    from palpate.reference.statics import solve_static
    from palpate.reference.stepping import simulate_by, simulate_explicit

pytestmark = pytest.mark.dolfinx


def wave_error(problem, damping=0.0, **options):
    result = simulate_implicit(
        problem, strain=Strain.LINEAR, displacement=first_mode, spectral_radius=1.0, **options
    )
    rest, omega = first_mode(problem.mesh.points), 0.5 * np.pi * SPEED
    damped = math.sqrt(omega**2 - 0.25 * damping**2)
    worst = 0.0
    for time, u in zip(result.times, result.displacements, strict=True):
        # x'' + lambda x' + omega^2 x = 0 from rest at 1.
        factor = math.exp(-0.5 * damping * time) * (
            math.cos(damped * time) + 0.5 * damping / damped * math.sin(damped * time)
        )
        worst = max(worst, float(np.linalg.norm(u - factor * rest) / np.linalg.norm(rest)))
    return worst, result


def test_the_p_wave_converges_with_second_order_in_time():
    period = 4.0 / SPEED
    errors = []
    for steps in (50, 100):
        problem = confined_bar(8, TimeSpan(period, period / steps, num_outputs=5))
        errors.append(wave_error(problem)[0])
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15)
    # The trapezoidal rule takes the period too long by (omega dt)^2 / 12: 2 pi of that in u.
    assert errors[1] < 1.05 * 2.0 * math.pi * (2.0 * math.pi / 100) ** 2 / 12.0


def test_consistent_and_lumped_mass_err_to_opposite_sides():
    period = 4.0 / SPEED
    problem = confined_bar(8, TimeSpan(period, period / 200, num_outputs=1))
    at_end = {}
    for is_lumped in (False, True):
        _, result = wave_error(problem, degree=1, is_mass_lumped=is_lumped)
        # Just after a whole period a mode that is too quick already moves back.
        at_end[is_lumped] = float(np.sum(result.velocities[-1, :, 0]))
    assert at_end[False] < 0.0 < at_end[True]


def test_mass_damping_lets_the_wave_decay():
    damping = 0.5
    period = 4.0 / SPEED
    problem = confined_bar(8, TimeSpan(period, period / 200, damping, 5))
    error, result = wave_error(problem, damping)
    assert error < 1e-3
    scale = result.strain_energies[0]
    assert result.damping_works[-1] > 0.5 * scale
    assert np.abs(result.energy_errors).max() < 1e-10 * scale


def test_energy_is_kept_without_numerical_damping_and_only_lost_with_it():
    problem = confined_bar(6, TimeSpan(1.0, 0.05, num_outputs=20))
    _, kept = wave_error(problem)
    scale = kept.strain_energies[0]
    assert np.abs(kept.energy_errors).max() < 1e-10 * scale
    lossy = simulate_implicit(
        problem, strain=Strain.LINEAR, displacement=first_mode, spectral_radius=0.3
    )
    lost = -np.diff(lossy.energy_errors)
    assert lossy.energy_errors[-1] < -1e-5 * scale
    assert lost.sum() < 0.05 * scale


def beam(box, span, loads):
    mesh = box((6, 1, 1), (0.3, 0.05, 0.05))
    return Problem(mesh, Material(5e4, 0.3, 1000.0), (support(mesh, "x0"),), loads, span)


def test_a_short_step_follows_the_explicit_reference(box):
    # Both lumped, the same tetrahedra, the same amplitude: they differ by their time steps alone.
    loads = (BodyForce((0.0, 0.0, -4000.0), TabularAmplitude((0.0, 0.02), (0.0, 1.0))),)
    apart = []
    for dt in (5e-4, 2.5e-4):
        problem = beam(box, TimeSpan(0.08, dt, 1.0, num_outputs=4), loads)
        ours = simulate_implicit(problem, degree=1, is_mass_lumped=True)
        explicit = simulate_explicit(problem)
        scale = np.abs(explicit.displacements).max()
        apart.append(np.abs(ours.displacements - explicit.displacements).max() / scale)
    assert apart[1] < 1e-3
    assert math.log2(apart[0] / apart[1]) == pytest.approx(2.0, abs=0.4)


def test_earlier_tangents_find_the_same_motion(box, monkeypatch):
    loads = (BodyForce((0.0, 0.0, -4000.0)),)
    problem = beam(box, TimeSpan(0.2, 0.01, num_outputs=4), loads)
    assembled = []
    assemble = Motion._assemble
    monkeypatch.setattr(
        Motion, "_assemble", lambda *given: (assembled.append(1), assemble(*given))[1]
    )

    def run(slow):
        monkeypatch.setattr(dynamics, "_SLOW", slow)
        assembled.clear()
        moved = simulate_implicit(problem, relative_tolerance=1e-10).displacements
        return moved, len(assembled)

    every, count = run(0.0)
    some, fewer = run(0.2)
    scale = np.abs(every).max()
    assert scale > 0.1  # of 0.3 m: far from linear
    assert np.abs(some - every).max() < 1e-8 * scale
    assert 1 < fewer < count / 2


def test_heavy_damping_ends_at_the_static_answer(box):
    loads = (BodyForce((0.0, 0.0, -2000.0)),)
    # Each step takes the spectral radius' share of what is left: 60 steps leave 1e-18.
    problem = beam(box, TimeSpan(600.0, 10.0, 40.0, num_outputs=1), loads)
    moved = simulate_implicit(problem, degree=2, spectral_radius=0.0)
    static = solve_static(problem, degree=2)
    scale = np.abs(static.displacement).max()
    assert np.abs(moved.displacements[-1] - static.displacement).max() < 1e-6 * scale


def test_a_moved_support_does_the_work_that_is_stored(box):
    mesh = box((2, 1, 1), (0.2, 0.1, 0.1))
    ramp = TabularAmplitude((0.0, 1.0), (0.0, 1.0), is_smooth=True)
    left, right = mesh.facet_groups["x0"], mesh.facet_groups["x1"]
    supports = (
        fixed(left),
        fixed(right, displacement=(0.02, 0.0, 0.0), amplitude=ramp),
    )
    problem = Problem(mesh, Material(1e4, 0.3, 10.0), supports, (), TimeSpan(1.0, 0.02))
    result = simulate_implicit(problem, degree=1, spectral_radius=1.0)
    stored = result.strain_energies[-1]
    assert stored > 0.0
    # The work of a step is taken at its middle: second order in the step.
    assert abs(result.energy_errors[-1]) < 2e-3 * stored


def test_what_cannot_be_stepped_is_refused(box):
    loads = (BodyForce((0.0, 0.0, -1.0)),)
    with pytest.raises(InputError, match="time_step"):
        simulate_implicit(beam(box, TimeSpan(1.0), loads))
    with pytest.raises(InputError, match="whole steps"):
        simulate_implicit(beam(box, TimeSpan(1.0, 0.03, num_outputs=7), loads))
    with pytest.raises(InputError, match="lump degree 1 only"):
        simulate_implicit(beam(box, TimeSpan(1.0, 0.1, num_outputs=1), loads), is_mass_lumped=True)
    with pytest.raises(InputError, match="spectral_radius"):
        AlphaMethod(1.5)


def test_a_load_beyond_the_material_is_an_honest_end(box):
    loads = (BodyForce((-1e7, 0.0, 0.0)),)
    problem = beam(box, TimeSpan(1.0, 0.01, num_outputs=10), loads)
    with pytest.raises(ReferenceStepError, match="found no step") as caught:
        simulate_implicit(problem, degree=1)
    assert caught.value.time_step < 0.01
    assert caught.value.displacement.shape == problem.mesh.points.shape
    assert np.isfinite(caught.value.displacement).all()


ELEMENTS = pytest.mark.parametrize("element", list(Element))


def test_a_wave_decays_by_beta_omega_over_two_and_energy_is_balanced():
    omega, xi = 0.5 * math.pi * SPEED, 0.1
    period = 2.0 * math.pi / omega
    span = TimeSpan(period, period / 200, num_outputs=5, stiffness_damping=2.0 * xi / omega)
    problem = confined_bar(20, span)
    result = simulate_implicit(
        problem,
        strain=Strain.LINEAR,
        degree=1,
        is_mass_lumped=True,
        displacement=first_mode,
        spectral_radius=1.0,
    )
    rest, damped = first_mode(problem.mesh.points), omega * math.sqrt(1.0 - xi**2)
    for time, u in zip(result.times, result.displacements, strict=True):
        factor = math.exp(-xi * omega * time) * (
            math.cos(damped * time) + xi * omega / damped * math.sin(damped * time)
        )
        # Twenty cells take omega too small by a 4000th, so the phase by a 600th at the end.
        assert np.linalg.norm(u - factor * rest) < 3e-3 * np.linalg.norm(rest)
    scale = result.strain_energies[0]
    assert result.damping_works[-1] > 0.5 * scale
    assert np.abs(result.energy_errors).max() < 1e-10 * scale


def bar(mesh, law, span):
    """Of two materials, held at one end, moved at the other, pressed and heavy."""
    ramp = TabularAmplitude((0.0, 0.4 * span.end_time), (0.0, 1.0), is_smooth=True)
    left, right = mesh.facet_groups["x0"], mesh.facet_groups["x1"]
    supports = (
        fixed(left),
        fixed(right, (False, True, False), (0.0, 0.3, 0.0),
                amplitude=ramp),
    )  # fmt: skip
    loads = (BodyForce((0.0, 40.0, -200.0)), Pressure(mesh.facet_groups["z1"], 60.0))
    inclusions = (Inclusion(np.arange(12), example_material(law, 0.2)),)
    return Problem(mesh, example_material(law), supports, loads, span, inclusions=inclusions)


@pytest.mark.parametrize(
    ("law", "element", "strain"),
    [
        (Law.SAINT_VENANT_KIRCHHOFF, Element.LINEAR, Strain.GREEN),
        (Law.SAINT_VENANT_KIRCHHOFF, Element.SMOOTHED, Strain.GREEN),
        pytest.param(
            Law.SAINT_VENANT_KIRCHHOFF, Element.SMOOTHED, Strain.LINEAR, marks=pytest.mark.nightly
        ),
        (Law.NEO_HOOKEAN_STABLE, Element.LINEAR, Strain.GREEN),
        *(
            pytest.param(law, element, Strain.GREEN, marks=pytest.mark.nightly)
            for law in Law
            for element in Element
            if not law.is_linear_in_strain
            and (law, element) != (Law.NEO_HOOKEAN_STABLE, Element.LINEAR)
        ),
    ],
)
def test_a_thousand_steps_are_those_of_fastsim(box, law, element, strain):
    mesh = box((4, 1, 1), (2.0, 0.5, 0.5))
    problem = bar(mesh, law, TimeSpan(5.0, 5e-3, 0.5, 10, stiffness_damping=0.01))
    ours = simulate(problem, element=element, strain=strain)
    theirs = simulate_explicit(problem, element=element, strain=strain)
    assert ours.num_steps == 1000
    largest = np.abs(theirs.displacements[1:]).max(axis=(1, 2))
    assert largest.min() > 1e-3
    error = np.abs(ours.displacements - theirs.displacements)[1:].max(axis=(1, 2))
    assert (error / largest).max() < 1e-10
    # And not those without it.
    span = dataclasses.replace(problem.time, stiffness_damping=0.0)
    other = simulate(dataclasses.replace(problem, time=span), element=element, strain=strain)
    assert np.abs(other.displacements - theirs.displacements).max() > 1e-3 * largest.max()


@pytest.mark.parametrize("strain", list(Strain))
def test_implicit_steps_follow_the_explicit_ones(box, strain, monkeypatch):
    monkeypatch.setattr(dynamics, "_SLOW", 0.0)  # a tangent of its own each time
    mesh = box((4, 1, 1), (2.0, 0.5, 0.5))
    apart = []
    for dt in (8e-3, 4e-3):
        span = TimeSpan(0.8, dt, num_outputs=4, stiffness_damping=0.02)
        problem = bar(mesh, Law.SAINT_VENANT_KIRCHHOFF, span)
        ours = simulate_implicit(problem, strain=strain, degree=1, is_mass_lumped=True)
        explicit = simulate_explicit(problem, strain=strain)
        scale = np.abs(explicit.displacements).max()
        apart.append(np.abs(ours.displacements - explicit.displacements).max() / scale)
        # Newton's method with the right tangent: the error of each step is squared.
        assert ours.newton_iterations <= (1 if strain is Strain.LINEAR else 4) * 0.8 / dt + 1
    # The explicit ones take the rate of strain half a step late: of first order.
    assert apart[1] < 0.01
    assert math.log2(apart[0] / apart[1]) == pytest.approx(1.0, abs=0.4)


def test_two_implementations_of_the_midpoint_rule_agree(box):
    # Generalised-alpha without numerical damping is the implicit midpoint rule.
    mesh = box((3, 1, 1), (1.5, 0.5, 0.5))
    span = TimeSpan(0.4, 0.02, 0.5, num_outputs=4, stiffness_damping=0.02)
    problem = bar(mesh, Law.SAINT_VENANT_KIRCHHOFF, span)
    problem = dataclasses.replace(problem, supports=problem.supports[:1])
    ours = simulate_implicit(
        problem, degree=1, is_mass_lumped=True, spectral_radius=1.0, relative_tolerance=1e-11
    )
    theirs = simulate_by(problem, Integrator.IMPLICIT_MIDPOINT, relative_tolerance=1e-11)
    scale = np.abs(theirs.displacements).max()
    assert scale > 0.01
    assert np.abs(ours.displacements - theirs.displacements).max() < 1e-8 * scale


@pytest.mark.parametrize("integrator", [Integrator.BACKWARD_EULER, Integrator.SEMI_IMPLICIT_EULER])
@ELEMENTS
@pytest.mark.long
def test_other_schemes_tend_to_the_same_motion(box, integrator, element):
    mesh = box((3, 1, 1), (1.5, 0.5, 0.5))
    apart = []
    for dt in (4e-3, 2e-3):
        span = TimeSpan(0.2, dt, num_outputs=2, stiffness_damping=0.02)
        problem = bar(mesh, Law.SAINT_VENANT_KIRCHHOFF, span)
        ours = simulate_by(problem, integrator, element=element)
        explicit = simulate_explicit(problem, element=element)
        scale = np.abs(explicit.displacements).max()
        apart.append(np.abs(ours.displacements - explicit.displacements).max() / scale)
        assert ours.newton_iterations <= 4 * 0.2 / dt
    assert apart[1] < 0.7 * apart[0] < 0.05
