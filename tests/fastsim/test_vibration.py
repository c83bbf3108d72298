"""Small swings: against the dense problem, a closed form, and their own derivative."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.body import Body
from palpate.fastsim.sensitivities import SoftTangentError
from palpate.fastsim.statics import solve_static
from palpate.fastsim.vibration import find_swings, rayleigh_quotient
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Support
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import InputError
from palpate.meshes.point_mass import PointMass
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh

BAR = brick_box((6, 2, 2), (0.1, 0.02, 0.02))


def bar(
    *, force: float = 0.0, poisson: float = 0.3, mass: float = 0.0, mesh: TetMesh = BAR
) -> Problem:
    return Problem(
        mesh,
        Material(youngs_modulus=1e5, poissons_ratio=poisson, density=1000.0),
        supports=[Support(np.flatnonzero(mesh.points[:, 0] < 1e-9))],
        loads=[BodyForce((0.0, 0.0, -force))],
        masses=[PointMass(side(mesh, 0, 0.1), mass)] if mass else [],
    )


def dense(problem: Problem, element: Element) -> np.ndarray:
    """Frequencies [Hz] by the whole stiffness matrix, column by column, of linear strain."""
    body = Body.of(problem, Strain.LINEAR, element=element)
    free = np.flatnonzero(problem.mesh.points[:, 0] > 1e-9)
    columns = []
    for point in free:
        for axis in range(3):
            unit = np.zeros_like(problem.mesh.points)
            unit[point, axis] = 1.0
            columns.append(body.internal_force(unit)[free].ravel())
    mass = np.repeat(body.lumped_mass[free], 3)
    root = np.sqrt(mass)
    values = np.linalg.eigvalsh(np.array(columns) / np.outer(root, root))
    return np.sqrt(values) / (2.0 * np.pi)


@pytest.mark.parametrize("element", Element)
@pytest.mark.parametrize("mass", [0.0, 0.02])
def test_the_lowest_frequencies_are_those_of_the_dense_problem(
    element: Element, mass: float
) -> None:
    problem = bar(mass=mass)
    still = np.zeros_like(BAR.points)
    found = find_swings(problem, still, 4, strain=Strain.LINEAR, element=element)
    assert found.frequencies == pytest.approx(dense(problem, element)[:4], rel=1e-7)
    # Modes are normal to one another, by mass.
    gram = np.einsum("ipk,p,jpk->ij", found.modes, found.mass, found.modes)
    assert gram == pytest.approx(np.eye(4), abs=1e-6)


def test_a_bar_without_lateral_strain_swings_along_itself_as_the_wave_equation_says() -> None:
    """f = sqrt(E / rho) / 4 L of a rod; lumped cells of a twelfth of it are 0.07 % too low."""
    mesh = brick_box((12, 4, 4), (0.1, 0.02, 0.02))
    still = np.zeros_like(mesh.points)
    found = find_swings(bar(poisson=0.0, mesh=mesh), still, 10, strain=Strain.LINEAR)
    along = int(np.argmax(np.abs(found.modes[:, :, 0] @ found.mass)))
    exact = np.sqrt(1e5 / 1000.0) / (4.0 * 0.1)
    assert found.frequencies[along] == pytest.approx(exact, rel=1e-3)


def test_a_swing_is_the_part_of_the_displacement_in_each_mode() -> None:
    found = find_swings(bar(), np.zeros_like(BAR.points), 3)
    mixed = 2e-3 * found.modes[0] - 1e-3 * found.modes[2]
    parts = found.swings_from(mixed)
    assert parts.sum(axis=0) == pytest.approx(mixed, abs=1e-7 * np.abs(mixed).max())
    assert np.abs(parts[1]).max() < 1e-7 * np.abs(mixed).max()


def test_rayleighs_quotient_moves_with_a_number_as_the_frequency_does() -> None:
    def quotient(force: float) -> float:
        problem = bar(force=force)
        u = solve_static(problem, strain=Strain.GREEN).displacement
        return float(2.0 * np.pi * find_swings(problem, u, 2).frequencies[0]) ** 2

    problem, step = bar(force=900.0), 1.0
    u = {f: solve_static(bar(force=f), strain=Strain.GREEN).displacement for f in (899.0, 901.0)}
    there = solve_static(problem, strain=Strain.GREEN).displacement
    mode = find_swings(problem, there, 2).modes[0]
    assert rayleigh_quotient(problem, there, mode) == pytest.approx(quotient(900.0), rel=1e-7)
    slope = (quotient(901.0) - quotient(899.0)) / (2.0 * step)
    pair = [rayleigh_quotient(bar(force=f), u[f], mode) for f in (899.0, 901.0)]
    # Both differences are of one step, and off by its square.
    assert (pair[1] - pair[0]) / (2.0 * step) == pytest.approx(slope, rel=1e-3)
    assert abs(slope) * 900.0 > 1e-3 * quotient(900.0)  # the load stiffens the bar


def test_what_has_no_small_swings_is_refused() -> None:
    still = np.zeros_like(BAR.points)
    with pytest.raises(InputError, match="number of free components"):
        find_swings(bar(), still, 0)
    pressed = Problem(BAR, bar().material, bar().supports, [Pressure(BAR.boundary_facets, 10.0)])
    with pytest.raises(InputError, match="without pressure that follows"):
        find_swings(pressed, still)
    crushed = still.copy()
    crushed[:, 0] = -0.6 * BAR.points[:, 0]  # Saint-Venant-Kirchhoff softens under compression
    with pytest.raises(SoftTangentError):
        find_swings(bar(), crushed)
