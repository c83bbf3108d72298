"""The judge's own smoothed tetrahedra: strains averaged over edges and nodes, in NumPy.

With the volume V_c of cell c, V_e = sum of V_c / 6 around edge e and V_n = sum of V_c / 4 around
node n:

    E_e     = sum of (V_c / 6) E_c / V_e         theta_n = sum of (V_c / 4) tr E_c / V_n
    S_c     = sum over its edges of 2 mu E_e / 6  +  sum over its nodes of lmbda theta_n / 4  I

Saint-Venant-Kirchhoff's, under Green strain, takes back the averaging over edges where they are
compressed, with their variance v_e = sum of (V_c / 6) |E_c|^2 / V_e - |E_e|^2 and beta from 0 to 1:

    W   += sum of V_e mu beta v_e,  beta = x^2 (3 - 2 x)
    x    = (-tr E_e min(lmbda/mu + 2, 6) - 0.2) / 0.5, from 0 to 1

By another law W, whose part without lmbda goes over edges and lmbda/2 g^2 over nodes, with E_e and
m_n = sum of (V_c / 4) m_c / V_n of m = J - 1 (of the corotational law tr U - 3):

    S_c     = sum over its edges of S(E_e; lmbda = 0) / 6,    P_c = F_c S_c + p_c dm/dF
    p_c     = sum over its nodes of lmbda g dg/dm (m_n) / 4

An edge or node where materials of other elastic constants meet has an average for each of them.
Apart from fastsim and from the reference.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Strain
from palpate.meshes.tet_mesh import EDGES, TetMesh, signed_volumes
from palpate.validation.metrics.laws import (
    OgdenTerms,
    energy_density,
    finite_stress,
    strain_of,
    tensor_power,
    transposed,
)

Array = NDArray[np.float64]


class Smoothing:
    """Averages over the edges and nodes of a mesh at rest, and the stress that follows from them.

    Lamé's parameters and Mooney and Rivlin's c01 (None is 0) are by cell [Pa], (num_cells,).
    """

    def __init__(self, mesh: TetMesh, lmbda: Array, mu: Array, c01: Array | None = None) -> None:
        self._lmbda, self._mu = lmbda, mu
        self._c01 = np.zeros_like(mu) if c01 is None else c01
        self._volumes = signed_volumes(mesh.points, mesh.cells)
        _, kind = np.unique(np.column_stack([lmbda, mu, self._c01]), axis=0, return_inverse=True)
        kind = kind.reshape(-1, 1).astype(np.int64)
        ends = np.sort(mesh.cells[:, EDGES].astype(np.int64), axis=2)
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

    def blended_stress(self, E: Array) -> Array:
        """S of Green strains by cell [Pa], which may be complex, (num_cells, 3, 3)."""
        means, beta, slope, variance = self._blend(E)
        edges, mu = self._edges, self._mu[:, None, None]
        own = beta[edges].mean(axis=1)[:, None, None] * E
        own -= (beta[:, None, None] * means)[edges].mean(axis=1)
        pressed = (slope * variance)[edges].mean(axis=1)[:, None, None] * np.eye(3)
        return np.asarray(self.stress(E) + 2.0 * mu * own + mu * pressed)

    def blend_energy(self, E: Array) -> float:
        """What is added to half the integral of E : `stress` [J]."""
        _, beta, _, variance = self._blend(E)
        return float(self._volumes @ (self._mu * (beta * variance)[self._edges].mean(axis=1)))

    def _blend(self, E: Array) -> tuple[Array, Array, Array, Array]:
        """E_e, beta, its derivative by tr E_e, and v_e of each edge."""
        means = self._patch_means(self._edges, E.reshape(-1, 9))
        squares = self._patch_means(self._edges, (E * E).sum(axis=(1, 2))[:, None])[:, 0]
        rate = -_by_patch(self._edges, np.minimum(self._lmbda / self._mu + 2.0, 6.0)) / 0.5
        x = rate * means[:, [0, 4, 8]].sum(axis=1) - 0.4
        x = np.where(x.real <= 0.0, 0.0, np.where(x.real >= 1.0, 1.0, x))
        beta, slope = x * x * (3.0 - 2.0 * x), rate * 6.0 * x * (1.0 - x)
        return means.reshape(-1, 3, 3), beta, slope, squares - (means * means).sum(axis=1)

    def law_energy(self, law: Law, H: Array, terms: OgdenTerms = ()) -> float:
        """Stored energy of displacement gradients by cell by another law [J]."""
        of_edges, measures = self._averages(law, H)
        edges, nodes = self._edges, self._nodes
        mu, c01 = (_by_patch(edges, of) for of in (self._mu, self._c01))
        shape = energy_density(law, _gradient_of(of_edges), np.zeros_like(mu), mu, c01, terms)
        g = np.log1p(measures) if law.is_by_log_of_volume else measures
        volume = 0.5 * _by_patch(nodes, self._lmbda) * g**2
        volumes = self._volumes[:, None]
        return float((volumes / 6 * shape[edges]).sum() + (volumes / 4 * volume[nodes]).sum())

    def law_stress(self, law: Law, H: Array, terms: OgdenTerms = ()) -> Array:
        """P of displacement gradients by cell by another law [Pa], (num_cells, 3, 3).

        Raises:
            LinAlgError: A cell that is squeezed flat.
        """
        of_edges, measures = self._averages(law, H)
        mu, c01 = (_by_patch(self._edges, of) for of in (self._mu, self._c01))
        H_e = _gradient_of(of_edges)
        P_e = finite_stress(law, H_e, np.zeros_like(mu), mu, c01, terms)
        S = np.linalg.solve(np.eye(3) + H_e, P_e)[self._edges].mean(axis=1)
        pressure = _by_patch(self._nodes, self._lmbda) * measures
        if law.is_by_log_of_volume:
            with np.errstate(invalid="ignore", divide="ignore"):
                J = 1.0 + measures
                pressure = _by_patch(self._nodes, self._lmbda) * np.log(J) / J
        p = pressure[self._nodes].mean(axis=1)[:, None, None]
        F = np.eye(3) + H
        return np.asarray(F @ S + p * _volume_measure(law, F)[1])

    def _averages(self, law: Law, H: Array) -> tuple[Array, Array]:
        """E of the edges and m of the nodes."""
        E = strain_of(H, Strain.GREEN).reshape(-1, 9)
        measures = _volume_measure(law, np.eye(3) + H)[0]
        of_edges = self._patch_means(self._edges, E).reshape(-1, 3, 3)
        return of_edges, self._patch_means(self._nodes, measures[:, None])[:, 0]

    def _means(self, patches: Indices, values: Array) -> Array:
        """Mean over a cell's patches of the means in them, of values by cell (num_cells, k)."""
        found: Array = self._patch_means(patches, values)[patches].mean(axis=1)
        return found

    def _patch_means(self, patches: Indices, values: Array) -> Array:
        """Means in patches of values by cell (num_cells, k), complex ones too."""
        flat, size = patches.ravel(), patches.shape[1]
        weights = np.repeat(self._volumes, size)
        volumes = np.bincount(flat, weights)
        rows = np.repeat(values, size, axis=0) * weights[:, None]
        columns = [_sums(flat, rows[:, k]) / volumes for k in range(values.shape[1])]
        return np.stack(columns, axis=1)


