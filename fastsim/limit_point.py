"""Where a body has softened when it loses its equilibrium.

At a limit point the tangent stiffness K loses its smallest eigenvalue. Beside it stands the same
matrix without the stress that destabilises, K_m = sum of V B^T D B with the law's D = dS/dE at the
present F: the smallest x . K x / x . K_m x is 1 in a body without stress and 0 at the limit, at any
rotation and scale.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.fastsim.body import Body
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Strain
from palpate.meshes.tet_mesh import TetMesh

# Inverse iterations for the softest direction, whose ratio falls apart from the next near a limit.
_ITERATIONS = 8
# Change of the displacement gradient by which stresses are derived: what it leaves out is of its
# square, what rounding adds of eps over it.
_SMALL = 1e-5
# A body this soft is at its limit, to the step by which the load was raised.
SOFT = 0.25


@dataclass(frozen=True)
class Softening:
    """How near an equilibrium is to its limit, and where.

    Attributes:
        stiffness: Smallest x . K x / x . K_m x [-]; 1 without stress, 0 at the limit, below 0
            where the equilibrium found is not stable.
        cell: The cell that the softest direction strains most.
        place: Its centre at rest [m].
        smallest_stretch: Smallest principal stretch of all cells [-].
        stretched_cell: The cell that has it.
    """

    stiffness: float
    cell: int
    place: tuple[float, float, float]
    smallest_stretch: float
    stretched_cell: int


def smallest_stretches(body: Body, displacement: Points) -> Floats:
    """Smallest principal stretch of each cell [-], shape (num_cells,): sqrt of C's eigenvalue."""
    F = body.displacement_gradients(displacement) + np.eye(3)
    C = F.transpose(0, 2, 1) @ F
    stretches: Floats = np.sqrt(np.maximum(np.linalg.eigvalsh(C)[:, 0], 0.0))
    return stretches


def find_softening(
    body: Body, displacement: Points, solve: Callable[[Points], Points | None]
) -> Softening:
    """Measure how far a body has softened at an equilibrium.

    Args:
        body: Mesh, material and strain.
        displacement: The equilibrium [m], shape (num_points, 3).
        solve: K x = b with the held components of x zero; None where K is not positive definite.
    """
    mesh = body.mesh
    stretches = smallest_stretches(body, displacement)
    stretched = int(np.argmin(stretches))
    form = _MaterialStiffness(body, displacement)
    right_side = form.times(smooth_direction(mesh))
    stiffness, mode = -1.0, None
    for _ in range(_ITERATIONS):
        x = solve(right_side)
        if x is None:
            break
        next_side = form.times(x)
        # K x = b, so that x . K x = x . b.
        with np.errstate(invalid="ignore", divide="ignore"):
            # NaN, where numbers leave their range, is no sign of a limit.
            stiffness = float(np.sum(x * right_side) / np.sum(x * next_side))
        mode = x
        right_side = next_side / np.linalg.norm(next_side)
    cell = stretched if mode is None else int(np.argmax(form.densities(mode)))
    centre = mesh.points[mesh.cells[cell]].mean(axis=0)
    place = float(centre[0]), float(centre[1]), float(centre[2])
    return Softening(stiffness, cell, place, float(stretches[stretched]), stretched)


def smooth_direction(mesh: TetMesh) -> Points:
    """A displacement without symmetry: random polynomials of degree 3, so every mode is in it."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    x, y, z = (2.0 * (mesh.points - low) / np.maximum(high - low, 1e-300) - 1.0).T
    powers = [x**i * y**j * z**k for i in range(4) for j in range(4 - i) for k in range(4 - i - j)]
    coefficients = np.random.default_rng(0).standard_normal((len(powers), 3))
    direction: Points = np.array(powers).T @ coefficients
    return direction / float(np.linalg.norm(direction))


class _MaterialStiffness:
    """K_m x = sum of V F (dS/dE : sym(F^T grad x)) grad N, cell by cell.

    The change of S along x is a central difference of the law's own: exact but for rounding where S
    is a polynomial of degree 2 in the displacement, as Saint-Venant-Kirchhoff's is.
    """

    def __init__(self, body: Body, displacement: Points) -> None:
        self._body, self._displacement = body, displacement
        self._F = self._gradients(displacement)
        self._volumes = body.mesh.cell_volumes

    def times(self, x: Points) -> Points:
        cells = self._body.mesh.cells
        P = self._volumes[:, None, None] * (self._F @ self._stress_changes(x))
        product = np.zeros_like(x)
        np.add.at(product, cells, self._body.shape_gradients @ P.transpose(0, 2, 1))
        return product

    def densities(self, x: Points) -> Floats:
        strain = self._F.transpose(0, 2, 1) @ self._body.displacement_gradients(x)
        values: Points = (strain * self._stress_changes(x)).sum(axis=(1, 2))
        return values

    def _gradients(self, displacement: Points) -> Floats:
        """F, which is I under linear strain."""
        H = self._body.displacement_gradients(displacement)
        F: Floats = np.eye(3) + (H if self._body.strain is Strain.GREEN else 0.0 * H)
        return F

    def _stresses(self, displacement: Points) -> Floats:
        """Second Piola-Kirchhoff's S = F^-1 P."""
        P = self._body.first_piola_kirchhoff_stresses(displacement)
        S: Floats = np.linalg.solve(self._gradients(displacement), P)
        return S

    def _stress_changes(self, x: Points) -> Floats:
        largest = float(np.abs(self._body.displacement_gradients(x)).max())
        step = _SMALL / largest if largest > 0.0 else 1.0
        ahead, behind = (self._stresses(self._displacement + s * x) for s in (step, -step))
        changes: Floats = (ahead - behind) / (2.0 * step)
        return changes
