"""Metrics against closed forms, and verdicts that never pass by accident."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.meshes import field_norms
from palpate.meshes.field_norms import l2_norm, l2_norms
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.refinement import refine_uniformly
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation import metrics
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.checks import decide, judge_check
from palpate.validation.states import State, Verdict, gravest

MESH = refine_uniformly(TetMesh(np.vstack([np.zeros(3), np.eye(3)]), [[0, 1, 2, 3]]))
PROBLEM = Problem(MESH, Material(1000.0, 0.3), (), ())


def state(displacement: np.ndarray) -> State:  # type: ignore[type-arg]
    return metrics.make_state(MESH, displacement, label="x", simulator="x", strain=Strain.GREEN)


def test_l2_norm_of_a_linear_field_is_exact() -> None:
    # Integral of x^2 over the unit corner tetrahedron: 2! / 5! = 1/60.
    field = MESH.points * [1.0, 0.0, 0.0]
    assert l2_norm(MESH, field) == pytest.approx(math.sqrt(1.0 / 60.0), rel=1e-14)
    # Constant: sqrt of the volume.
    ones = np.tile([0.0, 2.0, 0.0], (MESH.num_points, 1))
    assert l2_norm(MESH, ones) == pytest.approx(2.0 * math.sqrt(1.0 / 6.0), rel=1e-14)


def test_the_fields_of_a_motion_have_the_norms_of_each(monkeypatch: pytest.MonkeyPatch) -> None:
    fields = np.random.default_rng(3).normal(size=(7, MESH.num_points, 3))
    expected = [l2_norm(MESH, field) for field in fields]
    for at_once in (1, 3, 100):
        monkeypatch.setattr(field_norms, "_AT_ONCE", at_once * MESH.num_cells)
        assert l2_norms(MESH, fields) == pytest.approx(expected, rel=1e-14)


def test_a_uniform_stretch_has_its_volume_area_and_det_f() -> None:
    stretched = state(0.1 * MESH.points)
    assert stretched.volume == pytest.approx(1.1**3 * MESH.volume, rel=1e-14)
    assert stretched.surface_area == pytest.approx(1.1**2 * MESH.surface_area, rel=1e-14)
    assert stretched.smallest_det_f == pytest.approx(1.1**3, rel=1e-14)
    assert stretched.max_displacement == pytest.approx(0.1, rel=1e-14)


def test_errors_of_a_candidate_two_per_cent_too_large() -> None:
    reference, candidate = state(0.1 * MESH.points), state(0.102 * MESH.points)
    errors = {
        "displacement_l2": 0.02,
        "displacement_max": 0.02,
        "max_displacement": 0.02,
        # Scaled by the change of volume, not by the volume.
        "volume": (1.102**3 - 1.1**3) / (1.1**3 - 1.0),
        "surface_area": (1.102**2 - 1.1**2) / (1.1**2 - 1.0),
    }
    assert set(errors) == set(metrics.WHOLE_BODY_METRICS)
    for name, expected in errors.items():
        found = metrics.measure(name, PROBLEM, candidate, reference)
        assert found.value == pytest.approx(expected)


def test_where_nothing_changes_the_scale_is_part_of_the_rest_value() -> None:
    rest = state(np.zeros_like(MESH.points))
    candidate = state(1e-4 * MESH.points)
    difference = metrics.measure("volume", PROBLEM, candidate, rest)
    assert difference.value == pytest.approx((1.0001**3 - 1.0) / 1e-3, rel=1e-9)
    assert "rest volume" in difference.scale_name
    assert metrics.measure("displacement_l2", PROBLEM, candidate, rest).value == math.inf
    assert metrics.measure("displacement_l2", PROBLEM, rest, rest).value == 0.0


@pytest.mark.parametrize("metric", ["volume", "surface_area"])
def test_the_scale_of_a_change_says_what_it_is(metric: str) -> None:
    # 10 % longer all round: 33.1 % of the volume, 21 % of the area; a millionth: below 0.1 %.
    word = "volume" if metric == "volume" else "area"
    for stretch, name in (
        (0.1, f"change of {word} of the reference"),
        (1e-6, f"0.1 % of the rest {word}"),
    ):
        reference, candidate = state(stretch * MESH.points), state(0.5 * stretch * MESH.points)
        assert metrics.measure(metric, PROBLEM, candidate, reference).scale_name == name


@pytest.mark.parametrize(
    ("error", "bar", "limit", "verdict"),
    [
        (0.01, 0.0, 0.02, Verdict.PASSED),
        (0.01, 0.01, 0.02, Verdict.PASSED),
        (0.01, 0.011, 0.02, Verdict.INCONCLUSIVE),
        (0.03, 0.011, 0.02, Verdict.INCONCLUSIVE),
        (0.03, 0.009, 0.02, Verdict.FAILED),
        (0.0, math.inf, 0.02, Verdict.INCONCLUSIVE),
        (0.0, math.nan, 0.02, Verdict.INCONCLUSIVE),
        (math.nan, 0.0, 0.02, Verdict.FAILED),
        (math.inf, math.inf, 0.02, Verdict.FAILED),
    ],
)
def test_verdicts(error: float, bar: float, limit: float, verdict: Verdict) -> None:
    assert decide(error, bar, limit) is verdict


def test_a_worse_reference_never_makes_passing_easier() -> None:
    order = [Verdict.PASSED, Verdict.INCONCLUSIVE]
    for error in (0.0, 0.01, 0.02, 0.05):
        verdicts = [decide(error, bar, 0.02) for bar in (0.0, 0.005, 0.01, 0.05, math.inf)]
        if verdicts[0] is Verdict.PASSED:
            assert [order.index(v) for v in verdicts] == sorted(order.index(v) for v in verdicts)
        else:
            assert Verdict.PASSED not in verdicts


def test_missing_states_never_pass() -> None:
    spec = CheckSpec(metric="volume", limit=1e9, reason="r")
    good = state(0.1 * MESH.points)
    no_candidate = judge_check(spec, Strain.GREEN, PROBLEM, None, good, 0.0, "it crashed")
    assert (no_candidate.verdict, no_candidate.message) == (Verdict.FAILED, "it crashed")
    no_reference = judge_check(spec, Strain.GREEN, PROBLEM, good, None, 0.0, "")
    assert no_reference.verdict is Verdict.INCONCLUSIVE
    assert gravest([]) is Verdict.INCONCLUSIVE
    own = CheckSpec(metric="smallest_det_f", against="candidate", limit=0.0, reason="r")
    inverted = state(-2.0 * MESH.points * [1.0, 0.0, 0.0])
    assert (
        judge_check(own, Strain.GREEN, PROBLEM, inverted, None, 0.0, "").verdict is Verdict.FAILED
    )
    assert judge_check(own, Strain.GREEN, PROBLEM, good, None, 0.0, "").verdict is Verdict.PASSED
