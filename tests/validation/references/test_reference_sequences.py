"""Error bars from sequences of meshes: made-up states with known orders."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Strain
from palpate.validation.case import load_case
from palpate.validation.metrics.grid_convergence import Convergence, GridConvergence
from palpate.validation.references.sequences import (
    assess_metrics,
    at_points_of,
    bar_of,
    bar_of_two,
    widen,
)
from palpate.validation.references.stored import load_stored
from palpate.validation.states import State

MESH = brick_box((2, 1, 1), (0.2, 0.1, 0.1))


def state(stretch, volume=1.1e-3, area=0.05):
    field = np.zeros((MESH.num_points, 3))
    field[:, 0] = stretch * MESH.points[:, 0]
    return State("made up", "reference", Strain.GREEN, 2, field, volume, area, 1.0, 0.2 * stretch)


def sequence(numbers):
    return assess_metrics(MESH, [state(*row) for row in numbers])


def test_order_and_bar_of_a_known_sequence():
    # 0.3 - 0.01 h^2 at h = 1, 2, 4: order 2, limit 0.3, 0.01 away from the finest.
    found = sequence([(0.3 - 0.01 * h**2, 2e-3 - 1e-5 * h**2, 0.05) for h in (1, 2, 4)])
    for metric in ("displacement_l2", "displacement_max", "max_displacement", "volume"):
        assert found[metric].behaviour is Convergence.MONOTONE, metric
    largest = found["max_displacement"]
    assert largest.order == pytest.approx(2.0)
    # In units of the finest's largest displacement, with the safety factor of three meshes.
    assert largest.error_bar == pytest.approx(1.25 * 0.01 / 0.29)
    assert largest.extrapolated == pytest.approx(0.30 / 0.29)
    # Of a field only differences are known; their order is that of the error.
    field = found["displacement_l2"]
    assert field.order == pytest.approx(2.0)
    assert field.error_bar == pytest.approx(1.25 * 0.01 / 0.29)


def test_a_number_that_stays_is_below_the_noise():
    found = sequence([(0.3, 2e-3, 0.05)] * 3)
    for convergence in found.values():
        assert convergence.behaviour is Convergence.BELOW_NOISE
        # 1.25 times the noise, of numbers up to a thousand times their scale.
        assert bar_of(convergence) <= 1.3e-8 * max(1.0, abs(convergence.value))


@pytest.mark.parametrize(
    ("volumes", "behaviour"),
    [
        ((2.00e-3, 2.01e-3, 2.00e-3), Convergence.OSCILLATING),
        ((2.00e-3, 2.02e-3, 2.03e-3), Convergence.DIVERGING),
        ((2.00e-3, 2.0001e-3, 2.1e-3), Convergence.ORDER_OUT_OF_RANGE),
    ],
)
def test_what_does_not_converge_has_no_bar(volumes, behaviour):
    found = sequence([(0.3, volume, 0.05) for volume in volumes])["volume"]
    assert found.behaviour is behaviour
    assert bar_of(found) == math.inf
    assert widen(0.01, 1.0, found, "volume") == math.inf


def test_two_sequences_that_do_not_meet_widen_the_bar():
    other = GridConvergence(1.0, Convergence.MONOTONE, order=2.0, extrapolated=1.05, error_bar=0.02)
    assert widen(0.01, 1.04, other, "volume") == 0.01
    assert widen(0.01, 1.00, other, "volume") == pytest.approx(0.03)
    assert widen(0.01, 0.0, other, "displacement_l2") == 0.01


def test_two_sequences_are_compared_in_one_unit():
    # Linear tetrahedra 0.3 - 0.01 h^2: limit 0.3, finest 0.29, which is the unit; index 0.0125.
    others = [state(0.3 - 0.01 * h**2) for h in (1, 2, 4)]
    found = assess_metrics(MESH, others)
    bars = bar_of_two(MESH, state(0.4), state(0.399), others, found)
    # They are 0.4 - 0.3 apart: more than the index, and more than three times 0.4 - 0.399.
    assert bars["max_displacement"] == pytest.approx((0.4 - 0.3 - 0.0125) / 0.29)
    # Fields are not told apart by their values: three times the difference, of the truth's size.
    assert bars["displacement_l2"] == pytest.approx(3.0 * 0.001 / 0.4)


def test_refined_states_are_read_at_the_first_points():
    many = state(0.3)
    few = brick_box((1, 1, 1), (0.1, 0.1, 0.1))
    found = at_points_of(few, many, "truth")
    assert found.displacement.shape == (few.num_points, 3)
    assert found.max_displacement == np.linalg.norm(found.displacement, axis=1).max()
    assert found.volume == many.volume


def test_the_blocks_reference_carries_its_orders():
    stored = load_stored("block", load_case("block").problem)
    convergence = stored.provenance["grid_convergence"]
    for strain in Strain:
        order = convergence[strain.value]["displacement_l2"]["order"]
        assert 1.0 < order < 3.0
        bar = stored.bars["displacement_l2", strain]
        assert bar == convergence[strain.value]["displacement_l2"]["error_bar"]
    # This area does not converge yet, and so decides nothing.
    assert convergence["green"]["surface_area"]["behaviour"] == "diverging"
    assert stored.bars["surface_area", Strain.GREEN] == math.inf
