"""The explicit reference: exact motions, momentum, moving supports, and loud failure."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.reference.availability import is_available
from palpate.reference.errors import ReferenceBlowUpError

if is_available():
    from palpate.reference.stepping import simulate_explicit

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


def test_mass_damping_slows_the_fall_as_the_recurrence_says(box):
    mesh = box((1, 1, 1))
    load = BodyForce((0.0, 0.0, -1000.0))
    result = simulate_explicit(Problem(mesh, SOFT, (), (load,), span_of(50, damping=4.0)))
    # z'' + 4 z' = -1 from rest: z = -(t / 4 - (1 - exp(-4 t)) / 16), to order dt^2.
    t = 0.05
    exact = -(t / 4.0 - (1.0 - np.exp(-4.0 * t)) / 16.0)
    assert result.displacements[-1][:, 2] == pytest.approx(exact, rel=1e-4)


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
    mass = np.zeros(mesh.num_points)
    np.add.at(mass, mesh.cells, 1000.0 / 6.0 / 4.0)
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


@BOTH
def test_inner_forces_leave_the_momentum_alone(box, strain):
    mesh = box((2, 2, 1), jitter=0.2)
    velocity = np.random.default_rng(2).standard_normal(mesh.points.shape)
    problem = Problem(mesh, SOFT, (), (), span_of(40))
    result = simulate_explicit(problem, strain=strain, velocity=velocity)
    mass = np.zeros(mesh.num_points)
    shares = np.linalg.det(mesh.points[mesh.cells[:, 1:]] - mesh.points[mesh.cells[:, :1]]) / 24
    np.add.at(mass, mesh.cells, 1000.0 * shares[:, None])
    drift = mass @ result.displacements[-1] - mass @ velocity * 0.04
    assert np.abs(drift).max() < 1e-12 * mass.sum()


def test_a_step_that_is_too_long_stops_the_run_with_the_last_good_state(box):
    mesh = box((2, 2, 2))
    held = np.flatnonzero(mesh.points[:, 0] == 0.0).astype(np.int32)
    problem = Problem(
        mesh, SOFT, (Support(held),), (BodyForce((0.0, 0.0, -1e3)),), span_of(400, step=0.2)
    )
    with (
        np.errstate(over="ignore", invalid="ignore"),
        pytest.raises(ReferenceBlowUpError, match="shorten the time step") as caught,
    ):
        simulate_explicit(problem)
    assert 1 < caught.value.step < 400
    assert np.isfinite(caught.value.displacement).all()
    assert caught.value.displacement.shape == mesh.points.shape


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
