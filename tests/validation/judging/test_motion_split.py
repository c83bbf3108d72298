"""Of a simulator that states its scheme: a seeded step, solver or law lands in its own term."""

from __future__ import annotations

import dataclasses
import math
from functools import cache

import numpy as np
import pytest

from palpate.fastsim.body import Body
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.reference.schemes import (
    Integrator,
    Steps,
    amplification,
    numerical_damping_ratio,
)
from palpate.validation.judging.error_budget import (
    MODEL,
    SOLVER,
    TIME,
    UNEXPLAINED,
    Budget,
    motion_budgets,
)
from palpate.validation.metrics import make_state, measure
from palpate.validation.metrics.motion import measure_numerical_damping
from palpate.validation.references.runs import solve_by_steps
from palpate.validation.states import State, Trajectory, in_silence

pytestmark = pytest.mark.dolfinx

# What the project promises: within a tenth of what was seeded.
WITHIN = 0.1
STEP, LONG = 1e-3, 4e-3
OTHER = Law.NEO_HOOKEAN_STABLE


@cache
def swing(size: tuple[float, float, float] = (0.06, 0.02, 0.02)) -> Problem:
    """A bar of eighteen cells, let go under a sideways pull; it bends by a third of its length."""
    mesh = brick_box((3, 1, 1), size)
    fixed = np.flatnonzero(mesh.points[:, 0] == 0.0).astype(np.int32)
    x = mesh.points[mesh.boundary_facets][:, :, 0]
    supports = (Support(fixed, mesh.boundary_facets[(x == 0.0).all(axis=1)]),)
    loads = (BodyForce((0.0, 0.0, -5e3)),)
    # The central differences that fill the budget are stable with it on a mesh cut in eight.
    span = TimeSpan(0.112, STEP, 1.0, 14)
    return Problem(mesh, Material(2e4, 0.4), supports, loads, span)


def backward_euler(
    problem: Problem, time_step: float, *, iterations: int = 200, law: Law | None = None
) -> State:
    """A copy of our own simulator by backward Euler, with what may be wrong with one.

    Its forces are fastsim's; a step is solved by so many iterations with the stiffness at rest.
    The motion of a body that is held where it is and pulled by one body force, under Green strain.

    Args:
        problem: With time.
        time_step: [s].
        iterations: In each step, at most; fewer where the residual has come to 1e-12 of the load.
        law: In the place of the problem's.
    """
    material = dataclasses.replace(problem.material, law=law or problem.material.law)
    body = Body(problem.mesh, material)
    mass, span = body.lumped_mass[:, None], problem.time
    assert span is not None
    (load,) = problem.loads
    assert isinstance(load, BodyForce)
    force = mass / material.density * np.array(load.force_density)
    free = np.ones(problem.mesh.points.shape, dtype=bool)
    for support in problem.supports:
        free[np.ix_(support.points, np.flatnonzero(support.components))] = False
    dofs, w = np.flatnonzero(free), mass * (1.0 + span.mass_damping * time_step) / time_step**2
    h, unit = 1e-6 * np.ptp(problem.mesh.points), np.zeros(free.size)
    columns = []
    for dof in dofs:
        unit[dof] = h
        ends = [body.internal_force(s * unit.reshape(free.shape)).ravel()[dofs] for s in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2.0 * h))
        unit[dof] = 0.0
    inertia = np.broadcast_to(w, free.shape).ravel()[dofs]
    inverse = np.linalg.inv(np.column_stack(columns) + np.diag(inertia))
    u, v = np.zeros(free.shape), np.zeros(free.shape)
    states, per_output = [u], round(span.end_time / span.num_outputs / time_step)
    for step in range(per_output * span.num_outputs):
        y = u + (mass * v / time_step + force) / w
        new = u.copy()
        for _ in range(iterations):  # each takes seven tenths of what Newton's would
            left = (w * (y - new) - body.internal_force(new)).ravel()[dofs]
            if np.abs(left).max() <= 1e-12 * np.abs(force).max():
                break
            change = np.zeros(free.size)
            change[dofs] = 0.7 * (inverse @ left)
            new = new + change.reshape(free.shape)
        u, v = new, (new - u) / time_step
        if (step + 1) % per_output == 0:
            states.append(u)
    return make_state(
        problem.mesh,
        u,
        label="own",
        simulator="own",
        strain=Strain.GREEN,
        trajectory=Trajectory(
            np.linspace(0.0, span.end_time, span.num_outputs + 1), np.array(states)
        ),
        steps=Steps(Integrator.BACKWARD_EULER, time_step),
        says={"iterations": iterations},
    )


