"""States of refined meshes at the first points, and bars of references before adaptive ones."""

from __future__ import annotations

import math

import numpy as np

from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Strain
from palpate.validation.case import load_case
from palpate.validation.references.runs import at_points_of
from palpate.validation.references.stored import load_stored
from palpate.validation.states import State


def test_refined_states_are_read_at_the_first_points():
    mesh, few = brick_box((2, 1, 1), (0.2, 0.1, 0.1)), brick_box((1, 1, 1), (0.1, 0.1, 0.1))
    field = np.zeros((mesh.num_points, 3))
    field[:, 0] = 0.3 * mesh.points[:, 0]
    many = State("made up", "reference", Strain.GREEN, 2, field, 1.1e-3, 0.05, 1.0, 0.06)
    found = at_points_of(few, many)
    assert found.displacement.shape == (few.num_points, 3)
    assert found.max_displacement == np.linalg.norm(found.displacement, axis=1).max()
    assert found.volume == many.volume


def test_a_reference_cut_in_eight_carries_its_orders():
    stored = load_stored("block-fine", load_case("block-fine").problem)
    convergence = stored.provenance["grid_convergence"]
    for strain in Strain:
        order = convergence[strain.value]["displacement_l2"]["order"]
        assert 1.0 < order < 3.0
        bar = stored.bars["displacement_l2", strain]
        assert bar == convergence[strain.value]["displacement_l2"]["error_bar"]
    # This area does not converge yet, and so decides nothing.
    assert convergence["green"]["surface_area"]["behaviour"] == "order out of range"
    assert stored.bars["surface_area", Strain.GREEN] == math.inf
