"""`palpate bench delaunay`: tetrahedra of points, ours beside every installed rival.

Every timing is a process of its own on one thread; the tools take turns, and the best CPU time
of each counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.temporaries import scratch_folder
from palpate.validation.benchmarks.child import ChildFailedError, run_program, run_tool
from palpate.validation.benchmarks.delaunay_tools import NEEDS, PROGRAMS, TOOLS, compile_program
from palpate.validation.simulators.interpreters import interpreter_with

SIZES = (10_000, 100_000, 1_000_000)
RIVALS = {
    "CGAL (C++)": "apt install g++ libcgal-dev",
    "TetGen 1.5 (C++)": "apt install g++ libtet1.5-dev",
    "CGAL (Python)": "pip install cgal",
    "TetGen (Python)": "pip install tetgen",
    "gmsh": "pip install gmsh",
    "Qhull (scipy)": "pip install scipy",
}
# Grid and sphere: hard for exactness, so one size shows it.
_SHAPES_SIZE = 100_000
_REPEATS = 3
# Slower tools are not asked again at the largest size.
_ONCE_ABOVE_SECONDS = 12.0
_MODULE = "palpate.validation.benchmarks.delaunay_tools"

Row = dict[str, Any]


def place_points(kind: str, count: int) -> Points:
    """Points of a benchmark, shape (about count, 3), always the same.

    Args:
        kind: "random" in the unit cube, a "grid" of whole steps, or on a "sphere".
        count: How many; a grid takes the nearest cube number.
    """
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


def bench_delaunay(
    *,
    sizes: Sequence[int] = SIZES,
    progress: Callable[[str], None] | None = None,
) -> list[Row]:
    """Time raw Delaunay of random points, and of a grid and a sphere at 100 000.

    Args:
        sizes: Numbers of points.
        progress: Called with one line per row, or per tool that gave none.

    Returns:
        Rows with tool, points (random, grid, sphere), size, seconds (CPU, best of three), rate,
        cells and peak_memory_mb (of the process; for Python tools with the interpreter's 30 MB).
    """
    rows: list[Row] = []
    with scratch_folder("bench") as folder:
        programs = {tool: compile_program(tool, folder) for tool in PROGRAMS}
        source = folder / "points"
        for size in sizes:
            for kind in ("random", "grid", "sphere") if size == _SHAPES_SIZE else ("random",):
                place_points(kind, size).tofile(source)
                rows += _time_all(kind, size, source, programs, progress)
    return rows


def _time_all(
    kind: str,
    size: int,
    source: Path,
    programs: dict[str, Path | None],
    progress: Callable[[str], None] | None,
) -> list[Row]:
    best: dict[str, Row] = {}
    time_limit = 30.0 + 1e-4 * size  # Qhull takes hours for points on a sphere
    open_tools = ["palpate", *(t for t, path in programs.items() if path is not None)]
    open_tools += [tool for tool in TOOLS if tool != "palpate"]
    for _ in range(_REPEATS):
        for tool in list(open_tools):
            try:
                path = programs.get(tool)
                if path is not None:
                    row = run_program([str(path), str(source)], time_limit=time_limit)
                else:
                    row = run_tool(
                        _MODULE,
                        [tool, str(source)],
                        time_limit=time_limit,
                        interpreter=interpreter_with(NEEDS[tool]) if tool in NEEDS else None,
                    )
            except ChildFailedError as error:
                open_tools.remove(tool)
                if progress:
                    progress(f"{tool:17} {size} {kind} points: {error}")
                continue
            if row["seconds"] > _ONCE_ABOVE_SECONDS:
                open_tools.remove(tool)
            if tool not in best or row["seconds"] < best[tool]["seconds"]:
                best[tool] = row
    rows = [_row(tool, kind, size, measured) for tool, measured in best.items()]
    if progress:
        for row in rows:
            progress(
                f"{row['tool']:17} {size} {kind} points {row['seconds']:8.3f} s "
                f"{row['peak_memory_mb']:6.0f} MB"
            )
    return rows


def _row(tool: str, kind: str, size: int, measured: Row) -> Row:
    return {
        "tool": tool,
        "version": str(measured["version"]),
        "points": kind,
        "size": size,
        "threads": 1,
        "precision": "float64",
        "seconds": measured["seconds"],
        "rate": size / measured["seconds"],
        "rate_unit": "points per second",
        "cells": measured["cells"],
        "peak_memory_mb": measured["peak_memory_mb"],
    }
