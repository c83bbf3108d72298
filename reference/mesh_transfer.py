"""A TetMesh passed to dolfinx, with the maps that undo dolfinx's renumbering.

dolfinx accepts nearly any array, and hangs or aborts the process on some; such meshes are refused
before they are passed on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points, checked_indices
from palpate.meshes.errors import InputError, MeshError
from palpate.meshes.problem import Inclusion, Material
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh
from palpate.reference import fenicsx
from palpate.reference.fenicsx import exchange


def require_manifold_cells(mesh: TetMesh) -> None:
    """Refuse a mesh with a cell given twice, or a facet of more than two cells.

    Raises:
        MeshError: Such cells exist; the message names the first.
    """
    facets = np.sort(mesh.cells[:, CELL_FACETS].reshape(-1, 3), axis=1)
    _, inverse, counts = np.unique(facets, axis=0, return_inverse=True, return_counts=True)
    crowded = np.flatnonzero(counts[inverse.ravel()] > 2)
    if crowded.size == 0:
        # Two cells alone on the same four points share four facets, each of two cells.
        _, first, counts = np.unique(
            np.sort(mesh.cells, axis=1), axis=0, return_index=True, return_counts=True
        )
        crowded = 4 * first[counts > 1]
    if crowded.size:
        cells = sorted({int(c) for c in crowded // 4})
        raise MeshError(
            f"{len(cells)} cell(s) overlap others: a facet has more than two cells, or a cell is "
            f"given twice, first cell {cells[0]}; remove duplicate cells"
        )


@dataclass(frozen=True, eq=False)
class TransferredMesh:
    """A dolfinx mesh of a TetMesh, with the maps of points and cells between the two.

    Attributes:
        source: The TetMesh.
        mesh: The dolfinx mesh.
        point_of_node: The TetMesh's point of each geometry node of this rank.
        cell_of_cell: The TetMesh's cell of each dolfinx cell of this rank.
        point_of_vertex: The TetMesh's point of each topological vertex of this rank.
    """

    source: TetMesh
    mesh: Any
    point_of_node: Indices
    cell_of_cell: Indices
    point_of_vertex: Indices

    @cached_property
    def _boundary_numbers(self) -> dict[tuple[int, ...], int]:
        """Number of each boundary facet of this rank by its three points, sorted."""
        topology = self.mesh.topology
        triples = self.point_of_vertex[topology.connectivity(2, 0).array].reshape(-1, 3)
        on_boundary = np.diff(topology.connectivity(2, 3).offsets) == 1
        rows = np.sort(triples[on_boundary], axis=1).tolist()
        return {
            tuple(row): int(number)
            for number, row in zip(np.flatnonzero(on_boundary), rows, strict=True)
        }

    @cached_property
    def rank_of_cell(self) -> Indices:
        """The rank that owns each of the TetMesh's cells, shape (num_cells,)."""
        ranks = np.zeros(self.source.num_cells, dtype=np.int32)
        ranks[self.cell_of_cell] = fenicsx.COMM.rank
        everywhere: Indices = fenicsx.total(ranks)
        return everywhere

    def by_cell(
        self,
        material: Material,
        inclusions: Sequence[Inclusion],
        value: Callable[[Material], float],
    ) -> Any:
        """Return a constant of the material as a function that is constant in each cell.

        It is a function also for a single material, so that every body has the same compiled forms.
        """
        values = np.full(self.source.num_cells, value(material))
        for inclusion in inclusions:
            values[np.asarray(inclusion.cells)] = value(inclusion.material)
        return fenicsx.cell_function(self.mesh, values[self.cell_of_cell], self._constants)

    @cached_property
    def _constants(self) -> Any:
        """The space of functions that are constant in each cell."""
        return fenicsx.function_space(self.mesh, "DG", 0)

    def facet_entities(self, facets: Indices, what: str) -> Indices:
        """Numbers of boundary facets, each once, in this rank's part of the dolfinx mesh, sorted.

        `what` names the load or spring in a message.
        """
        rows = checked_indices(facets, 3, self.source.num_points, f"facets of {what}")
        if len(rows) == 0:
            return np.zeros(0, dtype=np.int32)
        triples = list(map(tuple, np.sort(rows, axis=1).tolist()))
        # A facet between two ranks looks like a boundary facet here, but is never requested.
        here = self._boundary_numbers
        return np.array(sorted(here[t] for t in triples if t in here), dtype=np.int32)

    def facet_measure(self, facets: Indices, what: str, *, degree: int) -> Any:
        """Return the UFL measure of area over some boundary facets, exact to a degree."""
        entities = self.facet_entities(facets, what)
        tags = fenicsx.meshtags(self.mesh, 2, entities, np.ones(len(entities), dtype=np.int32))
        measure = fenicsx.ufl.Measure("ds", domain=self.mesh, subdomain_data=tags)
        return measure(1, metadata={"quadrature_degree": degree})


