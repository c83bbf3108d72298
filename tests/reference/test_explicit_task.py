"""The explicit reference in its own process: the same trajectory, and its failures."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, TimeSpan
from palpate.reference.availability import is_available
from palpate.reference.child import run_task
from palpate.reference.errors import ReferenceBlowUpError, ReferenceTimeoutError
from palpate.reference.schemes import Integrator
from palpate.reference.tasks import SteppedTask

if is_available():
    from palpate.reference.stepping import simulate_explicit

pytestmark = pytest.mark.dolfinx


@pytest.fixture
def swing(box):
    mesh = box((3, 1, 1), (0.3, 0.1, 0.1))
    held = mesh.facet_groups["x0"]
    supports = (Support(np.unique(held).astype(np.int32), held),)
    span = TimeSpan(0.05, 1e-3, 1.0, 5)
    return Problem(mesh, Material(1e4, 0.35), supports, (BodyForce((0.0, 90.0, -300.0)),), span)


def test_the_child_gives_the_same_trajectory_bit_for_bit(swing):
    there = run_task(SteppedTask(Integrator.CENTRAL_DIFFERENCES), swing, time_limit=120)
    here = simulate_explicit(swing)
    assert np.array_equal(there.displacements, here.displacements)
    assert np.array_equal(there.strain_energies, here.strain_energies)
    assert np.array_equal(there.times, here.times)
    assert (there.time_step, there.num_steps) == (1e-3, 50)


def test_failures_come_back_typed(swing):
    with pytest.raises(InputError, match="time_step given"):
        run_task(
            SteppedTask(Integrator.CENTRAL_DIFFERENCES),
            dataclasses.replace(swing, time=TimeSpan(1.0)),
            time_limit=60,
        )
    wild = dataclasses.replace(swing, time=TimeSpan(100.0, 0.1, 0.0, 10))
    with pytest.raises(ReferenceBlowUpError) as caught:
        run_task(SteppedTask(Integrator.CENTRAL_DIFFERENCES), wild, time_limit=120)
    assert caught.value.displacement.shape == swing.mesh.points.shape
    assert np.isfinite(caught.value.displacement).all()
    with pytest.raises(ReferenceTimeoutError):
        run_task(SteppedTask(Integrator.CENTRAL_DIFFERENCES), swing, time_limit=0.2)
