"""Multigrid for displacements of a higher degree: those of degree 1 on the same mesh are below.

Aggregation coarsens a matrix by its entries alone. Of quadratic tetrahedra it makes levels that are
expensive (80 entries in a row) and worse than the one that is known: linear displacements on the
same mesh, an eighth of the unknowns. That level is factored, or where it is large coarsened by
aggregation, for which it is made. (E. M. Ronquist and A. T. Patera, J. Sci. Comput. 2 (1987)
389-406; Chebyshev's smoother: M. Adams et al., J. Comput. Phys. 188 (2003) 593-610.)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.reference import fenicsx
from palpate.reference.fenicsx import PETSc
from palpate.reference.mesh_transfer import TransferredSpace, create_space
from palpate.reference.supports import NodeFrames

# Up to this number of unknowns the linear level is factored: 1 s, less than it saves by iterations.
LARGEST_FACTORED = 60_000
_PREFIX = "palpate_reference_linear_level_"
_ZERO = 1e-6  # of a barycentric coordinate


def set_options(options: dict[str, Any]) -> None:
    """Put options into the table that PETSc's objects read theirs from."""
    table = PETSc.Options()
    for key, value in options.items():
        table[key] = value


def aggregation_options(prefix: str, smoothing: int, *, by_blocks: bool) -> dict[str, Any]:
    """Options of PETSc for smoothed aggregation of elastic bodies with Chebyshev's smoother."""
    return {
        f"{prefix}pc_gamg_type": "agg",
        f"{prefix}pc_gamg_agg_nsmooths": 1,
        f"{prefix}pc_gamg_threshold": 0.01,
        **smoother_options(prefix, smoothing, by_blocks=by_blocks),
    }


def smoother_options(prefix: str, smoothing: int, *, by_blocks: bool) -> dict[str, Any]:
    """Options of PETSc for so many smoothing steps by Chebyshev's polynomials.

    Over the 3 by 3 blocks of the nodes: contact adds k n n^T to that of a node, with k a hundred
    times what the body adds. Over the diagonal alone what is stiff along n would be stiff along the
    axes, and a node could not move along the tool: 87 iterations where blocks need 10. But blocks
    of an aggregate that has fewer free unknowns than rigid motions are singular.
    """
    return {
        f"{prefix}mg_levels_ksp_type": "chebyshev",
        f"{prefix}mg_levels_pc_type": "pbjacobi" if by_blocks else "jacobi",
        f"{prefix}mg_levels_ksp_max_it": smoothing,
        f"{prefix}mg_levels_ksp_chebyshev_esteig": "0,0.1,0,1.1",
    }


def attach_rigid_modes(
    matrix: Any, positions: Points, fixed: Indices, turn: Callable[[Floats], Floats] | None = None
) -> None:
    """Pass the rigid motions of nodes at `positions` [m] to a matrix, for aggregation.

    Args:
        matrix: PETSc matrix of three unknowns a node, whose rows this rank owns.
        positions: Rest positions of the nodes that this rank owns [m], shape (n, 3).
        fixed: Unknowns without motion.
        turn: Turns a flat vector along x, y, z to the axes that the unknowns are along.
    """
    num_nodes = fenicsx.total(len(positions))
    centred = positions - fenicsx.total(positions.sum(axis=0)) / num_nodes
    extent = fenicsx.largest(float(np.max(np.abs(centred), initial=0.0)))
    modes = np.zeros((6, len(centred), 3))
    for axis in range(3):
        modes[axis, :, axis] = 1.0
        modes[3 + axis] = np.cross(np.eye(3)[axis], centred / extent)
    flat = modes.reshape(6, -1)
    if turn is not None:
        flat = np.array([turn(mode) for mode in flat])
    flat[:, fixed] = 0.0
    # Orthonormalise by the Gram matrix, summed over the ranks; drop modes that are zero.
    sizes, directions = np.linalg.eigh(fenicsx.total(flat @ flat.T))
    is_independent = sizes > 1e-10 * max(float(sizes[-1]), 1e-300)
    vectors = []
    for mode in (directions[:, is_independent] / np.sqrt(sizes[is_independent])).T @ flat:
        vector = matrix.createVecRight()
        vector.array[:] = mode
        vectors.append(vector)
    matrix.setBlockSizes(3, 3)
    matrix.setNearNullSpace(PETSc.NullSpace().create(vectors=vectors, comm=fenicsx.COMM))