def transfer(mesh: TetMesh) -> TransferredMesh:
    """Pass a mesh to dolfinx and check that all points and cells have arrived.

    Raises:
        MeshError: Cells overlap.
    """
    require_manifold_cells(mesh)
    received = fenicsx.create_mesh(mesh.points, mesh.cells)
    topology = received.topology
    nodes = fenicsx.cell_nodes(received)
    point_of_node = np.asarray(received.geometry.input_global_indices, dtype=np.int32)
    cell_of_cell = np.asarray(topology.original_cell_index, dtype=np.int32)
    for pair in ((3, 0), (2, 0), (2, 3)):
        topology.create_connectivity(*pair)
    vertices = topology.connectivity(3, 0).array
    vertex_map = topology.index_map(0)
    num_vertices = vertex_map.size_local + vertex_map.num_ghosts
    point_of_vertex = np.full(num_vertices, -1, dtype=np.int32)
    point_of_vertex[vertices] = point_of_node[nodes.ravel()]

    arrived = np.array_equal(received.geometry.x[:, :3], mesh.points[point_of_node])
    same_cells = np.array_equal(
        np.sort(point_of_node[nodes], axis=1), np.sort(mesh.cells[cell_of_cell], axis=1)
    )
    num_arrived = fenicsx.total(int(received.geometry.index_map().size_local))
    num_cells = fenicsx.total(len(cell_of_cell))
    if not (
        arrived and same_cells and (num_arrived, num_cells) == (mesh.num_points, mesh.num_cells)
    ):
        raise RuntimeError("dolfinx did not return the mesh it was given")  # pragma: no cover
    return TransferredMesh(mesh, received, point_of_node, cell_of_cell, point_of_vertex)


