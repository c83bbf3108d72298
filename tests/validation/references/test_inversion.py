"""A truth whose meshes go towards an inverted cell at a corner has no bar there, and says why."""

from __future__ import annotations

import copy
import dataclasses
import math

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.problem import Material, Problem, Strain
from palpate.reference.adaptivity.goals import Budget, Goal, Quantity
from palpate.reference.availability import is_available
from palpate.reference.result import LOST, Formulation
from palpate.validation.case import load_case
from palpate.validation.judging.checks import CaseJudge
from palpate.validation.references.adaptive_truth import ADAPTIVE, why_without_limit
from palpate.validation.references.bars import PARTS
from palpate.validation.references.soundness import find_contradictions
from palpate.validation.references.stored import load_stored
from palpate.validation.states import Verdict

if is_available():
    from palpate.reference.adaptivity.adaptive import solve_adaptively

# Of Cook's membrane of Saint-Venant-Kirchhoff, as the last test finds it.
FALLING = [0.794, 0.766, 0.715]
GREEN = Strain.GREEN


def with_record(references, **changes):
    """The file with another record of its Green truth."""
    records = copy.deepcopy(references.provenance[ADAPTIVE])
    records["green"] |= changes
    return dataclasses.replace(references, provenance={**references.provenance, ADAPTIVE: records})


@pytest.fixture(name="block")
def stored_block():
    case = load_case("block")
    return case, load_stored("block", case.problem)


def test_a_finite_bar_beside_a_falling_det_f_is_refused(block):
    case, references = block
    assert find_contradictions(case.problem, references) == []
    wrong = find_contradictions(case.problem, with_record(references, smallest_det_f=FALLING))
    names = {line.split(",")[0].removeprefix("error bar of ") for line in wrong}
    # What is of the whole body has its limit.
    assert names == {"surface_area", "displacement_max", "max_displacement"}


@pytest.mark.parametrize(
    "harmless", [[0.95, 0.94, 0.93], [0.794, 0.715], "none", [0.8, "0.7", 0.5], None]
)
def test_a_record_without_a_trend_takes_no_bar(block, harmless):
    case, references = block
    spoiled = with_record(references, smallest_det_f=harmless)
    assert find_contradictions(case.problem, spoiled) == []


def test_only_a_law_that_softens_at_finite_strain_inverts(block):
    problem, record = block[0].problem, {"smallest_det_f": FALLING}
    assert "0.794, 0.766, 0.715" in why_without_limit(record, problem, GREEN, "surface_area")
    assert why_without_limit(record, problem, GREEN, "stress_l2@123")
    for metric, strain in (("volume", GREEN), ("surface_area", Strain.LINEAR), ("no_name", GREEN)):
        assert why_without_limit(record, problem, strain, metric) == ""
    material = dataclasses.replace(problem.material, law="neo-hookean")
    harder = dataclasses.replace(problem, material=material)
    assert why_without_limit(record, harder, GREEN, "surface_area") == ""


@pytest.mark.parametrize(
    ("record", "reason"),
    [
        ({"smallest_det_f": FALLING}, "smallest det F falls with every mesh"),
        ({"ended": f"{LOST}, 900 cells: a cell would invert"}, "900 cells: a cell would invert"),
    ],
)
def test_a_check_that_has_no_bar_for_it_says_so(block, record, reason):
    case, references = block
    key = ("displacement_max", GREEN)
    spec = next(s for s in case.checks if s.metric == key[0])
    spec = spec.model_copy(update={"against": "truth", "limit": 1.0})
    truth = references.truth(GREEN)
    assert CaseJudge(case, references).check(spec, truth).verdict is Verdict.PASSED
    # A truth that is made anew records the parts of its bars as they are.
    provenance = {**references.provenance, PARTS: {}}
    bars = {**references.bars, key: math.inf}
    lost = dataclasses.replace(references, bars=bars, provenance=provenance)
    found = CaseJudge(case, with_record(lost, **record)).check(spec, truth)
    assert found.verdict is Verdict.INCONCLUSIVE
    assert reason in found.message
    # Without such a record nobody knows why.
    assert reason not in CaseJudge(case, lost).check(spec, truth).message


@pytest.mark.dolfinx
@pytest.mark.nightly
def test_the_area_of_cooks_membrane_under_a_large_load_has_no_bar():
    """At 1.7 times this load the next mesh has no equilibrium: "a cell would invert"."""
    mesh = brick_box((4, 4, 1), (1.0, 1.0, 8.0))
    x, y, z = mesh.points.T
    tapered = np.column_stack([48.0 * x, 44.0 * x + y * (44.0 - 28.0 * x), z])
    clamp, end = side(mesh, 0, 0.0), side(mesh, 0, 1.0)
    problem = Problem(
        dataclasses.replace(mesh, points=tapered),
        Material(1.0, 0.49),
        (support_of(clamp),),
        (Traction(end, (0.0, 0.06, 0.0)),),
    )
    names = ("displacement_l2", "displacement_max", "max_displacement", "volume", "surface_area",
             "strain_energy")  # fmt: skip
    goals = [Goal(Quantity(name), 1e-3) for name in names]
    found = solve_adaptively(
        problem, goals, budget=Budget(unknowns=50_000.0), formulation=Formulation.MIXED
    )
    assert len(found.num_cells) == len(found.smallest_det_fs) == 4
    assert found.smallest_det_fs[-1] == found.smallest_det_f
    assert np.all(np.diff(found.smallest_det_fs[-3:]) < 0.0)
    # The area changed by 13 % of its change between meshes 2 and 3; its bar was 0.4, now there is
    # none.
    without = {name for name in names if math.isinf(found.bar(name))}
    assert without == {"displacement_max", "max_displacement", "surface_area"}
