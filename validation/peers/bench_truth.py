"""`palpate bench truth`: the reference with quadratic tetrahedra, on one rank and on two.

The whole command `palpate solve CASE --with reference --degree 2` is timed with Green strain, to a
relative residual of 1e-10; `size` is the number of unknowns. Rows have iterations (of Newton's
method), max_displacement [m], peak_memory_mb of all processes together, kb_per_unknown and
ms_per_unknown (by the clock).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.meshes.bricks import brick_box
from palpate.reference.availability import require_available
from palpate.validation.peers.bench import Benchmark, Row, Scene
from palpate.validation.peers.registry import OURS, Tool
from palpate.validation.peers.timing import Child, Schedule
from palpate.validation.states import Progress

# Unknowns -> bricks across a block that is twice as long.
BLOCKS = {28_611: 8, 115_911: 13, 351_351: 19, 1_101_411: 28}
TOOLS = (
    Tool(OURS, "reference_ranks", options={"num_threads": 1}),
    Tool(
        "palpate under mpirun",
        "reference_ranks",
        "apt-get install openmpi-bin; the PyPI wheel of dolfinx brings its own",
        {"num_threads": 2},
    ),
)


def make_scenes(size: int, _progress: Progress) -> Iterator[Scene]:
    """One block."""
    require_available()
    across = BLOCKS[size]
    mesh = brick_box((2 * across, across, across), (2.0, 1.0, 1.0))

    def finish(rows: list[Row], children: list[Child], _earlier: list[Row]) -> None:
        for row, child in zip(rows, children, strict=True):
            moved = np.linalg.norm(child.result["displacement"], axis=1)
            row["max_displacement"] = float(moved.max())
            row["kb_per_unknown"] = row["peak_memory_mb"] * 1024.0 / size
            row["ms_per_unknown"] = row["wall_seconds"] * 1000.0 / size

    yield Scene(size, {"points": mesh.points, "cells": mesh.cells}, {}, finish)


def remark(ours: list[Row], rivals: list[Row]) -> list[str]:
    """The difference of the results."""
    one = ours[0]["max_displacement"]
    apart = (abs(row["max_displacement"] - one) / one for row in rivals)
    return [f"largest displacements {each:.1g} apart" for each in apart]


BENCHMARK = Benchmark(
    task="Truth",
    sizes=tuple(BLOCKS),
    tools=TOOLS,
    # The set-up writes the mesh; a timing is one command, which has compiled its forms before.
    schedule=Schedule(turns=1, is_fresh=True, time_limit=3600.0),
    make_scenes=make_scenes,
    measure_work=lambda row: row["size"],
    rate_unit="unknowns per second",
    table=("wall_seconds", "max_displacement", "peak_memory_mb", "kb_per_unknown",
           "ms_per_unknown", "iterations"),
    remark=remark,
)  # fmt: skip
