"""Stresses of cells: what the energy is made of, and Cauchy's.

On linear tetrahedra, smoothed or not, both are constant in a cell. The smoothed element's S already
is an average over the cell's edges and corners; it is turned by the cell's own F.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.fastsim.body import Body
from palpate.meshes.arrays import Floats
from palpate.meshes.problem import Strain


def cell_stress(body: Body, displacement: ArrayLike) -> Floats:
    """Stress of each cell: S = lmbda tr(E) I + 2 mu E (eq. 2, 3-4, 6-7), as the element takes it.

    By another law S = F^-1 P.

    Args:
        body: Its strain says which: with engineering strain S is Cauchy's stress, with Green
            strain the second Piola-Kirchhoff stress.
        displacement: [m], shape (num_points, 3), finite.

    Returns:
        [Pa], shape (num_cells, 3, 3), symmetric.
    """
    gradient = body.displacement_gradients(displacement)
    if body.strain is Strain.GREEN and not body.law.is_linear_in_strain:
        P = body.first_piola_kirchhoff_stresses(displacement)
        S: Floats = np.linalg.solve(np.eye(3) + gradient, P)
        return S
    E = 0.5 * (gradient + gradient.transpose(0, 2, 1))
    if body.strain is Strain.GREEN:
        E = E + 0.5 * np.einsum("cki,ckj->cij", gradient, gradient)
    return body.stresses(E)


def cauchy_stress(body: Body, displacement: ArrayLike) -> Floats:
    """Cauchy's stress of each cell, F S F^T / det F; with engineering strain S itself.

    Args:
        body: Its strain says which.
        displacement: [m], shape (num_points, 3), finite.

    Returns:
        [Pa], shape (num_cells, 3, 3), symmetric; not finite where det F is 0 or a number overflows.
    """
    S = cell_stress(body, displacement)
    if body.strain is Strain.LINEAR:
        return S
    F = np.eye(3) + body.displacement_gradients(displacement)
    with np.errstate(all="ignore"):
        sigma: Floats = F @ S @ F.transpose(0, 2, 1) / body.det_f(displacement)[:, None, None]
    return sigma
