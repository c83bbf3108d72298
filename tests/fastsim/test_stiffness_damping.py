"""Stiffness damping: decay by its closed form, no drag on a turn, energy, the stable step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.fastsim.body import Body
from palpate.fastsim.dynamics import DynamicResult, simulate
from palpate.fastsim.errors import BlowUpError, UnstableStepError
from palpate.fastsim.explicit_body import SAFETY, ExplicitBody, Precision
from palpate.fastsim.explicit_time_step import damped_time_step, stiffened_time_step, viscous_force
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, InitialVelocity, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.diagnosis.law_simulators import example_material

SOFT = Material(1e4, 0.3, 1000.0)
START = InitialVelocity((0.3, 0.0, 0.0), (0.0, 0.0, 0.5), (0.8, 0.5, 0.6))
BOTH = pytest.mark.parametrize("strain", list(Strain))
ELEMENTS = pytest.mark.parametrize("element", list(Element))


def clamped(mesh: TetMesh, span: TimeSpan, material: Material = SOFT) -> Problem:
    fixed = Support(np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32))
    return Problem(mesh, material, (fixed,), (), span)


def confined_bar(mesh: TetMesh, span: TimeSpan) -> Problem:
    """Held at x = 0, sides sliding: u_x alone."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    supports = [Support(np.flatnonzero(mesh.points[:, 0] == low[0]).astype(np.int32))]
    for axis in (1, 2):
        on = (mesh.points[:, axis] == low[axis]) | (mesh.points[:, axis] == high[axis])
        parts = tuple(k == axis for k in range(3))
        supports.append(Support(np.flatnonzero(on).astype(np.int32), components=parts))
    return Problem(mesh, SOFT, tuple(supports), (), span)


@ELEMENTS
@pytest.mark.parametrize("xi", [0.02, 0.3])
def test_a_mode_decays_by_beta_omega_over_two(xi: float, element: Element) -> None:
    mesh = brick_box((8, 1, 1), (1.0, 0.1, 0.1))
    # P-wave speed sqrt((lmbda + 2 mu) / rho).
    omega = 0.5 * math.pi * math.sqrt(1e4 * 0.7 / (1.3 * 0.4) / 1000.0)
    beta, span = 2.0 * xi / omega, 0.5 * 2.0 * math.pi / omega
    u = np.zeros_like(mesh.points)
    u[:, 0] = 1e-3 * np.sin(0.5 * math.pi * mesh.points[:, 0])
    time = TimeSpan(span, span / 4000, num_outputs=40, stiffness_damping=beta)
    problem = confined_bar(mesh, time)
    result = simulate(problem, strain=Strain.LINEAR, element=element, displacement=u)
    # x'' + 2 xi omega x' + omega^2 x = 0 from rest at 1.
    damped = omega * math.sqrt(1.0 - xi**2)
    exact = np.exp(-xi * omega * result.times) * (
        np.cos(damped * result.times) + xi * omega / damped * np.sin(damped * result.times)
    )
    found = result.displacements[:, :, 0] @ u[:, 0] / (u[:, 0] @ u[:, 0])
    assert np.abs(found - exact).max() < 0.01


def turned(points: np.ndarray, angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return points @ (np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) - np.eye(3))


@ELEMENTS
def test_no_turn_is_resisted_however_large_its_steps(ragged_box: TetMesh, element: Element) -> None:
    # Of a strained body, so that not even its stress is turned against.
    points = ragged_box.points * (1.1, 0.95, 1.0)
    before, now = turned(points, 0.9), turned(points, 1.6)
    strained, moved = points - ragged_box.points, now - before
    body = Body(ragged_box, SOFT, element=element)
    scale = np.abs(body.internal_force(strained)).max()
    assert np.abs(viscous_force(body, strained + now, moved, 1.0)).max() < 1e-13 * scale
    control = Body(ragged_box, SOFT, Strain.LINEAR, element=element)
    assert np.abs(viscous_force(control, strained + now, moved, 1.0)).max() > 0.1 * scale


