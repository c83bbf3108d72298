"""Volume, surface area, energy, det F, stresses and support forces of a deformed body.

Stresses are means over a rest cell: of the second Piola-Kirchhoff stress S in the virtual work,
of Cauchy's stress (J. Bonet, R. D. Wood, 2nd ed. 2008, section 5.5)

    sigma = F S F^T / det F,

which under linear strain is S itself, and of the first Piola-Kirchhoff stress P = F S, whose mean
gives the nodal forces V P grad N of linear shape functions. On linear tetrahedra, smoothed or not,
all three are constant in a cell; S of a smoothed one is an average over its edges and nodes.

Note:
    At clamped edges and reentrant corners stresses grow without bound as the mesh is refined:
    compare them away from there, and never by the largest.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Strain
from palpate.reference import fenicsx
from palpate.reference.discrete_problem import DiscreteProblem, ElasticBody
from palpate.reference.fenicsx import last_offered, ufl
from palpate.reference.laws import cofactor, deformation_gradient

# Number of cells whose stresses are computed at once: some kilobytes each.
_AT_ONCE = 20_000


def lattice(order: int) -> Points:
    """Points of the reference tetrahedron with coordinates i/order, vertices included."""
    if order == 0:
        return np.full((1, 3), 0.25)
    rows = [r for r in itertools.product(range(order + 1), repeat=3) if sum(r) <= order]
    return np.array(rows, dtype=np.float64) / order


class DetFSampler:
    """Measures the smallest det F of a displacement.

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
    """Smallest principal stretch at the sample points [-], and its rest position [m], shape (3,).

    The stretch is the root of the smallest eigenvalue of F^T F.
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
    position = corners[0] + points[point] @ (corners[1:] - corners[0])
    found = float(np.sqrt(max(squared[cell, point], 0.0)))
    least = fenicsx.smallest(found)
    # Where several ranks have the same smallest stretch, the position of the last one is taken.
    return least, last_offered(position, found == least)


def least_modulus(body: ElasticBody, displacement: Floats) -> float:
    """The smallest of `least_moduli`; infinite under linear strain, which loses nothing.

    Where it is not above 0 no equilibrium of the body is stable (Hadamard's condition: Marsden and
    Hughes, section 5.1): what a mesh has there, finer ones lose.
    """
    if body.strain is not Strain.GREEN:
        return math.inf
    return float(least_moduli(body, displacement).min())


def least_moduli(body: ElasticBody, displacement: Floats) -> Floats:
    """Least tangent modulus at the corners of each cell over that at rest [-], in TetMesh order.

    Along principal directions, with stretches l and second Piola-Kirchhoff stresses S, the second
    derivative of Saint-Venant-Kirchhoff's energy is S_i + (lmbda + 2 mu) l_i^2 under a further
    stretch, and S_j + mu l_i^2 under a shear of directions i and j; each is divided by its value
    at rest. At 0 the energy loses rank-one convexity (J. E. Marsden, T. J. R. Hughes, Mathematical
    Foundations of Elasticity, 1983, section 3.4): confined compression reaches this at a stretch
    of 0.577 by the first, and with Poisson's ratio 0.3 at 0.655 by the second. For other laws, most
    of which stiffen in compression, the result is 1 everywhere.
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
    degree 1; for higher degrees it is the root of a polynomial, integrated with four more orders.
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


def measure_stresses(
    discrete: DiscreteProblem, displacement: Floats
) -> tuple[Floats, Floats, Floats]:
    """Mean of S, of sigma and of P in each cell [Pa], (num_cells, 3, 3), in the TetMesh's order."""
    transferred = discrete.space.transferred
    # S is of degree 2 (p - 1), F S F^T of twice that; 1 / det F is nearly constant in a cell.
    degree = discrete.stress_degree
    if degree is None:
        degree = 4 * (discrete.space.degree - 1)
    points, weights = fenicsx.quadrature(degree)
    # One expression of each law is compiled, P; the others follow from F.
    F_at, P_at = (
        fenicsx.evaluate_in_cells(transferred.mesh, of, points)
        for of in (deformation_gradient(discrete.u), discrete.piola)
    )
    discrete.set_displacement(displacement)
    everywhere = np.zeros((3, transferred.source.num_cells, 3, 3))
    own = transferred.cell_of_cell
    for start in range(0, len(own), _AT_ONCE):
        cells = np.arange(start, min(start + _AT_ONCE, len(own)), dtype=np.int32)
        F, P = (at(cells).reshape(len(cells), -1, 3, 3) for at in (F_at, P_at))
        S = sigma = P
        if discrete.strain is Strain.GREEN:
            S, J = np.linalg.solve(F, P), np.linalg.det(F)[..., None, None]
            sigma = P @ np.swapaxes(F, 2, 3) / J
        for mean, tensor in zip(everywhere, (S, sigma, P), strict=True):
            mean[own[cells]] = np.einsum("q,cqij->cij", weights, tensor)
    S_mean, sigma_mean, P_mean = fenicsx.total(everywhere)
    return S_mean, sigma_mean, P_mean


def support_forces(discrete: DiscreteProblem, displacement: Floats) -> Points:
    """Force of each support on the body [N], shape (num_supports, 3).

    It is the sum over the fixed degrees of freedom of R = internal - external - contact, so that
    supports, loads and tools together are in balance to rounding. See `FixedDofs.resultants`.
    """
    reactions = discrete.of_displacement(
        discrete.internal_force(displacement)
        - discrete.external_force(displacement)
        - discrete.contact_force(displacement)
    )
    total: Points = fenicsx.total(discrete.fixed.resultants(reactions.reshape(-1, 3)))
    return total
