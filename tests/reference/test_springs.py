"""Springs over patches: both solvers on the same mesh, closed forms, balances, refinement."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from bank import fixed

from palpate.fastsim.dynamic_relaxation import relax
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.explicit_body import ExplicitBody
from palpate.fastsim.springs import PatchSprings
from palpate.fastsim.statics import solve_static as fast_static
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.meshes.refinement import refine_problem
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.meshes.spring import AnchorPath, Spring
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference.audit import audit_displacement
    from palpate.reference.dynamics import simulate_implicit
    from palpate.reference.result import Formulation
    from palpate.reference.schemes import Integrator
    from palpate.reference.statics import solve_static
    from palpate.reference.stepping import simulate_by, simulate_explicit

SIZE = (1.0, 0.6, 0.5)
SOFT = Material(1e4, 0.35, 1000.0)
EVERY = pytest.mark.parametrize(
    ("strain", "element"), [(s, e) for s in Strain for e in Element], ids=lambda v: str(v)
)
SPAN = TimeSpan(1.0, 2e-3, mass_damping=2.0, num_outputs=10)
AWAY = AnchorPath([0.0, 0.3, 0.8], [[0.0, 0.0, 0.0], [0.05, 0.1, 0.15], [-0.1, 0.0, 0.3]], True)
QUICK = AnchorPath([0.0, 0.1], [[0.0, 0.0, 0.0], [0.05, 0.1, 0.2]])


def pinched(divisions=(4, 3, 3), *, stiffness=3e3, time=None, path=AWAY, amplitude=None):
    """A block that is held on the left and pulled at its top by a spring; a second holds on."""
    mesh = brick_box(divisions, SIZE, ragged=0.2)
    held = side(mesh, 0, 0.0)
    springs = (
        Spring.on(mesh, (0.8, 0.3, 0.5), 0.35, stiffness, path, amplitude),
        Spring.on(mesh, (1.0, 0.3, 0.1), 0.4, 500.0, AnchorPath([0.0], [[0.02, 0.0, 0.0]])),
    )
    return Problem(mesh, SOFT, (fixed(held),), (), time=time, springs=springs)


def energy(patches, displacement, anchors, factors):
    """Half the sum of K_ab (d - u_a) . (d - u_b) [J]."""
    left = anchors[patches.of_facet][:, None] - displacement[patches.facets]
    K = patches.stiffnesses.reshape(-1, 3, 3)
    by_facet = np.einsum("maj,mab,mbj->m", left, K, left)
    return 0.5 * float(factors[patches.of_facet] @ by_facet)


def apart(mine, theirs):
    return np.abs(mine - theirs).max() / np.abs(theirs).max()


@pytest.mark.dolfinx
@EVERY
def test_the_same_equilibrium_on_the_same_mesh(strain: Strain, element: Element) -> None:
    problem = pinched()
    mine = fast_static(problem, strain=strain, element=element).displacement
    found = solve_static(problem, strain=strain, element=element)
    assert np.abs(mine).max() > 0.1
    assert apart(mine, found.displacement) < 1e-8
    # What the supports push is what the springs pull.
    patches = PatchSprings(problem.mesh.points, problem.springs)
    ends = np.array([spring.path.end for spring in problem.springs])
    pulled = patches.resultants(mine, ends, np.ones(2)).sum(axis=0)
    assert np.linalg.norm(pulled + found.support_forces.sum(axis=0)) < 1e-7 * np.linalg.norm(pulled)
    audited = audit_displacement(problem, mine, strain=strain, degree=1, element=element)
    assert audited.displacement_error < 1e-7
    wrong = dataclasses.replace(problem, springs=problem.springs[:1])
    assert apart(fast_static(wrong, strain=strain, element=element).displacement, mine) > 1e-3


@pytest.mark.dolfinx
def test_beside_a_pressure_and_a_slanted_plane() -> None:
    problem = pinched()
    left, top = side(problem.mesh, 0, 0.0), side(problem.mesh, 2, 0.5)
    wall = fixed(left, normal=(1.0, 0.2, 0.0))
    far = side(problem.mesh, 1, 0.6)
    problem = dataclasses.replace(
        problem,
        supports=(wall, fixed(far)),
        loads=(Pressure(top, 200.0),),
    )
    mine = fast_static(problem).displacement
    assert apart(mine, solve_static(problem).displacement) < 1e-8


@pytest.mark.dolfinx
def test_beside_a_tool() -> None:
    """A ball presses where the spring pulls; dynamic relaxation says that it knows no springs."""
    problem = pinched()
    top = problem.mesh.points[:, 2].max()
    ways = np.array([[0.4, 0.3, top + 0.31], [0.4, 0.3, top + 0.25]])
    ball = RigidTool(SphereShape(0.3), ToolPath(np.array([0.0, 1.0]), ways))
    pressed = dataclasses.replace(problem, tools=(ball,))
    mine = fast_static(pressed).displacement
    assert apart(mine, fast_static(problem).displacement) > 0.1
    assert apart(mine, solve_static(pressed).displacement) < 1e-6
    with pytest.raises(InputError, match="knows no springs"):
        relax(problem)


@pytest.mark.dolfinx
@EVERY
def test_the_same_steps_on_the_same_mesh(strain: Strain, element: Element) -> None:
    letting_go = TabularAmplitude((0.0, 0.1, 0.6, 0.7), (0.0, 1.0, 1.0, 0.2))
    problem = pinched((3, 2, 2), time=SPAN, amplitude=letting_go)
    mine = simulate(problem, strain=strain, element=element).displacements
    theirs = simulate_explicit(problem, strain=strain, element=element).displacements
    assert np.abs(theirs).max() > 0.1
    assert apart(mine, theirs) < 1e-10


@pytest.mark.dolfinx
@pytest.mark.parametrize("strain", list(Strain))
def test_implicit_motion_goes_the_same_way(strain: Strain) -> None:
    """Both kinds of implicit steps come to the explicit ones: errors of their steps are left."""
    letting_go = TabularAmplitude((0.0, 0.05, 0.15), (0.5, 1.0, 0.2))
    span = TimeSpan(0.2, 2e-3, mass_damping=2.0, num_outputs=5)
    problem = pinched((3, 2, 2), time=span, path=QUICK, amplitude=letting_go)
    explicit = simulate(problem, strain=strain).displacements
    alpha = simulate_implicit(problem, strain=strain, degree=1, is_mass_lumped=True)
    assert apart(alpha.displacements, explicit) < 2e-3
    by = simulate_by(problem, Integrator.TRAPEZOIDAL, strain=strain)
    assert apart(by.displacements, explicit) < 2e-3
    held_on = pinched((3, 2, 2), time=span, path=QUICK)
    assert apart(simulate(held_on, strain=strain).displacements, explicit) > 0.05


@pytest.mark.dolfinx
@pytest.mark.nightly  # the mixed form takes 10 s to compile
def test_quadratic_and_mixed_tetrahedra_know_them() -> None:
    """On the same mesh the mixed form is the plain one to what the mesh leaves; both balance."""
    problem = pinched((2, 2, 2))
    plain = solve_static(problem, degree=2)
    mixed = solve_static(problem, degree=2, formulation=Formulation.MIXED)
    assert apart(mixed.displacement, plain.displacement) < 0.02
    for found in (plain, mixed):
        assert np.linalg.norm(found.support_forces) > 100.0


def test_a_bar_and_a_spring_in_a_row() -> None:
    """Without lateral contraction E A / L and k in series, where all of the end has one weight."""
    mesh = brick_box((5, 2, 2), SIZE, ragged=0.2)
    held, end = side(mesh, 0, 0.0), side(mesh, 0, 1.0)
    bar, k, d = 1e4 * 0.6 * 0.5 / 1.0, 2e3, 0.05
    spring = Spring(end, (1.0, 0.3, 0.25), 1e4, k, AnchorPath([0.0], [[d, 0.0, 0.0]]))
    problem = Problem(mesh, Material(1e4, 0.0), (fixed(held),), (), springs=(spring,))
    found = fast_static(problem, strain=Strain.LINEAR).displacement
    tip = k / (k + bar) * d
    exact = tip * np.outer(mesh.points[:, 0], [1.0, 0.0, 0.0])
    assert np.abs(found - exact).max() < 1e-6 * tip
    patches = PatchSprings(mesh.points, problem.springs)
    anchors, full = np.array([[d, 0.0, 0.0]]), np.ones(1)
    force = patches.resultants(found, anchors, full)
    assert force[0] == pytest.approx([bar * tip, 0.0, 0.0], abs=1e-5 * bar * tip)
    assert patches.force(found, anchors, full).sum(axis=0) == pytest.approx(force[0])
    assert energy(patches, found, anchors, full) == pytest.approx(
        0.5 * k * (d - tip) ** 2, rel=1e-5
    )


def test_energy_and_momentum_are_kept() -> None:
    """What a still anchor gives is what the spring loses; a free body's momentum is its push."""
    still = AnchorPath([0.0], [[0.05, 0.1, 0.15]])
    problem = pinched((3, 2, 2), time=SPAN, path=still)
    problem = dataclasses.replace(
        problem, supports=(), time=dataclasses.replace(SPAN, mass_damping=0.0)
    )
    body = ExplicitBody(problem, tracks_energy=True)
    patches = PatchSprings(problem.mesh.points, problem.springs)
    ends, full = np.array([spring.path.end for spring in problem.springs]), np.ones(2)
    mass, dt = body.elastic.lumped_mass, body.time_step
    stored = energy(patches, body.displacement, ends, full)
    before, pushed = body.displacement.copy(), np.zeros(3)
    pushed -= 0.5 * dt * patches.resultants(before, ends, full).sum(axis=0)  # half of the first
    for _ in range(200):
        pushed += dt * patches.resultants(body.displacement, ends, full).sum(axis=0)
        before = body.displacement.copy()
        body.step()
    momentum = mass @ (body.displacement - before) / dt
    assert np.linalg.norm(momentum) > 1.0
    assert momentum == pytest.approx(pushed, rel=1e-9)
    kinetic, work, _ = body.energies()
    now = body.displacement
    assert work == pytest.approx(stored - energy(patches, now, ends, full), rel=1e-9)
    assert kinetic + body.elastic.strain_energy(now) == pytest.approx(work, rel=0.01)


