"""Sizes of fields and of changes that relative errors are divided by."""

from __future__ import annotations

import math

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.tet_mesh import TetMesh

# Where a body hardly changes volume or area, errors are scaled by this part of the rest value
# instead: a change below it is not what such a check is about.
SMALLEST_CHANGE = 1e-3


def l2_norm(mesh: TetMesh, displacement: Points) -> float:
    """L2 norm of a linear field over the rest volume [m^2.5], integrated exactly.

    A cell's mass matrix is V/20 (1 + delta_ab), so |u|^2 integrates to V/20 (sum over corners
    of |u_a|^2 plus |sum over corners of u_a|^2).
    """
    corners = displacement[mesh.cells]
    squared = np.einsum("cai,cai->c", corners, corners)
    total = corners.sum(axis=1)
    squared += np.einsum("ci,ci->c", total, total)
    return math.sqrt(float(mesh.cell_volumes @ squared / 20.0))


def size_of_change(value: float, rest: float) -> float:
    """Size of a change from a rest value, but not less than 0.1 % of that."""
    return max(abs(value - rest), SMALLEST_CHANGE * rest)
