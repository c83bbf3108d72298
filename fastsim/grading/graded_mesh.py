"""A mesh that is refined locally, with everything that hangs on it carried along.

Bisection of marked tetrahedra (Arnold, Mukherjee, Pouly 2000): no point ever hangs, and the
descendants of a cell have at most 72 shapes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.fastsim import _core
from palpate.meshes.arrays import Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh


class GradedMesh:
    """A mesh and its bisections.

    Args:
        mesh: Any conforming mesh; its facet and point groups are carried.
    """

    def __init__(self, mesh: TetMesh) -> None:
        self._given = mesh
        given = np.vstack([mesh.boundary_facets, *mesh.facet_groups.values()])
        self._followed, number = np.unique(np.sort(given, axis=1), axis=0, return_inverse=True)
        number = number.reshape(-1)
        bounds = np.cumsum([len(mesh.boundary_facets), *map(len, mesh.facet_groups.values())])
        parts = np.split(number, bounds[:-1])
        self._boundary_numbers = parts[0]
        self._group_numbers = dict(zip(mesh.facet_groups, parts[1:], strict=True))
        tags = self._number_of(mesh.cells[:, CELL_FACETS].reshape(-1, 3)).reshape(-1, 4)
        self._core = _core.BisectedMesh(
            np.array(mesh.points), np.array(mesh.cells), tags.astype(np.int32)
        )
        self._mesh: TetMesh | None = None
        self._refresh()

    @property
    def given(self) -> TetMesh:
        """The mesh at the start; its points keep their numbers."""
        return self._given

    @property
    def mesh(self) -> TetMesh:
        """The mesh as it is now, with its groups."""
        if self._mesh is None:
            facet_groups = {
                name: self._facets_within(numbers) for name, numbers in self._group_numbers.items()
            }
            point_groups = {
                name: self.carry_points(rows) for name, rows in self._given.point_groups.items()
            }
            self._mesh = TetMesh(self.points, self.cells, facet_groups, point_groups)
        return self._mesh

    def refine(self, marked: ArrayLike) -> None:
        """Bisect cells, and others until no point hangs.

        Args:
            marked: Which cells of `mesh`, shape (num_cells,) of bool.
        """
        self._core.refine(self._checked(marked))
        self._refresh()

    def carry_points(self, rows: ArrayLike) -> Indices:
        """Points of a set on the given mesh, with the new ones between them.

        A new point belongs where both ends of its edge do; in the middle of the body between two
        boundary points it does not.

        Args:
            rows: Points of the given mesh, shape (n,).
        """
        belongs = np.zeros(len(self.points), dtype=bool)
        belongs[np.asarray(rows, dtype=np.int64)] = True
        on_boundary = np.zeros(len(self.points), dtype=bool)
        on_boundary[self.carry_facets(self._given.boundary_facets)] = True
        # Parents come before their children, generation by generation.
        for new, (a, b) in self._by_generation():
            across = on_boundary[a] & on_boundary[b] & ~on_boundary[new]
            belongs[new] = belongs[a] & belongs[b] & ~across
        chosen: Indices = np.flatnonzero(belongs).astype(np.int32)
        return chosen

    def carry_facets(self, facets: ArrayLike) -> Indices:
        """Facets that lie in given boundary or group facets, outward, shape (m, 3).

        Raises:
            InputError: A facet that is neither on the given boundary nor in a group.
        """
        rows = np.asarray(facets, dtype=np.int64).reshape(-1, 3)
        numbers = self._number_of(rows)
        if np.any(numbers < 0):
            first = int(np.flatnonzero(numbers < 0)[0])
            raise InputError(
                f"facet {rows[first].tolist()} is neither on the boundary nor in a facet group; "
                "name it in a group of the given mesh"
            )
        return self._facets_within(numbers)

    def _by_generation(self) -> list[tuple[NDArray[Any], NDArray[Any]]]:
        """New points in groups whose parents are all in earlier groups, with their parents."""
        count = len(self._given.points)
        depth = np.zeros(len(self.points), dtype=np.int64)
        new = np.arange(count, len(self.points))
        a, b = self.point_parents[new].T
        while True:
            deeper = 1 + np.maximum(depth[a], depth[b])
            if np.array_equal(deeper, depth[new]):
                break
            depth[new] = deeper
        return [
            (new[depth[new] == d], self.point_parents[new[depth[new] == d]].T)
            for d in range(1, int(depth.max(initial=0)) + 1)
        ]

    def _refresh(self) -> None:
        cells, self._tags, self.given_cell, self.generation = self._core.leaves()
        self.cells: Indices = cells
        self.points: Points = self._core.points()
        self.point_parents: Indices = self._core.point_parents()
        self._mesh = None

    def _checked(self, marked: ArrayLike) -> NDArray[np.uint8]:
        flags = np.asarray(marked)
        if flags.shape != (len(self.cells),) or flags.dtype != np.bool_:
            raise InputError(
                f"marks need shape ({len(self.cells)},) of bool, got {flags.shape} of {flags.dtype}"
            )
        return np.ascontiguousarray(flags).astype(np.uint8)

    def _number_of(self, facets: NDArray[Any]) -> NDArray[np.int64]:
        """Row of each facet among the followed ones, -1 for others."""
        wanted = np.sort(facets, axis=1).astype(np.int64)
        both = np.vstack([self._followed, wanted])
        key = np.unique(both, axis=0, return_inverse=True)[1].reshape(-1)
        place = np.full(int(key.max(initial=0)) + 1, -1)
        place[key[: len(self._followed)]] = np.arange(len(self._followed))
        numbers: NDArray[np.int64] = place[key[len(self._followed) :]]
        return numbers

    def _facets_within(self, numbers: NDArray[np.int64]) -> Indices:
        wanted = np.zeros(len(self._followed) + 1, dtype=bool)
        wanted[numbers] = True
        wanted[-1] = False
        cell, side = np.nonzero(wanted[self._tags])
        rows = np.take_along_axis(self.cells[cell], CELL_FACETS[side], axis=1)
        # A facet within the body is seen from both of its cells.
        first = np.unique(np.sort(rows, axis=1), axis=0, return_index=True)[1]
        found: Indices = np.ascontiguousarray(rows[np.sort(first)])
        return found
