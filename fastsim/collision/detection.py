"""Vertices in cells: of another body, or of the same one (section IV).

Boundary vertices are hashed into voxels (after Teschner et al. 2003) that fit the cells; a mesh
with cells of several sizes has several voxel sizes, a factor of two or more apart. Cells lie in
compact blocks; in each step only blocks that the other body's vertices come near are looked into.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.instruction_sets import chosen_instruction_set
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.tet_mesh import TetMesh


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
    weights: Floats

    def __len__(self) -> int:
        return len(self.vertices)


class VertexCellDetector:
    """Finds the boundary vertices of one body in the cells of another, step after step.

    A vertex is in a cell when it is in the cell's box and no barycentric weight, as computed, is
    negative; a cell that is inverted at the time holds nothing. A vertex on the side between two
    cells is found in either or both. Nothing is assumed of how far points move in a step.

    Args:
        mesh: Body whose cells are looked at.
        intruder: Body whose boundary vertices are looked for; None is the same body, whose own
            corners do not count.
        num_threads: At least 1; they wait between calls. What is found does not depend on it.
    """

    def __init__(
        self, mesh: TetMesh, intruder: TetMesh | None = None, *, num_threads: int = 1
    ) -> None:
        self._mesh = mesh
        self._intruder = mesh if intruder is None else intruder
        self._vertices = np.unique(self._intruder.boundary_facets).astype(np.int32)
        self._core = _core.VerticesInCells(
            mesh.points,
            mesh.cells,
            self._vertices,
            intruder is None,
            at_least_one(num_threads),
            chosen_instruction_set(),
        )

    @property
    def voxel_sizes(self) -> list[float]:
        """Sides of the voxels used [m], ascending."""
        return list(self._core.voxel_sizes())

    @property
    def work(self) -> dict[str, int]:
        """Of the last step: vertices hashed, cells near vertices, and pairs tested."""
        names = ("hashed", "cells_near", "pairs_tested")
        return dict(zip(names, map(int, self._core.work()), strict=True))

    def find(self, points: Points, intruder_points: Points | None = None) -> Overlaps:
        """Find all overlaps where the bodies are now.

        Args:
            points: Of the body with the cells [m], shape (num_points, 3).
            intruder_points: Of the other body [m]; None for the same body.

        Raises:
            InputError: Wrong shape.
            NonFiniteError: A point of the cells or a boundary vertex is NaN or infinite.
        """
        here, there = self._arrays(points, intruder_points)
        pairs, weights = self._core.find(there, here)
        return Overlaps(pairs[:, 0], pairs[:, 1], weights)

    def find_by_brute_force(
        self, points: Points, intruder_points: Points | None = None
    ) -> Overlaps:
        """Every vertex against every cell: the oracle of `find`, whose arguments it takes."""
        here, there = self._arrays(points, intruder_points)
        pairs, weights = _core.find_vertices_in_cells_brute_force(
            there, self._vertices, here, self._mesh.cells, self._intruder is self._mesh
        )
        return Overlaps(pairs[:, 0], pairs[:, 1], weights)

    def _arrays(self, points: Points, intruder_points: Points | None) -> tuple[Points, Points]:
        here = shaped_as(self._mesh.points, points)
        if intruder_points is None:
            if self._intruder is not self._mesh:
                raise InputError("two bodies: give the points of the intruder as well")
            return here, here
        return here, shaped_as(self._intruder.points, intruder_points)


def at_least_one(num_threads: int) -> int:
    """The number of threads, refused where there would be none."""
    if num_threads < 1:
        raise InputError(f"num_threads = {num_threads}; it must be at least 1")
    return num_threads


def shaped_as(rest: Points, points: Points) -> Points:
    """Points as the core takes them, refused where their shape is not that at rest."""
    array = np.ascontiguousarray(points, dtype=np.float64)
    if array.shape != rest.shape:
        raise InputError(f"points need shape {rest.shape}, got {array.shape}")
    return array
