"""fastsim's smoothed tetrahedra against the reference's on the same mesh: two codes, one answer."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.fastsim.body import Body
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.statics import solve_static as solve_fast
from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Support, Traction
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain, TimeSpan
from palpate.reference.availability import is_available
from palpate.validation.case import load_case

if is_available():
    from palpate.reference.discrete_problem import internal_force
    from palpate.reference.statics import solve_static
    from palpate.reference.stepping import simulate_explicit

pytestmark = pytest.mark.dolfinx

SMOOTHED = Element.SMOOTHED
BOTH = pytest.mark.parametrize("strain", list(Strain))


def two_materials(box, poissons_ratio):
    """Clamped at one end, hard and heavy in part, with every kind of load."""
    mesh = box((5, 3, 3), (0.5, 0.2, 0.2), jitter=0.2)
    centres = mesh.points[mesh.cells].mean(axis=1)
    hard = np.flatnonzero((centres[:, 0] > 0.25) & (centres[:, 1] > 0.1)).astype(np.int32)
    held = mesh.facet_groups["x0"]
    loads = (
        BodyForce((0.0, 20.0, -200.0)),
        Traction(mesh.facet_groups["x1"], (30.0, 0.0, 10.0)),
        PointForce(np.array([mesh.num_points - 1], np.int32), np.array([[0.0, 0.1, 0.0]])),
        Pressure(mesh.facet_groups["z1"], 30.0),
    )
    return Problem(
        mesh,
        Material(1e4, poissons_ratio),
        (Support(np.unique(held).astype(np.int32), held),),
        loads,
        inclusions=(Inclusion(hard, Material(6e4, 0.45, 3000.0)),),
    )


@BOTH
@pytest.mark.parametrize("poissons_ratio", [0.0, 0.3, 0.49])
def test_force_and_energy_are_the_same_to_rounding(box, strain, poissons_ratio):
    problem = two_materials(box, poissons_ratio)
    # About 10 % of the cell size.
    u = 0.006 * np.random.default_rng(7).standard_normal(problem.mesh.points.shape)
    ours = Body.of(problem, strain, element=SMOOTHED).internal_force(u)
    theirs = internal_force(
        problem.mesh,
        u,
        material=problem.material,
        inclusions=problem.inclusions,
        strain=strain,
        element=SMOOTHED,
    )
    assert np.abs(theirs).max() > 0.1
    assert np.abs(ours - theirs).max() <= 1e-12 * np.abs(theirs).max()


def largest_difference(problem, strain):
    fast = solve_fast(problem, strain=strain, element=SMOOTHED, relative_tolerance=1e-11)
    true = solve_static(problem, strain=strain, element=SMOOTHED, relative_tolerance=1e-11)
    scale = np.abs(true.displacement).max()
    assert scale > 0.0
    return np.abs(fast.displacement - true.displacement).max() / scale


@BOTH
def test_equilibria_of_two_materials_are_the_same(box, strain):
    assert largest_difference(two_materials(box, 0.4), strain) < 1e-8


@BOTH
@pytest.mark.parametrize(
    "name", ["beam", "block", "cantilever", "column", "csm1", "csm2", "kidney", "press", "sze"]
)
def test_built_in_cases_are_the_same(name, strain):
    assert largest_difference(load_case(name).problem, strain) < 1e-8


def both_motions(problem, strain, **begun):
    fast = simulate(problem, strain=strain, element=SMOOTHED, **begun)
    true = simulate_explicit(problem, strain=strain, element=SMOOTHED, **begun)
    assert fast.num_steps == true.num_steps
    return fast, true


def largest_difference_in_motion(problem, strain, **begun):
    fast, true = both_motions(problem, strain, **begun)
    scale = np.abs(true.displacements).max()
    assert scale > 0.0
    return np.abs(fast.displacements - true.displacements).max() / scale


@BOTH
def test_a_thousand_steps_of_two_materials_are_the_same(box, strain):
    problem = two_materials(box, 0.4)
    step = 0.5 * Body.of(problem, strain, element=SMOOTHED).critical_time_step()
    span = TimeSpan(1000 * step, step, mass_damping=2.0, num_outputs=10)
    moving = dataclasses.replace(problem, time=span)
    velocity = 0.2 * problem.mesh.points[:, :1] * [0.2, 1.0, 0.0]
    assert largest_difference_in_motion(moving, strain, velocity=velocity) < 1e-10


@BOTH
def test_a_thousand_steps_of_the_kidney_are_the_same(strain):
    problem = load_case("kidney").problem
    step = 0.5 * Body.of(problem, strain, element=SMOOTHED).critical_time_step()
    span = TimeSpan(1000 * step, step, mass_damping=5.0, num_outputs=10)
    moving = dataclasses.replace(problem, time=span)
    assert largest_difference_in_motion(moving, strain) < 1e-10


@BOTH
def test_a_moving_tool_leaves_the_same_motion_and_feels_the_same(strain):
    problem = load_case("slide").problem
    fast, true = both_motions(problem, strain)
    assert true.num_steps == 600
    scale = np.abs(true.displacements).max()
    assert np.abs(fast.displacements - true.displacements).max() < 1e-10 * scale
    felt = np.abs(true.tool_forces).max()
    assert felt > 0.01
    forces = np.array([track.mean_forces for track in fast.tools])
    assert np.abs(forces - true.tool_forces).max() < 1e-9 * felt
