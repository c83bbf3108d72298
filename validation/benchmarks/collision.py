"""`palpate bench collision`: who touches whom, ours beside collision libraries."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.validation.benchmarks.children import TimedChild, started, take_turns
from palpate.validation.benchmarks.collision_answers import (
    edges_within,
    keys_of,
    rows_of,
    vertices_within,
)
from palpate.validation.benchmarks.collision_scene import NUM_FRAMES, Place, Scene, make_scene

# Surface triangles of both bodies -> bricks along a side of each.
BODIES = {10_584: 21, 20_184: 29, 101_400: 65}
SIZES = tuple(BODIES)
TIMINGS = 5
SECONDS = 0.3  # of a timing, about, and at least once round the frames

IN_CELLS, NEAR_FACETS, NEAR_EDGES = (
    "vertices in cells",
    "vertices near triangles",
    "edges near edges",
)
QUERIES = (IN_CELLS, NEAR_FACETS, NEAR_EDGES)
_METHODS = ("LBVH", "HashGrid", "SpatialHash", "SweepAndPrune")

# Tool -> how to install it. PALPATE_BENCH_PYTHON may name the interpreter that has it.
RIVALS = {
    **{f"ipctk {method}": "pip install ipctk" for method in _METHODS},
    "warp BVH": "pip install warp-lang",
    "trimesh embree": "pip install trimesh embreex rtree scipy",
}
TABLE = (
    "query", "against", "place", "phase", "times_ours", "candidates", "pairs", "missed", "extra",
)  # fmt: skip

Row = dict[str, Any]
Keys = NDArray[np.int64]


def bench_collision(
    *,
    sizes: Sequence[int] = SIZES,
    progress: Callable[[str], None] | None = None,
) -> list[Row]:
    """Time detection between two bodies that deform in every step, and within them.

    All tools get the same points and answer the same query: in which cells of the other body
    vertices lie; which vertices lie in boxes of triangles, and which boxes of edges meet, grown by
    a fifth of the mean edge. Trees are refitted (Warp) or built anew (IPC toolkit, Embree) in
    every step, our hash is filled anew. Each tool runs in a process of its own, on one thread; the
    tools take turns, and the best processor time of each counts. Each timing goes round all frames
    of the motion.

    Args:
        sizes: Surface triangles of both bodies, of `SIZES`.
        progress: Called with one line per row.

    Returns:
        Rows with tool, query, against (other, or other and self), place (overlapping or apart),
        phase (candidates, or pairs with exact distances), size, seconds per step, times_ours;
        candidates: what the tool gave; pairs: those that truly lie within the distance or in a
        cell; missed: pairs that it did not give; extra (cells only): what it gave beyond them.
        Missed and extra of tools in single precision lie on sides of cells.
    """
    rows: list[Row] = []
    for size in sizes:
        for place in Place:
            scene = make_scene(BODIES[size], place)
            for query in QUERIES:
                for with_self in (False, True) if place is Place.OVERLAPPING else (False,):
                    found = _time_query(scene, query, with_self, progress)
                    for row in found:
                        row["size"], row["place"] = size, place.value
                        row["rate"] = size / row["seconds"] / 1e6
                        if progress:
                            progress(_line(row))
                    rows += found
    return rows


def _time_query(
    scene: Scene, query: str, with_self: bool, progress: Callable[[str], None] | None
) -> list[Row]:
    body = _body(scene, query, with_self)
    files: list[tuple[str, dict[str, Any]]] = [("palpate_collision.py", body)]
    if query == IN_CELLS:
        files += [("collision_warp.py", body)]
        if not with_self:
            files += [("collision_trimesh.py", body)]
    else:
        files += [("palpate_collision.py", body | {"only_candidates": False})]
        files += [("collision_ipctk.py", body | {"method": method}) for method in _METHODS]
        if query == NEAR_FACETS:
            files += [("collision_warp.py", body)]
    with started(files, progress) as children:
        counts = {id(child): _count_steps(child) for child in children}
        take_turns(children, TIMINGS, lambda child, _turn: counts[id(child)], progress)
        rows = [_row(child, counts[id(child)]) for child in children]
        answers = [keys_of(_ordered(child.force, query)) for child in children]
    ours = [row for row in rows if row["tool"] == "palpate"]
    for row in rows:
        row["query"] = query
        row["against"] = "other and self" if with_self else "other"
        row["phase"] = "pairs" if query == IN_CELLS or row is ours[-1] else "candidates"
        row["times_ours"] = row["seconds"] / ours[0]["seconds"]
    _compare(rows, answers, body, query)
    return rows


def _body(scene: Scene, query: str, with_self: bool) -> dict[str, Any]:
    """What every tool is given, as plain arrays."""
    uses_cells = query == IN_CELLS
    frames = scene.frames if uses_cells else scene.surface_frames
    elements = {
        IN_CELLS: scene.cells,
        NEAR_FACETS: scene.surface_facets,
        NEAR_EDGES: scene.surface_edges,
    }
    return {
        "frames_0": frames[0],
        "frames_1": frames[1],
        "elements": elements[query],
        "facets": scene.facets if uses_cells else scene.surface_facets,
        "edges": scene.surface_edges,
        "distance": scene.distance,
        "query": query,
        "with_self": with_self,
        "only_candidates": True,
    }


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


def _ordered(pairs: NDArray[np.float64] | None, query: str) -> NDArray[np.float64]:
    assert pairs is not None
    return np.sort(pairs, axis=1) if query == NEAR_EDGES else pairs


def _compare(rows: list[Row], answers: list[Keys], body: dict[str, Any], query: str) -> None:
    """Candidates, pairs, missed and extra, of the first frame."""
    if query == IN_CELLS:
        exact = answers[0]
    else:
        every = np.unique(np.concatenate(answers))
        exact = every[_within(rows_of(every), body, query)]
    for row, keys in zip(rows, answers, strict=True):
        expected = exact
        if row["tool"] == "trimesh embree":  # knows vertices alone
            expected = np.unique(rows_of(exact)[:, 0])
        row["candidates"] = len(keys)
        row["pairs"] = len(np.intersect1d(keys, expected))
        row["missed"] = len(np.setdiff1d(expected, keys))
        if query == IN_CELLS:
            row["extra"] = len(np.setdiff1d(keys, expected))


def _within(pairs: Keys, body: dict[str, Any], query: str) -> NDArray[np.bool_]:
    points = np.concatenate([body["frames_0"][0], body["frames_1"][0]])
    elements = np.concatenate([body["elements"], body["elements"] + body["frames_0"].shape[1]])
    first, second = pairs[:, 0], pairs[:, 1]
    distance = float(body["distance"])
    if query == NEAR_EDGES:
        return edges_within(points[elements[first]], points[elements[second]], distance)
    return vertices_within(points[first], points[elements[second]], distance)


def _line(row: Row) -> str:
    return (
        f"{row['size']:7d} {row['place']:11} {row['query']:23} {row['against']:14} "
        f"{row['tool']:19} {row['phase']:10} {1e3 * row['seconds']:9.3f} ms"
        f" {row['times_ours']:7.1f} x  {row['candidates']:8d} {row['pairs']:7d} {row['missed']:3d}"
    )


def summarise(rows: Sequence[Row]) -> list[str]:
    """How many times quicker than the quickest rival, for each query."""
    lines = []
    kinds = dict.fromkeys((r["size"], r["place"], r["query"], r["against"]) for r in rows)
    for size, place, query, against in kinds:
        here = [
            r
            for r in rows
            if (r["size"], r["place"], r["query"], r["against"]) == (size, place, query, against)
        ]
        ours = [row for row in here if row["tool"] == "palpate"]
        rivals = sorted((r for r in here if r["tool"] != "palpate"), key=lambda r: r["seconds"])
        parts = [f"{1e3 * ours[0]['seconds']:.3g} ms a step"]
        if against != "other":
            alone = next(
                row["seconds"]
                for row in rows
                if (row["size"], row["place"], row["query"], row["against"], row["tool"])
                == (size, place, query, "other", "palpate")
            )
            parts.append(f"{1e3 * (ours[0]['seconds'] - alone):.3g} ms of it within the bodies")
        if len(ours) > 1:
            parts.append(f"{1e3 * ours[1]['seconds']:.3g} ms with distances")
        if rivals:
            parts.append(
                f"{rivals[0]['times_ours']:.1f} times as quick as {rivals[0]['tool']} "
                f"{rivals[0]['version']}"
            )
        lines.append(f"{size} triangles {place}, {query} of {against}: " + ", ".join(parts))
    return lines