@cache
def own(step: float = STEP, iterations: int = 200, law: Law | None = None) -> State:
    return backward_euler(swing(), step, iterations=iterations, law=law)


@cache
def exact(step: float = STEP, law: Law | None = None) -> State:
    """The reference by the same scheme and step."""
    problem = swing() if law is None else dataclasses.replace(swing(), material=material(law))
    return solve_by_steps(problem, Strain.GREEN, own(step).steps, in_silence)


def material(law: Law) -> Material:
    return dataclasses.replace(swing().material, law=law)


@cache
def budget(step: float = STEP, iterations: int = 200, law: Law | None = None) -> Budget:
    return motion_budgets(swing(), own(step, iterations, law), same_mesh=exact(step))[0]


def assert_lands_in(term: str, seeded: Budget, healthy: Budget) -> None:
    """The change of the value, measured on the candidates alone, is the change of that term."""
    known = seeded.value - healthy.value
    assert abs(known) > 0.01 * abs(healthy.truth)
    found = (seeded.terms[term] or 0.0) - (healthy.terms[term] or 0.0)
    assert found == pytest.approx(known, rel=WITHIN)
    for other in {MODEL, TIME, SOLVER} - {term}:
        moved = (seeded.terms[other] or 0.0) - (healthy.terms[other] or 0.0)
        # Another motion has another error of time: by no quarter of what was seeded.
        assert abs(moved) < 0.25 * abs(known), other


@pytest.mark.long
def test_a_simulator_that_solves_its_steps_equals_the_reference_by_its_scheme() -> None:
    for step in (STEP, LONG):
        assert measure("trajectory_l2", swing(), own(step), exact(step)).value < 1e-9


def test_a_long_step_is_the_error_of_time() -> None:
    assert_lands_in(TIME, budget(LONG), budget())


def test_too_few_iterations_are_the_solvers_error() -> None:
    seeded = budget(LONG, 3)
    assert seeded.rest == SOLVER
    assert_lands_in(SOLVER, seeded, budget(LONG))


def test_another_law_that_is_not_stated_is_not_explained() -> None:
    candidate = dataclasses.replace(own(law=OTHER), says={})
    found = motion_budgets(swing(), candidate, same_mesh=exact())[0]
    assert found.rest == UNEXPLAINED
    assert found.terms[UNEXPLAINED] == pytest.approx(found.value - budget().value, rel=WITHIN)


def test_steps_without_the_same_mesh_are_refused() -> None:
    with pytest.raises(InputError, match="needs the same mesh"):
        motion_budgets(swing(), own())


def test_backward_euler_is_measured_to_damp_as_its_formula_says() -> None:
    # Wider than high, so that it has one mode of that frequency and not two.
    flat = dataclasses.replace(swing((0.06, 0.03, 0.02)), time=TimeSpan(0.6, LONG, 1.0, 75))
    found = measure_numerical_damping(flat, backward_euler(flat, LONG))
    omega_dt = 2.0 * math.pi * found.frequency * LONG
    assert found.formula == pytest.approx(0.5 * omega_dt, rel=0.05)
    assert abs(found.measured - found.formula) <= found.uncertainty < 0.1 * found.formula
    assert "backward-euler, steps of 0.004 s" in str(found)
    short = dataclasses.replace(flat, time=TimeSpan(0.24, LONG, 1.0, 30))
    with pytest.raises(InputError, match="periods"):
        measure_numerical_damping(short, backward_euler(short, LONG))


@pytest.mark.parametrize("integrator", [Integrator.BACKWARD_EULER, Integrator.BDF2])
def test_the_damping_of_one_mode_is_measured_to_the_formula(integrator: Integrator) -> None:
    problem, step, angle = swing(), 1e-3, 0.2
    span = TimeSpan(0.2, step, 0.0, 200)
    states = np.zeros((201, problem.mesh.num_points, 3))
    states[:, -1, 2] = 1e-4 * (amplification(integrator, angle) ** np.arange(201)).real
    solution = make_state(
        problem.mesh, states[-1], label="a", simulator="a", strain=Strain.GREEN,
        trajectory=Trajectory(step * np.arange(201), states), steps=Steps(integrator, step),
    )  # fmt: skip
    found = measure_numerical_damping(dataclasses.replace(problem, time=span), solution)
    assert found.formula == pytest.approx(numerical_damping_ratio(integrator, angle), rel=1e-6)
    assert found.measured == pytest.approx(found.formula, rel=1e-5)
