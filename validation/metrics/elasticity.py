"""Energy and nodal forces of a displacement, worked out by the judge itself for both sides.

Plain NumPy on linear tetrahedra, apart from fastsim and from the reference. Only what follows
from the displacement and the case's law can be measured so.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.boundary_conditions import Load, Pressure
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.exchange.nodal_loads import cell_materials, held_components, nodal_force
from palpate.validation.metrics.finite import largest
from palpate.validation.metrics.smoothing import Smoothing

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


class ElasticForces:
    """Internal forces of one body again and again: what does not change is worked out once."""

    def __init__(self, problem: Problem, strain: Strain, element: Element = Element.LINEAR) -> None:
        mesh = problem.mesh
        self._cells, self._shape = mesh.cells, mesh.points.shape
        self._gradients = shape_gradients(mesh)
        self._by_volume = (
            signed_volumes(mesh.points, mesh.cells)[:, None, None] * self._gradients
        ).transpose(0, 2, 1)
        self._lmbda, self._mu = _lame(problem)
        self._strain = strain
        is_smoothed = element is Element.SMOOTHED
        self._smoothing = Smoothing(mesh, self._lmbda, self._mu) if is_smoothed else None

    def __call__(self, displacement: Points) -> Points:
        """Derivative of the strain energy by the points [N], (num_points, 3); sums to zero."""
        gradients = displacement[self._cells].transpose(0, 2, 1) @ self._gradients
        E = 0.5 * (gradients + gradients.transpose(0, 2, 1))
        if self._strain is Strain.GREEN:
            E += 0.5 * (gradients.transpose(0, 2, 1) @ gradients)
        if self._smoothing is not None:
            S = self._smoothing.stress(E)
        else:
            S = 2.0 * self._mu[:, None, None] * E
            diagonal = np.arange(3)
            S[:, diagonal, diagonal] += (self._lmbda * np.trace(E, axis1=1, axis2=2))[:, None]
        P = S if self._strain is Strain.LINEAR else S + gradients @ S
        by_corner = (P @ self._by_volume).transpose(0, 2, 1)
        return sum_at_points(self._cells, by_corner, self._shape[0])


def sum_at_points(places: Indices, forces: Array, num_points: int) -> Points:
    """Sum forces (n, k, 3) of the corners of cells or facets (n, k) at the points they name."""
    flat, rows = places.ravel(), forces.reshape(-1, 3)
    summed: Points = np.stack(
        [np.bincount(flat, rows[:, axis], num_points) for axis in range(3)], axis=1
    )
    return summed


def internal_force(
    problem: Problem,
    displacement: Points,
    strain: Strain,
    element: Element = Element.LINEAR,
) -> Points:
    """Derivative of the strain energy by the points [N], (num_points, 3); sums to zero."""
    return ElasticForces(problem, strain, element)(displacement)


def load_force(mesh: TetMesh, load: Load, displacement: Points, strain: Strain) -> Points:
    """Force of any load at full size on each point [N], (num_points, 3).

    A pressure follows: -p times a third of the deformed facet's area along its outward normal at
    each corner, exact on linear tetrahedra; with linear strain on the facet at rest.
    """
    if not isinstance(load, Pressure):
        return nodal_force(mesh, load)
    places = mesh.points if strain is Strain.LINEAR else mesh.points + displacement
    a, b, c = (places[load.facets[:, k]] for k in range(3))
    thirds = -load.pressure / 6.0 * np.cross(b - a, c - a)
    return sum_at_points(load.facets, np.repeat(thirds[:, None], 3, axis=1), mesh.num_points)


def force_of_strain(problem: Problem, strain: Array) -> Points:
    """Nodal forces V (C : E) grad N of a strain by cell, (num_cells, 3, 3) [N]; linear theory."""
    mesh = problem.mesh
    lmbda, mu = _lame(problem)
    stress = 2.0 * mu[:, None, None] * strain
    stress += (lmbda * np.trace(strain, axis1=1, axis2=2))[:, None, None] * np.eye(3)
    volumes = signed_volumes(mesh.points, mesh.cells)[:, None, None]
    by_corner = (volumes * stress @ shape_gradients(mesh).transpose(0, 2, 1)).transpose(0, 2, 1)
    return sum_at_points(mesh.cells, by_corner, mesh.num_points)


def diagonal_of_stiffness(problem: Problem) -> Points:
    """Diagonal of the stiffness at rest [N/m], (num_points, 3).

    Of corner a along i: V ((lmbda + mu) (grad_i N_a)^2 + mu |grad N_a|^2).
    """
    mesh = problem.mesh
    lmbda, mu = (array[:, None, None] for array in _lame(problem))
    squared = shape_gradients(mesh) ** 2
    volumes = signed_volumes(mesh.points, mesh.cells)[:, None, None]
    by_corner = volumes * ((lmbda + mu) * squared + mu * squared.sum(axis=2, keepdims=True))
    return sum_at_points(mesh.cells, by_corner, mesh.num_points)


def out_of_balance(
    problem: Problem,
    displacement: Points,
    strain: Strain,
    element: Element = Element.LINEAR,
) -> tuple[Points, float]:
    """What is left of external and internal forces where nothing is held, tools left out.

    Returns:
        External less internal force at each point, 0 in held components [N], (num_points, 3);
        the largest internal or external force of a point [N], to hold it against.
    """
    internal = internal_force(problem, displacement, strain, element)
    external = np.zeros_like(internal)
    for load in problem.loads:
        external += load_force(problem.mesh, load, displacement, strain)
    scale = largest(np.linalg.norm(np.concatenate([internal, external]), axis=1))
    fixed, _ = held_components(problem)
    return (external - internal) * (1.0 - fixed), scale


def factor_at_end(problem: Problem, load: Load) -> float:
    """What a load is multiplied by at the end of a motion; 1 in statics."""
    if problem.time is None or load.amplitude is None:
        return 1.0
    return load.amplitude(problem.time.end_time)


def support_reactions(problem: Problem, displacement: Points, strain: Strain) -> Points:
    """Total force that each support exerts in its held components [N], (num_supports, 3).

    The internal force less the dead loads at the held points: zero elsewhere in equilibrium.
    Follower pressure on held points is not subtracted.
    """
    force = internal_force(problem, displacement, strain)
    for load in problem.loads:
        force = force - factor_at_end(problem, load) * nodal_force(problem.mesh, load)
    fixed, _ = held_components(problem)
    force = force * fixed
    return np.array(
        [force[s.points].sum(axis=0) * np.array(s.components) for s in problem.supports]
    ).reshape(-1, 3)