class LinearLevel:
    """Displacements of degree 1 below those of a higher one, as PETSc's multigrid of two levels.

    Its unknowns are along x, y, z at every node, also where those above are along axes of their own
    or fixed: a fixed unknown takes no part of a correction.

    Args:
        space: Displacements of degree 2 or more.
        fixed: Unknowns that supports fix.
        frames: Nodes whose unknowns are along axes of their own; None where there are none.
        is_symmetric: Whether the matrices are.
        by_blocks: Whether aggregation below this level is smoothed by blocks of nodes.
    """

    def __init__(
        self,
        space: TransferredSpace,
        fixed: Indices,
        frames: NodeFrames | None,
        *,
        is_symmetric: bool,
        by_blocks: bool,
    ) -> None:
        self._by_blocks = by_blocks
        self._linear = create_space(space.transferred, 1)
        self._interpolation = _interpolation(space, self._linear, fixed, frames)
        self._is_symmetric = is_symmetric
        self.is_factored = 3 * self._linear.num_global_blocks < LARGEST_FACTORED
        self._matrix: Any = None

    def prepare(self, matrix: Any, preconditioner: Any) -> None:
        """Set the matrix of this level to P^T A P, in a multigrid that `attach` was called for."""
        if self._matrix is not None:
            self._matrix.destroy()
        rows = fenicsx.in_rows(matrix)
        self._matrix = below = rows.ptap(self._interpolation)
        if rows is not matrix:
            rows.destroy()
        diagonal = below.getDiagonal()
        first, _ = below.getOwnershipRange()
        # Nodes all of whose neighbours are fixed: no unknown above belongs to them.
        without = np.flatnonzero(np.array(diagonal.array) == 0.0) + first
        typical = float(diagonal.norm(PETSc.NormType.NORM_1)) / diagonal.size
        diagonal.destroy()
        below.zeroRowsColumns(without.astype(PETSc.IntType), diag=typical or 1.0)
        if self._is_symmetric:
            below.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        if not self.is_factored:
            nowhere = np.zeros(0, dtype=np.int32)
            attach_rigid_modes(below, self._linear.coordinates, nowhere)
        preconditioner.getMGCoarseSolve().setOperators(below)

    def attach(self, ksp: Any) -> None:
        """Make a Krylov solver's preconditioner the multigrid of two levels."""
        preconditioner = ksp.getPC()
        preconditioner.setType("mg")
        preconditioner.setMGLevels(2)
        preconditioner.setMGInterpolation(1, self._interpolation)
        below = preconditioner.getMGCoarseSolve()
        below.setType("preonly")
        if self.is_factored:
            below.getPC().setType("cholesky" if self._is_symmetric else "lu")
            below.getPC().setFactorSolverType("mumps")
        else:
            below.getPC().setType("gamg")
            below.setOptionsPrefix(_PREFIX)
            set_options(aggregation_options(_PREFIX, 2, by_blocks=self._by_blocks))
            below.setFromOptions()


def _interpolation(
    space: TransferredSpace, linear: TransferredSpace, fixed: Indices, frames: NodeFrames | None
) -> Any:
    """The PETSc matrix P of the unknowns of `space` from linear displacements along x, y, z."""
    from scipy.sparse import csr_matrix

    nodes, corners = fenicsx.cell_dofs(space.space), fenicsx.cell_dofs(linear.space)
    # Barycentric coordinates of the nodes of each cell; the first four are its corners.
    x = space.space.tabulate_dof_coordinates()[nodes]
    edges = (x[:, 1:4] - x[:, :1]).transpose(0, 2, 1)
    inner = np.linalg.solve(edges, (x - x[:, :1]).transpose(0, 2, 1)).transpose(0, 2, 1)
    of_cell = np.concatenate([1.0 - inner.sum(axis=2, keepdims=True), inner], axis=2)
    of_cell[np.abs(of_cell) < _ZERO] = 0.0
    weights = np.zeros((space.num_local_blocks, 4))
    ends = np.zeros((space.num_local_blocks, 4), dtype=np.int32)
    weights[nodes] = of_cell
    ends[nodes] = corners[:, None, :]
    number, num_own = linear.space.dofmap.index_map.local_to_global, space.num_blocks
    columns = np.asarray(number(ends[:num_own].ravel()), dtype=np.int64).reshape(-1, 4)
    # Rows of each node's unknowns, in blocks of 3 by 3.
    turned = np.broadcast_to(np.eye(3), (num_own, 3, 3)).copy()
    if frames is not None:
        turned[frames.dofs[:, 0] // 3] = frames.axes
    turned.reshape(-1, 3)[fixed] = 0.0
    rows, end = np.nonzero(weights[:num_own])
    entries = weights[rows, end][:, None, None] * turned[rows]
    axes = np.arange(3)
    down = np.broadcast_to(3 * rows[:, None, None] + axes[:, None], entries.shape)
    along = np.broadcast_to(3 * columns[rows, end][:, None, None] + axes, entries.shape)
    shape = (3 * num_own, 3 * linear.num_global_blocks)
    found = csr_matrix((entries.ravel(), (down.ravel(), along.ravel())), shape)
    found.eliminate_zeros()
    return PETSc.Mat().createAIJ(
        tuple((3 * of.num_blocks, 3 * of.num_global_blocks) for of in (space, linear)),
        bsize=(3, 3),
        csr=(found.indptr.astype(PETSc.IntType), found.indices.astype(PETSc.IntType), found.data),
        comm=fenicsx.COMM,
    )
