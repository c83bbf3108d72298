"""Refinement of tetrahedra, uniform or local, with new points on the old straight edges."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Integers, Mask, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, on_other_mesh
from palpate.meshes.tet_mesh import EDGES, TetMesh, signed_volumes

# The octahedron left inside is cut along one of three diagonals, given as the midpoints of
# opposite edges; around it the four other midpoints in turn.
_DIAGONALS = (
    ((0, 5), (1, 3, 4, 2)),  # 01-23
    ((1, 4), (0, 2, 5, 3)),  # 02-13
    ((2, 3), (0, 1, 5, 4)),  # 03-12
)


def refine_uniformly(mesh: TetMesh) -> TetMesh:
    """Cut each cell into eight by its edges' midpoints, the inner diagonal the shortest.

    Returns:
        A mesh of eight times the cells on the same domain; the old points come first, in
        their order; facet groups cover the same area, point groups gain the midpoints between
        their points.
    """
    midpoints = _EdgeMidpoints(mesh)
    corners = mesh.cells.astype(np.int64)
    m = midpoints.of(corners[:, EDGES].reshape(-1, 2)).reshape(-1, 6)
    points = midpoints.points
    c0, c1, c2, c3 = corners.T
    m01, m02, m03, m12, m13, m23 = m.T
    children = [
        np.column_stack(rows)
        for rows in ((c0, m01, m02, m03), (m01, c1, m12, m13), (m02, m12, c2, m23),
                     (m03, m13, m23, c3))
    ]  # fmt: skip
    lengths = np.stack(
        [np.linalg.norm(points[m[:, a]] - points[m[:, b]], axis=1) for (a, b), _ in _DIAGONALS]
    )
    chosen = lengths.argmin(axis=0)
    inner = np.empty((len(corners), 4, 4), dtype=np.int64)
    for which, ((a, b), around) in enumerate(_DIAGONALS):
        rows = chosen == which
        for k in range(4):
            inner[rows, k] = m[rows][:, [a, b, around[k], around[(k + 1) % 4]]]
    cells = np.vstack([*children, inner.reshape(-1, 4)])
    mirrored = signed_volumes(points, cells) < 0.0
    cells[mirrored] = cells[mirrored][:, [0, 2, 1, 3]]
    return TetMesh(
        points,
        cells.astype(np.int32),
        {name: midpoints.facets(rows) for name, rows in mesh.facet_groups.items()},
        {name: midpoints.between(rows) for name, rows in mesh.point_groups.items()},
    )


def refine_problem(problem: Problem) -> Problem:
    """The same problem on the uniformly refined mesh, eight cells for each, of the same volume.

    Point forces stay on their points. Facet loads cover the same area, tools may touch the same
    facets, inclusions fill the same cells.

    Args:
        problem: On any mesh.

    Returns:
        The problem with all its parts carried over.
    """
    midpoints = _EdgeMidpoints(problem.mesh)
    # In the order of the cells of `refine_uniformly`: four corners, then four inside.
    given = np.arange(problem.mesh.num_cells)
    given_cell = np.concatenate([np.tile(given, 4), np.repeat(given, 4)])
    return on_other_mesh(
        problem,
        refine_uniformly(problem.mesh),
        facets=midpoints.facets,
        cells=partial(_cells_within, given_cell),
    )


def _cells_within(given_cell: Integers | Indices, chosen: Indices) -> Indices:
    """Cells of a refined mesh that lie in chosen cells of the given one."""
    return np.flatnonzero(np.isin(given_cell, chosen)).astype(np.int32)


def at_refined_points(mesh: TetMesh, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """A field linear in each cell, (num_points, ...), at the points of `refine_uniformly`."""
    first, second = _EdgeMidpoints(mesh).ends.T
    return np.concatenate([values, 0.5 * (values[first] + values[second])])


def mean_over_parents(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means over a mesh's cells, (num_cells, ...), from those over its refinement's, 8 for each.

    The plain mean of eight in the order of `refine_uniformly`, since they have the same volume.
    """
    half, rest = len(values) // 2, values.shape[1:]
    corners = values[:half].reshape(4, -1, *rest).mean(axis=0)
    inside = values[half:].reshape(-1, 4, *rest).mean(axis=1)
    mean: NDArray[np.float64] = 0.5 * (corners + inside)
    return mean


class _Midpoints:
    """Numbers the midpoints of edges of a mesh, by ascending `_edge_keys`, after its points."""

    def __init__(self, mesh: TetMesh, keys: Integers) -> None:
        self.num_given = mesh.num_points
        self.keys = keys
        self.ends: Integers = np.column_stack(np.divmod(keys, mesh.num_points))
        middle: Points = mesh.points[self.ends].mean(axis=1)
        self.points: Points = np.vstack([mesh.points, middle])

    def between(self, chosen: Indices) -> Indices:
        """The chosen points and the midpoints of these edges whose two ends are chosen."""
        inside = np.isin(self.ends, chosen).all(axis=1)
        both: Indices = np.concatenate([chosen, np.flatnonzero(inside) + self.num_given])
        return both.astype(np.int32)


