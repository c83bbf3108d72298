"""Vertices in cells: of another body, or of the same one (section IV).

Boundary vertices are hashed into voxels (Teschner et al. 2003) that fit the cells; a mesh with
cells of several sizes has several voxel sizes, a factor of two apart. From step to step only the
vertices that changed their voxel are touched.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.meshes.arrays import Indices, Points
from palpate.meshes.errors import InputError, NonFiniteError
from palpate.meshes.tet_mesh import TetMesh

# Voxels are numbered in 32 bits.
_MOST_VOXELS = 2.0**30


@dataclass(frozen=True, eq=False)
class Overlaps:
    """Vertices found in cells.

    Attributes:
        vertices: Point of the intruding body, ascending, shape (n,).
        cells: Cell that holds it, shape (n,).
        weights: Barycentric weights of the cell's corners [-], >= 0, sum 1, shape (n, 4).
    """

    vertices: Indices
    cells: Indices
    weights: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.vertices)


class VertexCellDetector:
    """Finds the boundary vertices of one body in the cells of another, step after step.

    A vertex is in a cell when it is in the cell's box and no barycentric weight, as computed, is
    negative; a cell that is inverted at the time holds nothing. A vertex on the side between two
    cells is found in either or both.

    Args:
        mesh: Body whose cells are looked at.
        intruder: Body whose boundary vertices are looked for; None is the same body, whose own
            corners do not count.
    """

    def __init__(self, mesh: TetMesh, intruder: TetMesh | None = None) -> None:
        self._mesh = mesh
        self._intruder = mesh if intruder is None else intruder
        vertices = np.unique(self._intruder.boundary_facets).astype(np.int32)
        self._core = _core.VerticesInCells(
            np.array(mesh.points), np.array(mesh.cells), vertices, intruder is None
        )
        self._smallest_voxel = min(self._core.voxel_sizes())

    @property
    def voxel_sizes(self) -> list[float]:
        """Sides of the voxels used [m], ascending."""
        return list(self._core.voxel_sizes())

    @property
    def work(self) -> dict[str, int]:
        """Of the last step: voxel changes, cells near vertices, and pairs tested."""
        names = ("rehashed", "cells_near", "pairs_tested")
        return dict(zip(names, map(int, self._core.work()), strict=True))

    def find(self, points: Points, intruder_points: Points | None = None) -> Overlaps:
        """Find all overlaps where the bodies are now.

        Args:
            points: Of the body with the cells [m], shape (num_points, 3).
            intruder_points: Of the other body [m]; None for the same body.

        Raises:
            InputError: Wrong shape, not finite, or further from the origin than voxels can be
                numbered.
        """
        here = self._checked(points, self._mesh)
        there = here if intruder_points is None else self._checked(intruder_points, self._intruder)
        pairs, weights = self._core.find(there, here)
        return Overlaps(pairs[:, 0], pairs[:, 1], weights)

    def find_by_brute_force(
        self, points: Points, intruder_points: Points | None = None
    ) -> Overlaps:
        """Every vertex against every cell: the oracle of `find`."""
        here = self._checked(points, self._mesh)
        there = here if intruder_points is None else self._checked(intruder_points, self._intruder)
        vertices = np.unique(self._intruder.boundary_facets).astype(np.int32)
        pairs, weights = _core.find_vertices_in_cells_brute_force(
            there, vertices, here, np.array(self._mesh.cells), self._intruder is self._mesh
        )
        return Overlaps(pairs[:, 0], pairs[:, 1], weights)

    def _checked(self, points: Points, mesh: TetMesh) -> Points:
        array = np.ascontiguousarray(points, dtype=np.float64)
        if array.shape != mesh.points.shape:
            raise InputError(f"points need shape {mesh.points.shape}, got {array.shape}")
        largest = float(np.abs(array).max())
        if not np.isfinite(largest):
            raise NonFiniteError(np.flatnonzero(~np.isfinite(array).all(axis=1)).tolist())
        if largest > _MOST_VOXELS * self._smallest_voxel:
            raise InputError(
                f"a point is {largest:.3g} m from the origin, too far for voxels of "
                f"{self._smallest_voxel:.3g} m; move the scene to the origin, or stop the run"
            )
        return array
