"""Fourteen kinds of damage on organs: repaired within the limits, or refused soon with advice."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np
import pytest
from damaged_organs import DEFECTS
from perturbed_surfaces import ball, kidney

from palpate.fastsim.exact_repair.patch_repairs import all_crossings
from palpate.fastsim.exact_repair.solid_repair import repair_to_solid
from palpate.meshes.errors import InputError
from palpate.meshes.repair.choices import RepairChoices
from palpate.meshes.shapes import shape_tube
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import TriSurface

# Damage that is repaired on any body; the rest is repaired or refused.
ALWAYS_REPAIRED = {
    "holes of 3 to 12 edges", "hole of 30 edges", "flipped facets", "facets given twice",
    "sheet a hundredth of an edge beside", "bodies overlapping by 0.3 edges", "fins",
    "crumpled patch", "patch pushed over its neighbours", "T-junctions", "facets torn apart",
}  # fmt: skip
# Processor time of a refusal [s].
LONGEST = 10.0


def is_solid(surface: TriSurface) -> bool:
    try:
        require_closed(surface)
    except InputError:
        return False
    return not len(all_crossings(surface.points, surface.facets))


def damage_and_repair(body: TriSurface, defect: str, seed: list[int]) -> str:
    """What came of it: sound as it was given, repaired, or refused."""
    given = DEFECTS[defect](body, np.random.default_rng(seed))
    if is_solid(given.surface):
        return "sound"
    start = time.process_time()
    try:
        made = repair_to_solid(given.surface, RepairChoices(smallest_shell=given.smallest_shell))
    except InputError:
        assert time.process_time() - start <= LONGEST
        return "refused"
    assert is_solid(made.surface)
    return "repaired"


@pytest.mark.parametrize(
    "defect",
    [
        "sheet a hundredth of an edge beside", "T-junctions", "fins", "wall pushed through another",
    ],
)  # fmt: skip
def test_four_kinds_on_a_ball(defect: str) -> None:
    assert damage_and_repair(ball(), defect, [0, 0]) == "repaired"


@pytest.mark.nightly
@pytest.mark.timeout(0)  # each surface has its own limit
@pytest.mark.parametrize("defect", DEFECTS)
def test_damaged_organs_are_repaired_or_refused_soon(defect: str) -> None:
    number = list(DEFECTS).index(defect)
    bodies = [kidney(), ball(), shape_tube(0.02, 0.014, 0.06, edge_length=4e-3)]
    found = Counter(
        damage_and_repair(body, defect, [number, k, seed])
        for k, body in enumerate(bodies)
        for seed in range(2)
    )
    print(f"{defect}: {dict(found)}")
    if defect in ALWAYS_REPAIRED:
        assert found["refused"] == 0
