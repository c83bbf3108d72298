"""Where a solution on linear tetrahedra is wrong: recovered against computed stress.

The stress of linear tetrahedra is constant in each cell. Averaged to the points it is nearer the
truth (Zienkiewicz, Zhu 1987), so the difference tells where cells are too large.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.fastsim.body import Body
from palpate.fastsim.cell_stress import cell_stress
from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.tet_mesh import TetMesh, signed_volumes


def recovered_stress(mesh: TetMesh, stress: Floats) -> Floats:
    """Stress at the points: the mean of the cells around, by volume, (num_points, 3, 3) [Pa]."""
    volumes = signed_volumes(mesh.points, mesh.cells)
    total = np.zeros((mesh.num_points, 9))
    weight = np.zeros(mesh.num_points)
    rows = volumes[:, None] * stress.reshape(-1, 9)
    for k in range(4):
        np.add.at(total, mesh.cells[:, k], rows)
        np.add.at(weight, mesh.cells[:, k], volumes)
    means: Floats = (total / weight[:, None]).reshape(-1, 3, 3)
    return means


def estimate_error(body: Body, displacement: ArrayLike) -> Floats:
    """Estimated error of each cell in the energy norm [J^(1/2)], shape (num_cells,).

    The root of the integral of (S* - S) : C^-1 : (S* - S) over the rest cell, S* linear between
    recovered values at the points. An indicator, not a bound: it finds where to refine.

    Args:
        body: Mesh, material and strain.
        displacement: [m], shape (num_points, 3), finite.
    """
    mesh = body.mesh
    stress = cell_stress(body, displacement)
    at_points = recovered_stress(mesh, stress)
    gap = at_points[mesh.cells] - stress[:, None]
    lmbda, mu = body.lmbda, body.mu

    def product(a: Floats, b: Floats) -> Floats:
        # a : C^-1 : b = (a : b - lmbda / (3 lmbda + 2 mu) tr a tr b) / (2 mu)
        whole = np.einsum("cij,cij->c", a, b)
        traces = np.einsum("cii->c", a) * np.einsum("cii->c", b)
        out: Floats = (whole - lmbda / (3.0 * lmbda + 2.0 * mu) * traces) / (2.0 * mu)
        return out

    # Linear functions on a tetrahedron: int N_a N_b = V (1 + delta_ab) / 20.
    total = product(gap.sum(axis=1), gap.sum(axis=1))
    for k in range(4):
        total += product(gap[:, k], gap[:, k])
    squared = np.maximum(total, 0.0) * signed_volumes(mesh.points, mesh.cells) / 20.0
    errors: Floats = np.sqrt(squared)
    return errors


def mark_largest(errors: ArrayLike, *, part: float = 0.5) -> NDArray[np.bool_]:
    """The fewest cells that hold a part of the squared error (Doerfler 1996).

    Args:
        errors: Of each cell, >= 0, shape (num_cells,).
        part: Above 0, at most 1.
    """
    squared = np.asarray(errors, dtype=np.float64) ** 2
    if not 0.0 < part <= 1.0:
        raise InputError(f"part = {part:g}: needs a value above 0, at most 1")
    if squared.ndim != 1 or not np.isfinite(squared).all():
        raise InputError("errors need one finite value for each cell")
    order = np.argsort(-squared, kind="stable")
    summed = np.cumsum(squared[order])
    marked = np.zeros(len(squared), dtype=bool)
    if summed.size and summed[-1] > 0.0:
        needed = int(np.searchsorted(summed, part * summed[-1] * (1.0 - 1e-12))) + 1
        marked[order[:needed]] = True
    return marked
