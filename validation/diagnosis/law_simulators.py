"""Energy, stress and tangent of a simulator's law, and deformations at which it is checked.

Of fastsim and the reference they are read from the forces of single cells: a body of n separate
tetrahedra, each deformed by an F of its own, u_a = (F - I) X_a. Of one cell f_a = V P grad N_a, and
the sum of grad N_a (x) X_a is I, so that P = 1/V sum of f_a (x) X_a.
"""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Protocol

import numpy as np

from palpate.fastsim.body import Body
from palpate.meshes.arrays import Points
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.metrics.smoothing import Array

# Parts like those of Ogden's rubber, 1972: three terms, one of them of a negative exponent.
OGDEN_TERMS = ((0.7, 1.3), (0.2, 5.0), (0.1, -2.0))
# Constant c01 of Mooney and Rivlin's law, over mu.
C01 = 0.2


def example_material(
    law: Law, poissons_ratio: float = 0.4, youngs_modulus: float = 1e4
) -> Material:
    """Material of these moduli at rest [-], [Pa]; c01 is mu / 5, Ogden's law has three terms."""
    return following(Material(youngs_modulus, poissons_ratio), law)


def following(material: Material, law: Law) -> Material:
    """A material of the same density and moduli at rest that follows another law."""
    mu = material.youngs_modulus / (2.0 * (1.0 + material.poissons_ratio))
    return dataclasses.replace(
        material,
        law=law,
        c01=C01 * mu if law.has_c01 else 0.0,
        ogden_terms=OGDEN_TERMS if law is Law.OGDEN else (),
    )


_ONE = np.eye(3)
# Random deformations, and how far their det F may be from 1.
_NUM_RANDOM, _DETERMINANTS = 24, (0.3, 3.0)
# Those that a body is asked for in equilibrium: no larger ones, which a solver may not find.
_NUM_MODERATE, _MODERATE = 6, (0.8, 1.25)


def deformations(law: Law) -> dict[str, Array]:
    """Deformation gradients F [-] by kind, each (n, 3, 3); det F > 0 but for `inverted`.

    Inverted ones are there only for a law that is finite at them.
    """
    found = {
        "uniaxial": np.array([np.diag([a, 1.0, 1.0]) for a in (0.3, 0.5, 0.8, 1.2, 2.0, 3.0)]),
        "biaxial": np.array([np.diag([a, a, 1.0]) for a in (0.5, 0.8, 1.2, 1.7)]),
        "shear": np.array([_sheared(g) for g in (0.1, 0.5, 1.0, 2.0)]),
        "volumetric": np.array([np.cbrt(J) * _ONE for J in (0.3, 0.6, 0.9, 1.1, 1.7, 3.0)]),
        "random": _random(_NUM_RANDOM, 0.4, _DETERMINANTS),
        "near-degenerate": np.array(
            [np.diag([0.02, 1.0, 1.0]), np.diag([1.5, 0.05, 0.8]), _sheared(10.0)]
        ),
    }
    if law.is_finite_when_inverted:
        found["inverted"] = np.array([np.diag([-0.5, 1.0, 1.0]), np.diag([1.2, -0.2, 0.9])])
    return found


def moderate_deformations() -> dict[str, Array]:
    """Upper triangular F of moderate size: all that a cell can do but to turn."""
    found = {
        "uniaxial": np.array([np.diag([a, 1.0, 1.0]) for a in (0.85, 1.2, 1.5)]),
        "biaxial": np.array([np.diag([a, a, 1.0]) for a in (0.9, 1.2)]),
        "shear": np.array([_sheared(g) for g in (0.2, 0.5)]),
        "volumetric": np.array([np.cbrt(J) * _ONE for J in (0.8, 1.25)]),
        # F = Q R: the same stretch without the turn.
        "random": np.array(
            [
                np.linalg.qr(F)[1] * np.sign(np.diag(np.linalg.qr(F)[1]))[:, None]
                for F in _random(_NUM_MODERATE, 0.15, _MODERATE)
            ]
        ),
    }
    return found


def rotations(count: int) -> Array:
    """Random turns, (count, 3, 3); the same each time."""
    Q, R = np.linalg.qr(np.random.default_rng(2).standard_normal((count, 3, 3)))
    Q = Q * np.sign(np.einsum("cii->ci", R))[:, None, :]
    turns: Array = Q * np.sign(np.linalg.det(Q))[:, None, None]
    return turns


def _sheared(amount: float) -> Array:
    F = _ONE.copy()
    F[0, 1] = amount
    return F


def _random(count: int, size: float, determinants: tuple[float, float]) -> Array:
    """Deformation gradients in random directions, with det F spread evenly over its logarithm."""
    rng = np.random.default_rng(1)
    wanted = np.geomspace(*determinants, count)
    found: list[Array] = []
    while len(found) < count:
        F = _ONE + size * rng.standard_normal((3, 3))
        J = float(np.linalg.det(F))
        if J > 0.2:
            found.append(F * np.cbrt(wanted[len(found)] / J))
    return np.array(found)


# Right-angled, with edges of 1 m.
CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
VOLUME = 1.0 / 6.0


class LawOf(Protocol):
    """A law as somebody has written it; F of shape (n, 3, 3) with n as first asked for."""

    @property
    def name(self) -> str:
        """Name of the program or author of the law."""

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
    """Displacements of the corners of separate cells [m], (4 n, 3)."""
    moved: Points = (CORNERS @ (F - np.eye(3)).transpose(0, 2, 1)).reshape(-1, 3)
    return moved


def nodal_forces(P: Array, edge: float) -> Points:
    """Nodal forces of P at the corners of separate cells of this edge [m], [N], (4 n, 3)."""
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
