"""`palpate bench delaunay`: Delaunay tetrahedra of points, ours beside every installed rival.

The points are random, and with 100 000 also on a grid and on a sphere. Every timing is a process
of its own; seconds are from the points in the tool's memory to the cells there. Rows have points
(random, grid, sphere), cells and peak_memory_mb of the process, with the interpreter's 30 MB.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.temporaries import scratch_folder
from palpate.validation.peers.bench import Benchmark, Row, Scene
from palpate.validation.peers.registry import OURS, Tool, tools_for
from palpate.validation.peers.timing import Child, Schedule
from palpate.validation.states import Progress

# Grid and sphere test exact arithmetic: one size is enough to show it.
SHAPES_SIZE = 100_000
SCHEDULE = Schedule(turns=3, long=12.0, is_fresh=True, time_limit=130.0)
TOOLS = (Tool(OURS, "ours"), *tools_for("delaunay"))


def place_points(kind: str, count: int) -> Points:
    """About so many points, (n, 3), always the same: "random", a "grid", or on a "sphere"."""
    random = np.random.default_rng(20070705)
    if kind == "random":
        return random.random((count, 3))
    if kind == "grid":
        axis = np.arange(float(round(count ** (1.0 / 3.0))))
        grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
        return np.ascontiguousarray(grid.reshape(-1, 3))
    if kind == "sphere":
        points = random.normal(size=(count, 3))
        return np.ascontiguousarray(points / np.linalg.norm(points, axis=1)[:, None])
    raise ValueError(f"no such points: {kind!r}")


def make_scenes(size: int, _progress: Progress) -> Iterator[Scene]:
    """Points of each kind, and a folder for libraries that are compiled."""

    def finish(rows: list[Row], children: list[Child], _earlier: list[Row]) -> None:
        for row, child in zip(rows, children, strict=True):
            row["cells"] = int(child.result["num_cells"])

    with scratch_folder("bench") as folder:
        for kind in ("random", "grid", "sphere") if size == SHAPES_SIZE else ("random",):
            job = {"points": place_points(kind, size), "folder": str(folder)}
            yield Scene(size, job, {"points": kind}, finish)


BENCHMARK = Benchmark(
    task="Delaunay",
    sizes=(10_000, 100_000, 1_000_000),
    tools=TOOLS,
    schedule=SCHEDULE,
    make_scenes=make_scenes,
    measure_work=lambda row: row["size"],
    rate_unit="points per second",
    same=("points",),
)
