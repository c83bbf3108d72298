"""The judge's own audit: exact where theory says exactly, and the reference's numbers elsewhere."""

from __future__ import annotations

import dataclasses
import re
from functools import partial

import numpy as np
import pytest

import palpate
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Strain
from palpate.meshes.transforms import rotation, turn
from palpate.validation.case import load_case
from palpate.validation.metrics.audit import (
    NotPositiveDefiniteError,
    Tangent,
    audit_on_own_mesh,
    solve_scaled,
)
from palpate.validation.metrics.body import Body

EVERY = [(strain, element) for strain in Strain for element in Element]


def off_balance(name: str, strain: Strain, element: Element) -> tuple[palpate.Problem, np.ndarray]:
    """A case, and its solution with every point, fixed ones too, a thousandth off."""
    problem = load_case(name).problem
    solution = palpate.solve(problem, strain=strain, element=element).displacement
    noise = np.random.default_rng(1).standard_normal(solution.shape)
    return problem, solution + 1e-3 * np.abs(solution).max() * noise


@pytest.mark.dolfinx
@pytest.mark.parametrize(
    "name",
    ["block", "ring", *(pytest.param(n, marks=pytest.mark.nightly) for n in ("kidney", "beam"))],
)
@pytest.mark.parametrize(("strain", "element"), EVERY)
@pytest.mark.long
def test_it_finds_what_the_reference_finds(name: str, strain: Strain, element: Element) -> None:
    from palpate.reference.audit import audit_displacement

    problem, displacement = off_balance(name, strain, element)
    ours = audit_on_own_mesh(problem, displacement, strain=strain, element=element)
    theirs = audit_displacement(problem, displacement, strain=strain, degree=1, element=element)
    for field in dataclasses.fields(theirs):
        found, wanted = getattr(ours, field.name), getattr(theirs, field.name)
        if field.name == "cell_errors":
            assert np.abs(found - wanted).max() < 1e-6 * wanted.max()
        elif isinstance(wanted, float):
            assert found == pytest.approx(wanted, rel=1e-6), field.name
        else:
            assert found == wanted, field.name
    # Nothing of all that is zero on both sides.
    assert ours.residual_norm > 0.0
    assert ours.support_gap > 0.0
    assert ours.displacement_error is not None
    assert ours.displacement_error > 1e-4


@pytest.mark.parametrize(("strain", "element"), EVERY)
def test_an_equilibrium_passes_and_a_softer_solution_does_not(
    strain: Strain, element: Element
) -> None:
    problem = load_case("block").problem
    solution = palpate.solve(problem, strain=strain, element=element).displacement
    good = audit_on_own_mesh(problem, solution, strain=strain, element=element)
    assert good.relative_residual_norm < 1e-8
    assert good.support_gap == 0.0
    assert abs(good.displacement_error or 1.0) < 1e-8
    softer = audit_on_own_mesh(problem, 1.02 * solution, strain=strain, element=element)
    assert softer.relative_residual_norm > 1e-3
    assert softer.displacement_error == pytest.approx(0.02, rel=0.1)


@pytest.mark.parametrize("element", Element)
def test_under_linear_strain_the_norm_is_the_energy_norm_of_the_error(element: Element) -> None:
    problem = load_case("cantilever").problem
    right = palpate.solve(problem, strain="linear", element=element).displacement
    body = Body(problem, Strain.LINEAR, element)
    error = 1e-3 * np.random.default_rng(0).standard_normal(right.shape)
    error[body.fixed] = 0.0
    found = audit_on_own_mesh(problem, right + error, strain=Strain.LINEAR, element=element)
    assert found.residual_norm == pytest.approx(np.sqrt(2.0 * body.energy(error)), rel=1e-6)
    assert np.linalg.norm(found.cell_errors) == pytest.approx(found.residual_norm, rel=1e-6)
    # One Newton step solves a linear problem: the estimate is exact.
    size = np.linalg.norm(error) / np.linalg.norm(right)
    assert found.displacement_error == pytest.approx(size, rel=1e-5)


@pytest.mark.parametrize(("strain", "element"), EVERY)
def test_the_tangent_is_the_forces_derivative(strain: Strain, element: Element) -> None:
    problem, displacement = off_balance("block", strain, element)
    body = Body(problem, strain, element)
    change = np.random.default_rng(2).standard_normal(displacement.shape)
    step = 1e-4 * np.abs(displacement).max()
    ends = [displacement + sign * step * change for sign in (1.0, -1.0)]
    forces = [body.internal(u) - body.external(u) for u in ends]
    slope = np.where(body.fixed, 0.0, (forces[0] - forces[1]) / (2.0 * step))
    found = Tangent(body, displacement).times(change)
    # Forces are cubic in the displacement: the difference is off by the square of the step.
    assert np.abs(found - slope).max() < 1e-6 * np.abs(slope).max()
    assert np.abs(slope).max() > 0.0


