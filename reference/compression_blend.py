"""Smoothed tetrahedra of Saint-Venant-Kirchhoff's law where they are compressed: plain ones.

Under pressure a cell gains energy as it turns and shears, and strain that is averaged over edges
does not resist that. With the variance of the strain in the cells c of an edge e,

    v_e = 1 / V_e  sum of (V_c / 6) |E_c - E_e|^2
    W  += sum of V_e mu beta(x_e) v_e,   x_e = (-tr E_e min(lmbda/mu + 2, 6) - 0.2) / 0.5

where beta is 0 for x < 0, 1 for x > 1, and x^2 (3 - 2 x) between: with beta = 1 the edge has the
shear part of the plain tetrahedra. Where E is the same in all cells of an edge nothing is added.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.reference.patch_matrices import Patches, sparse_matrix, with_rows_scaled

_ONSET, _WIDTH, _LARGEST_RATIO = 0.2, 0.5, 6.0
_DIAGONAL = np.array([0, 4, 8])


class CompressionBlend:
    """What is added to W, in terms of the cells' integrals of E (flat, nine per cell, by `dofs`).

    Volumes [m3] and `dofs` are those of the cells; Lamé's parameters [Pa] those of the edges.
    """

    def __init__(
        self, edges: Patches, dofs: Indices, volumes: Floats, lmbda: Floats, mu: Floats
    ) -> None:
        self._edges, self._dofs, self._volumes, self._mu = edges, dofs, volumes, mu
        self._rate = -np.minimum(lmbda / mu + 2.0, _LARGEST_RATIO) / _WIDTH
        self._share = 1.0 / (6.0 * edges.volumes)  # of each integral in the edge's mean

    def energy(self, integrals: Floats, strains: Floats) -> float:
        """[J]; `strains` are those of the edges, flat."""
        beta, _, _ = self._beta(strains)
        return float((self._edges.volumes * self._mu * beta) @ self._variance(integrals, strains))

    def stresses(self, integrals: Floats, strains: Floats) -> tuple[Floats, Floats]:
        """What is added to dW/dE of the edges, over their volumes, and to S of the cells [Pa].

        Both flat.
        """
        beta, slope, _ = self._beta(strains)
        of_edges = -2.0 * (self._mu * beta)[:, None] * strains.reshape(-1, 9)
        pressed = self._mu * slope * self._variance(integrals, strains)
        of_edges[:, _DIAGONAL] += pressed[:, None]
        of_cells = np.empty((len(self._dofs), 9))
        factor = (2.0 * self._mu * beta)[self._edges.of_cell].mean(axis=1)
        of_cells[self._dofs] = factor[:, None] * self._cell_strains(integrals)
        return of_edges.ravel(), of_cells.ravel()

    def stiffness(self, integrals: Floats, strains: Floats, rates: Any, averages: Any) -> Any:
        """B^T (d2W) B for the derivatives B of the integrals, a new PETSc matrix.

        `averages` gives the edges' strains from the integrals.
        """
        beta, slope, bend = self._beta(strains)
        weight = self._edges.volumes * self._mu
        variance = self._variance(integrals, strains)
        of_mean = averages.matMult(rates)
        total = of_mean.transposeMatMult(
            with_rows_scaled(of_mean, np.repeat(-2.0 * weight * beta, 9))
        )
        own = np.empty((len(self._dofs), 9))
        factor = (2.0 * self._mu * beta)[self._edges.of_cell].mean(axis=1)
        own[self._dofs] = (factor / self._volumes)[:, None]
        total.axpy(1.0, rates.transposeMatMult(with_rows_scaled(rates, own.ravel())))
        # Derivatives of tr E_e and of v_e by the integrals.
        edge = self._edges.of_cell.ravel()
        columns = 9 * np.repeat(self._dofs, 6)[:, None]
        shape = (len(weight), 9 * len(self._dofs))
        share = self._share[edge]
        traces = sparse_matrix(
            np.repeat(edge, 3), (columns + _DIAGONAL).ravel(), np.repeat(share, 3), shape
        ).matMult(rates)
        differences = 2.0 * share[:, None] * self._differences(integrals, strains)
        variances = sparse_matrix(
            np.repeat(edge, 9), (columns + np.arange(9)).ravel(), differences.ravel(), shape
        ).matMult(rates)
        half = with_rows_scaled(traces, 0.5 * weight * bend * variance)
        half.axpy(1.0, with_rows_scaled(variances, weight * slope))
        mixed = traces.transposeMatMult(half)
        total.axpy(1.0, mixed)
        total.axpy(1.0, mixed.transpose())
        return total

    def _cell_strains(self, integrals: Floats) -> Floats:
        found: Floats = integrals.reshape(-1, 9)[self._dofs] / self._volumes[:, None]
        return found

    def _differences(self, integrals: Floats, strains: Floats) -> Floats:
        """E_c - E_e, six rows of nine for each cell."""
        edge = self._edges.of_cell.ravel()
        own = np.repeat(self._cell_strains(integrals), 6, axis=0)
        found: Floats = own - strains.reshape(-1, 9)[edge]
        return found

    def _variance(self, integrals: Floats, strains: Floats) -> Floats:
        edge = self._edges.of_cell.ravel()
        squared = (self._differences(integrals, strains) ** 2).sum(axis=1)
        weighed = np.repeat(self._volumes, 6) * self._share[edge] * squared
        return np.asarray(np.bincount(edge, weighed), dtype=np.float64)

    def _beta(self, strains: Floats) -> tuple[Floats, Floats, Floats]:
        """Beta with its derivatives by tr E_e."""
        traces = strains.reshape(-1, 9)[:, _DIAGONAL].sum(axis=1)
        x = self._rate * traces - _ONSET / _WIDTH
        rises = (x > 0.0) & (x < 1.0)
        y = np.clip(x, 0.0, 1.0)
        slope = self._rate * 6.0 * y * (1.0 - y)
        bend = np.where(rises, self._rate**2 * (6.0 - 12.0 * y), 0.0)
        return y**2 * (3.0 - 2.0 * y), slope, bend