@dataclass(frozen=True, eq=False)
class TransferredSpace:
    """A displacement space on a transferred mesh.

    Attributes:
        transferred: The mesh.
        degree: Polynomial degree.
        space: The dolfinx space.
        dof_of_point: Blocked dof at each of the TetMesh's points, shape (num_points,); beyond
            `num_blocks` where another rank owns it, -1 where no cell of this rank has the point.
    """

    transferred: TransferredMesh
    degree: int
    space: Any
    dof_of_point: Indices

    @property
    def num_blocks(self) -> int:
        """Number of nodes that this rank owns, three degrees of freedom each."""
        return int(self.space.dofmap.index_map.size_local)

    @property
    def num_local_blocks(self) -> int:
        """Number of nodes in the cells of this rank, including those that other ranks own."""
        return fenicsx.num_local_blocks(self.space)

    @property
    def num_global_blocks(self) -> int:
        """Number of nodes of the space over all ranks."""
        return int(self.space.dofmap.index_map.size_global)

    @property
    def coordinates(self) -> Points:
        """Rest positions of the nodes that this rank owns [m], shape (num_blocks, 3)."""
        positions: Points = self.space.tabulate_dof_coordinates()[: self.num_blocks]
        return positions

    def owned_dofs(self, points: Indices) -> Indices:
        """Blocked dofs of those among some points that this rank owns."""
        dofs = self.dof_of_point[points]
        owned: Indices = dofs[self._is_owned(dofs)]
        return owned

    def _is_owned(self, dofs: Indices) -> np.ndarray[Any, Any]:
        return (dofs >= 0) & (dofs < self.num_blocks)

    def at_points(self, values: Points) -> Points:
        """Values of a flat vector of the space at the TetMesh's points, shape (num_points, 3)."""
        picked = np.zeros((self.transferred.source.num_points, 3))
        here = self._is_owned(self.dof_of_point)
        picked[here] = np.array(values).reshape(-1, 3)[self.dof_of_point[here]]
        return picked if fenicsx.COMM.size == 1 else fenicsx.total(picked)

    def from_points(self, values: Points) -> Floats:
        """Return the flat vector of a field that is linear between the TetMesh's points."""
        nodal = np.asarray(values, dtype=np.float64)
        if nodal.shape != (self.transferred.source.num_points, 3):
            raise InputError(
                f"a displacement needs shape ({self.transferred.source.num_points}, 3), "
                f"got {nodal.shape}"
            )
        if not np.isfinite(nodal).all():
            raise InputError("the displacement has a value that is NaN or infinite")
        if self.degree == 1:
            flat = np.zeros((self.num_blocks, 3))
            here = self._is_owned(self.dof_of_point)
            flat[self.dof_of_point[here]] = nodal[here]
            return flat.ravel()
        linear = create_space(self.transferred, 1)
        low = fenicsx.fem.Function(linear.space)
        known = linear.dof_of_point >= 0
        low.x.array.reshape(-1, 3)[linear.dof_of_point[known]] = nodal[known]
        high = fenicsx.fem.Function(self.space)
        high.interpolate(low)
        return np.array(high.x.array[: 3 * self.num_blocks])


def create_space(transferred: TransferredMesh, degree: int) -> TransferredSpace:
    """Return the continuous displacement space of a degree on a transferred mesh."""
    space = fenicsx.function_space(transferred.mesh, "Lagrange", degree, (3,))
    return map_points(transferred, degree, space)


def map_points(transferred: TransferredMesh, degree: int, space: Any) -> TransferredSpace:
    """Find the TetMesh's points in a dolfinx space of displacements."""
    dofs = fenicsx.cell_dofs(space)
    nodes = fenicsx.cell_nodes(transferred.mesh)
    # The first four dofs of a Lagrange cell sit at its vertices, in the order of its nodes.
    dof_of_point = np.full(transferred.source.num_points, -1, dtype=np.int32)
    dof_of_point[transferred.point_of_node[nodes].ravel()] = dofs[:, :4].ravel()
    return TransferredSpace(transferred, degree, space, dof_of_point)


def carry_field(
    source: TransferredSpace, field: Any, target: TransferredSpace, cells: Indices
) -> Floats:
    """Values of a function on one mesh at the nodes of another mesh of the same body.

    The two meshes are distributed over the ranks in different ways: each rank requests the values
    at its own nodes from the ranks that own the cells in which these nodes lie. `cells` is the cell
    of the first TetMesh that each cell of the second lies in. Flat, of the nodes that this rank
    owns; exact where the first space is contained in the second.
    """
    here = source.transferred
    number = np.full(here.source.num_cells, -1, dtype=np.int32)
    number[here.cell_of_cell] = np.arange(len(here.cell_of_cell), dtype=np.int32)
    cell_of_dof = np.empty(target.num_local_blocks, dtype=np.int32)
    of_cells = cells[target.transferred.cell_of_cell]
    cell_of_dof[fenicsx.cell_dofs(target.space)] = of_cells[:, None]
    asked = cell_of_dof[: target.num_blocks]
    owner = here.rank_of_cell[asked]
    order = np.argsort(owner, kind="stable")
    parts = np.split(order, np.searchsorted(owner[order], np.arange(1, fenicsx.COMM.size)))
    positions = target.coordinates
    requests = exchange([(positions[part], asked[part]) for part in parts])
    replies = [fenicsx.values_at(field, x, number[of]) for x, of in requests]
    values: Floats = np.empty((target.num_blocks, target.space.dofmap.bs))
    values[order] = np.concatenate(exchange(replies))
    return values.ravel()
