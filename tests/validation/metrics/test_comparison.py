"""Metrics and distances of surfaces by closed forms; verdicts that never pass by accident."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bank import made_state

from palpate.meshes import field_norms
from palpate.meshes.bricks import brick_box
from palpate.meshes.field_norms import l2_norm, l2_norms
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.refinement import refine_uniformly
from palpate.meshes.shapes import shape_sphere
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation import metrics
from palpate.validation.case.schema import CheckSpec
from palpate.validation.exchange.point_location import nearest_on_surface
from palpate.validation.judging.checks import decide, judge_check
from palpate.validation.metrics.comparison import _stride, surface_distances
from palpate.validation.states import State, Verdict, gravest

MESH = refine_uniformly(TetMesh(np.vstack([np.zeros(3), np.eye(3)]), [[0, 1, 2, 3]]))
PROBLEM = Problem(MESH, Material(1000.0, 0.3), (), ())


def state(displacement: np.ndarray) -> State:  # type: ignore[type-arg]
    return made_state(MESH, displacement)


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


TRIANGLE = (np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]], dtype=np.int32))


@pytest.mark.parametrize(
    ("position", "distance"),
    [
        ([0.2, 0.2, 0.7], 0.7),  # above the inside
        ([-3.0, -4.0, 0.0], 5.0),  # beyond a corner
        ([0.5, -2.0, 0.0], 2.0),  # beyond an edge
        ([1.0, 1.0, 0.0], np.sqrt(0.5)),  # beyond the slanted edge
        ([0.25, 0.25, 0.0], 0.0),
    ],
)
def test_distance_to_one_triangle(position: list[float], distance: float) -> None:
    found = nearest_on_surface(np.array([position]), *TRIANGLE).distances
    assert found[0] == pytest.approx(distance, abs=1e-12)


def test_concentric_spheres_are_apart_by_the_difference_of_radii() -> None:
    sphere = shape_sphere(1.0, edge_length=0.2)
    hausdorff, mean = surface_distances(
        sphere.points, sphere.facets, 1.1 * sphere.points, sphere.facets
    )
    # Facets cut inside the sphere by at most edge^2 / (8 R) = 0.005 (edges up to 0.25).
    assert hausdorff == pytest.approx(0.1, abs=0.01)
    assert mean == pytest.approx(0.1, abs=0.01)


def test_the_search_finds_what_brute_force_finds() -> None:
    rng = np.random.default_rng(2)
    sphere = shape_sphere(1.0, edge_length=0.4)
    points = sphere.points + 5.0
    positions = rng.uniform(3.5, 6.5, (300, 3))
    found = nearest_on_surface(positions, points, sphere.facets).distances
    one_by_one = [
        nearest_on_surface(positions, points, facet[None]).distances for facet in sphere.facets
    ]
    np.testing.assert_allclose(found, np.min(one_by_one, axis=0), rtol=1e-12)


@pytest.mark.parametrize("size", [1e-9, 0.05, 2.0])
def test_what_is_known_of_one_body_in_two_states_changes_no_distance(size: float) -> None:
    sphere = shape_sphere(1.0, edge_length=0.3)
    random = np.random.default_rng(4)
    moved = sphere.points + size * random.standard_normal(sphere.points.shape)
    known = surface_distances(sphere.points, sphere.facets, moved, sphere.facets)
    # Facets that are not the very same say nothing of which place belongs to which.
    assert known == surface_distances(sphere.points, sphere.facets, moved, sphere.facets.copy())


def test_a_shifted_box_is_off_by_the_shift_and_sliding_is_seen_at_the_ends_only() -> None:
    mesh = brick_box((4, 2, 2), (2.0, 1.0, 1.0))
    problem = Problem(mesh, Material(1.0, 0.3), (), ())

    candidate, reference = (
        made_state(mesh, np.tile([x, 0.0, 0.0], (mesh.num_points, 1))) for x in (0.11, 0.10)
    )
    hausdorff = metrics.measure("surface_hausdorff", problem, candidate, reference)
    assert hausdorff.value == pytest.approx(0.1, rel=1e-9)  # 0.01 of a largest displacement of 0.1
    mean = metrics.measure("surface_mean_distance", problem, candidate, reference)
    # The two ends, 2 of 10 areas, are 0.01 off; of the sides only what sticks out.
    assert 0.02 < mean.value < 0.03


@pytest.mark.parametrize("shift", [0.0, 50.0])
@pytest.mark.parametrize(("larger", "stride"), [(1.0, 1), (2.0, 1), (6.0, 9), (100.0, 4)])
def test_facets_are_left_out_towards_a_surface_torn_much_larger(
    larger: float, stride: int, shift: float
) -> None:
    """Every (larger / 2)^2-th, but never fewer than 64 of them; wherever the surfaces are."""
    facet = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    number = 64 * 9 if larger < 50.0 else 64 * 4
    facets = np.tile(np.arange(3), (number, 1))
    away = shift * np.array([1.0, 0.0, 0.0])
    pair = (facet + away, facets, larger * facet + away, facets)
    assert _stride(pair) == stride
