"""Energy, stress and tangent of a simulator's law, read from the forces of single cells.

A body of n separate tetrahedra, each deformed by an F of its own: u_a = (F - I) X_a. Of one cell
f_a = V P grad N_a, and the sum of grad N_a (x) X_a is I, so that P = 1/V sum of f_a (x) X_a.
"""

from __future__ import annotations

from functools import cache
from typing import Protocol

import numpy as np

from palpate.fastsim.body import Body
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Material, Problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.metrics.laws import Array

# Right-angled, with edges of 1 m.
CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
VOLUME = 1.0 / 6.0


class LawOf(Protocol):
    """A law as somebody has written it; F of shape (n, 3, 3) with n as first asked for."""

    @property
    def name(self) -> str:
        """Whose."""

    def energy(self, F: Array) -> Array:
        """W [J/m3], (n,)."""

    def stress(self, F: Array) -> Array:
        """P [Pa], (n, 3, 3)."""

    def change(self, F: Array, dF: Array) -> Array:
        """Derivative of P along dF by the tangent that a solver is given [Pa], (n, 3, 3)."""


def separate_cells(count: int, edge: float = 1.0) -> TetMesh:
    """So many tetrahedra with edges of this length [m], two edges apart along x."""
    points = np.tile(CORNERS, (count, 1))
    points[:, 0] += np.repeat(2.0 * np.arange(count), 4)
    return TetMesh(edge * points, np.arange(4 * count, dtype=np.int32).reshape(-1, 4))


def displacements(F: Array) -> Points:
    """Of the corners of separate cells [m], (4 n, 3)."""
    moved: Points = (CORNERS @ (F - np.eye(3)).transpose(0, 2, 1)).reshape(-1, 3)
    return moved


def nodal_forces(P: Array, edge: float) -> Points:
    """What P makes at the corners of separate cells of this edge [m], [N], (4 n, 3)."""
    gradients = np.vstack([-np.ones(3), np.eye(3)])
    forces: Points = (edge**2 * VOLUME * gradients @ P.transpose(0, 2, 1)).reshape(-1, 3)
    return forces


def stress_of_forces(forces: Points) -> Array:
    """P by the forces at the corners of separate cells [Pa], (n, 3, 3)."""
    P: Array = np.einsum("cai,aj->cij", forces.reshape(-1, 4, 3), CORNERS) / VOLUME
    return P


class FastsimLaw:
    """What fastsim's core makes of a material."""

    name = "fastsim"

    def __init__(self, material: Material) -> None:
        self._material = material
        self._single = Body(separate_cells(1), material)
        self._body: Body | None = None

    def _cells(self, F: Array) -> Body:
        if self._body is None or self._body.mesh.num_cells != len(F):
            self._body = Body(separate_cells(len(F)), self._material)
        return self._body

    def energy(self, F: Array) -> Array:
        """See `LawOf`."""
        single = self._single
        found = [single.strain_energy(displacements(of[None])) for of in F]
        return np.array(found) / VOLUME

    def stress(self, F: Array) -> Array:
        """See `LawOf`."""
        return stress_of_forces(self._cells(F).internal_force(displacements(F)))

    def change(self, F: Array, dF: Array) -> Array:
        """See `LawOf`."""
        body = self._cells(F)
        body.core.assemble_tangent(displacements(F))
        return stress_of_forces(body.core.multiply(displacements(dF + np.eye(3))))


class ReferenceLaw:
    """What UFL makes of its energy; needs FEniCSx."""

    name = "reference"

    def __init__(self, material: Material) -> None:
        from palpate.meshes.problem import Strain
        from palpate.reference.discrete_problem import DiscreteProblem

        def build(count: int) -> DiscreteProblem:
            problem = Problem(separate_cells(count), material, (), ())
            return DiscreteProblem(problem, strain=Strain.GREEN, degree=1)

        self._single = build(1)
        self._of_count = cache(build)

    def energy(self, F: Array) -> Array:
        """See `LawOf`."""
        single = self._single
        flat = [single.space.from_points(displacements(of[None])) for of in F]
        return np.array([single.strain_energy(u) for u in flat]) / VOLUME

    def stress(self, F: Array) -> Array:
        """See `LawOf`."""
        cells = self._of_count(len(F))
        force = cells.internal_force(cells.space.from_points(displacements(F)))
        return stress_of_forces(cells.at_points(force))

    def change(self, F: Array, dF: Array) -> Array:
        """See `LawOf`."""
        cells = self._of_count(len(F))
        matrix = cells.tangent(cells.space.from_points(displacements(F)), 0.0)
        x, y = matrix.createVecs()
        x.array[:] = cells.space.from_points(displacements(dF + np.eye(3)))
        matrix.mult(x, y)
        return stress_of_forces(cells.at_points(np.array(y.array)))