def _edge_keys(pairs: Integers, num_points: int) -> Integers:
    """One number for the edge between two points, (..., 2), whichever comes first."""
    keys: Integers = pairs.min(axis=-1) * num_points + pairs.max(axis=-1)
    return keys


class _EdgeMidpoints(_Midpoints):
    """The midpoint of every edge of a mesh."""

    def __init__(self, mesh: TetMesh) -> None:
        pairs = mesh.cells[:, EDGES].astype(np.int64)
        super().__init__(mesh, np.unique(_edge_keys(pairs, mesh.num_points)))

    def of(self, pairs: Integers) -> Integers:
        """Point index of the midpoint of each edge, shape (n,)."""
        position = np.searchsorted(self.keys, _edge_keys(pairs, self.num_given))
        return np.asarray(position + self.num_given, dtype=np.int64)

    def facets(self, facets: Indices) -> Indices:
        """The four parts of each facet, with the same orientation, shape (4 n, 3)."""
        a, b, c = facets.astype(np.int64).reshape(-1, 3).T
        ab, bc, ca = (self.of(np.column_stack(p)) for p in ((a, b), (b, c), (c, a)))
        rows = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        return np.vstack([np.column_stack(row) for row in rows]).astype(np.int32)


# Local refinement: marked cells are cut at the midpoints of all their edges, and no point hangs.
# Every facet with a cut edge is cut at its longest edge too, which keeps the shapes bounded in
# practice (A. Plaza, G. F. Carey, Appl. Numer. Math. 32, 2000); a cell with all edges cut becomes
# eight. Edges are cut one after the other, longest first by one order of the whole mesh, so that
# two cells cut their common facet in the same way.

# Edges of each facet of a cell, by their number in EDGES.
_FACET_EDGES = np.array([[3, 4, 5], [1, 2, 5], [0, 2, 4], [0, 1, 3]])
_FACET_PAIRS = np.array([[0, 1], [0, 2], [1, 2]])


@dataclass(frozen=True, eq=False)
class LocallyRefined:
    """A problem on a locally refined mesh, whose first points are the old ones in their order.

    `given_cell` is the old cell in which each new one lies, shape (num_cells,).
    """

    problem: Problem
    given_cell: Indices


def refine_cells(problem: Problem, marked: Mask) -> LocallyRefined:
    """Halve the edges of the marked cells, shape (num_cells,), and cut until no point hangs.

    Supports, loads and tools keep their facets' area, inclusions their volume, forces on points
    their points.

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
    carried = on_other_mesh(
        problem, refined, facets=cut.facets, cells=partial(_cells_within, given_cell)
    )
    return LocallyRefined(carried, given_cell)


class _Cut(_Midpoints):
    """The midpoints of the edges that are cut, and the parts of cells and facets."""

    def __init__(self, mesh: TetMesh, marked: Mask) -> None:
        pairs = mesh.cells[:, EDGES].astype(np.int64)
        keys, edge_of = np.unique(_edge_keys(pairs, mesh.num_points), return_inverse=True)
        edges_of_cells = edge_of.reshape(-1, 6)
        first, second = np.divmod(keys, mesh.num_points)
        lengths = np.linalg.norm(mesh.points[first] - mesh.points[second], axis=1)
        rank = np.argsort(np.lexsort([keys, lengths]))
        is_cut = np.zeros(len(keys), dtype=bool)
        is_cut[edges_of_cells[marked]] = True
        facets = edges_of_cells[:, _FACET_EDGES].reshape(-1, 3)
        longest = np.take_along_axis(facets, rank[facets].argmax(axis=1)[:, None], axis=1)[:, 0]
        while True:
            wanted = longest[is_cut[facets].any(axis=1)]
            if is_cut[wanted].all():
                break
            is_cut[wanted] = True
        super().__init__(mesh, keys[is_cut])
        self._rank = rank[is_cut]

    def simplices(self, corners: Indices, edges: Integers) -> tuple[Integers, Indices]:
        """Cut cells or facets until none has an edge that is cut.

        Returns:
            The new ones, oriented as the old ones, and in which old one each lies.
        """
        done: list[Integers] = []
        done_of: list[Integers] = []
        rows = corners.astype(np.int64)
        given = np.arange(len(rows))
        while True:
            pairs = rows[:, edges]
            keys = _edge_keys(pairs, self.num_given)
            # An edge to a new point is no edge of the given mesh.
            is_cut = (pairs < self.num_given).all(axis=-1) & np.isin(keys, self.keys)
            number = np.searchsorted(self.keys, keys)
            active = is_cut.any(axis=1)
            done.append(rows[~active])
            done_of.append(given[~active])
            if not active.any():
                break
            rows, given, is_cut = rows[active], given[active], is_cut[active]
            number = np.where(is_cut, number[active], 0)
            first = np.where(is_cut, self._rank[number], -1).argmax(axis=1)
            here = np.arange(len(rows))
            middle = self.num_given + number[here, first]
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
        """The parts of some facets, oriented as they were, shape (n, 3)."""
        return self.simplices(np.asarray(facets), _FACET_PAIRS)[0].astype(np.int32)