def test_a_column_that_would_buckle_is_in_equilibrium_but_not_stable() -> None:
    mesh = brick_box((2, 2, 12), (1.0, 1.0, 10.0))
    corners = mesh.points[mesh.boundary_facets]
    base, top = (mesh.boundary_facets[(corners[:, :, 2] == z).all(axis=1)] for z in (0.0, 10.0))
    # Euler's strain, clamped and free: (pi / 2)^2 (1 / 12) / 10^2 = 0.2 %; linear tetrahedra of
    # this size are stiffer in bending, some three times.
    for stretch, is_stable in ((0.9995, True), (0.95, False)):
        pressure = 1e4 * stretch * (stretch**2 - 1.0) / 2.0  # P = F S, S = E (stretch^2 - 1) / 2
        column = palpate.Problem(
            mesh,
            palpate.Material(1e4, 0.0),
            (palpate.Support(np.unique(base).astype(np.int32), base),),
            (palpate.Traction(top, (0.0, 0.0, pressure)),),
        )
        moved = np.zeros_like(mesh.points)
        moved[:, 2] = (stretch - 1.0) * mesh.points[:, 2]
        found = audit_on_own_mesh(column, moved, strain=Strain.GREEN)
        assert found.relative_residual_norm < 1e-12
        assert found.is_stable is is_stable


def test_an_inverted_body_has_no_estimate_and_what_cannot_be_audited_is_refused() -> None:
    problem = load_case("block").problem
    inverted = np.zeros_like(problem.mesh.points)
    inverted[:, 0] = -2.0 * problem.mesh.points[:, 0]
    found = audit_on_own_mesh(problem, inverted, strain=Strain.GREEN)
    assert found.smallest_det_f == pytest.approx(-1.0)
    assert found.displacement_error is None
    assert found.is_stable is None
    pressed = load_case("press").problem
    with pytest.raises(InputError, match="knows no tools"):
        audit_on_own_mesh(pressed, np.zeros_like(pressed.mesh.points), strain=Strain.GREEN)
    floating = dataclasses.replace(problem, supports=())
    with pytest.raises(InputError, match="floats"):
        audit_on_own_mesh(floating, inverted, strain=Strain.GREEN)


@pytest.mark.parametrize(("strain", "element"), EVERY)
def test_on_slanted_walls_it_finds_what_it_finds_where_they_are_straight(
    strain: Strain, element: Element
) -> None:
    straight, displacement = off_balance("submerged", strain, element)
    R = rotation((1.0, 2.0, 3.0), 50.0)
    slanted, _ = turn(straight, R)
    assert any(support.normal is not None for support in slanted.supports)
    wanted = audit_on_own_mesh(straight, displacement, strain, element)
    found = audit_on_own_mesh(slanted, displacement @ R.T, strain, element)
    assert wanted.displacement_error is not None
    assert wanted.displacement_error > 1e-4
    for field in dataclasses.fields(wanted):
        one, other = getattr(found, field.name), getattr(wanted, field.name)
        if field.name == "cell_errors":
            assert np.abs(one - other).max() < 1e-6 * other.max()
        elif isinstance(other, float) and field.name != "support_gap":
            assert one == pytest.approx(other, rel=1e-6), field.name
    # The largest component of a distance depends on the axes.
    assert 0.3 < found.support_gap / wanted.support_gap < 2.0
    right = palpate.solve(slanted, strain=strain, element=element).displacement
    good = audit_on_own_mesh(slanted, right, strain, element)
    assert good.relative_residual_norm < 1e-8
    assert abs(good.displacement_error or 1.0) < 1e-7


def test_both_solvers_solve_and_tell_what_they_cannot() -> None:
    rng = np.random.default_rng(3)
    matrix = rng.standard_normal((12, 12))
    symmetric = matrix @ matrix.T + 12.0 * np.eye(12)
    turned = symmetric + matrix - matrix.T
    right = rng.standard_normal((4, 3))
    for is_symmetric, used in ((True, symmetric), (False, turned)):
        solve = partial(solve_scaled, is_symmetric=is_symmetric)
        diagonal = np.diag(used).reshape(4, 3)

        def product(x: np.ndarray, used: np.ndarray = used) -> np.ndarray:
            return (used @ x.ravel()).reshape(4, 3)

        found = solve(product, right, diagonal, tolerance=1e-12)
        wanted = np.linalg.solve(used, right.ravel()).reshape(4, 3)
        np.testing.assert_allclose(found, wanted, rtol=1e-9)
        assert not solve(product, 0.0 * right, diagonal, tolerance=1e-12).any()
    indefinite = np.diag(np.linspace(-1e-3, 1.0, 12))
    with pytest.raises(NotPositiveDefiniteError):
        solve_scaled(
            lambda x: (indefinite @ x.ravel()).reshape(4, 3),
            right, np.ones((4, 3)), tolerance=1e-6,
        )  # fmt: skip


def test_the_door_says_which_degree_needs_no_fenicsx(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.reference.availability.is_available", lambda: False)
    solution = 0.0 * load_case("block").problem.mesh.points
    assert palpate.audit("block", solution, degree=1).degree == 1
    with pytest.raises(palpate.ReferenceUnavailableError, match=re.escape("degree 1 needs none")):
        palpate.audit("block", solution)
