"""Metrics of motion on swings that are known."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from bank import made_state

from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem
from palpate.validation.metrics import measure
from palpate.validation.states import State, Trajectory

MESH = brick_box((2, 1, 1), (2.0, 1.0, 1.0))
PROBLEM = Problem(MESH, Material(1.0, 0.3), (), ())
TIMES = np.linspace(0.0, 2.0, 81)


def swinging(size: float = 0.1, frequency: float = 2.0, damping: float = 0.5) -> State:
    """Sideways by x^2: the end swings most."""
    wave = size * np.exp(-damping * TIMES) * np.sin(2 * math.pi * frequency * TIMES)
    shape = np.zeros_like(MESH.points)
    shape[:, 1] = MESH.points[:, 0] ** 2
    fields = wave[:, None, None] * shape
    return made_state(MESH, fields[-1], trajectory=Trajectory(TIMES, fields))


def test_errors_of_a_swing_are_those_put_in() -> None:
    reference = swinging()
    larger, faster, livelier = swinging(0.103), swinging(frequency=2.02), swinging(damping=0.3)
    for metric, candidate, error, digits in (
        ("trajectory_l2", larger, 0.03, 1e-9),
        ("oscillation_amplitude", larger, 0.03, 1e-6),
        ("oscillation_frequency", faster, 0.01, 1e-6),
        ("oscillation_phase", faster, 0.04, 1e-6),  # 0.02 Hz over 2 s
        ("oscillation_damping", livelier, 0.2 / 2.0, 1e-6),
    ):
        found = measure(metric, PROBLEM, candidate, reference).value
        assert found == pytest.approx(error, rel=digits), metric


def test_a_candidate_that_does_not_swing_is_infinitely_wrong() -> None:
    assert measure("oscillation_frequency", PROBLEM, swinging(0.0), swinging()).value == math.inf


def test_a_static_state_has_no_motion_to_judge() -> None:
    still = made_state(MESH, 0 * MESH.points)
    with pytest.raises(InputError, match="time"):
        measure("trajectory_l2", PROBLEM, still, swinging())


def test_the_force_on_a_tool_is_compared_over_time() -> None:
    felt = [[[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [1.0, 0.0, 4.0]]]
    reference = dataclasses.replace(swinging(), tool_forces=np.array(felt))
    other = [[[0.0, 0.0, 0.0], [0.0, 0.3, 2.4], [1.0, 0.0, 4.0]]]
    candidate = dataclasses.replace(swinging(), tool_forces=np.array(other))
    found = measure("tool_force", PROBLEM, candidate, reference)
    assert found.value == pytest.approx(0.5 / math.sqrt(17.0), rel=1e-14)
    # The last one only, or none: nothing that could be compared.
    for given in (np.array([felt[0][-1]]), None):
        short = dataclasses.replace(candidate, tool_forces=given)
        assert measure("tool_force", PROBLEM, short, reference).value == math.inf
