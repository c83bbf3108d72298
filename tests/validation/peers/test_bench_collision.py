"""The collision benchmark: whole rows, and one answer."""

from __future__ import annotations

import dataclasses

import numpy as np

from palpate.fastsim.contact.body_contact import VertexCellDetector
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.peers import bench_collision as collision
from palpate.validation.peers.bench import summarise, time_all
from palpate.validation.peers.bench_collision import (
    NUM_FRAMES,
    Place,
    keys_of,
    make_bodies,
    vertices_of,
)


def test_the_bodies_deform_in_every_step_and_stay_whole():
    bodies = make_bodies(8, Place.OVERLAPPING)
    assert len(bodies["facets"]) == 12 * 8**2
    for frames in bodies["frames"]:
        assert frames.shape[0] == NUM_FRAMES
        assert all(np.all(signed_volumes(points, bodies["cells"]) > 0.0) for points in frames)
        for before, after in zip(frames, np.roll(frames, -1, axis=0), strict=True):
            # No rigid motion, nor any other affine one: what is left of the best is of its order.
            matrix = np.column_stack([before, np.ones(len(before))])
            left = after - matrix @ np.linalg.lstsq(matrix, after, rcond=None)[0]
            assert np.linalg.norm(left) > 0.3 * np.linalg.norm(after - before)


def test_rows_are_whole(monkeypatch):
    monkeypatch.setattr(collision, "BODIES", {864: 6})
    monkeypatch.delenv("PALPATE_BENCH_PYTHON", raising=False)
    benchmark = dataclasses.replace(
        collision.BENCHMARK,
        schedule=dataclasses.replace(collision.BENCHMARK.schedule, turns=2, seconds=0.002),
    )
    lines = []
    rows = time_all(benchmark, (864,), lines.append)
    ours = [row for row in rows if row["tool"] == "palpate"]
    # Overlapping, alone and with self; apart alone.
    assert len(ours) == 3
    for row in ours:
        assert row["missed"] == row["extra"] == 0
        assert np.isfinite(row["rate"])
        assert (row["pairs"] > 0) == (row["place"] == "overlapping")
    assert ours[1]["seconds_within"] == ours[1]["seconds"] - ours[0]["seconds"]
    assert len(lines) >= len(rows)
    said = summarise(benchmark, rows)
    assert len(said) == 3
    assert sum("within the bodies" in line for line in said) == 1


def test_a_pair_left_out_or_made_up_is_seen():
    bodies = make_bodies(6, Place.OVERLAPPING)
    here, there = (TetMesh(frames[0], bodies["cells"]) for frames in bodies["frames"])
    found = VertexCellDetector(here, there).find(here.points, there.points)
    pairs = np.column_stack([found.vertices, found.cells])
    assert len(pairs) > 2
    rows = [{"tool": "palpate"}, {"tool": "other"}, {"tool": "trimesh embree"}]
    made_up = np.vstack([pairs[1:], [[1, 1]]])
    collision.compare(rows, [pairs, made_up, pairs[:, :1]])
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
