"""Steps of whole bodies: energy, laws, elements, moved supports, and refusals."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Support
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import PlaneShape, RigidTool, ToolPath
from palpate.reference.availability import is_available
from palpate.reference.child import run_task
from palpate.reference.errors import ReferenceBlowUpError, ReferenceStepError
from palpate.reference.schemes import Integrator, numerical_damping_ratio
from palpate.reference.tasks import SteppedTask
from palpate.validation.diagnosis.law_simulators import example_material

if is_available():
    from palpate.reference.dynamics import simulate_implicit
    from palpate.reference.statics import solve_static
    from palpate.reference.stepping import simulate_by, simulate_explicit

pytestmark = pytest.mark.dolfinx

IMPLICIT = [i for i in Integrator if i.is_implicit]
STEPPED = [*IMPLICIT, Integrator.SEMI_IMPLICIT_EULER]
# Confined: P-wave speed sqrt((lmbda + 2 mu) / rho) with E = 1, nu = 0.3, rho = 1.
SPEED = 1.16023870


def wave(box, span):
    """A bar that can only lengthen, in the shape of its first mode."""
    mesh = box((8, 1, 1), (1.0, 0.1, 0.1))
    supports = []
    for name in ("x0", "y0", "y1", "z0", "z1"):
        facets = mesh.facet_groups[name]
        axes = tuple(name[0] == axis for axis in "xyz")
        supports.append(Support(np.unique(facets).astype(np.int32), facets, axes))
    shape = np.zeros_like(mesh.points)
    shape[:, 0] = 1e-3 * np.sin(0.5 * np.pi * mesh.points[:, 0])
    return Problem(mesh, Material(1.0, 0.3, 1.0), tuple(supports), (), span), shape


def swing(box, span, **more):
    mesh = box((3, 1, 1), (0.3, 0.1, 0.1))
    held = mesh.facet_groups["x0"]
    supports = (Support(np.unique(held).astype(np.int32), held),)
    more = {"loads": (BodyForce((0.0, 90.0, -300.0)),), **more}
    return Problem(mesh, Material(1e4, 0.35), supports, more.pop("loads"), span, **more)


@pytest.mark.parametrize("integrator", STEPPED)
def test_energy_of_a_wave_decays_stays_or_is_bounded_as_the_scheme_has_it(box, integrator):
    periods, steps = 3, 60
    dt = 4.0 / SPEED / steps
    problem, shape = wave(box, TimeSpan(periods * steps * dt, dt, 0.0, periods * steps))
    found = simulate_by(problem, integrator, strain=Strain.LINEAR, displacement=shape)
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


@pytest.mark.parametrize("law", list(Law))
def test_every_law_settles_by_backward_euler_where_statics_has_it(box, law):
    mesh = box((3, 1, 1), (0.3, 0.1, 0.1))
    material = example_material(law, 0.35)
    # Long steps with damping: it creeps to rest.
    problem = swing(box, TimeSpan(30.0, 0.3, 20.0, 1))
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
    problem = swing(box, TimeSpan(0.04, 0.01, 1.0, 2))
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
        problem = swing(box, TimeSpan(0.04, 0.04 / steps, 1.0, 1))
        found = simulate_by(problem, integrator, element=element)
        ends.append(found.displacements[-1])
    fine = simulate_explicit(swing(box, TimeSpan(0.04, 0.04 / 640, 1.0, 1)), element=element)
    errors = [np.linalg.norm(end - fine.displacements[-1]) for end in ends]
    size = np.linalg.norm(fine.displacements[-1])
    assert errors[0] > 1e-6 * size
    assert math.log2(errors[0] / errors[1]) == pytest.approx(integrator.order, abs=0.2)


def test_the_midpoint_rule_is_generalised_alpha_without_dissipation(box):
    problem = swing(box, TimeSpan(0.1, 5e-3, 1.0, 5))
    found = simulate_by(problem, Integrator.IMPLICIT_MIDPOINT)
    other = simulate_implicit(
        problem, degree=1, spectral_radius=1.0, is_mass_lumped=True, relative_tolerance=1e-11
    )
    size = np.abs(found.displacements).max()
    assert np.abs(found.displacements - other.displacements).max() < 1e-7 * size


@pytest.mark.parametrize("integrator", [Integrator.BACKWARD_EULER, Integrator.BDF2])
def test_supports_move_and_pressure_follows(box, integrator):
    mesh = box((3, 1, 1), (0.3, 0.1, 0.1))
    held, pushed = mesh.facet_groups["x0"], mesh.facet_groups["z1"]
    ramp = TabularAmplitude((0.0, 1.0), (0.0, 1.0))
    moved = Support(
        np.unique(held).astype(np.int32), held, displacement=(0.0, 0.0, 0.02), amplitude=ramp
    )
    problem = Problem(
        mesh,
        Material(1e4, 0.35),
        (moved,),
        (Pressure(pushed, 30.0),),
        TimeSpan(12.0, 0.2, 20.0, 12),
    )
    found = simulate_by(problem, integrator)
    still = Support(np.unique(held).astype(np.int32), held, displacement=(0.0, 0.0, 0.02))
    rest = solve_static(dataclasses.replace(problem, supports=(still,), time=None), degree=1)
    size = np.abs(rest.displacement).max()
    assert found.displacements[1][held[0, 0], 2] == pytest.approx(0.02, rel=1e-12)
    assert np.abs(found.displacements[-1] - rest.displacement).max() < 1e-3 * size


def test_the_child_gives_the_same_and_failures_come_back_typed(box):
    problem = swing(box, TimeSpan(0.05, 1e-2, 1.0, 5))
    there = run_task(SteppedTask(Integrator.BDF2), problem, time_limit=120)
    here = simulate_by(problem, Integrator.BDF2)
    assert there.integrator is Integrator.BDF2
    assert np.array_equal(there.displacements, here.displacements)
    wild = dataclasses.replace(problem, time=TimeSpan(100.0, 0.1, 0.0, 10))
    with pytest.raises(ReferenceBlowUpError):
        run_task(SteppedTask(Integrator.SEMI_IMPLICIT_EULER), wild, time_limit=120)


def test_what_it_does_not_know_is_refused(box):
    problem = swing(box, TimeSpan(0.05, 1e-2, 1.0, 5))
    path = ToolPath(
        np.array([0.0, 1.0]), np.full((2, 3), 9.0), np.tile((1.0, 0.0, 0.0, 0.0), (2, 1))
    )
    with pytest.raises(InputError, match="tool"):
        simulate_by(
            dataclasses.replace(problem, tools=(RigidTool(PlaneShape(), path),)), Integrator.BDF2
        )


def test_a_step_without_a_solution_says_when(box):
    # Crushed to nothing within one step: no displacement balances it.
    problem = swing(box, TimeSpan(1.0, 1.0, 0.0, 1), loads=(BodyForce((-3e6, 0.0, 0.0)),))
    with pytest.raises(ReferenceStepError) as caught:
        simulate_by(problem, Integrator.BACKWARD_EULER)
    assert caught.value.time == 0.0
    assert caught.value.displacement.shape == problem.mesh.points.shape