@BOTH
@ELEMENTS
def test_small_changes_are_resisted_by_the_stiffness_at_rest(
    ragged_box: TetMesh, strain: Strain, element: Element
) -> None:
    # Whatever the law: it is Hooke's.
    body = Body(ragged_box, example_material(Law.NEO_HOOKEAN), strain, element=element)
    d = 1e-8 * np.random.default_rng(3).standard_normal(ragged_box.points.shape)
    body.core.assemble_tangent(np.zeros_like(d))
    expected = 0.3 * body.core.multiply(d)
    found = viscous_force(body, d, d, 0.3)
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize(
    ("law", "strain"),
    [
        (Law.SAINT_VENANT_KIRCHHOFF, Strain.GREEN),
        (Law.SAINT_VENANT_KIRCHHOFF, Strain.LINEAR),
        (Law.NEO_HOOKEAN_STABLE, Strain.GREEN),
        (Law.OGDEN, Strain.GREEN),
    ],
)
@ELEMENTS
def test_steps_are_those_of_the_equations(
    ragged_box: TetMesh, law: Law, strain: Strain, element: Element
) -> None:
    span = TimeSpan(0.05, None, 3.0, num_outputs=1, stiffness_damping=2e-3)
    problem = clamped(ragged_box, span, example_material(law))
    velocity = 0.1 * np.random.default_rng(5).standard_normal(ragged_box.points.shape)
    velocity += 0.4 * ragged_box.points[:, [1, 0, 2]] * (1.0, -1.0, 0.0)
    plain = ExplicitBody(problem, strain=strain, element=element, velocity=velocity)
    threaded = ExplicitBody(
        problem, strain=strain, element=element, velocity=velocity, num_threads=2,
        tracks_energy=True,
    )  # fmt: skip
    single = ExplicitBody(
        problem, strain=strain, element=element, velocity=velocity, precision=Precision.SINGLE
    )
    dt, body = plain.time_step, plain.elastic
    mass, free = body.lumped_mass[:, None], ragged_box.points[:, :1] >= 1e-9
    velocity = np.where(free, velocity, 0.0)
    u, d = np.zeros_like(velocity), dt * velocity
    force = -viscous_force(body, u, d, 2e-3 / dt) / mass - 3.0 * velocity
    d = np.where(free, d - 0.5 * dt**2 * force, 0.0)
    for _ in range(30):
        force = -body.internal_force(u) - viscous_force(body, u, d, 2e-3 / dt)
        d = (1.0 - 1.5 * dt) * d + dt**2 * force / mass
        d = np.where(free, d / (1.0 + 1.5 * dt), 0.0)
        u = u + d
    for run in (plain, threaded, single):
        run.look()
        run.step(30)
    assert np.abs(u).max() > 0.003
    assert np.abs(plain.displacement - u).max() < 1e-13 * np.abs(u).max()
    assert np.abs(threaded.displacement - u).max() < 1e-13 * np.abs(u).max()
    assert np.abs(single.displacement - u).max() < 1e-5 * np.abs(u).max()


def spinning(mesh: TetMesh, beta: float, **options: object) -> DynamicResult:
    time = TimeSpan(2.0, num_outputs=20, stiffness_damping=beta)
    problem = Problem(mesh, SOFT, (), (), time, initial_velocity=START)
    return simulate(problem, tracks_energy=True, **options)  # type: ignore[arg-type]


@ELEMENTS
def test_a_free_body_keeps_its_momenta_and_loses_what_rings(
    ragged_box: TetMesh, element: Element
) -> None:
    mass = Body(ragged_box, SOFT).lumped_mass[:, None]
    start = START.at(ragged_box.points)
    still = spinning(ragged_box, 0.0, element=element)
    damped = spinning(ragged_box, 5e-3, element=element)
    moments = []
    for result in (still, damped):
        position = ragged_box.points + result.displacements[-1]
        moments.append(np.sum(mass * np.cross(position, result.velocity), axis=0))
        momentum = np.sum(mass * (result.velocity - start), axis=0)
        assert np.abs(momentum).max() < 1e-12 * mass.sum()
    # Of the scheme's velocities, which differ from its momenta by the order of the step.
    assert moments[1] == pytest.approx(moments[0], rel=2e-3, abs=1e-6)
    energies = damped.energies
    assert energies is not None
    assert energies.damping_loss[-1] > 0.0
    assert (np.diff(energies.damping_loss) > 0.0).all()
    # What is lost is the ringing, not the turn: that goes on.
    rigid = still.energies.kinetic[0]
    assert energies.damping_loss[-1] < 0.05 * rigid
    assert energies.kinetic[-1] + energies.strain[-1] > 0.95 * rigid


