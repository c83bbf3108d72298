"""TetMesh: an immutable, checked mesh of four-node tetrahedra."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points, checked_indices, checked_points
from palpate.meshes.errors import InvertedCellError, MeshError
from palpate.meshes.tri_surface import TriSurface

# Facet k of a positive cell lies opposite its vertex k; seen from outside, counter-clockwise.
CELL_FACETS = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]], dtype=np.int32)
# Local corners of the six edges of a cell.
EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])

# Cells processed at once: few enough for the processor's cache.
_BLOCK = 2048


def signed_volumes(points: Points, cells: Indices) -> Floats:
    """Signed volume of each cell, det(x1 - x0, x2 - x0, x3 - x0) / 6 [m3], shape (num_cells,)."""
    volumes = np.empty(len(cells))
    coordinates = np.ascontiguousarray(points.T)
    for first in range(0, len(cells), _BLOCK):
        # Corner by corner and axis by axis, so that numpy works on long rows.
        corners = np.ascontiguousarray(cells[first : first + _BLOCK].T, dtype=np.intp)
        x, y, z = coordinates.take(corners, axis=1)
        for along in (x, y, z):
            along[1:] -= along[0]
        volumes[first : first + _BLOCK] = (
            (y[1] * z[2] - z[1] * y[2]) * x[3]
            + (x[1] * y[2] - y[1] * x[2]) * z[3]
            + (z[1] * x[2] - x[1] * z[2]) * y[3]
        ) / 6.0
    return volumes


def outer_facets(cells: Indices, num_points: int) -> tuple[Indices, Indices]:
    """Facets of one of the cells only, outward, (n, 3), and the row of that cell, (n,)."""
    facets = cells[:, CELL_FACETS].reshape(-1, 3)
    # Both cells of a facet give it the same smallest, middle and largest point.
    a, b, c = (facets[:, k].astype(np.int64) for k in range(3))
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    middle = a + b + c - low - high
    # One whole number for two of the points; for all three where it fits 63 bits.
    pair = middle * num_points + high
    if num_points < 2**21:
        key = low * num_points**2 + pair
        order = np.argsort(key)
        same = key[order[1:]] == key[order[:-1]]
    else:
        order = np.lexsort([pair, low])
        same = (low[order[1:]] == low[order[:-1]]) & (pair[order[1:]] == pair[order[:-1]])
    shared = np.zeros(len(facets), dtype=bool)
    shared[order[1:][same]] = True
    shared[order[:-1][same]] = True
    rows = np.flatnonzero(~shared)
    return np.ascontiguousarray(facets[rows]), (rows // 4).astype(np.int32)


@dataclass(frozen=True, eq=False)
class TetMesh:
    """A solid made of tetrahedra; checked on construction, immutable afterwards.

    Args:
        points: Rest positions [m], shape (num_points, 3), finite.
        cells: Point indices, shape (num_cells, 4), every signed volume > 0.
        facet_groups: Named sets of boundary facets, each shape (n, 3).
        point_groups: Named sets of points, each shape (n,).
        cell_groups: Named sets of cells by their indices, each shape (n,).

    Raises:
        ShapeError: An array has the wrong shape or type.
        NonFiniteError: A coordinate is NaN or infinite.
        IndexRangeError: An index is outside the points.
        InvertedCellError: A cell is inverted or flat.
        MeshError: No cells, or points that no cell uses.

    >>> import palpate
    >>> corner = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    >>> one = palpate.TetMesh(corner, [[0, 1, 2, 3]])
    >>> one.num_cells, len(one.boundary_facets), round(6.0 * one.volume, 12)
    (1, 4, 1.0)
    """

    points: Points
    cells: Indices
    facet_groups: Mapping[str, Indices] = field(default_factory=dict)
    point_groups: Mapping[str, Indices] = field(default_factory=dict)
    cell_groups: Mapping[str, Indices] = field(default_factory=dict)

    def __post_init__(self) -> None:
        points = checked_points(self.points)
        cells = checked_indices(self.cells, 4, len(points), "cells")
        if len(cells) == 0:
            raise MeshError("the mesh has no tetrahedra; give a volume mesh, or mesh the surface")
        volumes = signed_volumes(points, cells)
        bad = np.flatnonzero(~(volumes > 0.0))
        if bad.size:
            raise InvertedCellError(bad.tolist(), volumes[bad].tolist())
        unused = np.flatnonzero(np.bincount(cells.ravel(), minlength=len(points)) == 0)
        if unused.size:
            raise MeshError(
                f"{unused.size} point(s) belong to no cell, first {int(unused[0])}; drop them"
            )
        keep = object.__setattr__
        keep(self, "points", points)
        keep(self, "cells", cells)
        volumes.setflags(write=False)
        keep(self, "cell_volumes", volumes)  # found already
        for kind, given, width, most in (
            ("facets", self.facet_groups, 3, len(points)),
            ("points", self.point_groups, 1, len(points)),
            ("cells", self.cell_groups, 1, len(cells)),
        ):
            groups = {
                name: checked_indices(rows, width, most, f"{kind} of {name!r}")
                for name, rows in given.items()
            }
            keep(self, f"{kind[:-1]}_groups", MappingProxyType(groups))

    def __reduce__(self) -> tuple[type[TetMesh], tuple[Any, ...]]:
        # A read-only view of a dict cannot be pickled; the dict can.
        groups = dict(self.facet_groups), dict(self.point_groups), dict(self.cell_groups)
        return TetMesh, (self.points, self.cells, *groups)

    def __repr__(self) -> str:
        return f"<TetMesh of {self.num_points} points and {self.num_cells} cells>"

    @property
    def num_points(self) -> int:
        """Number of points."""
        return len(self.points)

    @property
    def num_cells(self) -> int:
        """Number of tetrahedra."""
        return len(self.cells)

    @cached_property
    def boundary_facets(self) -> Indices:
        """Facets of one cell only, counter-clockwise seen from outside, shape (n, 3)."""
        boundary = outer_facets(self.cells, self.num_points)[0]
        boundary.setflags(write=False)
        return boundary

    @cached_property
    def cell_volumes(self) -> Floats:
        """Rest volume of each cell [m3], > 0, shape (num_cells,)."""
        volumes = signed_volumes(self.points, self.cells)
        volumes.setflags(write=False)
        return volumes

    @cached_property
    def volume(self) -> float:
        """Rest volume [m3]."""
        return float(self.cell_volumes.sum())

    @cached_property
    def surface_area(self) -> float:
        """Rest area of the boundary [m2]."""
        return self.surface().area

    def surface(self, displacement: Points | None = None) -> TriSurface:
        """The boundary as a surface on all points, moved by a displacement when one is given."""
        points = self.points if displacement is None else self.points + displacement
        return TriSurface(points, self.boundary_facets)
