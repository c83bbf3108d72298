"""The collision benchmark: whole rows, one answer, and distances of its own."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.collision.detection import VertexCellDetector
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.benchmarks import collision
from palpate.validation.benchmarks.collision import keys_of, vertices_of
from palpate.validation.benchmarks.collision_scene import NUM_FRAMES, Place, make_scene


def test_the_bodies_deform_in_every_step_and_stay_whole():
    scene = make_scene(8, Place.OVERLAPPING)
    assert len(scene.facets) == 12 * 8**2
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
    monkeypatch.delenv("PALPATE_BENCH_PYTHON", raising=False)


@pytest.mark.usefixtures("small")
def test_rows_are_whole():
    lines = []
    rows = collision.bench_collision(sizes=(864,), progress=lines.append)
    ours = [row for row in rows if row["tool"] == "palpate"]
    # Overlapping, alone and with self; apart alone.
    assert len(ours) == 3
    for row in ours:
        assert row["missed"] == row["extra"] == 0
        assert np.isfinite(row["rate"])
        assert (row["pairs"] > 0) == (row["place"] == "overlapping")
    assert len(lines) >= len(rows)
    said = collision.summarise(rows)
    assert len(said) == 3
    assert sum("within the bodies" in line for line in said) == 1


def test_a_pair_left_out_or_made_up_is_seen():
    scene = make_scene(6, Place.OVERLAPPING)
    here, there = (frames[0] for frames in scene.frames)
    found = VertexCellDetector(TetMesh(here, scene.cells), TetMesh(there, scene.cells)).find(
        here, there
    )
    pairs = np.column_stack([found.vertices, found.cells])
    assert len(pairs) > 2
    rows = [{"tool": "palpate"}, {"tool": "other"}, {"tool": "trimesh embree"}]
    made_up = np.vstack([pairs[1:], [[1, 1]]])
    answers = [keys_of(pairs), keys_of(made_up), np.unique(pairs[:, 0])]
    collision._compare(rows, answers)
    assert [row["missed"] for row in rows] == [0, 1, 0]
    assert [row["extra"] for row in rows] == [0, 1, 0]
    assert [row["pairs"] for row in rows] == [
        len(pairs), len(pairs) - 1, len(np.unique(found.vertices)),
    ]  # fmt: skip


def test_pairs_keep_their_numbers():
    pairs = np.array([[3, 70_000], [0, 1], [3, 70_000]])
    assert keys_of(pairs).tolist() == [1, (3 << 32) + 70_000]
    assert vertices_of(keys_of(pairs)).tolist() == [0, 3]
    assert keys_of(np.zeros((0, 2))).tolist() == []
    assert keys_of(np.array([[5.0], [2.0]])).tolist() == [2, 5]
