"""Volume, surface area, energy and det F of a deformed body."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.reference import fenicsx
from palpate.reference.across_ranks import last_offered
from palpate.reference.discrete_problem import ElasticBody
from palpate.reference.fenicsx import ufl
from palpate.reference.kinematics import cofactor, deformation_gradient


def lattice(order: int) -> Points:
    """Points of the reference tetrahedron with coordinates i/order, vertices included."""
    if order == 0:
        return np.full((1, 3), 0.25)
    rows = [r for r in itertools.product(range(order + 1), repeat=3) if sum(r) <= order]
    points: Points = np.array(rows, dtype=np.float64) / order
    return points


class DetFSampler:
    """The smallest det F of a displacement.

    det F is a polynomial of degree 3 (p - 1) in a cell: one point for p = 1, else the lattice
    that determines it, with the vertices among its points.
    """

    def __init__(self, body: ElasticBody) -> None:
        self._body = body
        mesh = body.space.transferred.mesh
        points = lattice(3 * (body.space.degree - 1))
        F = deformation_gradient(body.u)
        self._det_f = fenicsx.evaluate_in_cells(mesh, ufl.det(F), points)
        gradient = ufl.grad(body.u)
        self._gradient = fenicsx.evaluate_in_cells(mesh, ufl.inner(gradient, gradient), points)

    def smallest(self, displacement: Floats) -> float:
        """Smallest det F at the sample points [-]."""
        self._body.set_displacement(displacement)
        return fenicsx.smallest(float(np.min(self._det_f())))

    def largest_gradient(self, displacement: Floats) -> float:
        """Largest Frobenius norm of grad u at the sample points [-]."""
        self._body.set_displacement(displacement)
        return fenicsx.largest(float(np.sqrt(np.max(self._gradient()))))


def find_smallest_stretch(body: ElasticBody, displacement: Floats) -> tuple[float, Points]:
    """Smallest principal stretch at the sample points [-], and its place at rest [m], shape (3,).

    The root of the smallest eigenvalue of F^T F.
    """
    transferred = body.space.transferred
    mesh = transferred.mesh
    points = lattice(3 * (body.space.degree - 1))
    sample = fenicsx.evaluate_in_cells(mesh, deformation_gradient(body.u), points)
    body.set_displacement(displacement)
    F = sample().reshape(-1, len(points), 3, 3)
    squared = np.linalg.eigvalsh(np.swapaxes(F, 2, 3) @ F)[..., 0]
    cell, point = np.unravel_index(int(np.argmin(squared)), squared.shape)
    corners = mesh.geometry.x[fenicsx.cell_nodes(mesh)[cell], :3]
    place = corners[0] + points[point] @ (corners[1:] - corners[0])
    found = float(np.sqrt(max(squared[cell, point], 0.0)))
    least = fenicsx.smallest(found)
    # Of equal ranks the last one's word counts.
    return least, last_offered(place, found == least)


def least_moduli(body: ElasticBody, displacement: Floats) -> Floats:
    """How much of its stiffness is left at the corners of each cell [-], in the TetMesh's order.

    Along principal directions, with stretches l and second Piola-Kirchhoff stresses S, the energy
    of Saint-Venant-Kirchhoff curves by S_i + (lmbda + 2 mu) l_i^2 under a further stretch, and by
    S_j + mu l_i^2 under a shear of directions i and j; both over what they are at rest. At 0 it
    loses rank-one convexity (J. E. Marsden, T. J. R. Hughes, Mathematical Foundations of
    Elasticity, 1983, section 3.4): confined compression gets there at a stretch of 0.577 by the
    first, and with Poisson's ratio 0.3 at 0.655 by the second. Of other laws, most of which stiffen
    as they are pressed, 1 everywhere.
    """
    transferred = body.space.transferred
    if not body.law.is_linear_in_strain:
        return np.ones(transferred.source.num_cells)
    mesh, points = transferred.mesh, lattice(1)
    F_at = fenicsx.evaluate_in_cells(mesh, deformation_gradient(body.u), points)
    S_at = fenicsx.evaluate_in_cells(mesh, body.stress, points)
    body.set_displacement(displacement)
    F, S = (sample().reshape(-1, len(points), 3, 3) for sample in (F_at, S_at))
    lmbda, mu = (fenicsx.cell_values(x)[:, None, None] for x in body.lame)
    squared, along = np.linalg.eigh(np.swapaxes(F, 2, 3) @ F)
    stress = np.einsum("cpik,cpij,cpjk->cpk", along, S, along)
    least = ((stress + (lmbda + 2.0 * mu) * squared) / (lmbda + 2.0 * mu)).min(axis=(1, 2))
    for i, j in itertools.permutations(range(3), 2):
        shear = (stress[..., j] + mu[..., 0] * squared[..., i]) / mu[..., 0]
        least = np.minimum(least, shear.min(axis=1))
    everywhere = np.zeros(transferred.source.num_cells)
    everywhere[transferred.cell_of_cell] = least
    moduli: Floats = fenicsx.total(everywhere)
    return moduli


@dataclass(frozen=True)
class DeformedState:
    """Volume [m3], surface area [m2] and strain energy [J] of a displacement."""

    volume: float
    surface_area: float
    strain_energy: float


def measure_state(body: ElasticBody, displacement: Floats) -> DeformedState:
    """Integrate over the rest body: volume of det F, area of |cof(F) N|, energy of psi.

    det F and psi are polynomials and integrated exactly. |cof(F) N| is constant on a facet for
    degree 1; beyond that it is the root of a polynomial, and four orders more are spent on it.
    """
    mesh = body.space.transferred.mesh
    body.set_displacement(displacement)
    F = deformation_gradient(body.u)
    order = body.space.degree - 1
    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": 3 * order})
    ds = ufl.ds(domain=mesh, metadata={"quadrature_degree": 8 * order})
    area_vector = cofactor(F) * ufl.FacetNormal(mesh)
    return DeformedState(
        volume=fenicsx.assemble_scalar(fenicsx.form(ufl.det(F) * dx)),
        surface_area=fenicsx.assemble_scalar(
            fenicsx.form(ufl.sqrt(ufl.inner(area_vector, area_vector)) * ds)
        ),
        strain_energy=body.strain_energy(displacement),
    )
