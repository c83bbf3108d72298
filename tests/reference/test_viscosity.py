"""Stiffness damping of the reference: closed form, energy, tangents, fastsim on the same mesh."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from palpate.fastsim.dynamics import simulate
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Support
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain, TimeSpan
from palpate.reference.availability import is_available
from palpate.reference.schemes import Integrator
from palpate.validation.diagnosis.law_simulators import example_material

if is_available():
    from palpate.reference import dynamics
    from palpate.reference.dynamics import simulate_implicit
    from palpate.reference.stepping import simulate_by, simulate_explicit

pytestmark = pytest.mark.dolfinx

SPEED = 1.16023870  # of P waves with E = 1, nu = 0.3, rho = 1
ELEMENTS = pytest.mark.parametrize("element", list(Element))


def test_a_wave_decays_by_beta_omega_over_two_and_energy_is_balanced(box):
    mesh = box((20, 1, 1), (1.0, 0.1, 0.1))
    supports = []
    for name in ("x0", "y0", "y1", "z0", "z1"):
        facets = mesh.facet_groups[name]
        axes = tuple(name[0] == axis for axis in "xyz")
        supports.append(Support(np.unique(facets).astype(np.int32), facets, axes))
    omega, xi = 0.5 * math.pi * SPEED, 0.1
    period = 2.0 * math.pi / omega
    span = TimeSpan(period, period / 200, num_outputs=5, stiffness_damping=2.0 * xi / omega)
    problem = Problem(mesh, Material(1.0, 0.3, 1.0), tuple(supports), (), span)

    def first_mode(points):
        shape = np.zeros_like(points)
        shape[:, 0] = 1e-3 * np.sin(0.5 * math.pi * points[:, 0])
        return shape

    result = simulate_implicit(
        problem,
        strain=Strain.LINEAR,
        degree=1,
        is_mass_lumped=True,
        displacement=first_mode,
        spectral_radius=1.0,
    )
    rest, damped = first_mode(mesh.points), omega * math.sqrt(1.0 - xi**2)
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
        Support(np.unique(left).astype(np.int32), left),
        Support(np.unique(right).astype(np.int32), right, (False, True, False), (0.0, 0.3, 0.0),
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
