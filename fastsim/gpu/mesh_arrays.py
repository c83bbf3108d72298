"""What the kernels read of a mesh at rest, as plain arrays: shared by all bodies of a batch.

Points keep the caller's numbers. Cells are sorted along Morton's curve through their centres, so
that neighbours in a launch share points in the cache.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.tet_mesh import TetMesh

# Corners of the six edges of a cell, as core/mechanics/smoothing_patches.hpp.
_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
_BITS = 10  # of the curve, along each axis


@dataclass(frozen=True, eq=False)
class Groups:
    """Members of numbered groups, ascending: those of group k from start[k] to start[k + 1]."""

    start: Indices
    members: Indices

    @classmethod
    def of(cls, numbers: NDArray[np.signedinteger[Any]], count: int) -> Groups:
        """Places in `numbers` by the number that stands there."""
        flat = numbers.reshape(-1)
        order = np.argsort(flat, kind="stable").astype(np.int32)
        start = np.searchsorted(flat[order], np.arange(count + 1)).astype(np.int32)
        return cls(start, order)


@dataclass(frozen=True, eq=False)
class Patches:
    """Where the smoothed element averages: cells of one kind around each edge and node.

    Attributes:
        cell_edges, cell_nodes: Patches of each cell, shapes (num_cells, 6) and (num_cells, 4).
        edges, nodes: Cells of each patch.
        edge_weights: 1 / (36 V_e) [1/m3]; times mu and the sum of 2 V_c E_c.
        node_weights: 1 / (32 V_n) [1/m3]; times lmbda and the sum of the traces.
        edge_kinds, node_kinds: Of their cells.
    """

    cell_edges: Indices
    cell_nodes: Indices
    edges: Groups
    nodes: Groups
    edge_weights: Floats
    node_weights: Floats
    edge_kinds: Indices
    node_kinds: Indices


@dataclass(frozen=True, eq=False)
class MeshArrays:
    """A mesh at rest, its cells in the order of the launches.

    Attributes:
        corners: Shape (num_cells, 4).
        gradients: Of the shape functions of corners 1 to 3 [1/m], shape (num_cells, 3, 3).
        volumes: [m3], shape (num_cells,).
        kinds: Rows of the moduli, shape (num_cells,).
        gather: Entries 4 cell + corner of each point.
        patches: Of the smoothed element, else None.
    """

    corners: Indices
    gradients: Floats
    volumes: Floats
    kinds: Indices
    gather: Groups
    patches: Patches | None

    @classmethod
    def of(
        cls, mesh: TetMesh, gradients: Floats, kinds: Indices, *, is_smoothed: bool
    ) -> MeshArrays:
        """Of a mesh, with the gradients (num_cells, 3, 3) and kinds of its cells in its order."""
        order = morton_order(mesh.points[mesh.cells].mean(axis=1))
        corners = np.ascontiguousarray(mesh.cells[order], dtype=np.int32)
        volumes, kinds = mesh.cell_volumes[order], kinds[order].astype(np.int32)
        return cls(
            corners,
            np.ascontiguousarray(gradients[order]),
            volumes,
            kinds,
            Groups.of(corners, mesh.num_points),
            make_patches(corners, volumes, kinds) if is_smoothed else None,
        )


def morton_order(places: Floats) -> NDArray[np.int64]:
    """Places [m], shape (n, 3), along a curve that fills their box (Morton 1966)."""
    low, size = places.min(axis=0), max(float(np.ptp(places, axis=0).max()), 1e-300)
    at = ((places - low) / size * (2**_BITS - 1)).astype(np.int64)
    code = np.zeros(len(places), dtype=np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            code |= ((at[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


def make_patches(corners: Indices, volumes: Floats, kinds: Indices) -> Patches:
    """Of cells with corners (n, 4), volumes [m3] and kinds (n,)."""
    ends = np.sort(corners[:, _EDGES], axis=2).reshape(-1, 2).astype(np.int64)
    num_points = int(corners.max()) + 1
    most = int(kinds.max()) + 1
    edge_keys = (ends[:, 0] * num_points + ends[:, 1]) * most + np.repeat(kinds, 6)
    node_keys = corners.reshape(-1).astype(np.int64) * most + np.repeat(kinds, 4)
    found = []
    for keys, width in ((edge_keys, 6), (node_keys, 4)):
        names, numbers = np.unique(keys, return_inverse=True)
        numbers = numbers.reshape(-1, width).astype(np.int32)
        places = Groups.of(numbers, len(names))
        share = np.bincount(numbers.reshape(-1), np.repeat(volumes / width, width))
        kinds_of = (names % most).astype(np.int32)
        cells = Groups(places.start, (places.members // width).astype(np.int32))
        found.append((numbers, cells, share, kinds_of))
    (cell_edges, edges, of_edges, edge_kinds), (cell_nodes, nodes, of_nodes, node_kinds) = found
    return Patches(
        cell_edges,
        cell_nodes,
        edges,
        nodes,
        1.0 / (36.0 * of_edges),
        1.0 / (32.0 * of_nodes),
        edge_kinds,
        node_kinds,
    )