@pytest.mark.parametrize("law", [Law.SAINT_VENANT_KIRCHHOFF, Law.NEO_HOOKEAN])
def test_energy_is_balanced_with_what_is_lost(law: Law) -> None:
    mesh = brick_box((4, 2, 2), (2.0, 1.0, 1.0), ragged=0.1)
    kick = InitialVelocity((0.0, 0.0, 0.6))
    off = []
    for part in (0.5, 0.25):
        body = Body(mesh, example_material(law))
        step = part * damped_time_step(body.critical_time_step(), 0.01)
        span = TimeSpan(400 * step / part, step, num_outputs=8, stiffness_damping=0.01)
        problem = clamped(mesh, span, example_material(law))
        problem = Problem(mesh, problem.material, problem.supports, (), span, initial_velocity=kick)
        energies = simulate(problem, tracks_energy=True).energies
        assert energies is not None
        off.append(np.abs(energies.balance / energies.balance[0] - 1.0).max())
        assert energies.damping_loss[-1] > 0.3 * energies.balance[0]
    # Of the scheme's order: that of the forces, which are a step behind, in the step.
    assert off[1] < 0.6 * off[0] < 0.02


@ELEMENTS
def test_the_stable_step_is_the_damped_one(element: Element) -> None:
    mesh = brick_box((4, 2, 2), (2.0, 1.0, 1.0), ragged=0.1)
    critical = Body(mesh, SOFT, Strain.LINEAR, element=element).critical_time_step(
        relative_tolerance=1e-7
    )
    beta = 0.7 * critical
    damped = damped_time_step(critical, beta)
    # 2 / omega (sqrt(1 + xi^2) - xi) with xi = beta omega / 2.
    xi = beta / critical
    assert damped == pytest.approx(critical * (math.sqrt(1.0 + xi**2) - xi), rel=1e-14)
    assert stiffened_time_step(critical, beta, damped) == pytest.approx(damped, rel=1e-14)

    def run(step: float) -> DynamicResult:
        span = TimeSpan(2000 * step, step, num_outputs=1, stiffness_damping=beta)
        noise = 1e-6 * np.random.default_rng(2).standard_normal(mesh.points.shape)
        return simulate(
            clamped(mesh, span), strain=Strain.LINEAR, element=element, displacement=noise
        )

    assert np.abs(run(0.995 * damped).displacements[-1]).max() < 1e-6
    with pytest.raises(UnstableStepError):
        run(1.01 * damped)
    free = ExplicitBody(clamped(mesh, TimeSpan(1.0, stiffness_damping=beta)), element=element)
    assert free.time_step <= SAFETY * free.critical_time_step < 0.8 * critical
    assert free.critical_time_step == pytest.approx(damped, rel=1e-3)


def test_beyond_the_damped_step_a_run_blows_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bound is no more careful than it has to be."""
    mesh = brick_box((4, 2, 2), (2.0, 1.0, 1.0), ragged=0.1)
    critical = Body(mesh, SOFT, Strain.LINEAR).critical_time_step(relative_tolerance=1e-7)
    step = 1.02 * damped_time_step(critical, critical)
    assert step < 0.5 * critical
    monkeypatch.setattr("palpate.fastsim.explicit_time_step.damped_time_step", lambda c, _beta: c)
    noise = 1e-6 * np.random.default_rng(2).standard_normal(mesh.points.shape)
    span = TimeSpan(2000 * step, step, num_outputs=1, stiffness_damping=critical)
    with pytest.raises(BlowUpError):
        simulate(clamped(mesh, span), strain=Strain.LINEAR, displacement=noise)


def test_contact_leaves_room_for_it() -> None:
    mesh = brick_box((4, 2, 2), (2.0, 1.0, 1.0), ragged=0.1)
    path = ToolPath(np.array([0.0]), np.array([[1.5, 0.5, 1.3]]), np.array([[1.0, 0, 0, 0]]))
    tool = RigidTool(SphereShape(0.2), path)
    steps = []
    for beta in (0.0, 0.01):
        span = TimeSpan(0.1, num_outputs=1, stiffness_damping=beta)
        fixed = clamped(mesh, span)
        body = ExplicitBody(Problem(mesh, SOFT, fixed.supports, (), span, (tool,)))
        steps.append(body.critical_time_step)
    assert steps[1] == pytest.approx(damped_time_step(steps[0], 0.01), rel=1e-12)


@pytest.mark.parametrize("bad", [-1e-3, math.nan, math.inf])
def test_bad_values_are_refused(bad: float) -> None:
    with pytest.raises(InputError, match="stiffness_damping"):
        TimeSpan(1.0, stiffness_damping=bad)
