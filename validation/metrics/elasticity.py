"""Energy and nodal forces of a displacement, worked out by the judge itself for both sides.

Plain NumPy on linear tetrahedra, apart from fastsim and from the reference. Only what follows
from the displacement and the case's law can be measured so.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.exchange.nodal_loads import cell_materials, held_components

Array = NDArray[np.float64]


def shape_gradients(mesh: TetMesh) -> Array:
    """Rest gradients of the four linear shape functions of each cell [1/m], (num_cells, 4, 3)."""
    corners = mesh.points[mesh.cells]
    inverse = np.linalg.inv((corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1))
    return np.concatenate([-inverse.sum(axis=1)[:, None], inverse], axis=1)


def displacement_gradients(mesh: TetMesh, displacement: Points) -> Array:
    """Gradient of a linear field in each cell [-], (num_cells, 3, 3)."""
    gradients: Array = np.einsum(
        "cai,caj->cij", displacement[mesh.cells], shape_gradients(mesh), optimize=True
    )
    return gradients


def _strain(gradients: Array, strain: Strain) -> Array:
    measure = 0.5 * (gradients + gradients.transpose(0, 2, 1))
    if strain is Strain.GREEN:
        measure = measure + 0.5 * np.einsum("cki,ckj->cij", gradients, gradients)
    return measure


def _lame(problem: Problem) -> tuple[Array, Array]:
    E, nu = cell_materials(problem)[:, :2].T
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def strain_energy(problem: Problem, displacement: Points, strain: Strain) -> float:
    """Integral of psi = lmbda/2 tr(E)^2 + mu tr(E^2) over the rest volume [J]."""
    mesh = problem.mesh
    lmbda, mu = _lame(problem)
    E = _strain(displacement_gradients(mesh, displacement), strain)
    density = 0.5 * lmbda * np.einsum("cii->c", E) ** 2 + mu * np.einsum("cij,cij->c", E, E)
    return float(signed_volumes(mesh.points, mesh.cells) @ density)


def internal_force(problem: Problem, displacement: Points, strain: Strain) -> Points:
    """Derivative of the strain energy by the points [N], (num_points, 3); sums to zero."""
    mesh = problem.mesh
    lmbda, mu = _lame(problem)
    gradients = displacement_gradients(mesh, displacement)
    E = _strain(gradients, strain)
    S = 2.0 * mu[:, None, None] * E
    S += (lmbda * np.einsum("cii->c", E))[:, None, None] * np.eye(3)
    P = S if strain is Strain.LINEAR else S + gradients @ S
    volumes = signed_volumes(mesh.points, mesh.cells)
    by_corner = np.einsum("c,cij,caj->cai", volumes, P, shape_gradients(mesh), optimize=True)
    force = np.zeros_like(mesh.points)
    np.add.at(force, mesh.cells, by_corner)
    return force


def support_reactions(problem: Problem, displacement: Points, strain: Strain) -> Points:
    """Total force that each support exerts in its held components [N], (num_supports, 3).

    The internal force less the dead loads at the held points: zero elsewhere in equilibrium.
    Follower pressure on held points is not subtracted.
    """
    from palpate.validation.exchange.nodal_loads import nodal_force

    force = internal_force(problem, displacement, strain)
    for load in problem.loads:
        force = force - nodal_force(problem.mesh, load)
    fixed, _ = held_components(problem)
    force = force * fixed
    return np.array(
        [force[s.points].sum(axis=0) * np.array(s.components) for s in problem.supports]
    ).reshape(-1, 3)
