"""`palpate bench collision`: vertices found in cells, ours beside collision libraries.

Two bodies deform in every step, and touch each other and themselves. All tools get the same points
and the same query: in which cells of the other body vertices lie. In every step trees are refitted
(Warp) or built anew (Embree), and our hash is filled anew. A timing covers all frames.

Rows have against (other, or other and self), place (overlapping or apart), times_ours; pairs: our
pairs that the tool found; missed: those that it did not find; extra: those that it found beyond.
Missed and extra pairs of tools in single precision lie on sides of cells.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.bricks import brick_box
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.transforms import rotation
from palpate.validation.peers.bench import Benchmark, Row, Scene
from palpate.validation.peers.registry import OURS, Tool, tools_for
from palpate.validation.peers.timing import Child, Schedule
from palpate.validation.states import Progress

# Surface triangles of both bodies -> bricks along a side of each.
BODIES = {10_584: 21, 20_184: 29, 101_400: 65}
RAYS = "trimesh embree"

# Number of steps after which the motion repeats.
NUM_FRAMES = 6
_SWAY = 0.02  # amplitude of the points' motion over the bodies' half size
_ROUND = 0.6  # roundness: 0 is a cube, 1 a ball


# Arrangements, by the distance of the centres along the diagonal over half the size of a body: in
# both the boxes around the bodies overlap.
PLACES = {"overlapping": 1.7, "apart": 2.5}


def make_bodies(divisions: int, arrangement: str) -> dict[str, NDArray[np.generic]]:
    """Rounded boxes of divisions^3 bricks, six tetrahedra each, the second one turned.

    `cells` and boundary `facets` of either body, 24 divisions^2 in all, and `frames`, points of
    each body by step [m], shape (2, NUM_FRAMES, num_points, 3).
    """
    box = brick_box((divisions,) * 3, (2.0,) * 3, ragged=0.1)
    points = box.points - 1.0
    largest = np.abs(points).max(axis=1)
    length = np.linalg.norm(points, axis=1)
    ball = (
        points * np.divide(largest, length, out=np.ones_like(length), where=length > 0.0)[:, None]
    )
    mesh = TetMesh((1.0 - _ROUND) * points + _ROUND * ball, box.cells)
    between = np.full(3, PLACES[arrangement] / np.sqrt(3.0))
    first = _frames(mesh.points, _turned(0.4, 0.3), np.zeros(3), 0.0)
    second = _frames(mesh.points, _turned(1.1, -0.7), between, 2.0)
    return {
        "cells": mesh.cells,
        "facets": mesh.boundary_facets,
        "frames": np.stack([first, second]),
    }


def _turned(about_z: float, about_x: float) -> Points:
    once = rotation((1.0, 0.0, 0.0), math.degrees(about_x))
    turn: Points = rotation((0.0, 0.0, 1.0), math.degrees(about_z)) @ once
    return turn


def _frames(points: Points, turn: Points, centre: Points, phase: float) -> NDArray[np.float64]:
    """Waves through the body: every point moves differently, and no step is a rigid motion."""
    frames = []
    for k in range(NUM_FRAMES):
        angle = 2.0 * np.pi * k / NUM_FRAMES + phase
        wave = np.sin(4.0 * points[:, [1, 2, 0]] + angle + [0.0, 1.0, 2.0])
        frames.append((points + _SWAY * wave) @ turn.T + centre)
    return np.array(frames)


def make_scenes(size: int, _progress: Progress) -> Iterator[Scene]:
    """Each body against the other, and where they overlap also against itself."""
    for arrangement, with_self in (("overlapping", False), ("overlapping", True), ("apart", False)):
        columns = {"against": "other and self" if with_self else "other", "place": arrangement}
        job = {**make_bodies(BODIES[size], arrangement), "with_self": with_self}
        yield Scene(size, job, columns, _finish)


def _finish(rows: list[Row], children: list[Child], earlier: list[Row]) -> None:
    compare(rows, [child.result["pairs"] for child in children])
    for row in rows:
        row["times_ours"] = row["seconds"] / rows[0]["seconds"]
    if rows[0]["against"] != "other":
        alone = next(row for row in reversed(earlier) if row["tool"] == OURS)
        rows[0]["seconds_within"] = rows[0]["seconds"] - alone["seconds"]


def compare(rows: Sequence[Row], results: Sequence[NDArray[np.generic]]) -> None:
    """Add pairs, missed and extra of the first frame; ours, the first, equal brute force."""
    ours = _keys(results[0])
    for row, pairs in zip(rows, results, strict=True):
        keys = _keys(pairs)
        # Rays find vertices only, not their cells.
        expected = np.unique(ours >> 32) if row["tool"] == RAYS else ours
        row["pairs"] = len(np.intersect1d(keys, expected))
        row["missed"] = len(np.setdiff1d(expected, keys))
        row["extra"] = len(np.setdiff1d(keys, expected))


def _keys(pairs: NDArray[np.generic]) -> NDArray[np.int64]:
    """One number for each row of whole numbers, ascending, each once."""
    rows = np.asarray(pairs, dtype=np.int64)
    keys: NDArray[np.int64] = np.unique(
        rows[:, 0] if rows.shape[1] == 1 else rows[:, 0] << 32 | rows[:, 1]
    )
    return keys


def remark(ours: list[Row], _rivals: list[Row]) -> list[str]:
    """Milliseconds of a step, and the part of it for self-collision."""
    parts = [f"{1e3 * ours[0]['seconds']:.3g} ms a step"]
    if "seconds_within" in ours[0]:
        parts.append(f"{1e3 * ours[0]['seconds_within']:.3g} ms of it within the bodies")
    return parts


BENCHMARK = Benchmark(
    task="Collision",
    sizes=tuple(BODIES),
    tools=(Tool(OURS, "ours"), *tools_for("collision")),
    schedule=Schedule(turns=5, seconds=0.3, unit=NUM_FRAMES),
    make_scenes=make_scenes,
    measure_work=lambda row: row["size"] / 1e6,
    rate_unit="million surface triangles per second",
    same=("place", "against"),
    table=("against", "place", "times_ours", "pairs", "missed", "extra"),
    remark=remark,
)
