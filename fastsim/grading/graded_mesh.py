"""A mesh that is refined locally, with its problem carried along, and an indicator of its error.

Bisection of marked tetrahedra (Arnold, Mukherjee, Pouly 2000): no point ever hangs, and the
descendants of a cell have at most 72 shapes.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.fastsim import _core
from palpate.fastsim.body import Body, cell_stress
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, on_other_mesh
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh, signed_volumes


class GradedMesh:
    """A mesh and its bisections.

    Args:
        mesh: Any conforming mesh; its groups are carried.
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
            cell_groups = {
                name: self.carry_cells(rows) for name, rows in self._given.cell_groups.items()
            }
            self._mesh = TetMesh(self.points, self.cells, facet_groups, point_groups, cell_groups)
        return self._mesh

    def refine(self, marked: ArrayLike) -> None:
        """Bisect cells, and others until no point hangs.

        Args:
            marked: Which cells of `mesh`, shape (num_cells,) of bool.
        """
        flags = np.asarray(marked)
        if flags.shape != (len(self.cells),) or flags.dtype != np.bool_:
            raise InputError(
                f"marks need shape ({len(self.cells)},) of bool, got {flags.shape} of {flags.dtype}"
            )
        self._core.refine(np.ascontiguousarray(flags).astype(np.uint8))
        self._refresh()

    def carry_cells(self, rows: ArrayLike) -> Indices:
        """Cells of `mesh` that lie in some cells of the given mesh, ascending."""
        return np.flatnonzero(np.isin(self.given_cell, rows)).astype(np.int32)

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
        return np.flatnonzero(belongs).astype(np.int32)

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

    def _number_of(self, facets: NDArray[Any]) -> NDArray[np.int64]:
        """Row of each facet among the followed ones, -1 for others."""
        wanted = np.sort(facets, axis=1).astype(np.int64)
        both = np.vstack([self._followed, wanted])
        key = np.unique(both, axis=0, return_inverse=True)[1].reshape(-1)
        position = np.full(int(key.max(initial=0)) + 1, -1)
        position[key[: len(self._followed)]] = np.arange(len(self._followed))
        numbers: NDArray[np.int64] = position[key[len(self._followed) :]]
        return numbers

    def _facets_within(self, numbers: NDArray[np.int64]) -> Indices:
        wanted = np.zeros(len(self._followed) + 1, dtype=bool)
        wanted[numbers] = True
        wanted[-1] = False
        cell, side = np.nonzero(wanted[self._tags])
        rows = np.take_along_axis(self.cells[cell], CELL_FACETS[side], axis=1)
        # A facet within the body is seen from both of its cells.
        first = np.unique(np.sort(rows, axis=1), axis=0, return_index=True)[1]
        return np.ascontiguousarray(rows[np.sort(first)])


def carry_problem(problem: Problem, graded: GradedMesh) -> Problem:
    """The same problem on the refined mesh: the same regions are fixed, loaded and touched.

    It is on the mesh that `graded` began with. Forces on single points stay on their points, which
    keep their numbers.
    """
    carried = on_other_mesh(
        problem, graded.mesh, facets=graded.carry_facets, cells=graded.carry_cells
    )
    supports = (
        dataclasses.replace(new, points=graded.carry_points(old.points))
        for old, new in zip(problem.supports, carried.supports, strict=True)
    )
    return dataclasses.replace(carried, supports=tuple(supports))


# Error of a solution on linear tetrahedra: recovered against computed stress.
#
# The stress of linear tetrahedra is constant in each cell. Averaged to the points it is nearer the
# truth (Zienkiewicz, Zhu 1987), so the difference shows where cells are too large.


def recovered_stress(mesh: TetMesh, stress: Floats) -> Floats:
    """Stress at the points: the mean of the cells around, by volume, (num_points, 3, 3) [Pa]."""
    volumes = signed_volumes(mesh.points, mesh.cells)
    total = np.zeros((mesh.num_points, 9))
    weight = np.zeros(mesh.num_points)
    rows = volumes[:, None] * stress.reshape(-1, 9)
    for k in range(4):
        np.add.at(total, mesh.cells[:, k], rows)
        np.add.at(weight, mesh.cells[:, k], volumes)
    return (total / weight[:, None]).reshape(-1, 3, 3)


def estimate_error(body: Body, displacement: ArrayLike) -> Floats:
    """Estimated error of each cell in the energy norm [J^(1/2)], shape (num_cells,).

    The root of the integral of (S* - S) : C^-1 : (S* - S) over the rest cell, S* linear between
    recovered values at the points. An indicator, not a bound: it finds where to refine.
    """
    mesh = body.mesh
    stress = cell_stress(body, displacement)
    at_points = recovered_stress(mesh, stress)
    gap = at_points[mesh.cells] - stress[:, None]
    lmbda, mu = body.lmbda, body.mu

    def product(a: Floats, b: Floats) -> Floats:
        # a : C^-1 : b = (a : b - lmbda / (3 lmbda + 2 mu) tr a tr b) / (2 mu)
        whole = np.einsum("cij,cij->c", a, b)
        traces = np.einsum("cii->c", a) * np.einsum("cii->c", b)
        out: Floats = (whole - lmbda / (3.0 * lmbda + 2.0 * mu) * traces) / (2.0 * mu)
        return out

    # Linear functions on a tetrahedron: int N_a N_b = V (1 + delta_ab) / 20.
    total = product(gap.sum(axis=1), gap.sum(axis=1))
    for k in range(4):
        total += product(gap[:, k], gap[:, k])
    squared = np.maximum(total, 0.0) * signed_volumes(mesh.points, mesh.cells) / 20.0
    errors: Floats = np.sqrt(squared)
    return errors


def mark_largest(errors: ArrayLike, *, part: float = 0.5) -> NDArray[np.bool_]:
    """The fewest cells that make up a part, at most 1, of the squared error (Doerfler 1996)."""
    squared = np.asarray(errors, dtype=np.float64) ** 2
    if not 0.0 < part <= 1.0:
        raise InputError(f"part = {part:g}: needs a value above 0, at most 1")
    if squared.ndim != 1 or not np.isfinite(squared).all():
        raise InputError("errors need one finite value for each cell")
    order = np.argsort(-squared, kind="stable")
    summed = np.cumsum(squared[order])
    marked = np.zeros(len(squared), dtype=bool)
    if summed.size and summed[-1] > 0.0:
        needed = int(np.searchsorted(summed, part * summed[-1] * (1.0 - 1e-12))) + 1
        marked[order[:needed]] = True
    return marked
