"""Surfaces for `palpate bench mesh`, none made by palpate's own triangulation.

A fine kidney is the geometry. gmsh's surface mesher covers it with the wanted number of
triangles; VTK decimates it, and draws it anew by marching cubes (flying edges). Run as a child
process, `python -m ... KIND SIZE TARGET.npz`: gmsh may abort.
"""

from __future__ import annotations

import json
import math
import sys

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.benchmarks.child import run_tool
from palpate.validation.simulators.interpreters import interpreter_with

_MODULE = "palpate.validation.benchmarks.mesh_surfaces"
KINDS = ("gmsh", "decimated", "marching cubes")


def make_surface(kind: str, size: int, target: str) -> TriSurface:
    """Make a kidney of about `size` triangles in a child process.

    Raises:
        ChildFailedError: gmsh or VTK is missing or failed.
    """
    interpreter = interpreter_with("gmsh" if kind == "gmsh" else "pyvista")
    run_tool(_MODULE, [kind, str(size), target], time_limit=300.0, interpreter=interpreter)
    with np.load(target) as stored:
        return TriSurface(stored["points"], stored["facets"])


def _remeshed_by_gmsh(size: int) -> tuple[Points, Indices]:
    import gmsh

    fine = shape_kidney(edge_length=2e-3)
    gmsh.initialize([], interruptible=False)
    gmsh.option.setNumber("General.Verbosity", 1)
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.model.addDiscreteEntity(2, 1)
    tags = np.arange(1, len(fine.points) + 1)
    gmsh.model.mesh.addNodes(2, 1, tags.tolist(), fine.points.ravel().tolist())
    gmsh.model.mesh.addElementsByType(1, 2, [], (fine.facets + 1).ravel().tolist())
    gmsh.model.mesh.classifySurfaces(math.pi, True, True, math.pi)
    gmsh.model.mesh.createGeometry()
    # Triangles of edge h have an area of sqrt(3)/4 h^2; gmsh makes them about 10 % shorter.
    edge = 1.1 * math.sqrt(fine.area / size * 4.0 / math.sqrt(3.0))
    for name in ("MeshSizeMin", "MeshSizeMax"):
        gmsh.option.setNumber(f"Mesh.{name}", edge)
    gmsh.model.mesh.generate(2)
    numbers, coordinates, _ = gmsh.model.mesh.getNodes()
    _, connectivity = gmsh.model.mesh.getElementsByType(2)
    gmsh.finalize()
    order = np.full(int(numbers.max()) + 1, -1)
    order[numbers] = np.arange(len(numbers))
    return coordinates.reshape(-1, 3), order[connectivity].reshape(-1, 3)


def _decimated(size: int) -> tuple[Points, Indices]:
    import pyvista

    fine = shape_kidney(edge_length=math.sqrt(0.0264 / (4.0 * size) * 4.0 / math.sqrt(3.0)))
    mesh = pyvista.PolyData.from_regular_faces(fine.points, fine.facets)
    coarse = mesh.decimate(1.0 - size / fine.num_facets)
    return np.asarray(coarse.points, dtype=float), coarse.regular_faces


def _marching_cubes(size: int) -> tuple[Points, Indices]:
    import pyvista

    fine = shape_kidney(edge_length=4e-3)
    mesh = pyvista.PolyData.from_regular_faces(fine.points, fine.facets)
    low, high = fine.points.min(axis=0), fine.points.max(axis=0)
    # A surface crosses about 2.5 triangles for each voxel face's worth of area.
    voxel = math.sqrt(2.5 * fine.area / size)
    counts = np.ceil((high - low) / voxel).astype(int) + 4
    grid = pyvista.ImageData(
        dimensions=counts.tolist(), spacing=(voxel,) * 3, origin=(low - 1.53 * voxel).tolist()
    )
    distance = grid.compute_implicit_distance(mesh)
    drawn = distance.contour([0.0], scalars="implicit_distance", method="flying_edges")
    return np.asarray(drawn.points, dtype=float), drawn.regular_faces


def _outward(points: Points, facets: Indices) -> tuple[Points, Indices]:
    used, numbers = np.unique(facets, return_inverse=True)
    facets = numbers.reshape(-1, 3).astype(np.int32)
    points = np.ascontiguousarray(points[used])
    return points, facets if TriSurface(points, facets).volume > 0.0 else facets[:, ::-1].copy()


def _main() -> None:
    kind, size, target = sys.argv[1:]
    make = {"gmsh": _remeshed_by_gmsh, "decimated": _decimated, "marching cubes": _marching_cubes}
    points, facets = _outward(*make[kind](int(size)))
    np.savez(target, points=points, facets=facets)
    print(json.dumps({"facets": len(facets)}))


if __name__ == "__main__":
    _main()
