"""Uniform refinement: every tetrahedron into eight, points on the old straight edges."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.boundary_conditions import Load, Pressure, Traction
from palpate.meshes.problem import Problem
from palpate.meshes.tet_mesh import TetMesh

# Local corners of the edges of a cell.
EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
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
        their order; facet groups are carried, point groups gain the midpoints between them.
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
            side = m[rows][:, [a, b, around[k], around[(k + 1) % 4]]]
            inner[rows, k] = side
    cells = np.vstack([*children, inner.reshape(-1, 4)])
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    mirrored = np.einsum("ij,ij->i", np.cross(edges[:, 0], edges[:, 1]), edges[:, 2]) < 0.0
    cells[mirrored] = cells[mirrored][:, [0, 2, 1, 3]]
    return TetMesh(
        points,
        cells.astype(np.int32),
        {name: midpoints.facets(rows) for name, rows in mesh.facet_groups.items()},
        {name: midpoints.between(rows) for name, rows in mesh.point_groups.items()},
    )


def refine_problem(problem: Problem) -> Problem:
    """The same problem on the uniformly refined mesh, all that it has carried over.

    Point forces stay on their points. Facet loads cover the same area, tools may touch the same
    facets, inclusions fill the same cells.

    Args:
        problem: On any mesh.

    Returns:
        The problem on eight cells for each; its mesh has the same volume.
    """
    midpoints = _EdgeMidpoints(problem.mesh)
    # In the order of the cells of `refine_uniformly`: four corners, then four inside.
    given = np.arange(problem.mesh.num_cells)
    given_cell = np.concatenate([np.tile(given, 4), np.repeat(given, 4)])
    return carry_problem(problem, refine_uniformly(problem.mesh), given_cell, midpoints.facets)


def carry_problem(
    problem: Problem,
    mesh: TetMesh,
    given_cell: NDArray[Any],
    carry_facets: Callable[[Indices], Indices],
) -> Problem:
    """A problem on a finer mesh of its body that has its points first.

    Args:
        problem: On the coarser mesh.
        mesh: The finer one.
        given_cell: The coarser mesh's cell that each of the finer one lies in.
        carry_facets: From facets of the coarser mesh to their parts.
    """
    supports = [
        dataclasses.replace(support, facets=carry_facets(support.facets))
        for support in problem.supports
    ]
    loads: list[Load] = []
    for load in problem.loads:
        if isinstance(load, Traction | Pressure):
            loads.append(dataclasses.replace(load, facets=carry_facets(load.facets)))
        else:
            loads.append(load)
    tools = [
        dataclasses.replace(tool, contact_facets=carry_facets(tool.contact_facets))
        for tool in problem.tools
    ]
    springs = [
        dataclasses.replace(spring, facets=carry_facets(spring.facets))
        for spring in problem.springs
    ]
    inclusions = [
        dataclasses.replace(
            one, cells=np.flatnonzero(np.isin(given_cell, one.cells)).astype(np.int32)
        )
        for one in problem.inclusions
    ]
    return dataclasses.replace(
        problem,
        mesh=mesh,
        supports=tuple(supports),
        loads=tuple(loads),
        tools=tuple(tools),
        inclusions=tuple(inclusions),
        springs=tuple(springs),
    )


def at_refined_points(mesh: TetMesh, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """A field at the points of a mesh, linear in each cell, at those of `refine_uniformly`.

    Args:
        mesh: The mesh that is refined.
        values: Shape (num_points, ...).

    Returns:
        Shape (num_points of the refined mesh, ...), the given ones first.
    """
    first, second = _EdgeMidpoints(mesh).ends
    finer: NDArray[np.float64] = np.concatenate([values, 0.5 * (values[first] + values[second])])
    return finer


def mean_over_parents(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means by cell of a refined mesh as means by cell of the mesh it came from.

    Args:
        values: (8 num_cells, ...), in the order of the cells of `refine_uniformly`.

    Returns:
        (num_cells, ...): the eight cut from one cell have the same volume.
    """
    half, rest = len(values) // 2, values.shape[1:]
    corners = values[:half].reshape(4, -1, *rest).mean(axis=0)
    inside = values[half:].reshape(-1, 4, *rest).mean(axis=1)
    mean: NDArray[np.float64] = 0.5 * (corners + inside)
    return mean


class _EdgeMidpoints:
    """Numbers the midpoint of every edge of a mesh, after the mesh's own points."""

    def __init__(self, mesh: TetMesh) -> None:
        self._stride = mesh.num_points
        pairs = mesh.cells[:, EDGES].reshape(-1, 2).astype(np.int64)
        self._keys = np.unique(self._key(pairs))
        first, second = self.ends
        middle: Points = 0.5 * (mesh.points[first] + mesh.points[second])
        self.points: Points = np.vstack([mesh.points, middle])

    @property
    def ends(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Points at the two ends of each edge, each (n,)."""
        first, second = np.divmod(self._keys, self._stride)
        return first, second

    def _key(self, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
        low, high = pairs.min(axis=1), pairs.max(axis=1)
        key: NDArray[np.int64] = low * self._stride + high
        return key

    def of(self, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
        """Point index of the midpoint of each edge, shape (n,)."""
        place: NDArray[np.int64] = np.searchsorted(self._keys, self._key(pairs)).astype(np.int64)
        return np.asarray(place + self._stride, dtype=np.int64)

    def facets(self, facets: Indices) -> Indices:
        """Four facets for each, with the same orientation."""
        if len(facets) == 0:
            return np.zeros((0, 3), dtype=np.int32)
        a, b, c = facets.astype(np.int64).T
        ab, bc, ca = (self.of(np.column_stack(p)) for p in ((a, b), (b, c), (c, a)))
        rows = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        fine: Indices = np.vstack([np.column_stack(row) for row in rows]).astype(np.int32)
        return fine

    def between(self, chosen: Indices) -> Indices:
        """The chosen points and the midpoints of edges whose two ends are chosen."""
        first, second = self.ends
        inside = np.isin(first, chosen) & np.isin(second, chosen)
        extra = np.flatnonzero(inside) + self._stride
        both: Indices = np.concatenate([chosen, extra]).astype(np.int32)
        return both
