"""The judge's own smoothed tetrahedra: strains averaged over edges and nodes, in NumPy.

With the volume V_c of cell c, V_e = sum of V_c / 6 around edge e and V_n = sum of V_c / 4 around
node n:

    E_e     = sum of (V_c / 6) E_c / V_e         theta_n = sum of (V_c / 4) tr E_c / V_n
    S_c     = sum over its edges of 2 mu E_e / 6  +  sum over its nodes of lmbda theta_n / 4  I

An edge or node where materials of other elastic constants meet has an average for each of them.
Apart from fastsim and from the reference.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices
from palpate.meshes.tet_mesh import TetMesh, signed_volumes

Array = NDArray[np.float64]
_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


class Smoothing:
    """Averages over the edges and nodes of a mesh, and the stress that follows from them.

    Args:
        mesh: At rest.
        lmbda: Lamé's first parameter by cell [Pa], (num_cells,).
        mu: The second [Pa].
    """

    def __init__(self, mesh: TetMesh, lmbda: Array, mu: Array) -> None:
        self._lmbda, self._mu = lmbda, mu
        self._volumes = signed_volumes(mesh.points, mesh.cells)
        _, kind = np.unique(np.column_stack([lmbda, mu]), axis=0, return_inverse=True)
        kind = kind.reshape(-1, 1).astype(np.int64)
        ends = np.sort(mesh.cells[:, _EDGES].astype(np.int64), axis=2)
        edges = ends[:, :, 0] * mesh.num_points + ends[:, :, 1]
        self._edges = _numbered(edges * (int(kind.max()) + 1) + kind)
        self._nodes = _numbered(mesh.cells.astype(np.int64) * (int(kind.max()) + 1) + kind)

    def stress(self, strain: Array) -> Array:
        """Second Piola-Kirchhoff (or Cauchy) stress of strains by cell [Pa], (num_cells, 3, 3)."""
        of_edges = self._means(self._edges, strain.reshape(-1, 9)).reshape(-1, 3, 3)
        theta = self._means(self._nodes, np.trace(strain, axis1=1, axis2=2)[:, None])[:, 0]
        S: Array = 2.0 * self._mu[:, None, None] * of_edges
        diagonal = np.arange(3)
        S[:, diagonal, diagonal] += (self._lmbda * theta)[:, None]
        return S

    def _means(self, patches: Indices, values: Array) -> Array:
        """Mean over a cell's patches of the means in them, of values by cell (num_cells, k)."""
        flat, size = patches.ravel(), patches.shape[1]
        weights = np.repeat(self._volumes, size)
        volumes = np.bincount(flat, weights)
        rows = np.repeat(values, size, axis=0) * weights[:, None]
        columns = [np.bincount(flat, rows[:, k]) / volumes for k in range(values.shape[1])]
        found: Array = np.stack(columns, axis=1)[patches].mean(axis=1)
        return found


def _numbered(keys: NDArray[np.int64]) -> Indices:
    """The same array with its values numbered from 0."""
    _, numbers = np.unique(keys, return_inverse=True)
    return numbers.reshape(keys.shape).astype(np.int32)