@pytest.mark.parametrize("strain", list(Strain))
def test_it_has_a_limit_on_finer_meshes(strain: Strain) -> None:
    """The force on the anchor of four meshes: differences fall by about four each time."""
    problem = pinched((4, 3, 2))
    forces = []
    for _ in range(3):
        found = fast_static(problem, strain=strain).displacement
        patches = PatchSprings(problem.mesh.points, problem.springs)
        ends = np.array([spring.path.end for spring in problem.springs])
        forces.append(patches.resultants(found, ends, np.ones(2))[0])
        problem = refine_problem(problem)
    steps = [np.linalg.norm(b - a) for a, b in itertools.pairwise(forces)]
    assert steps[0] < 0.2 * np.linalg.norm(forces[-1])
    assert 2.0 < steps[0] / steps[1] < 8.0


def test_a_stiff_spring_shortens_the_stable_step() -> None:
    soft, stiff = (ExplicitBody(pinched((3, 2, 2), stiffness=k)) for k in (1.0, 3e6))
    assert stiff.critical_time_step < 0.5 * soft.critical_time_step
    # It is the largest frequency's: a step a little longer blows up, one shorter does not.
    problem = pinched((3, 2, 2), stiffness=3e6)
    exact = Strain.LINEAR
    critical = ExplicitBody(problem, strain=exact).critical_time_step
    fine = ExplicitBody(problem, strain=exact, time_step=0.98 * critical)
    fine.step(500)
    assert np.abs(fine.displacement).max() < 1.0
