"""Stresses of cells: closed forms of uniform deformations, and the forces that they make."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.body import Body, cauchy_stress, cell_stress
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Element, Material, Strain
from palpate.meshes.tet_mesh import signed_volumes

MESH = brick_box((3, 2, 2), (1.5, 1.0, 1.0))
E, NU = 3000.0, 0.3
EACH = pytest.mark.parametrize("element", list(Element))
BOTH = pytest.mark.parametrize("strain", list(Strain))


def turned(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@EACH
@BOTH
def test_a_sheared_stretched_and_turned_body_has_the_stresses_of_the_formulas(
    strain: Strain, element: Element
) -> None:
    U = np.array([[1.2, 0.3, 0.0], [0.0, 0.9, 0.1], [0.0, 0.0, 1.1]])
    F = turned(0.7) @ U
    H = F - np.eye(3)
    body = Body(MESH, Material(E, NU), strain, element=element)
    u = MESH.points @ H.T
    measure = (F.T @ F - np.eye(3)) / 2 if strain is Strain.GREEN else (H + H.T) / 2
    lmbda, mu = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
    S = lmbda * np.trace(measure) * np.eye(3) + 2 * mu * measure
    sigma = F @ S @ F.T / np.linalg.det(F) if strain is Strain.GREEN else S
    assert np.abs(cell_stress(body, u) - S).max() <= 1e-12 * E
    assert np.abs(cauchy_stress(body, u) - sigma).max() <= 1e-12 * E
    if strain is Strain.GREEN:
        # S is of the rest frame, which no turn changes; Cauchy's stress turns with the body.
        straight = MESH.points @ (U - np.eye(3)).T
        assert np.abs(cell_stress(body, straight) - S).max() <= 1e-12 * E
        R = turned(0.7)
        found = R @ cauchy_stress(body, straight) @ R.T
        assert np.abs(found - sigma).max() <= 1e-12 * E


@EACH
@BOTH
def test_the_stresses_of_cells_are_those_that_make_the_forces(
    strain: Strain, element: Element
) -> None:
    body = Body(MESH, Material(E, NU), strain, element=element)
    u = np.random.default_rng(3).uniform(-0.04, 0.04, MESH.points.shape)
    S, sigma = cell_stress(body, u), cauchy_stress(body, u)
    F = np.eye(3) + body.displacement_gradients(u)
    volumes = signed_volumes(MESH.points, MESH.cells)
    # f_a = V P grad N_a, P = F S; with Cauchy's stress P = det F sigma F^-T.
    piola = S if strain is Strain.LINEAR else F @ S
    by_cauchy = sigma
    if strain is Strain.GREEN:
        inverse = np.linalg.inv(F).transpose(0, 2, 1)
        by_cauchy = np.linalg.det(F)[:, None, None] * sigma @ inverse
    forces = body.internal_force(u)
    for P in (piola, by_cauchy):
        nodal = np.einsum("c,cij,caj->cai", volumes, P, body.shape_gradients)
        made = np.zeros_like(u)
        np.add.at(made, MESH.cells, nodal)
        assert np.abs(made - forces).max() <= 1e-12 * np.abs(forces).max()
