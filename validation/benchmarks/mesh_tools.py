"""The tools of `palpate bench mesh`, each in a child process: `python -m ... TOOL SURFACE MESH`.

Seconds are CPU time from the surface in memory to the finished mesh, clean-up included.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.validation.benchmarks.child import peak_memory_mb

# Wanted edge length inside, in mean edges of the surface: with it the number of cells is within
# 20 % of gmsh's, whose inner edges come out longer than those of the surface.
_EDGES_INSIDE = 1.38

Filled = tuple[Points, Indices, float, str]  # points, cells, CPU seconds, version


def _palpate(points: Points, facets: Indices) -> Filled:
    from palpate.fastsim import _core
    from palpate.fastsim.mesher import mesh_surface
    from palpate.meshes.tri_surface import TriSurface

    surface = TriSurface(points, facets)
    start = time.process_time()
    corners = points[facets]
    mean_edge = float(np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).mean())
    mesh = mesh_surface(surface, edge_length=_EDGES_INSIDE * mean_edge)
    return mesh.points, mesh.cells, time.process_time() - start, _core.__version__


def _gmsh(points: Points, facets: Indices, *, algorithm: int, netgen: bool) -> Filled:
    import gmsh

    gmsh.initialize([], interruptible=False)
    gmsh.option.setNumber("General.Verbosity", 1)
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.option.setNumber("Mesh.Algorithm3D", algorithm)
    gmsh.option.setNumber("Mesh.Optimize", 1)
    gmsh.option.setNumber("Mesh.OptimizeNetgen", int(netgen))
    gmsh.model.addDiscreteEntity(2, 1)
    tags = np.arange(1, len(points) + 1)
    gmsh.model.mesh.addNodes(2, 1, tags.tolist(), points.ravel().tolist())
    gmsh.model.mesh.addElementsByType(1, 2, [], (facets + 1).ravel().tolist())
    gmsh.model.geo.addSurfaceLoop([1], 1)
    gmsh.model.geo.addVolume([1], 1)
    gmsh.model.geo.synchronize()
    start = time.process_time()
    gmsh.model.mesh.generate(3)
    seconds = time.process_time() - start
    numbers, coordinates, _ = gmsh.model.mesh.getNodes()
    _, connectivity = gmsh.model.mesh.getElementsByType(4)
    gmsh.finalize()
    order = np.argsort(numbers)
    cells = np.searchsorted(numbers[order], connectivity).reshape(-1, 4)
    return coordinates.reshape(-1, 3)[order], cells, seconds, gmsh.__version__


def _tetgen(points: Points, facets: Indices) -> Filled:
    from tetgen import __version__, _tetgen

    mesher = _tetgen.PyTetgen()
    mesher.load_mesh(points, facets)
    start = time.process_time()
    mesher.tetrahedralize(switches_str="pq1.2YQ")
    seconds = time.process_time() - start
    return mesher.return_nodes(), mesher.return_tets(), seconds, __version__


TOOLS: dict[str, Callable[[Points, Indices], Filled]] = {
    "palpate": _palpate,
    "gmsh HXT": lambda p, f: _gmsh(p, f, algorithm=10, netgen=False),
    "TetGen pq1.2Y": _tetgen,
    "gmsh Delaunay + Netgen": lambda p, f: _gmsh(p, f, algorithm=1, netgen=True),
}

# What a rival's interpreter must have.
NEEDS = {"gmsh HXT": "gmsh", "TetGen pq1.2Y": "tetgen", "gmsh Delaunay + Netgen": "gmsh"}


def _main() -> None:
    tool, source, target = sys.argv[1:]
    with np.load(source) as stored:
        surface = stored["points"], stored["facets"]
    points, cells, seconds, version = TOOLS[tool](*surface)
    np.savez(target, points=points, cells=np.asarray(cells, dtype=np.int32))
    answer = {"seconds": seconds, "version": version, "peak_memory_mb": peak_memory_mb()}
    print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    _main()
