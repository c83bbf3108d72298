"""Limits of single precision follow from 2^-24, the case's stiffness and its number of steps."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.validation.case import load_case
from palpate.validation.metrics import make_state
from palpate.validation.metrics.rounding import LARGEST, SAFETY, SinglePrecision, rounding_of_motion
from palpate.validation.references.reference_set import SAME_MESH
from palpate.validation.references.stored import load_stored
from palpate.validation.states import Trajectory


def reference_of(name):
    case = load_case(name)
    return case.problem, load_stored(name, case.problem).states[SAME_MESH, Strain.GREEN]


def bar(bricks, length, youngs_modulus=1000.0):
    """A clamped bar of one brick's section, bent by its end, and a made-up bent state."""
    mesh = brick_box((bricks, 1, 1), (length, 1.0, 1.0))
    facets = mesh.boundary_facets
    x = mesh.points[facets][:, :, 0]
    fixed, pulled = facets[(x == 0.0).all(axis=1)], facets[(x == length).all(axis=1)]
    problem = Problem(
        mesh,
        Material(youngs_modulus, 0.3),
        (Support(np.unique(fixed).astype(np.int32), fixed),),
        (Traction(pulled, (0.0, 0.0, 1.0)),),
    )
    field = np.zeros_like(mesh.points)
    field[:, 2] = 0.1 * mesh.points[:, 0] ** 2 / length
    return problem, make_state(mesh, field, label="", simulator="", strain=Strain.GREEN)


def test_a_slender_body_amplifies_rounding_more_than_a_stout_one():
    """Tips of bars of the same relative deflection: noise of curvature adds up along the bar."""
    limits = [
        SinglePrecision(p).limit("max_displacement", s) for p, s in (bar(4, 4.0), bar(32, 32.0))
    ]
    assert limits[1] > 2.0 * limits[0]


def test_neither_stiffness_nor_units_matter():
    soft = SinglePrecision(bar(4, 4.0)[0]).limit("displacement_l2", bar(4, 4.0)[1])
    problem, state = bar(4, 4.0, youngs_modulus=1e6)
    assert SinglePrecision(problem).limit("displacement_l2", state) == pytest.approx(soft, rel=0.05)


def test_a_strain_of_rounding_is_the_limit_of_a_homogeneous_stretch():
    """Stretch by 0.1: 4 u of strain at random is at most 4 u / 0.1 = 2.4e-6 of it, times ten."""
    problem, reference = reference_of("stretch")
    limit = SinglePrecision(problem).limit("displacement_h1", reference)
    assert 0.05 * SAFETY * 4 * 2.0**-24 / 0.1 < limit < SAFETY * 4 * 2.0**-24 / 0.1


def test_a_motion_is_rounded_by_the_square_root_of_its_steps():
    """r = sqrt(n) 2^-24 / (w dt): whole periods of a cosine about 0 have |v| = w |a|."""
    problem, state = bar(2, 2.0)
    w, steps = 7.0, 1000
    end = 4 * 2.0 * math.pi / w
    times = np.linspace(0.0, end, 2001)
    shape = np.broadcast_to(problem.mesh.points, (len(times), *problem.mesh.points.shape))
    moving = dataclasses.replace(problem, time=TimeSpan(end, end / steps, 0.0, 500))
    trajectory = Trajectory(times, np.cos(w * times)[:, None, None] * shape)
    swinging = dataclasses.replace(state, trajectory=trajectory)
    expected = math.sqrt(steps) * 2.0**-24 / (w * end / steps)
    assert rounding_of_motion(moving, swinging) == pytest.approx(expected, rel=1e-3)
    limit = SinglePrecision(moving).limit("trajectory_l2", swinging)
    assert limit == pytest.approx(SAFETY * expected, rel=0.05)
    assert limit < LARGEST


@pytest.mark.parametrize("name", ["block", "cantilever", "press", "slide", "wave"])
def test_no_limit_is_above_a_tenth_of_a_material_two_per_cent_too_soft(name):
    problem, reference = reference_of(name)
    single = SinglePrecision(problem)
    metrics = ["displacement_l2", "displacement_h1", "volume", "local_volume", "reaction_force"]
    metrics += ["tool_force"] if problem.tools else []
    metrics += ["trajectory_l2"] if problem.time else []
    for metric in metrics:
        assert 2.0**-24 < single.limit(metric, reference) <= 0.1 * 0.02
