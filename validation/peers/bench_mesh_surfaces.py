"""Surfaces for `palpate bench mesh`, none made by palpate's own triangulation.

A fine kidney is the geometry. gmsh's surface mesher covers it with the wanted number of
triangles; VTK decimates it, and draws it anew by marching cubes (flying edges).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from palpate.meshes.kidney import shape_kidney
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.peers.bench_children import ChildFailedError, Schedule, Tool, timed

_GMSH = Tool("gmsh", "gmsh_meshes", "pip install gmsh")
_VTK = Tool("VTK", "pyvista_surfaces", "pip install pyvista")
# Equilateral triangles of edge h have an area of sqrt(3)/4 h^2.
_EDGE_SQUARED = 4.0 / math.sqrt(3.0)


def make_surface(kind: str, size: int) -> TriSurface:
    """Make a kidney of about `size` triangles in a child process: gmsh may abort.

    Args:
        kind: "gmsh", "decimated" or "marching cubes".
        size: Number of triangles, about.

    Raises:
        ChildFailedError: gmsh or VTK is missing or failed.
    """
    options: dict[str, Any]
    if kind == "gmsh":
        fine, tool = shape_kidney(edge_length=2e-3), _GMSH
        # It makes them about 10 % shorter.
        options = {"edge_length": 1.1 * math.sqrt(fine.area / size * _EDGE_SQUARED)}
    elif kind == "decimated":
        fine, tool = (
            shape_kidney(edge_length=math.sqrt(0.0264 / (4.0 * size) * _EDGE_SQUARED)),
            _VTK,
        )
        options = {"size": size}
    else:
        fine, tool = shape_kidney(edge_length=4e-3), _VTK
        # A surface crosses about 2.5 triangles for each voxel face's worth of area.
        options = {"voxel": math.sqrt(2.5 * fine.area / size)}
    job = {"points": fine.points, "facets": fine.facets, **options}
    said: list[str] = []
    with timed((tool,), "Surface", job, Schedule(turns=1), said.append) as children:
        if not children:
            raise ChildFailedError(said[0] if said else f"{tool.name} is missing; {tool.install}")
        made = children[0].answer
    used, numbers = np.unique(made["facets"], return_inverse=True)
    facets = numbers.reshape(-1, 3).astype(np.int32)
    surface = TriSurface(np.ascontiguousarray(made["points"][used]), facets)
    return surface if surface.volume > 0.0 else TriSurface(surface.points, facets[:, ::-1].copy())
