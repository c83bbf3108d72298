"""`palpate bench mesh`: surfaces filled with tetrahedra, ours beside every installed rival.

The surfaces are kidneys that palpate's own triangulation has not made: gmsh covers a fine kidney
with the wanted number of triangles, VTK decimates that, or draws it anew by marching cubes (flying
edges). Every timing is a process of its own; quality is measured here, in the same way for all.
Seconds are from the surface in the tool's memory to the finished mesh there. Rows have surface,
cells, min_dihedral_deg, p1_dihedral_deg (1st percentile of each cell's smallest angle), inverted
cells, boundary_kept, relative_volume_error, critical_time_step_us (E = 10 kPa, nu = 0.45, 1000
kg/m3) and peak_memory_mb.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from palpate.fastsim.body import Body
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Material
from palpate.meshes.quality import measure_quality
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.peers.bench import Benchmark, Row, Scene
from palpate.validation.peers.registry import OURS, Tool, tools_for
from palpate.validation.peers.timing import Child, ChildFailedError, Schedule, timed
from palpate.validation.states import Progress

# The surfaces of lower quality have one size.
POOR_SIZE = 10_000
SCHEDULE = Schedule(turns=3, long=5.0, is_fresh=True, time_limit=400.0)
TOOLS = (Tool(OURS, "ours"), *tools_for("mesh"))
_GMSH, _VTK = tools_for("surface")
# Equilateral triangles of edge h have an area of sqrt(3)/4 h^2.
_EDGE_SQUARED = 4.0 / math.sqrt(3.0)
# Soft tissue; of the critical steps only the ratio depends on the mesh.
_TISSUE = Material(1e4, 0.45, 1000.0)


def make_surface(kind: str, size: int) -> TriSurface:
    """Make a kidney of about `size` triangles in a child process: gmsh may abort.

    The kind is "gmsh", "decimated" or "marching cubes". Raises ChildFailedError where gmsh or VTK
    is missing or failed.
    """
    tool, option = _GMSH if kind == "gmsh" else _VTK, "edge_length"
    if kind == "gmsh":
        fine = shape_kidney(edge_length=2e-3)
        # gmsh makes edges about 10 % shorter.
        value = 1.1 * math.sqrt(fine.area / size * _EDGE_SQUARED)
    elif kind == "decimated":
        fine = shape_kidney(edge_length=math.sqrt(0.0264 / (4.0 * size) * _EDGE_SQUARED))
        option, value = "size", size
    else:
        fine = shape_kidney(edge_length=4e-3)
        # A surface has about 2.5 triangles for each area of a voxel's face.
        option, value = "voxel", math.sqrt(2.5 * fine.area / size)
    job = {"points": fine.points, "facets": fine.facets, option: value}
    said: list[str] = []
    with timed((tool,), "Surface", job, Schedule(turns=1), said.append) as children:
        if not children:
            raise ChildFailedError(said[0] if said else f"{tool.name} is missing; {tool.install}")
        made = children[0].result
    used, numbers = np.unique(made["facets"], return_inverse=True)
    facets = numbers.reshape(-1, 3).astype(np.int32)
    surface = TriSurface(np.ascontiguousarray(made["points"][used]), facets)
    return surface if surface.volume > 0.0 else TriSurface(surface.points, facets[:, ::-1].copy())


def make_scenes(size: int, progress: Progress) -> Iterator[Scene]:
    """Surfaces of about `size` triangles."""
    for kind in ("gmsh", "decimated", "marching cubes") if size == POOR_SIZE else ("gmsh",):
        try:
            surface = make_surface(kind, size)
        except ChildFailedError as error:
            progress(f"no {kind} surface of {size} triangles: {error}")
            continue

        def finish(
            rows: list[Row],
            children: list[Child],
            _earlier: list[Row],
            surface: TriSurface = surface,
        ) -> None:
            for row, child in zip(rows, children, strict=True):
                row |= measure(surface, child.result)

        job = {"points": surface.points, "facets": surface.facets}
        yield Scene(surface.num_facets, job, {"surface": kind}, finish)


def measure(surface: TriSurface, result: Mapping[str, Any]) -> Row:
    """Measure the quality of a mesh; with inverted cells only their number is reported."""
    points, cells = result["points"], result["cells"].astype(np.int32)
    # Relative to a local origin, so that the sum keeps its digits.
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


BENCHMARK = Benchmark(
    task="Mesh",
    sizes=(2_000, POOR_SIZE, 50_000),
    tools=TOOLS,
    schedule=SCHEDULE,
    make_scenes=make_scenes,
    measure_work=lambda row: row["cells"],
    rate_unit="cells per second",
    same=("surface",),
)
