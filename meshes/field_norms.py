"""Norms of fields, and sizes of changes, by which relative errors are divided."""

from __future__ import annotations

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.tet_mesh import TetMesh

# Where a body hardly changes volume or area, errors are divided by this fraction of the rest
# value instead.
SMALLEST_CHANGE = 1e-3

# Cells of all fields that are summed at once; limits the memory.
_AT_ONCE = 100_000


def l2_norm(mesh: TetMesh, displacement: Points) -> float:
    """L2 norm of a linear field over the rest volume [m^2.5], integrated exactly.

    A cell's mass matrix is V/20 (1 + delta_ab), so |u|^2 integrates to V/20 (sum over corners
    of |u_a|^2 plus |sum over corners of u_a|^2).
    """
    return float(l2_norms(mesh, displacement[None])[0])


def l2_norms(mesh: TetMesh, displacements: Floats) -> Floats:
    """`l2_norm` of many fields, (n, num_points, 3), such as the states of a motion: (n,)."""
    squared = np.empty(len(displacements))
    at_once = max(1, _AT_ONCE // mesh.num_cells)
    for start in range(0, len(displacements), at_once):
        fields = displacements[start : start + at_once]
        # Corner by corner, so that only one corner's values are in memory, not those of four.
        total = np.zeros((len(fields), mesh.num_cells, fields.shape[2]))
        sums = np.zeros((len(fields), mesh.num_cells))
        for corner in mesh.cells.T:
            values = fields[:, corner]
            sums += np.einsum("tci,tci->tc", values, values)
            total += values
        sums += np.einsum("tci,tci->tc", total, total)
        squared[start : start + at_once] = sums @ mesh.cell_volumes
    norms: Floats = np.sqrt(squared / 20.0)
    return norms


def l2_gradient(mesh: TetMesh, displacement: Points) -> Points:
    """Derivative of `l2_norm` by each point's value, (num_points, 3); 0 for the zero field."""
    corners = displacement[mesh.cells]
    weighted = corners + corners.sum(axis=1, keepdims=True)
    gradient = np.zeros_like(displacement)
    np.add.at(gradient, mesh.cells, mesh.cell_volumes[:, None, None] / 20.0 * weighted)
    return gradient / (l2_norm(mesh, displacement) or 1.0)


def size_of_change(value: float, rest: float) -> float:
    """Absolute change from a rest value, but at least 0.1 % of the rest value."""
    return max(abs(value - rest), SMALLEST_CHANGE * rest)
