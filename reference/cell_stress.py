"""Stresses of cells and forces of supports: what is known beside the displacement.

Means over a rest cell of the second Piola-Kirchhoff stress S that the virtual work is made of, and
of Cauchy's stress (J. Bonet, R. D. Wood, 2nd ed. 2008, section 5.5)

    sigma = F S F^T / det F,

which under linear strain is S itself, and of the first Piola-Kirchhoff stress P = F S, whose mean
makes the nodal forces V P grad N of linear shape functions. On linear tetrahedra, smoothed or not,
all are constant in a cell; the smoothed ones' S already is an average over the cell's edges and
nodes.

Note:
    At clamped edges and reentrant corners stresses grow without end as the mesh is refined: compare
    them away from there, and never by the largest.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Strain
from palpate.meshes.tet_mesh import signed_volumes
from palpate.reference import fenicsx
from palpate.reference.discrete_problem import DiscreteProblem
from palpate.reference.fenicsx import ufl
from palpate.reference.kinematics import deformation_gradient


def cauchy_stress(F: Any, S: Any) -> Any:
    """Return sigma = F S F^T / det F [Pa]."""
    return F * S * F.T / ufl.det(F)


def measure_stresses(
    discrete: DiscreteProblem, displacement: Floats
) -> tuple[Floats, Floats, Floats]:
    """Mean of S, of sigma and of P in each cell [Pa], (num_cells, 3, 3), in the TetMesh's order."""
    discrete.set_displacement(displacement)
    S = discrete.stress
    if discrete.strain is Strain.LINEAR:
        mean = _cell_means(discrete, S)
        return mean, mean, mean
    F = deformation_gradient(discrete.u)
    S_mean, sigma, P = (_cell_means(discrete, T) for T in (S, cauchy_stress(F, S), F * S))
    return S_mean, sigma, P


def _cell_means(discrete: DiscreteProblem, tensor: Any) -> Floats:
    transferred = discrete.space.transferred
    source = transferred.source
    tensors = fenicsx.cell_tensor_space(transferred.mesh)
    # S is of degree 2 (p - 1), F S F^T of twice that; det F, beneath, is nearly constant in a cell.
    degree = discrete.stress_degree
    if degree is None:
        degree = 4 * (discrete.space.degree - 1)
    dx = ufl.dx(domain=transferred.mesh, metadata={"quadrature_degree": degree})
    form = fenicsx.form(ufl.inner(tensor, ufl.TestFunction(tensors)) * dx)
    integrals = fenicsx.assemble_vector(form).reshape(-1, 3, 3)
    everywhere = np.zeros((source.num_cells, 3, 3))
    everywhere[transferred.cell_of_cell] = integrals[fenicsx.cell_dofs(tensors)[:, 0]]
    volumes = signed_volumes(source.points, source.cells)
    means: Floats = fenicsx.total(everywhere) / volumes[:, None, None]
    return means


def support_forces(discrete: DiscreteProblem, displacement: Floats) -> Points:
    """Force of each support on the body [N], shape (num_supports, 3).

    The nodal forces that are out of balance without it, R = internal - external - contact, summed
    over what it holds: with the loads they add up to nothing, to rounding. See `HeldDofs.shares`.
    """
    reactions = discrete.of_displacement(
        discrete.internal_force(displacement)
        - discrete.external_force(displacement)
        - discrete.contact_force(displacement)
    )
    total: Points = fenicsx.total(discrete.held.shares(reactions.reshape(-1, 3)))
    return total
