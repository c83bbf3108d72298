"""Local refinement: chosen cells are cut at the midpoints of all their edges, and no point hangs.

Every facet with a cut edge is cut at its longest edge too, which keeps the shapes bounded in
practice (A. Plaza, G. F. Carey, Appl. Numer. Math. 32, 2000); a cell with all edges cut becomes
eight. Edges are cut one after the other, longest first by one order of the whole mesh, so that two
cells cut their common facet in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.meshes.refinement import EDGES, carry_problem
from palpate.meshes.tet_mesh import TetMesh

# Edges of each facet of a cell, by their number in EDGES.
_FACET_EDGES = np.array([[3, 4, 5], [1, 2, 5], [0, 2, 4], [0, 1, 3]])
_FACET_PAIRS = np.array([[0, 1], [0, 2], [1, 2]])
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LocallyRefined:
    """A problem on a locally refined mesh.

    Attributes:
        problem: On the new mesh, whose first points are the old ones in their order.
        given_cell: The old cell that each new one lies in, shape (num_cells,).
    """

    problem: Problem
    given_cell: Indices


def refine_cells(problem: Problem, marked: NDArray[np.bool_]) -> LocallyRefined:
    """Halve the edges of the marked cells, and cut others as far as no point hangs.

    Supports, loads and tools keep their facets' area, inclusions their volume, forces on points
    their points.

    Args:
        problem: On any mesh.
        marked: Which of its cells, shape (num_cells,) of bool.

    Returns:
        The same problem on the finer mesh of the same body.

    Raises:
        InputError: Marks of the wrong shape or type.
    """
    mesh = problem.mesh
    flags = np.asarray(marked)
    if flags.shape != (mesh.num_cells,) or flags.dtype != np.bool_:
        raise InputError(
            f"marks need shape ({mesh.num_cells},) of bool, got {flags.shape} of {flags.dtype}"
        )
    cut = _Cut(mesh, flags)
    cells, given_cell = cut.simplices(mesh.cells, EDGES)
    refined = TetMesh(
        cut.points,
        cells.astype(np.int32),
        {name: cut.facets(rows) for name, rows in mesh.facet_groups.items()},
        {name: cut.between(rows) for name, rows in mesh.point_groups.items()},
    )
    return LocallyRefined(carry_problem(problem, refined, given_cell, cut.facets), given_cell)


class _Cut:
    """The edges that are cut, each with its midpoint, after the mesh's own points."""

    def __init__(self, mesh: TetMesh, marked: NDArray[np.bool_]) -> None:
        self._num_given = mesh.num_points
        pairs = mesh.cells[:, EDGES].reshape(-1, 2).astype(np.int64)
        keys, edge_of = np.unique(self._key(pairs), return_inverse=True)
        edges_of_cells = edge_of.reshape(-1, 6)
        ends = np.column_stack(np.divmod(keys, self._num_given))
        lengths = np.linalg.norm(mesh.points[ends[:, 0]] - mesh.points[ends[:, 1]], axis=1)
        rank = np.empty(len(keys), dtype=np.int64)
        rank[np.lexsort([keys, lengths])] = np.arange(len(keys))
        is_cut = np.zeros(len(keys), dtype=bool)
        is_cut[edges_of_cells[marked]] = True
        facets = edges_of_cells[:, _FACET_EDGES].reshape(-1, 3)
        longest = np.take_along_axis(facets, rank[facets].argmax(axis=1)[:, None], axis=1)[:, 0]
        while True:
            wanted = longest[is_cut[facets].any(axis=1)]
            if is_cut[wanted].all():
                break
            is_cut[wanted] = True
        self._keys, self._rank, self._ends = keys[is_cut], rank[is_cut], ends[is_cut]
        middle: Points = mesh.points[self._ends].mean(axis=1)
        self.points: Points = np.vstack([mesh.points, middle])

    def _key(self, pairs: Integers) -> Integers:
        low, high = pairs.min(axis=-1), pairs.max(axis=-1)
        # Of an edge to a new point: no key of the given mesh's.
        key: Integers = np.where(high < self._num_given, low * self._num_given + high, -1)
        return key

    def simplices(self, corners: Indices, edges: Integers) -> tuple[Integers, Indices]:
        """Cut cells or facets until none has an edge that is cut.

        Returns:
            The new ones, turned as the old ones were, and which old one each lies in.
        """
        done: list[Integers] = []
        done_of: list[Integers] = []
        rows = corners.astype(np.int64)
        given = np.arange(len(rows))
        while len(rows):
            keys = self._key(rows[:, edges])
            place = np.searchsorted(self._keys, keys)
            place[place == len(self._keys)] = 0
            is_cut = (keys >= 0) & (self._keys[place] == keys) if len(self._keys) else keys < -1
            active = is_cut.any(axis=1)
            done.append(rows[~active])
            done_of.append(given[~active])
            rows, given, place = rows[active], given[active], place[active]
            rank = np.where(is_cut[active], self._rank[place], -1) if len(rows) else place
            first = rank.argmax(axis=1) if len(rows) else np.zeros(0, dtype=np.int64)
            here = np.arange(len(rows))
            middle = self._num_given + place[here, first]
            halves = []
            for side in (0, 1):
                half = rows.copy()
                half[here, edges[first, side]] = middle
                halves.append(half)
            rows, given = np.vstack(halves), np.concatenate([given, given])
        every, owner = np.vstack(done), np.concatenate(done_of)
        order = np.argsort(owner, kind="stable")
        return every[order], owner[order].astype(np.int32)

    def facets(self, facets: Indices) -> Indices:
        """The parts of some facets, turned as they were, shape (n, 3)."""
        if len(facets) == 0:
            return np.zeros((0, 3), dtype=np.int32)
        parts: Indices = self.simplices(np.asarray(facets), _FACET_PAIRS)[0].astype(np.int32)
        return parts

    def between(self, chosen: Indices) -> Indices:
        """The chosen points and the midpoints of cut edges whose two ends are chosen."""
        inside = np.isin(self._ends, chosen).all(axis=1)
        both: Indices = np.concatenate([chosen, np.flatnonzero(inside) + self._num_given])
        return both.astype(np.int32)
