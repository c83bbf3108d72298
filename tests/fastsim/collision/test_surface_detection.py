"""Vertices near facets and edges near edges: the hashed sets are those of brute force."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.fastsim import _core
from palpate.fastsim.collision.surface_detection import (
    EdgeEdgeDetector,
    EdgesNearEdges,
    VertexFacetDetector,
    VerticesNearFacets,
    edges_of,
)
from palpate.fastsim.instruction_sets import VARIABLE
from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError, NonFiniteError
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.tri_surface import TriSurface

BOX = shape_box(edge_length=0.25)
BALL = shape_sphere(0.6, edge_length=0.25)
SEEDS = st.integers(0, 2**32 - 1)
Detector = VertexFacetDetector | EdgeEdgeDetector


def soup(rng: np.random.Generator, kind: str) -> TriSurface:
    """Triangles of a kind, not of a body: more than a block of them, on few points to share."""
    points = {
        "random": lambda: rng.uniform(-1.0, 1.0, (70, 3)),
        "coplanar": lambda: rng.integers(-3, 4, (70, 3)) * [0.25, 0.25, 0.0],
        "lattice": lambda: rng.integers(-3, 4, (70, 3)) / 4.0,
        "needles": lambda: rng.uniform(-1.0, 1.0, (70, 3)) * [1e3, 1.0, 1e-3],
        "sizes": lambda: rng.uniform(-1.0, 1.0, (70, 3)) * 10.0 ** rng.uniform(-6, 0, (70, 1)),
        "points": lambda: np.repeat(rng.uniform(-0.1, 0.1, (14, 3)), 5, axis=0),
        "far": lambda: rng.uniform(-1.0, 1.0, (70, 3)) + 1e8,
    }[kind]()
    return TriSurface(points, rng.integers(0, 70, (45, 3)).astype(np.int32))


KINDS = ("random", "coplanar", "lattice", "needles", "sizes", "points", "far")


def require_all(
    detector: Detector, distance: float, here: Points, there: Points | None = None
) -> int:
    """Compare both phases with brute force; return how many pairs there are."""
    candidates = detector.find_candidates(distance, here, there)
    every = detector.find_by_brute_force(distance, here, there, only_candidates=True)
    assert np.array_equal(candidates, _pairs(every))
    found = detector.find(distance, here, there)
    expected = detector.find_by_brute_force(distance, here, there)
    assert np.array_equal(_pairs(found), _pairs(expected))
    assert np.array_equal(found.distances, expected.distances)
    assert {tuple(p) for p in _pairs(expected)} <= {tuple(p) for p in candidates}
    return len(found)


def _pairs(found: VerticesNearFacets | EdgesNearEdges) -> np.ndarray:
    if isinstance(found, VerticesNearFacets):
        return np.column_stack([found.vertices, found.facets])
    return np.column_stack([found.first, found.second])


@pytest.mark.parametrize("make", [VertexFacetDetector, EdgeEdgeDetector])
@settings(max_examples=20, deadline=None)
@given(SEEDS, st.sampled_from(KINDS), st.sampled_from(KINDS))
def test_triangles_of_every_kind(
    make: Callable[..., Detector], seed: int, kind: str, other: str
) -> None:
    rng = np.random.default_rng(seed)
    surface, intruder = soup(rng, kind), soup(rng, other)
    detector = make(surface, intruder)
    alone = make(surface)
    for _ in range(2):
        distance = float(rng.choice([0.0, 0.25, 10.0 ** rng.uniform(-9, 1)]))
        require_all(detector, distance, surface.points, intruder.points)
        require_all(alone, distance, surface.points)
        # Where they were made tells nothing of where they are: other points altogether.
        surface = TriSurface(soup(rng, str(rng.choice(KINDS))).points, surface.facets)


@pytest.mark.parametrize("make", [VertexFacetDetector, EdgeEdgeDetector])
@settings(max_examples=10, deadline=None)
@given(SEEDS)
def test_bodies_that_meet_part_and_deform(make: Callable[..., Detector], seed: int) -> None:
    rng = np.random.default_rng(seed)
    detector = make(BOX, BALL)
    place = np.array([1.9, 0.5, 0.5]) + rng.uniform(-0.1, 0.1, 3)
    counts = []
    for step in range(5):
        there = BALL.points * (1.0 + 0.1 * np.sin(step)) + place
        here = BOX.points + 0.05 * np.sin(5.0 * BOX.points[:, [1, 2, 0]] + step)
        counts.append(require_all(detector, 0.1, here, there))
        place = place - [0.25, 0.0, 0.0]
    assert counts[0] == 0
    assert counts[-1] > 0


@pytest.mark.parametrize("make", [VertexFacetDetector, EdgeEdgeDetector])
@settings(max_examples=10, deadline=None)
@given(SEEDS)
def test_boxes_that_touch_on_one_lattice(make: Callable[..., Detector], seed: int) -> None:
    # Sides, edges and corners of elements on each other, and on borders of voxels.
    rng = np.random.default_rng(seed)
    detector = make(BOX, BOX_COPY)
    shift = rng.integers(-4, 5, 3) / 4.0
    for distance in (0.0, 0.25):
        require_all(detector, distance, BOX.points, BOX.points + shift)
    beside = BOX.points + np.array([1.0, 0.0, 0.0])
    assert require_all(detector, 0.0, BOX.points, beside) > 0


BOX_COPY = TriSurface(BOX.points, BOX.facets)


@pytest.mark.parametrize("make", [VertexFacetDetector, EdgeEdgeDetector])
def test_a_sheet_folded_onto_itself(make: Callable[..., Detector]) -> None:
    box = shape_box((4.0, 1.0, 0.25), edge_length=0.25)
    detector = make(box)
    # Flat: the nearest without a common point are diagonals about a corner, 0.25 / sqrt(6) apart.
    assert require_all(detector, 0.1, box.points) == 0
    assert require_all(detector, 0.18, box.points) > 0
    seen = 0
    for turn in (1.0, 2.0, 3.0, 3.3):
        far = np.clip(box.points[:, 0] - 2.0, 0.0, None)
        points = np.array(box.points)
        points[:, 0] = np.minimum(points[:, 0], 2.0) + far * np.cos(turn)
        points[:, 2] += far * np.sin(turn)
        seen += require_all(detector, 0.05, points)
    assert seen > 0


def test_distances_and_nearest_points_agree_with_a_dense_sampling() -> None:
    rng = np.random.default_rng(3)
    surface, intruder = soup(rng, "random"), soup(rng, "random")
    t = np.linspace(0.0, 1.0, 41)
    faces = VertexFacetDetector(surface, intruder).find(2.0, surface.points, intruder.points)
    corners = surface.points[surface.facets[faces.facets]]
    nearest = np.einsum("ik,ikx->ix", faces.weights, corners)
    gap = np.linalg.norm(nearest - intruder.points[faces.vertices], axis=1)
    assert gap == pytest.approx(faces.distances, abs=1e-14)
    assert np.all(faces.weights >= 0.0)
    assert faces.weights.sum(axis=1) == pytest.approx(1.0, abs=1e-15)
    grid = np.array([(1 - a - b, a, b) for a in t for b in t if a + b <= 1.0 + 1e-9])
    for k in range(0, len(faces), 17):
        samples = grid @ corners[k]
        best = np.linalg.norm(samples - intruder.points[faces.vertices[k]], axis=1).min()
        assert faces.distances[k] <= best + 1e-12
        # Samples are a fortieth of a side apart.
        assert best <= faces.distances[k] + 0.025 * 2.0 * np.sqrt(12.0)

    detector = EdgeEdgeDetector(surface, intruder)
    edges = detector.find(2.0, surface.points, intruder.points)
    a = intruder.points[detector.intruder_edges[edges.first]]
    b = surface.points[detector.edges[edges.second]]
    s, r = edges.parameters[:, :1], edges.parameters[:, 1:]
    on_a, on_b = (1 - s) * a[:, 0] + s * a[:, 1], (1 - r) * b[:, 0] + r * b[:, 1]
    assert np.linalg.norm(on_a - on_b, axis=1) == pytest.approx(edges.distances, abs=1e-14)
    for k in range(0, len(edges), 17):
        line = (1 - t)[:, None] * a[k, 0] + t[:, None] * a[k, 1]
        other = (1 - t)[:, None] * b[k, 0] + t[:, None] * b[k, 1]
        best = np.linalg.norm(line[:, None] - other[None], axis=2).min()
        assert edges.distances[k] <= best + 1e-12
        assert best <= edges.distances[k] + 0.025 * 2.0 * np.sqrt(12.0)


def test_edges_are_each_given_once() -> None:
    edges = edges_of(BOX)
    # Euler: a closed surface of genus 0 has 3/2 as many edges as facets.
    assert len(edges) == 3 * BOX.num_facets // 2
    assert np.all(edges[:, 0] < edges[:, 1])


@pytest.mark.parametrize("make", [VertexFacetDetector, EdgeEdgeDetector])
def test_refusals(make: Callable[..., Detector]) -> None:
    detector = make(BOX, BALL)
    for distance in (-0.1, np.nan, np.inf):
        with pytest.raises(InputError, match="distance"):
            detector.find(distance, BOX.points, BALL.points)
    with pytest.raises(InputError, match="shape"):
        detector.find(0.1, BOX.points[1:], BALL.points)
    with pytest.raises(InputError, match="intruder"):
        detector.find(0.1, BOX.points)
    with pytest.raises(InputError, match="one table"):
        make(BOX).find(0.1, BOX.points, BOX.points)
    for value in (np.nan, np.inf):
        for find in (detector.find, detector.find_candidates, detector.find_by_brute_force):
            bad = np.array(BALL.points)
            bad[4, 0] = value
            with pytest.raises(NonFiniteError) as caught:
                find(0.1, BOX.points, bad)
            assert caught.value.points == [4]
            bad = np.array(BOX.points)
            bad[-1, 0] = value
            with pytest.raises(NonFiniteError) as caught:
                find(0.1, bad, BALL.points)
            assert caught.value.points == [len(bad) - 1]


@pytest.mark.parametrize("make", [VertexFacetDetector, EdgeEdgeDetector])
@pytest.mark.parametrize("shift", [1e9, 1e15, -1e300])
def test_far_from_the_origin(make: Callable[..., Detector], shift: float) -> None:
    # At 1e15 m coordinates are eighths, and at 1e300 m each body is a point.
    box, ball = shape_box(edge_length=0.5), shape_sphere(0.6, edge_length=0.4)
    detector = make(box, ball)
    there = ball.points + np.array([1.5, 0.5, 0.5])
    count = require_all(detector, 0.1, box.points + shift, there + shift)
    assert (count > 0) or abs(shift) > 1e15
    # One of them far away, and a body torn to where voxels cannot be counted.
    assert require_all(detector, 0.1, box.points, there + shift) == 0
    torn = np.array(box.points)
    torn[::3] *= shift
    require_all(detector, 0.1, torn, there)
    require_all(make(box), 0.1, torn)


SETS = list(_core.InstructionSet)
AVAILABLE = SETS[: SETS.index(_core.widest_instruction_set()) + 1]


@pytest.mark.parametrize("num_threads", [1, 2, 5])
@pytest.mark.parametrize("name", [known.name for known in AVAILABLE])
def test_threads_and_instruction_sets_change_nothing(
    name: str, num_threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, name)
    fine = shape_sphere(0.6, edge_length=0.15)
    there = fine.points + np.array([1.4, 0.5, 0.5])
    for make in (VertexFacetDetector, EdgeEdgeDetector):
        apart = make(fine, num_threads=num_threads)
        between = make(BOX, fine, num_threads=num_threads)
        for step in range(3):
            assert require_all(apart, 0.18, fine.points * (1.0 + 0.1 * step)) > 0
            assert require_all(between, 0.1, BOX.points, there - 0.02 * step) > 0


def test_no_threads_are_refused() -> None:
    for make in (VertexFacetDetector, EdgeEdgeDetector):
        with pytest.raises(InputError, match="num_threads"):
            make(BOX, num_threads=0)
