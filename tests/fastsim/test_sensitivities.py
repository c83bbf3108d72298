"""Sensitivities of equilibria against differences of whole solutions and closed forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from bodies import SOFT, facets_at, points_at

from palpate.fastsim.sensitivities import Change, SoftTangentError, find_sensitivities
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Support, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh


def beam(
    mesh: TetMesh,
    modulus: float = SOFT.youngs_modulus,
    ratio: float = 0.3,
    law: Law = SOFT.law,
    *,
    weight: float = 20.0,
    drop: float = 0.0,
    normal: tuple[float, float, float] | None = None,
) -> Problem:
    """A ragged box, fixed at one end, the other moved or on a plane, bent by its weight."""
    fixed = facets_at(mesh, 0, 0.0)
    supports = [Support(np.unique(fixed).astype(np.int32), fixed)]
    if drop:
        end = points_at(mesh, 0, 1.6)
        supports.append(
            Support(end, components=(False, False, True), displacement=(0.0, 0.0, -drop))
        )
    if normal is not None:
        supports.append(Support(points_at(mesh, 0, 1.6), normal=normal))
    material = replace(SOFT, youngs_modulus=modulus, poissons_ratio=ratio, law=law)
    return Problem(mesh, material, tuple(supports), (BodyForce((0.0, 0.0, -weight)),))


def differences(make: Callable[[float], Problem], value: float, step: float, **how: object):  # type: ignore[no-untyped-def]
    """Central difference of whole solutions, and what it compares with."""
    at = make(value)
    u = solve_static(at, relative_tolerance=1e-13, **how).displacement  # type: ignore[arg-type]
    ahead, behind = (
        solve_static(make(value + s), relative_tolerance=1e-13, start=u, **how).displacement  # type: ignore[arg-type]
        for s in (step, -step)
    )
    change = Change(make(value - step), make(value + step), 2.0 * step)
    return (ahead - behind) / (2.0 * step), find_sensitivities(at, u, [change], **how)[0]  # type: ignore[arg-type]


@pytest.mark.parametrize("element", list(Element))
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize("law", [Law.SAINT_VENANT_KIRCHHOFF, Law.NEO_HOOKEAN, Law.COROTATIONAL])
def test_by_modulus_ratio_and_load_they_are_those_of_whole_solutions(
    ragged_box: TetMesh, element: Element, strain: Strain, law: Law
) -> None:
    def by_modulus(x: float) -> Problem:
        return beam(ragged_box, modulus=x, law=law)

    def by_ratio(x: float) -> Problem:
        return beam(ragged_box, ratio=x, law=law)

    def by_load(x: float) -> Problem:
        return beam(ragged_box, weight=x, law=law)

    E = SOFT.youngs_modulus
    for make, value, step in (
        (by_modulus, E, 1e-4 * E),
        (by_ratio, 0.3, 1e-4),
        (by_load, 20.0, 2e-3),
    ):
        expected, found = differences(make, value, step, strain=strain, element=element)
        scale = np.abs(expected).max()
        assert scale * value > 1e-3  # the body does move by it
        # Rounding of 1e-13 over a step of 1e-4; its square, times (2 / (1 - 2 nu))^2 = 25, is less.
        assert np.abs(found - expected).max() < 3e-6 * scale


@pytest.mark.parametrize("law", [Law.SAINT_VENANT_KIRCHHOFF, Law.NEO_HOOKEAN_STABLE])
def test_by_a_moved_support_they_are_those_of_whole_solutions(
    ragged_box: TetMesh, law: Law
) -> None:
    def make(drop: float) -> Problem:
        return beam(ragged_box, law=law, weight=5.0, drop=drop)

    expected, found = differences(make, 0.05, 5e-5)
    end = points_at(ragged_box, 0, 1.6)
    assert np.allclose(found[end, 2], -1.0, rtol=0.0, atol=1e-12)
    assert np.abs(found - expected).max() < 2e-5 * np.abs(expected).max()


def test_on_a_slanted_plane_they_are_those_of_whole_solutions(ragged_box: TetMesh) -> None:
    def make(ratio: float) -> Problem:
        return beam(ragged_box, ratio=ratio, normal=(0.6, 0.0, 0.8))

    expected, found = differences(make, 0.3, 3e-4)
    assert np.abs(found - expected).max() < 2e-5 * np.abs(expected).max()


def test_under_linear_strain_displacement_is_inverse_to_the_modulus(ragged_box: TetMesh) -> None:
    problem = beam(ragged_box)
    u = solve_static(problem, strain=Strain.LINEAR, relative_tolerance=1e-13).displacement
    E = SOFT.youngs_modulus
    change = Change(beam(ragged_box, 0.99 * E), beam(ragged_box, 1.01 * E), 0.02 * E)
    found = find_sensitivities(problem, u, [change], strain=Strain.LINEAR)[0]
    # u = c / E, so du/dE = -u / E; the residual is linear in E, and the step does not matter.
    assert np.abs(found + u / E).max() < 1e-8 * np.abs(u / E).max()


def test_what_has_no_exact_tangent_is_refused(ragged_box: TetMesh) -> None:
    problem = beam(ragged_box)
    u = np.zeros_like(ragged_box.points)
    pressed = replace(problem, loads=(Pressure(facets_at(ragged_box, 0, 1.6), 1.0),))
    with pytest.raises(InputError, match="without pressure that follows"):
        find_sensitivities(pressed, u, [])
    other = beam(replace(ragged_box, points=1.01 * ragged_box.points))
    with pytest.raises(InputError, match="moves the mesh"):
        find_sensitivities(problem, u, [Change(problem, other, 1.0)])
    fewer = replace(
        problem, supports=(replace(problem.supports[0], components=(True, True, False)),)
    )
    with pytest.raises(InputError, match="which components"):
        find_sensitivities(problem, u, [Change(problem, fewer, 1.0)])
    with pytest.raises(InputError, match="width = 0"):
        find_sensitivities(problem, u, [Change(problem, problem, 0.0)])


def test_a_state_that_is_no_equilibrium_has_none(ragged_box: TetMesh) -> None:
    crushed = ragged_box.points * np.array([-0.6, 0.0, 0.0])
    problem = replace(
        beam(ragged_box), loads=(Traction(facets_at(ragged_box, 0, 1.6), (-1.0, 0.0, 0.0)),)
    )
    with pytest.raises(SoftTangentError, match="no stable equilibrium"):
        find_sensitivities(
            problem, crushed, [Change(beam(ragged_box, 0.9e4), beam(ragged_box), 1e3)]
        )
