"""Patches of cells, and PETSc matrices of averages over them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.reference.fenicsx import COMM, PETSc


@dataclass(frozen=True, eq=False)
class Patches:
    """Cells of one material around each edge, or around each node, and their volumes [m3].

    `of_cell` is the patches of each cell, shape (num_cells, 6) for edges, (num_cells, 4) for nodes;
    to the volume of each of them it adds an equal part of its own.
    """

    of_cell: Indices
    volumes: Floats


def row_vector(matrix: Any, values: Floats) -> Any:
    """A vector of one value for each row of a PETSc matrix."""
    vector = matrix.createVecLeft()
    vector.array[:] = values
    return vector


def with_rows_scaled(matrix: Any, factors: Floats) -> Any:
    """A copy of a PETSc matrix with its rows times factors."""
    copy = matrix.copy()
    copy.diagonalScale(L=row_vector(copy, factors))
    return copy


def sparse_matrix(rows: Indices, columns: Indices, values: Floats, shape: tuple[int, int]) -> Any:
    """The PETSc matrix with these entries, each of which occurs once."""
    order = np.lexsort((columns, rows))
    starts = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=shape[0]))])
    csr = (starts.astype(PETSc.IntType), columns[order].astype(PETSc.IntType), values[order])
    return PETSc.Mat().createAIJ(shape, csr=csr, comm=COMM)
