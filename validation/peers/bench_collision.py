"""`palpate bench collision`: who touches whom, ours beside collision libraries.

Two bodies that deform in every step, and within them. All tools get the same points and answer the
same query: in which cells of the other body vertices lie. Trees are refitted (Warp) or built anew
(Embree) in every step, our hash is filled anew. Each timing goes round all frames of the motion.

Rows have against (other, or other and self), place (overlapping or apart), times_ours; pairs: what
the tool found of what we found; missed: what it did not; extra: what it found beyond. Missed and
extra of tools in single precision lie on sides of cells.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.validation.peers.bench_children import OURS, Child, Schedule, Tool
from palpate.validation.peers.bench_collision_scene import NUM_FRAMES, Place, make_bodies
from palpate.validation.peers.bench_run import Benchmark, Row, Scene
from palpate.validation.states import Progress

# Surface triangles of both bodies -> bricks along a side of each.
BODIES = {10_584: 21, 20_184: 29, 101_400: 65}
RAYS = "trimesh embree"

Keys = NDArray[np.int64]


def make_scenes(size: int, _progress: Progress) -> Iterator[Scene]:
    """Either body in the other, and where they overlap each in itself too."""
    for place in Place:
        bodies = make_bodies(BODIES[size], place)
        for with_self in (False, True) if place is Place.OVERLAPPING else (False,):
            yield Scene(
                size,
                {**bodies, "with_self": with_self},
                {"against": "other and self" if with_self else "other", "place": place.value},
                _finish,
            )


def _finish(rows: list[Row], children: list[Child], earlier: list[Row]) -> None:
    compare(rows, [child.answer["pairs"] for child in children])
    for row in rows:
        row["times_ours"] = row["seconds"] / rows[0]["seconds"]
    if rows[0]["against"] != "other":
        alone = next(row for row in reversed(earlier) if row["tool"] == OURS)
        rows[0]["seconds_within"] = rows[0]["seconds"] - alone["seconds"]


def compare(rows: Sequence[Row], answers: Sequence[NDArray[np.generic]]) -> None:
    """Pairs, missed and extra, of the first frame: ours, the first, are those of brute force."""
    ours = keys_of(answers[0])
    for row, answer in zip(rows, answers, strict=True):
        keys = keys_of(answer)
        # Rays know vertices alone.
        expected = vertices_of(ours) if row["tool"] == RAYS else ours
        row["pairs"] = len(np.intersect1d(keys, expected))
        row["missed"] = len(np.setdiff1d(expected, keys))
        row["extra"] = len(np.setdiff1d(keys, expected))


def keys_of(pairs: NDArray[np.generic]) -> Keys:
    """One number for each row of whole numbers, ascending, each once."""
    rows = np.asarray(pairs, dtype=np.int64)
    unique: Keys = np.unique(rows[:, 0] if rows.shape[1] == 1 else rows[:, 0] << 32 | rows[:, 1])
    return unique


def vertices_of(keys: Keys) -> Keys:
    """The first numbers of the pairs that `keys_of` numbered, ascending, each once."""
    vertices: Keys = np.unique(keys >> 32)
    return vertices


def remark(ours: list[Row], _rivals: list[Row]) -> list[str]:
    """Milliseconds of a step, and of it within the bodies."""
    parts = [f"{1e3 * ours[0]['seconds']:.3g} ms a step"]
    if "seconds_within" in ours[0]:
        parts.append(f"{1e3 * ours[0]['seconds_within']:.3g} ms of it within the bodies")
    return parts


BENCHMARK = Benchmark(
    task="Collision",
    sizes=tuple(BODIES),
    tools=(
        Tool(OURS, "ours"),
        Tool("warp BVH", "warp_tree", "pip install warp-lang"),
        Tool(RAYS, "trimesh_rays", "pip install trimesh embreex rtree scipy"),
    ),
    schedule=Schedule(turns=5, seconds=0.3, unit=NUM_FRAMES),
    make_scenes=make_scenes,
    measure_work=lambda row: row["size"] / 1e6,
    rate_unit="million surface triangles per second",
    same=("place", "against"),
    table=("against", "place", "times_ours", "pairs", "missed", "extra"),
    remark=remark,
)
