"""Strains averaged over edges and nodes: the law of the smoothed tetrahedra, as sparse matrices.

Cell c has the volume V_c and the strain E_c (Green's, or the linear one). An edge e has the volume
V_e = sum of V_c / 6 over its cells, a node n has V_n = sum of V_c / 4:

    E_e     = 1 / V_e  sum of (V_c / 6) E_c                     strain of an edge
    theta_n = 1 / V_n  sum of (V_c / 4) tr E_c                  volume strain of a node
    W       = sum of V_e mu E_e : E_e  +  sum of V_n lmbda / 2 theta_n^2
    S_c     = 1 / V_c dW / dE_c  =  1/6 sum of 2 mu E_e  +  1/4 sum of lmbda theta_n I

The shear part goes over edges, which do not lock in bending; the volumetric part over nodes, of
which there are too few to lock it. An edge or node where several materials meet has a patch of
cells for each. With s the integrals V_c E_c, which is what UFL assembles, all of it is one matrix
A of averages and one diagonal D of moduli:

    W = (A s) . D (A s) / 2,   S = A^T D (A s),   K = (A B)^T D (A B) + geometric part,   B = ds/du.

G. R. Liu, T. Nguyen-Thoi, Smoothed Finite Element Methods, 2010; C.-K. Lee, L. A. Mihai, J. S.
Hale, P. Kerfriden, S. P. A. Bordas, Strain smoothing for compressible and nearly-incompressible
finite elasticity, Computers and Structures 182 (2017) 540-555. They average the deformation
gradient; here it is the strain, so that a finite rotation strains no edge either.

Note:
    W is never above that of the plain tetrahedra (it is convex in E). Pressures lmbda theta_n of
    neighbouring nodes may alternate; averages over a cell do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.reference.fenicsx import COMM, PETSc

# A 3 x 3 tensor, row by row.
_SIZE = 9
_DIAGONAL = np.array([0, 4, 8])


@dataclass(frozen=True, eq=False)
class Patches:
    """Cells of one material around each edge, or around each node.

    Attributes:
        of_cell: Patches of each cell, shape (num_cells, 6) for edges, (num_cells, 4) for nodes.
        volumes: An equal share of each cell's volume for each of its patches [m3], (num_patches,).
    """

    of_cell: Indices
    volumes: Floats


def find_patches(mesh: Any, dimension: int, constants: Floats, volumes: Floats) -> Patches:
    """Gather the cells around the edges (dimension 1) or nodes (0) of a dolfinx mesh.

    Args:
        mesh: On one rank: another one's cells at an edge would be missing.
        dimension: 1 or 0.
        constants: Of each cell's material, shape (num_cells, n); equal rows share patches.
        volumes: Of the cells [m3], shape (num_cells,).
    """
    topology = mesh.topology
    topology.create_entities(dimension)
    topology.create_connectivity(3, dimension)
    entities = topology.connectivity(3, dimension).array.reshape(len(volumes), -1)
    kinds, kind = np.unique(constants, axis=0, return_inverse=True)
    pairs = entities.astype(np.int64) * len(kinds) + kind.reshape(-1, 1)
    _, of_cell = np.unique(pairs, return_inverse=True)
    of_cell = of_cell.reshape(pairs.shape)
    shares = np.broadcast_to(volumes[:, None] / pairs.shape[1], pairs.shape)
    summed = np.bincount(of_cell.ravel(), shares.ravel())
    return Patches(of_cell, np.asarray(summed, dtype=np.float64))


class Smoothing:
    """Averages A and moduli D of a mesh (see the module).

    Flat strains and stresses are those of a function that is constant in each cell, of shape 3 x 3:
    full tensors, so that the double contraction is the scalar product.

    Args:
        mesh: dolfinx mesh on one rank.
        dofs: Blocked degree of freedom of each cell in the space of those functions, (num_cells,).
        lmbda: First Lamé parameter of each cell [Pa], (num_cells,).
        mu: Shear modulus of each cell [Pa], (num_cells,).
        volumes: Of the cells [m3], (num_cells,).
    """

    def __init__(
        self, mesh: Any, dofs: Indices, lmbda: Floats, mu: Floats, volumes: Floats
    ) -> None:
        constants = np.column_stack([lmbda, mu])
        edges, nodes = (find_patches(mesh, k, constants, volumes) for k in (1, 0))
        num_edges, num_nodes = len(edges.volumes), len(nodes.volumes)

        cell = np.repeat(dofs, 6)
        component = np.arange(_SIZE)
        edge = edges.of_cell.ravel()
        of_edges = (
            (_SIZE * edge[:, None] + component).ravel(),
            (_SIZE * cell[:, None] + component).ravel(),
            np.repeat(1.0 / (6.0 * edges.volumes[edge]), _SIZE),
        )
        cell = np.repeat(dofs, 4)
        node = nodes.of_cell.ravel()
        of_nodes = (
            np.repeat(_SIZE * num_edges + node, 3),
            (_SIZE * cell[:, None] + _DIAGONAL).ravel(),
            np.repeat(1.0 / (4.0 * nodes.volumes[node]), 3),
        )
        rows, columns, values = (np.concatenate(x) for x in zip(of_edges, of_nodes, strict=True))
        shape = (_SIZE * num_edges + num_nodes, _SIZE * len(volumes))
        self._averages = sparse_matrix(rows, columns, values, shape)

        shear, bulk = np.empty(num_edges), np.empty(num_nodes)
        shear[edges.of_cell] = 2.0 * mu[:, None]
        bulk[nodes.of_cell] = lmbda[:, None]
        self._moduli = np.concatenate(
            [np.repeat(shear * edges.volumes, _SIZE), bulk * nodes.volumes]
        )

    def energy(self, strains: Floats) -> float:
        """W of the cells' integrals of strain [m3], flat [J]."""
        means = times(self._averages, strains)
        return 0.5 * float(means @ (self._moduli * means))

    def stress(self, strains: Floats) -> Floats:
        """Second Piola-Kirchhoff stress S of each cell [Pa], flat, of the integrals of strain."""
        forces = self._moduli * times(self._averages, strains)
        x, y = self._averages.createVecs()
        y.array[:] = forces
        self._averages.multTranspose(y, x)
        return np.array(x.array)

    def stiffness(self, strain_rates: Any, changes: Any = None) -> Any:
        """(A B)^T D (A B') of PETSc matrices: B, the derivative of the integrals of strain, and B'.

        Args:
            strain_rates: B.
            changes: B', of the integrals that the stress is of; None is B.
        """
        means = self._averages.matMult(strain_rates)
        forces = means.copy() if changes is None else self._averages.matMult(changes)
        moduli = forces.createVecLeft()
        moduli.array[:] = self._moduli
        forces.diagonalScale(L=moduli)
        return means.transposeMatMult(forces)


def times(matrix: Any, values: Floats) -> Floats:
    """A PETSc matrix times a flat vector."""
    x, y = matrix.createVecs()
    x.array[:] = values
    matrix.mult(x, y)
    return np.array(y.array)


def sparse_matrix(rows: Indices, columns: Indices, values: Floats, shape: tuple[int, int]) -> Any:
    """The PETSc matrix of these entries, each named once."""
    order = np.lexsort((columns, rows))
    starts = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=shape[0]))])
    csr = (starts.astype(PETSc.IntType), columns[order].astype(PETSc.IntType), values[order])
    return PETSc.Mat().createAIJ(shape, csr=csr, comm=COMM)
