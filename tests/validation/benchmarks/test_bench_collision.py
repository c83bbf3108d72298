"""The collision benchmark: whole rows, one answer, and distances of its own."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.collision.surface_detection import EdgeEdgeDetector, VertexFacetDetector
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.tet_mesh import signed_volumes
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.benchmarks import collision
from palpate.validation.benchmarks.collision_answers import (
    edges_within,
    keys_of,
    rows_of,
    vertices_within,
)
from palpate.validation.benchmarks.collision_scene import NUM_FRAMES, Place, make_scene


def test_the_bodies_deform_in_every_step_and_stay_whole():
    scene = make_scene(8, Place.OVERLAPPING)
    assert len(scene.surface_facets) == 12 * 8**2
    assert len(scene.surface_edges) == 3 * len(scene.surface_facets) // 2
    for frames in scene.frames:
        assert frames.shape[0] == NUM_FRAMES
        assert all(np.all(signed_volumes(points, scene.cells) > 0.0) for points in frames)
        for before, after in zip(frames, np.roll(frames, -1, axis=0), strict=True):
            # No rigid motion, nor any other affine one: what is left of the best is of its order.
            matrix = np.column_stack([before, np.ones(len(before))])
            left = after - matrix @ np.linalg.lstsq(matrix, after, rcond=None)[0]
            assert np.linalg.norm(left) > 0.3 * np.linalg.norm(after - before)


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(collision, "BODIES", {864: 6})
    monkeypatch.setattr(collision, "SECONDS", 0.002)
    monkeypatch.setattr(collision, "TIMINGS", 2)
    monkeypatch.setattr(collision, "QUERIES", (collision.IN_CELLS, collision.NEAR_EDGES))
    monkeypatch.setattr(collision, "_METHODS", ("LBVH",))
    monkeypatch.delenv("PALPATE_BENCH_PYTHON", raising=False)


@pytest.mark.usefixtures("small")
def test_rows_are_whole():
    lines = []
    rows = collision.bench_collision(sizes=(864,), progress=lines.append)
    ours = [row for row in rows if row["tool"] == "palpate"]
    # Cells once, edges with and without distances; alone and with self; apart alone.
    assert len(ours) == 3 * 3
    for row in ours:
        assert row["missed"] == 0
        assert row["candidates"] >= row["pairs"]
        assert np.isfinite(row["rate"])
        assert row["phase"] == "candidates" or row["candidates"] == row["pairs"]
        assert (row["pairs"] > 0) == (row["place"] == "overlapping")
    assert len(lines) >= len(rows)
    said = collision.summarise(rows)
    assert len(said) == 6
    assert sum("within the bodies" in line for line in said) == 2


def test_a_pair_left_out_or_made_up_is_seen():
    scene = make_scene(6, Place.OVERLAPPING)
    frames = scene.surface_frames
    body = collision._body(scene, collision.NEAR_FACETS, False)
    detector = VertexFacetDetector(
        *(TriSurface(points[0], scene.surface_facets) for points in frames)
    )
    found = detector.find(scene.distance, frames[0][0], frames[1][0])
    count = frames[0].shape[1]
    pairs = np.column_stack([found.vertices + count, found.facets])
    assert len(pairs) > 2
    rows = [{"tool": "palpate"}, {"tool": "other"}]
    answers = [keys_of(pairs), keys_of(pairs[1:])]
    collision._compare(rows, answers, body, collision.NEAR_FACETS)
    assert [row["missed"] for row in rows] == [0, 1]
    assert [row["pairs"] for row in rows] == [len(pairs), len(pairs) - 1]
    answers = [keys_of(pairs), keys_of(np.vstack([pairs, [[1, 1]]]))]
    collision._compare(rows, answers, body, collision.IN_CELLS)
    assert [row["extra"] for row in rows] == [0, 1]


def test_distances_are_those_of_the_narrow_phase():
    box, ball = shape_box(edge_length=0.25), shape_sphere(0.6, edge_length=0.25)
    there = ball.points + np.array([1.4, 0.5, 0.5])
    vertices = VertexFacetDetector(box, ball)
    candidates = vertices.find_candidates(0.2, box.points, there)
    found = vertices.find(0.2, box.points, there)
    within = vertices_within(there[candidates[:, 0]], box.points[box.facets[candidates[:, 1]]], 0.2)
    expected = np.column_stack([found.vertices, found.facets])
    assert 0 < len(expected) < len(candidates)
    assert np.array_equal(candidates[within], expected)

    edges = EdgeEdgeDetector(box, ball)
    candidates = edges.find_candidates(0.2, box.points, there)
    near = edges.find(0.2, box.points, there)
    within = edges_within(
        there[edges.intruder_edges[candidates[:, 0]]],
        box.points[edges.edges[candidates[:, 1]]],
        0.2,
    )
    expected = np.column_stack([near.first, near.second])
    assert 0 < len(expected) < len(candidates)
    assert np.array_equal(candidates[within], expected)


def test_pairs_keep_their_numbers():
    pairs = np.array([[3, 70_000], [0, 1], [3, 70_000]])
    assert rows_of(keys_of(pairs)).tolist() == [[0, 1], [3, 70_000]]
    assert keys_of(np.zeros((0, 2))).tolist() == []
    assert keys_of(np.array([[5.0], [2.0]])).tolist() == [2, 5]
