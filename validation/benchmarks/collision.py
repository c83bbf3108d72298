"""`palpate bench collision`: who touches whom, ours beside collision libraries."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.validation.benchmarks.children import TimedChild, started, take_turns
from palpate.validation.benchmarks.collision_scene import NUM_FRAMES, Place, Scene, make_scene

# Surface triangles of both bodies -> bricks along a side of each.
BODIES = {10_584: 21, 20_184: 29, 101_400: 65}
SIZES = tuple(BODIES)
TIMINGS = 5
SECONDS = 0.3  # of a timing, about, and at least once round the frames

# Tool -> how to install it. PALPATE_BENCH_PYTHON may name the interpreter that has it.
RIVALS = {
    "warp BVH": "pip install warp-lang",
    "trimesh embree": "pip install trimesh embreex rtree scipy",
}
TABLE = ("against", "place", "times_ours", "pairs", "missed", "extra")

Row = dict[str, Any]
Keys = NDArray[np.int64]


def bench_collision(
    *,
    sizes: Sequence[int] = SIZES,
    progress: Callable[[str], None] | None = None,
) -> list[Row]:
    """Time detection between two bodies that deform in every step, and within them.

    All tools get the same points and answer the same query: in which cells of the other body
    vertices lie. Trees are refitted (Warp) or built anew (Embree) in every step, our hash is
    filled anew. Each tool runs in a process of its own, on one thread; the
    tools take turns, and the best processor time of each counts. Each timing goes round all frames
    of the motion.

    Args:
        sizes: Surface triangles of both bodies, of `SIZES`.
        progress: Called with one line per row.

    Returns:
        Rows with tool, against (other, or other and self), place (overlapping or apart), size,
        seconds per step, times_ours; pairs: what the tool found of what we found; missed: what it
        did not; extra: what it found beyond. Missed and extra of tools in single precision lie on
        sides of cells.
    """
    rows: list[Row] = []
    for size in sizes:
        for place in Place:
            scene = make_scene(BODIES[size], place)
            for with_self in (False, True) if place is Place.OVERLAPPING else (False,):
                found = _time_tools(scene, with_self, progress)
                for row in found:
                    row["size"], row["place"] = size, place.value
                    row["rate"] = size / row["seconds"] / 1e6
                    if progress:
                        progress(_line(row))
                rows += found
    return rows


def _time_tools(scene: Scene, with_self: bool, progress: Callable[[str], None] | None) -> list[Row]:
    body = {
        "frames_0": scene.frames[0],
        "frames_1": scene.frames[1],
        "elements": scene.cells,
        "facets": scene.facets,
        "with_self": with_self,
    }
    files = [("palpate_collision.py", body), ("collision_warp.py", body)]
    if not with_self:
        files += [("collision_trimesh.py", body)]
    with started(files, progress) as children:
        counts = {id(child): _count_steps(child) for child in children}
        take_turns(children, TIMINGS, lambda child, _turn: counts[id(child)], progress)
        rows = [_row(child, counts[id(child)]) for child in children]
        answers = [_keys(child.force) for child in children]
    for row in rows:
        row["against"] = "other and self" if with_self else "other"
        row["times_ours"] = row["seconds"] / rows[0]["seconds"]
    _compare(rows, answers)
    return rows


def _count_steps(child: TimedChild) -> int:
    """Rounds of all frames that last about `SECONDS`."""
    wall = float(child.time(NUM_FRAMES)["wall"])
    wall = min(wall, float(child.time(NUM_FRAMES)["wall"])) if wall < 1.0 else wall
    child.answers.clear()
    return NUM_FRAMES * max(1, round(SECONDS / wall))


def _row(child: TimedChild, num_steps: int) -> Row:
    return {
        "tool": child.about["tool"],
        "version": child.about["version"],
        "threads": 1,
        "precision": child.about["precision"],
        "seconds": child.best("processor") / num_steps,
        "rate_unit": "million surface triangles per second",
        "wall_seconds": child.best("wall") / num_steps,
        "peak_memory_mb": child.answers[-1]["peak_memory_mb"],
    }


def _keys(pairs: NDArray[np.float64] | None) -> Keys:
    assert pairs is not None
    return keys_of(pairs)


def _compare(rows: list[Row], answers: list[Keys]) -> None:
    """Pairs, missed and extra, of the first frame: ours, the first, are those of brute force."""
    for row, keys in zip(rows, answers, strict=True):
        # Embree knows vertices alone.
        expected = vertices_of(answers[0]) if row["tool"] == "trimesh embree" else answers[0]
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


def _line(row: Row) -> str:
    return (
        f"{row['size']:7d} {row['place']:11} {row['against']:14} {row['tool']:14} "
        f"{1e3 * row['seconds']:9.3f} ms {row['times_ours']:7.1f} x  {row['pairs']:7d} "
        f"{row['missed']:3d}"
    )


def summarise(rows: Sequence[Row]) -> list[str]:
    """How many times quicker than the quickest rival, for each scene."""
    lines = []
    ours = {_kind(row): row for row in rows if row["tool"] == "palpate"}
    for (size, place, against), own in ours.items():
        rivals = [r for r in rows if _kind(r) == _kind(own) and r["tool"] != "palpate"]
        parts = [f"{1e3 * own['seconds']:.3g} ms a step"]
        if against != "other":
            alone = ours[size, place, "other"]["seconds"]
            parts.append(f"{1e3 * (own['seconds'] - alone):.3g} ms of it within the bodies")
        if rivals:
            quickest = min(rivals, key=lambda row: float(row["seconds"]))
            parts.append(
                f"{quickest['times_ours']:.1f} times as quick as {quickest['tool']} "
                f"{quickest['version']}"
            )
        lines.append(
            f"{size} triangles {place}, vertices in cells of {against}: " + ", ".join(parts)
        )
    return lines


def _kind(row: Row) -> tuple[int, str, str]:
    return row["size"], row["place"], row["against"]
