"""A layer between smooth walls, pressed or rubbed on part of its top: Fourier series.

Linear strain, plane strain in x and z. Walls without friction at x = 0 and L mirror the load, so
that

u_x = sum U_m(z) sin(k x),  u_z = sum W_m(z) cos(k x),  k = m pi / L,

and Navier's equations leave (U, W) = sum over s = k, -k of e^(s z) [a (-k, s) + b (-k z, s z - 3 +
4 nu)] for each m; the four constants are those of the load and of what the bottom does. Loads that
begin half-way make stresses that are singular there, as do sheared walls.
"""

from __future__ import annotations

import numpy as np

from calibration_recipe.answers import Answer, answer_of
from calibration_recipe.shapes import confined_modulus
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, rollers, side, support_of
from palpate.meshes.problem import Material, Problem, Strain

_LENGTH, _BRICKS = 1.0, 4
_TERMS = 3000
# Pressure or shear over E (1 - nu): strains of some per cent.
_LOAD = 0.02


def layer_problem(
    *, nu: float, height: float, load: str, bottom: str, width: float
) -> tuple[Problem, Strain, Answer]:
    """A problem and its answer.

    Args:
        nu: Poisson's ratio.
        height: Of the layer, over its length.
        load: "press" or "rub": uniform over the half of the top from x = 0; "swell": a pressure of
            1 - (x / L)^2 all over.
        bottom: "bonded" or "smooth".
        width: Of two bricks in a row, over the length: flat cells where it is small.
    """
    layers = max(1, round(height * _BRICKS / _LENGTH))
    mesh = brick_box((_BRICKS, 2, layers), (_LENGTH, width, height), ragged=0.2)
    material = Material(1.0, nu, 1.0)
    size = _LOAD * (1.0 - nu) * min(1.0, 0.5 / height)
    top = side(mesh, 2, height)
    half = top[(mesh.points[top][:, :, 0] <= 0.5 * _LENGTH + 1e-9).all(axis=1)]
    if load == "swell":
        bend = np.zeros((3, 3, 3))
        bend[2, 0, 0] = 2.0 * size / _LENGTH**2
        push = Traction(top, (0.0, 0.0, -size), curvature=bend)
    else:
        push = Traction(half, (0.0, 0.0, -size) if load == "press" else (size, 0.0, 0.0))
    sides = ((0, 0.0), (0, _LENGTH), (1, 0.0), (1, width))
    under = support_of(side(mesh, 2, 0.0), (bottom == "bonded", bottom == "bonded", True))
    problem = Problem(mesh, material, (*rollers(mesh, sides), under), (push,))
    series = _Series(material, height, load, bottom == "bonded", size)
    return problem, Strain.LINEAR, answer_of(mesh, series, Strain.LINEAR, "Fourier series", 1e-5)


class _Series:
    """The displacement at places."""

    def __init__(
        self, material: Material, height: float, load: str, is_bonded: bool, size: float
    ) -> None:
        nu = material.poissons_ratio
        mu = 0.5 * material.youngs_modulus / (1.0 + nu)
        stiff = confined_modulus(material)
        self._k = k = np.arange(1, _TERMS + 1) * np.pi / _LENGTH
        self._height, self._kappa = height, 3.0 - 4.0 * nu
        number = np.arange(1, _TERMS + 1)
        p, t, mean = np.zeros(_TERMS), np.zeros(_TERMS), 0.0
        half = 0.5 * number * np.pi
        if load == "press":
            p, mean = 2.0 * size * np.sin(half) / (number * np.pi), 0.5 * size
        elif load == "swell":
            p, mean = -4.0 * size * (-1.0) ** number / (number * np.pi) ** 2, 2.0 / 3.0 * size
        else:
            t = 2.0 * size * (1.0 - np.cos(half)) / (number * np.pi)
        self._mean = -mean / stiff
        lmbda = stiff - 2.0 * mu
        system = np.zeros((_TERMS, 4, 4))
        for row, z in ((0, height), (2, 0.0)):
            u, w, u_z, w_z = self._modes(np.full(1, z))
            normal = (stiff * w_z + lmbda * k[:, None, None] * u)[:, 0]
            shear = mu * (u_z - k[:, None, None] * w)[:, 0]
            if row:
                system[:, 2], system[:, 3] = w[:, 0], u[:, 0] if is_bonded else shear / k[:, None]
            else:
                system[:, 0], system[:, 1] = normal / k[:, None], shear / k[:, None]
        right = np.column_stack([-p / k, t / k, np.zeros(_TERMS), np.zeros(_TERMS)])
        # Constants of the two ends differ in size by e^(k H): each decays from its own.
        self._constants = np.linalg.solve(system, right[..., None])[..., 0]

    def __call__(self, positions: Points) -> Points:
        u = np.zeros_like(positions)
        u[:, 2] = self._mean * positions[:, 2]
        heights, level = np.unique(np.round(positions[:, 2], 12), return_inverse=True)
        for row, z in enumerate(heights):
            at = np.flatnonzero(level.ravel() == row)
            along, of = np.unique(np.round(positions[at, 0], 12), return_inverse=True)
            U, W, _, _ = self._modes(np.full(1, z))
            angle = np.outer(along, self._k)
            u[at, 0] += (np.sin(angle) @ np.einsum("mq,mq->m", U[:, 0], self._constants))[of]
            u[at, 2] += (np.cos(angle) @ np.einsum("mq,mq->m", W[:, 0], self._constants))[of]
        return u

    def _modes(self, z: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """U, W and their derivatives for four modes; shape (terms, len(z), 4).

        The growing two are measured from the top, the others from the bottom.
        """
        k, columns = self._k[:, None], []
        for s, depth in ((k, z - self._height), (-k, z)):
            decay = np.exp(s * depth)
            one = np.ones_like(decay)
            columns.append((-one, s / k * one, -s * one, s**2 / k * one, decay))
            linear = s * depth
            u, w = -k * depth * one, linear - self._kappa
            columns.append((u, w, -k * (1.0 + linear), s * (1.0 + w), decay))
        pairs = [[c[4] * c[i] for c in columns] for i in range(4)]
        U, W, U_z, W_z = (np.stack(rows, axis=-1) for rows in pairs)
        return U, W, U_z, W_z