def _volume_measure(law: Law, F: Array) -> tuple[Array, Array]:
    """M by cell and dm/dF: J - 1 and cof F; of the corotational law tr U - 3 and R."""
    if law is Law.COROTATIONAL:
        U = tensor_power(transposed(F) @ F, 0.5)
        return np.trace(U, axis1=1, axis2=2) - 3.0, F @ np.linalg.inv(U)
    J = np.linalg.det(F)
    cofactor: Array = J[:, None, None] * transposed(np.linalg.inv(F))
    return J - 1.0, cofactor


def _sums(groups: Indices, values: Any) -> Any:
    real = np.bincount(groups, values.real)
    return real + 1j * np.bincount(groups, values.imag) if np.iscomplexobj(values) else real


def _by_patch(patches: Indices, values: Array) -> Array:
    """The values that all cells of a patch have in common."""
    found = np.empty(int(patches.max()) + 1)
    found[patches] = values[:, None]
    return found


def _gradient_of(E: Array) -> Array:
    """H of an upper triangular F with F^T F = I + 2 E, by Cholesky; E may be complex."""
    C = np.eye(3) + 2.0 * E
    F = np.zeros_like(C)
    for i in range(3):
        F[:, i, i] = np.sqrt(C[:, i, i] - (F[:, :i, i] ** 2).sum(axis=1))
        for j in range(i + 1, 3):
            inner = (F[:, :i, i] * F[:, :i, j]).sum(axis=1)
            F[:, i, j] = (C[:, i, j] - inner) / F[:, i, i]
    H: Array = F - np.eye(3)
    return H


def _numbered(keys: NDArray[np.int64]) -> Indices:
    """The same array with its values numbered from 0."""
    _, numbers = np.unique(keys, return_inverse=True)
    return numbers.reshape(keys.shape).astype(np.int32)
