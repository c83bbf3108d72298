"""Hebert's symbolic refinement of a cube: section V of the paper.

A cell is a name: its generation, a corner, and three signed axes. Children, parents and neighbours
are worked out from names alone; the calculus is in fastsim/core/grading/cell_name.cpp. On a cube
the cells are those of `GradedMesh`, found another way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.fastsim import _core
from palpate.fastsim.grading.size_fields import SizeField, TooManyCellsError, mean_edges
from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.tet_mesh import TetMesh, signed_volumes

CellName = _core.CellName
# Corners are whole numbers in units of this part of the cube's side.
UNIT = 2.0**-16


class SymbolicCube:
    """The unit cube in Kuhn's six tetrahedra, refined by names."""

    def __init__(self) -> None:
        self._core = _core.SymbolicCube()

    @property
    def num_cells(self) -> int:
        """Number of cells."""
        return int(self._core.num_cells())

    @property
    def names(self) -> list[CellName]:
        """The cells, in ascending order of their codes."""
        return list(self._core.cells())

    @property
    def corners(self) -> Floats:
        """Corners of the cells, in the same order, exact, shape (num_cells, 4, 3)."""
        return UNIT * self._core.corners().reshape(-1, 4, 3).astype(np.float64)

    @property
    def mesh(self) -> TetMesh:
        """The cells as a mesh of the unit cube."""
        corners = self.corners
        points, number = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        cells = number.reshape(-1, 4).astype(np.int32)
        mirrored = signed_volumes(points, cells) < 0.0
        cells[mirrored] = cells[mirrored][:, [0, 1, 3, 2]]
        return TetMesh(points, cells)

    def refine(self, marked: ArrayLike) -> None:
        """Bisect the marked cells, and others until no point hangs.

        Args:
            marked: Shape (num_cells,) of bool, in the order of `names`.

        Raises:
            InputError: Wrong shape, or cells smaller than names can represent (2^-14 of the side).
        """
        flags = np.asarray(marked)
        if flags.shape != (self.num_cells,) or flags.dtype != np.bool_:
            raise InputError(f"marks need shape ({self.num_cells},) of bool, got {flags.shape}")
        if not self._core.refine(np.ascontiguousarray(flags).astype(np.uint8)):
            raise InputError("cells smaller than 2^-14 of the side have no names; refine less")

    def refine_to_size(self, size: SizeField, *, max_cells: int = 5_000_000) -> None:
        """Bisect until no cell's edges are on average longer than the field asks for."""
        while True:
            corners = self.corners
            cells = np.arange(4 * len(corners), dtype=np.int32).reshape(-1, 4)
            edges = mean_edges(corners.reshape(-1, 3), cells)
            marked = edges > size(corners.mean(axis=1))
            if not marked.any():
                return
            if self.num_cells + int(marked.sum()) > max_cells:
                raise TooManyCellsError(self.num_cells, max_cells)
            self.refine(marked)
