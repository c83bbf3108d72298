"""A TetMesh handed to dolfinx, with the maps that undo dolfinx's renumbering.

dolfinx accepts nearly any array, and hangs or aborts the process on some; so everything it could
choke on is refused before it sees it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from palpate.meshes.arrays import Indices, Points, checked_indices
from palpate.meshes.errors import InputError, MeshError
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh
from palpate.reference import fenicsx


def require_manifold_cells(mesh: TetMesh) -> None:
    """Refuse a mesh with a cell given twice, or a facet of more than two cells.

    Raises:
        MeshError: Naming the first guilty cells.
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
    """A dolfinx mesh of a TetMesh and where each thing went.

    Attributes:
        source: The TetMesh.
        mesh: The dolfinx mesh.
        point_of_node: The TetMesh's point of each geometry node, shape (num_points,).
        cell_of_cell: The TetMesh's cell of each dolfinx cell, shape (num_cells,).
        point_of_vertex: The TetMesh's point of each topological vertex, shape (num_points,).
    """

    source: TetMesh
    mesh: Any
    point_of_node: Indices
    cell_of_cell: Indices
    point_of_vertex: Indices

    @cached_property
    def _boundary_numbers(self) -> dict[tuple[int, ...], int]:
        """Number of each boundary facet by its three points, sorted."""
        topology = self.mesh.topology
        triples = self.point_of_vertex[topology.connectivity(2, 0).array].reshape(-1, 3)
        on_boundary = np.diff(topology.connectivity(2, 3).offsets) == 1
        rows = np.sort(triples[on_boundary], axis=1).tolist()
        return {
            tuple(row): int(number)
            for number, row in zip(np.flatnonzero(on_boundary), rows, strict=True)
        }

    def facet_entities(self, facets: Indices, what: str) -> Indices:
        """Numbers of boundary facets in the dolfinx mesh, sorted, shape (n,).

        Args:
            facets: Facets by points, shape (n, 3), in any order of points.
            what: Whose facets, for the message.

        Raises:
            InputError: A facet that is not on the boundary, or is given twice.
        """
        rows = checked_indices(facets, 3, self.source.num_points, f"facets of {what}")
        if len(rows) == 0:
            return np.zeros(0, dtype=np.int32)
        try:
            found = [self._boundary_numbers[tuple(row)] for row in np.sort(rows, axis=1).tolist()]
        except KeyError as error:
            points = [int(p) for p in error.args[0]]
            raise InputError(
                f"{what}: facet {points} is not on the boundary of the mesh; choose boundary facets"
            ) from None
        if len(set(found)) < len(found):
            raise InputError(f"{what}: a facet is given twice; remove the copy")
        return np.array(sorted(found), dtype=np.int32)

    def facet_measure(self, facets: Indices, what: str, *, degree: int) -> Any:
        """Return the UFL measure of area over some boundary facets, exact to a degree."""
        entities = self.facet_entities(facets, what)
        tags = fenicsx.meshtags(self.mesh, 2, entities, np.ones(len(entities), dtype=np.int32))
        measure = fenicsx.ufl.Measure("ds", domain=self.mesh, subdomain_data=tags)
        return measure(1, metadata={"quadrature_degree": degree})


def transfer(mesh: TetMesh) -> TransferredMesh:
    """Hand a mesh to dolfinx and check that it arrived whole.

    Raises:
        MeshError: Overlapping cells.
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
    point_of_vertex = np.full(topology.index_map(0).size_local, -1, dtype=np.int32)
    point_of_vertex[vertices] = point_of_node[nodes.ravel()]

    arrived = np.array_equal(received.geometry.x[:, :3], mesh.points[point_of_node])
    same_cells = np.array_equal(
        np.sort(point_of_node[nodes], axis=1), np.sort(mesh.cells[cell_of_cell], axis=1)
    )
    if not (arrived and same_cells and len(point_of_node) == mesh.num_points):
        raise RuntimeError("dolfinx did not return the mesh it was given")  # pragma: no cover
    return TransferredMesh(mesh, received, point_of_node, cell_of_cell, point_of_vertex)


@dataclass(frozen=True, eq=False)
class TransferredSpace:
    """A displacement space on a transferred mesh.

    Attributes:
        transferred: The mesh.
        degree: Polynomial degree.
        space: The dolfinx space.
        dof_of_point: Blocked dof at each of the TetMesh's points, shape (num_points,).
    """

    transferred: TransferredMesh
    degree: int
    space: Any
    dof_of_point: Indices

    @property
    def num_blocks(self) -> int:
        """Number of nodes of the space, three degrees of freedom each."""
        return int(self.space.dofmap.index_map.size_local)

    def at_points(self, values: Points) -> Points:
        """Values of a flat vector of the space at the TetMesh's points, shape (num_points, 3)."""
        picked: Points = np.array(values).reshape(-1, 3)[self.dof_of_point]
        return picked

    def from_points(self, values: Points) -> Points:
        """Return the flat vector of a field that is linear between the TetMesh's points."""
        nodal = np.asarray(values, dtype=np.float64)
        if nodal.shape != (self.transferred.source.num_points, 3):
            raise InputError(
                f"a displacement needs shape ({self.transferred.source.num_points}, 3), "
                f"got {nodal.shape}"
            )
        if not np.isfinite(nodal).all():
            raise InputError("the displacement has a value that is NaN or infinite")
        flat = np.zeros((self.num_blocks, 3))
        if self.degree == 1:
            flat[self.dof_of_point] = nodal
            return flat.ravel()
        linear = create_space(self.transferred, 1)
        low = fenicsx.fem.Function(linear.space)
        low.x.array[:] = linear.from_points(nodal)
        high = fenicsx.fem.Function(self.space)
        high.interpolate(low)
        interpolated: Points = np.array(high.x.array)
        return interpolated


def create_space(transferred: TransferredMesh, degree: int) -> TransferredSpace:
    """Return the continuous displacement space of a degree on a transferred mesh."""
    space = fenicsx.vector_space(transferred.mesh, degree)
    dofs = fenicsx.cell_dofs(space)
    nodes = fenicsx.cell_nodes(transferred.mesh)
    # The first four dofs of a Lagrange cell sit at its vertices, in the order of its nodes.
    dof_of_point = np.zeros(transferred.source.num_points, dtype=np.int32)
    dof_of_point[transferred.point_of_node[nodes].ravel()] = dofs[:, :4].ravel()
    return TransferredSpace(transferred, degree, space, dof_of_point)
