"""`palpate bench mesh`: surfaces filled with tetrahedra, ours beside every installed rival.

Every timing is a process of its own on one thread with a time limit; the tools take turns, and
the best CPU time of each counts. Quality is measured here, the same way for all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.fastsim.body import Body
from palpate.meshes.problem import Material
from palpate.meshes.quality import measure_quality
from palpate.meshes.temporaries import scratch_folder
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.benchmarks.child import ChildFailedError, run_tool
from palpate.validation.benchmarks.mesh_surfaces import make_surface
from palpate.validation.benchmarks.mesh_tools import NEEDS, TOOLS
from palpate.validation.simulators.interpreters import interpreter_with

SIZES = (2_000, 10_000, 50_000)
RIVALS = {
    "gmsh HXT": "pip install gmsh (which also makes the surfaces)",
    "TetGen pq1.2Y": "pip install tetgen",
    "gmsh Delaunay + Netgen": "pip install gmsh",
}
# The poorer surfaces come in one size.
_POOR_SIZE = 10_000
_REPEATS = 3
_ONCE_ABOVE_SECONDS = 5.0
_TIME_LIMIT = 400.0
_MODULE = "palpate.validation.benchmarks.mesh_tools"
# Soft tissue; only the ratio of the critical steps depends on the mesh.
_TISSUE = Material(1e4, 0.45, 1000.0)

Row = dict[str, Any]


def bench_mesh(
    *,
    sizes: Sequence[int] = SIZES,
    progress: Callable[[str], None] | None = None,
) -> list[Row]:
    """Time the filling of kidney surfaces made by gmsh, decimated and by marching cubes.

    Args:
        sizes: Numbers of triangles, about.
        progress: Called with one line per row, or per tool that gave none.

    Returns:
        Rows with tool, surface, size [triangles], seconds (CPU, best of three), rate
        [cells per second], cells, min_dihedral_deg, p1_dihedral_deg (1st percentile of each
        cell's smallest angle), inverted cells, boundary_kept, relative_volume_error,
        critical_time_step_us (E = 10 kPa, nu = 0.45, 1000 kg/m3) and peak_memory_mb.
    """
    rows: list[Row] = []
    with scratch_folder("bench") as folder:
        for size in sizes:
            poor = ("decimated", "marching cubes") if size == _POOR_SIZE else ()
            for kind in ("gmsh", *poor):
                source = str(folder / "surface.npz")
                try:
                    surface = make_surface(kind, size, source)
                except ChildFailedError as error:
                    if progress:
                        progress(f"no {kind} surface of {size} triangles: {error}")
                    continue
                rows += _time_all(kind, surface, source, progress)
    return rows


def _time_all(
    kind: str, surface: TriSurface, source: str, progress: Callable[[str], None] | None
) -> list[Row]:
    best: dict[str, Row] = {}
    open_tools = list(TOOLS)
    target = str(Path(source).with_name("mesh.npz"))
    for _ in range(_REPEATS):
        for tool in list(open_tools):
            try:
                answer = run_tool(
                    _MODULE,
                    [tool, source, target],
                    time_limit=_TIME_LIMIT,
                    interpreter=interpreter_with(NEEDS[tool]) if tool in NEEDS else None,
                )
            except ChildFailedError as error:
                open_tools.remove(tool)
                if progress:
                    progress(f"{tool:22} {kind} {surface.num_facets}: {error}")
                continue
            if answer["seconds"] > _ONCE_ABOVE_SECONDS:
                open_tools.remove(tool)
            if tool not in best:
                best[tool] = answer | _measure(surface, target)
                if progress:
                    progress(_line(tool, kind, surface.num_facets, best[tool]))
            best[tool]["seconds"] = min(best[tool]["seconds"], answer["seconds"])
    return [_row(tool, kind, surface, measured) for tool, measured in best.items()]


def _measure(surface: TriSurface, target: str) -> Row:
    with np.load(target) as stored:
        points, cells = stored["points"], stored["cells"]
    # About a local origin, so that the sum keeps its digits.
    volumes = signed_volumes(points - surface.points.mean(axis=0), cells)
    inverted = int((volumes <= 0.0).sum())
    measured: Row = {
        "cells": len(cells),
        "inverted": inverted,
        "relative_volume_error": abs(float(volumes.sum()) / surface.volume - 1.0),
    }
    if inverted or len(cells) == 0:
        return measured
    mesh = TetMesh(points, cells)
    quality = measure_quality(mesh)
    return measured | {
        "min_dihedral_deg": quality.smallest_dihedral_deg,
        "p1_dihedral_deg": quality.first_percentile_dihedral_deg,
        "boundary_kept": is_boundary_kept(surface, mesh),
        "critical_time_step_us": 1e6 * Body(mesh, _TISSUE).critical_time_step_bound(),
    }


def is_boundary_kept(surface: TriSurface, mesh: TetMesh) -> bool:
    """Whether the mesh's boundary facets are the surface's, corner for corner, bit for bit."""

    def facets_of(triangles: np.ndarray[Any, np.dtype[np.float64]]) -> set[bytes]:
        # Corners in one order, whatever their numbers.
        order = np.lexsort(triangles.transpose(2, 0, 1)[::-1], axis=1)
        return {row.tobytes() for row in np.take_along_axis(triangles, order[:, :, None], axis=1)}

    given = facets_of(surface.points[surface.facets])
    return given == facets_of(mesh.points[mesh.boundary_facets])


def _line(tool: str, kind: str, size: int, measured: Row) -> str:
    return (
        f"{tool:22} {kind} {size}: {measured['seconds']:7.2f} s "
        f"{measured['cells'] / measured['seconds'] / 1e3:6.1f} k cells/s, dihedral angle "
        f"{measured.get('min_dihedral_deg', 0.0):.1f} (1 %: "
        f"{measured.get('p1_dihedral_deg', 0.0):.1f}) deg"
    )


def _row(tool: str, kind: str, surface: TriSurface, measured: Row) -> Row:
    seconds = measured.pop("seconds")
    return {
        "tool": tool,
        "version": str(measured.pop("version")),
        "surface": kind,
        "size": surface.num_facets,
        "threads": 1,
        "precision": "float64",
        "seconds": seconds,
        "rate": measured["cells"] / seconds,
        "rate_unit": "cells per second",
        **measured,
    }
