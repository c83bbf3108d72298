"""One cell against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.body import Body
from palpate.meshes.problem import Material, Strain
from palpate.meshes.tet_mesh import TetMesh

EPS = float(np.finfo(float).eps)
UNIT = Material(1.0, 0.3)
LMBDA = 0.3 / (1.3 * 0.4)
MU = 1.0 / 2.6


def stress_of_cell(mesh: TetMesh, gradient: np.ndarray, strain: Strain) -> np.ndarray:
    """First Piola-Kirchhoff stress from the nodal forces of one cell: sum of f_a X_a^T / V."""
    displacement = mesh.points @ gradient.T
    force = Body(mesh, UNIT, strain).internal_force(displacement)
    return force.T @ mesh.points / mesh.volume


# Stretch, nominal stress over Young's modulus l (l^2 - 1) / 2, lateral stretch for nu = 0.3.
UNIAXIAL = [
    (0.80, -0.144000, 1.0526158),
    (0.90, -0.085500, 1.0281051),
    (1.10, 0.115500, 0.9679876),
    (1.25, 0.3515625, 0.9117291),
    (1.50, 0.937500, 0.7905694),
]


@pytest.mark.parametrize(("stretch", "stress", "lateral"), UNIAXIAL)
def test_free_uniaxial_stretch_gives_the_closed_form(
    single_cell: TetMesh, stretch: float, stress: float, lateral: float
) -> None:
    exact_lateral = np.sqrt(1.0 - 0.3 * (stretch**2 - 1.0))
    assert exact_lateral == pytest.approx(lateral, abs=5e-8)  # the printed digits
    gradient = np.diag([stretch, exact_lateral, exact_lateral]) - np.eye(3)
    P = stress_of_cell(single_cell, gradient, Strain.GREEN)
    # P22 = P33 = 0: the lateral faces are free.
    np.testing.assert_allclose(P, np.diag([stress, 0.0, 0.0]), rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("stretch", [0.7, 0.9, 1.1, 1.4])
def test_confined_stretch_gives_the_closed_form(single_cell: TetMesh, stretch: float) -> None:
    P = stress_of_cell(single_cell, np.diag([stretch - 1.0, 0.0, 0.0]), Strain.GREEN)
    expected = stretch * (LMBDA + 2.0 * MU) * (stretch**2 - 1.0) / 2.0
    assert P[0, 0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("shear", [-0.5, 0.1, 0.8])
def test_simple_shear_gives_the_closed_form(single_cell: TetMesh, shear: float) -> None:
    gradient = np.zeros((3, 3))
    gradient[0, 1] = shear
    green = stress_of_cell(single_cell, gradient, Strain.GREEN)
    linear = stress_of_cell(single_cell, gradient, Strain.LINEAR)
    # E12 = k/2, E22 = k^2/2: P12 = S12 + k S22 = mu k + k (lmbda + 2 mu) k^2/2.
    expected = MU * shear + shear * (LMBDA + 2.0 * MU) * shear**2 / 2.0
    assert green[0, 1] == pytest.approx(expected, rel=1e-12)
    assert linear[0, 1] == pytest.approx(MU * shear, rel=1e-12)


def test_energy_of_confined_stretch_is_the_closed_form(single_cell: TetMesh) -> None:
    displacement = single_cell.points @ np.diag([0.2, 0.0, 0.0])
    E11 = (1.2**2 - 1.0) / 2.0
    expected = single_cell.volume * (LMBDA / 2.0 + MU) * E11**2
    energy = Body(single_cell, UNIT).strain_energy(displacement)
    assert energy == pytest.approx(expected, rel=1e-13)


def test_det_f_is_the_volume_ratio_and_negative_for_a_mirrored_cell(single_cell: TetMesh) -> None:
    stretched = single_cell.points @ np.diag([0.5, 0.0, -0.2])
    mirrored = single_cell.points @ np.diag([-2.0, 0.0, 0.0])
    assert Body(single_cell, UNIT).det_f(stretched)[0] == pytest.approx(1.5 * 0.8, rel=1e-14)
    assert Body(single_cell, UNIT).det_f(mirrored)[0] == pytest.approx(-1.0, rel=1e-14)


def test_small_strains_keep_their_digits(single_cell: TetMesh) -> None:
    """Strain from H keeps 12 digits of a 1e-9 strain; from F^T F - I only 7 would be left."""
    tiny = 1e-9
    centred = TetMesh(single_cell.points - single_cell.points[0], single_cell.cells)
    P = stress_of_cell(centred, np.diag([tiny, 0.0, 0.0]), Strain.GREEN)
    expected = (1.0 + tiny) * (LMBDA + 2.0 * MU) * (tiny + tiny**2 / 2.0)
    assert P[0, 0] == pytest.approx(expected, rel=1000 * EPS)
