"""Hashed detection gives exactly what brute force gives, whatever moves and however it lies."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.fastsim.contact.body_contact import Overlaps, VertexCellDetector
from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.errors import InputError, NonFiniteError
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.tet_mesh import TetMesh

BOX = mesh_surface(shape_box(edge_length=0.5))
BALL = mesh_surface(shape_sphere(0.6, edge_length=0.3))


def graded_box() -> TetMesh:
    graded = GradedMesh(BOX)
    for k in range(9):
        middle = graded.points[graded.cells].mean(axis=1)
        graded.refine(np.linalg.norm(middle - 1.0, axis=1) < 0.8 * 0.8**k)
    return graded.mesh


GRADED = graded_box()


def require_equal(found: Overlaps, expected: Overlaps) -> None:
    assert np.array_equal(found.vertices, expected.vertices)
    assert np.array_equal(found.cells, expected.cells)
    assert np.array_equal(found.weights, expected.weights)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["box", "graded"]))
def test_moving_bodies_step_by_step(seed: int, name: str) -> None:
    rng = np.random.default_rng(seed)
    body = {"box": BOX, "graded": GRADED}[name]
    detector = VertexCellDetector(body, BALL)
    position, speed = rng.uniform(-0.5, 1.5, 3), rng.uniform(-0.3, 0.3, 3)
    for _ in range(6):
        position = position + speed
        squeeze = 1.0 + rng.uniform(-0.3, 0.3, 3)
        there = BALL.points * squeeze + position
        here = body.points + 0.05 * rng.standard_normal(3) + 0.02 * np.sin(7.0 * body.points)
        require_equal(detector.find(here, there), detector.find_by_brute_force(here, there))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_points_on_voxel_borders_corners_sides_and_planes(seed: int) -> None:
    # Both boxes on one grid of eighths: everything touches, and lies on borders of voxels.
    rng = np.random.default_rng(seed)
    detector = VertexCellDetector(BOX, BOX_COPY)
    for _ in range(4):
        there = BOX.points + rng.integers(-8, 9, 3) / 8.0
        here = BOX.points - rng.integers(-8, 9, 3) / 8.0 * rng.integers(2)
        found = detector.find(here, there)
        require_equal(found, detector.find_by_brute_force(here, there))
        assert np.all(found.weights >= 0.0)
        assert found.weights.sum(axis=1) == pytest.approx(1.0, abs=1e-15)
        corners = here[BOX.cells[found.cells]]
        assert np.einsum("ik,ikx->ix", found.weights, corners) == pytest.approx(
            there[found.vertices], abs=1e-14
        )


BOX_COPY = TetMesh(BOX.points, BOX.cells)


def test_one_body_wholly_within_another_is_found_entirely() -> None:
    inside = BALL.points * 0.3 + 0.5
    detector = VertexCellDetector(BOX, BALL)
    found = detector.find(BOX.points, inside)
    assert set(found.vertices.tolist()) == set(np.unique(BALL.boundary_facets).tolist())
    assert len(detector.find(BOX.points, BALL.points + 5.0)) == 0


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_bar_folded_onto_itself(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bar = mesh_surface(shape_box((6.0, 1.0, 0.5), edge_length=0.5))
    detector = VertexCellDetector(bar)
    assert len(detector.find(np.array(bar.points))) == 0
    seen = 0
    for turn in np.linspace(0.5, 4.0, 5) + rng.uniform(-0.1, 0.1):
        # The far half swings round the middle, at last into the near half.
        far = np.clip(bar.points[:, 0] - 3.0, 0.0, None)
        angle = turn * np.clip(far / 0.5, 0.0, 1.0)
        points = np.array(bar.points)
        points[:, 0] = np.minimum(bar.points[:, 0], 3.0) + far * np.cos(angle)
        points[:, 2] += far * np.sin(angle)
        found = detector.find(points)
        require_equal(found, detector.find_by_brute_force(points))
        corners = bar.cells[found.cells]
        assert not (corners == found.vertices[:, None]).any()
        seen += len(found)
    assert seen > 0


def test_inverted_and_flat_cells_hold_nothing() -> None:
    detector = VertexCellDetector(BOX, BALL)
    for scale in ([1.0, 1.0, -1.0], [1.0, 1.0, 0.0]):
        here = BOX.points * scale
        assert len(detector.find(here, BALL.points * 0.3 + here.mean(axis=0))) == 0


def test_a_cell_torn_far_out_is_still_looked_at() -> None:
    detector = VertexCellDetector(GRADED, BALL)
    here = np.array(GRADED.points)
    here[0] += 500.0
    there = BALL.points + here[0] * 0.5
    require_equal(detector.find(here, there), detector.find_by_brute_force(here, there))


def test_voxels_fit_the_cells_and_only_what_is_near_is_hashed() -> None:
    assert len(VertexCellDetector(BOX, BALL).voxel_sizes) == 1
    detector = VertexCellDetector(GRADED, BALL)
    sizes = detector.voxel_sizes
    assert len(sizes) > 2
    assert max(sizes) / min(sizes) >= 4.0
    num_vertices = len(np.unique(BALL.boundary_facets))
    detector.find(GRADED.points, BALL.points * 0.3 + 0.5)
    assert num_vertices <= detector.work["hashed"] <= num_vertices * len(sizes)
    assert detector.work["cells_near"] > 0
    detector.find(GRADED.points, BALL.points + np.array([1.4, 0.5, 0.5]))
    assert 0 < detector.work["hashed"] < num_vertices
    detector.find(GRADED.points, BALL.points + 5.0)
    assert detector.work == {"hashed": 0, "cells_near": 0, "pairs_tested": 0}


@pytest.mark.parametrize("shift", [1e3, 1e9, 1e15, 1e300])
def test_far_from_the_origin(shift: float) -> None:
    # At 1e15 m coordinates are eighths, and at 1e300 m both bodies are points.
    detector = VertexCellDetector(BOX, BALL)
    here, there = BOX.points + shift, BALL.points * 0.5 + 0.4 + shift
    found = detector.find(here, there)
    require_equal(found, detector.find_by_brute_force(here, there))
    assert (len(found) > 0) == (shift <= 1e15)
    # One of them far away: whatever the voxels, nothing overlaps.
    assert len(detector.find(BOX.points, there)) == 0
    torn = np.array(BOX.points)
    torn[::3] *= shift
    require_equal(detector.find(torn, BALL.points), detector.find_by_brute_force(torn, BALL.points))


def test_refusals() -> None:
    detector = VertexCellDetector(BOX, BALL)
    with pytest.raises(InputError, match="shape"):
        detector.find(BOX.points[1:], BALL.points)
    with pytest.raises(InputError, match="intruder"):
        detector.find(BOX.points)
    vertex = int(np.unique(BALL.boundary_facets)[3])
    for value in (np.nan, np.inf, -np.inf):
        bad = np.array(BALL.points)
        bad[vertex, 1] = value
        with pytest.raises(NonFiniteError) as caught:
            detector.find(BOX.points, bad)
        assert caught.value.points == [vertex]
        for point in (0, 1, BOX.num_points - 1):
            bad = np.array(BOX.points)
            bad[point, 2] = value
            with pytest.raises(NonFiniteError) as caught:
                detector.find(bad, BALL.points)
            assert caught.value.points == [point]
    with pytest.raises(InputError, match="num_threads"):
        VertexCellDetector(BOX, num_threads=0)


@pytest.mark.parametrize("num_threads", [2, 5])
def test_threads_change_nothing(num_threads: int) -> None:
    detector = VertexCellDetector(GRADED, BALL, num_threads=num_threads)
    alone = VertexCellDetector(GRADED, BALL)
    for shift in (0.0, 0.3, 0.6, 3.0):
        found = detector.find(GRADED.points, BALL.points + shift)
        require_equal(found, alone.find(GRADED.points, BALL.points + shift))
        assert detector.work == alone.work
