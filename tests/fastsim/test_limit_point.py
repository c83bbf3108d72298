"""Saint-Venant-Kirchhoff's limit: found at the right load, placed, and said."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from bodies import facets_at, points_at

from palpate.fastsim.body import Body
from palpate.fastsim.errors import EquilibriumLostError, NotConvergedError
from palpate.fastsim.forces import external_force
from palpate.fastsim.newton import (
    Newton,
    _MaterialStiffness,
    find_softening,
    smallest_stretches,
)
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce, Support, Traction
from palpate.meshes.bricks import brick_box
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.diagnosis.law_simulators import example_material

SOFT = Material(1e4, 0.3, 1000.0)
# Free uniaxial compression: P/E = l (l^2 - 1) / 2 is least at l = 1 / sqrt(3), -1 / (3 sqrt(3)).
LIMIT, STRETCH = 1.0 / (3.0 * np.sqrt(3.0)), 1.0 / np.sqrt(3.0)
STEP = 1.0 / 8192.0


def compressed_bar(mesh: TetMesh, stress: float) -> Problem:
    """Rollers on three planes; dead pressure `stress` on the far end."""
    rollers = tuple(
        Support(points_at(mesh, axis, 0.0), components=tuple(k == axis for k in range(3)))  # type: ignore[arg-type]
        for axis in range(3)
    )
    push = Traction(facets_at(mesh, 0, mesh.points[:, 0].max()), (-stress, 0.0, 0.0))
    return Problem(mesh, SOFT, rollers, (push,))


@pytest.mark.parametrize("overload", [1.05, 1.3, 5.0])
def test_a_compressed_brick_gives_way_at_the_closed_forms_peak(overload: float) -> None:
    mesh = brick_box((1, 1, 1), (1.6, 1.0, 1.2))
    with pytest.raises(EquilibriumLostError) as caught:
        solve_static(compressed_bar(mesh, overload * LIMIT * SOFT.youngs_modulus))
    error = caught.value
    gap = 1.0 / overload - error.load_factor
    assert 0.0 <= gap < STEP
    # Near its peak P = P_limit - 3 l (dl)^2 / 2 (E): so far is the last stretch from the peak's.
    reach = np.sqrt(2.0 * STEP * overload * LIMIT / (3.0 * STRETCH))
    left = error.smallest_stretch
    assert STRETCH < left < STRETCH + 1.1 * reach
    # Stiffness (3 l^2 - 1) / 2, and l^2 without the stress.
    assert error.stiffness == pytest.approx((3.0 * left**2 - 1.0) / (2.0 * left**2), rel=1e-4)
    lateral = 1.0 - 0.3 * (left**2 - 1.0)
    assert error.smallest_det_f == pytest.approx(left * lateral, rel=1e-6)


def test_a_compressed_bar_gives_way_just_before_and_says_so(ragged_box: TetMesh) -> None:
    """Many cells can give way unevenly, a little before the uniform state does."""
    problem = compressed_bar(ragged_box, 1.3 * LIMIT * SOFT.youngs_modulus)
    with pytest.raises(EquilibriumLostError) as caught:
        solve_static(problem)
    error = caught.value
    assert 0.995 < 1.3 * error.load_factor < 1.0
    assert STRETCH < error.smallest_stretch < STRETCH + 0.03
    assert 0.0 <= error.stiffness < 0.02
    # What it carries is an equilibrium at the load it names.
    internal = Body(ragged_box, SOFT).internal_force(error.displacement)
    load = error.load_factor * external_force(problem)
    free = ragged_box.points.min(axis=1) > 1e-9
    assert np.linalg.norm((load - internal)[free]) < 1e-9 * np.linalg.norm(load)
    assert np.isfinite(error.displacement).all()
    for words in (
        f"{error.load_factor:.4g} of the load",
        f"cell {error.cell}",
        "0.577",
        "lower the load",
    ):
        assert words in str(error)


@pytest.mark.dolfinx
def test_the_reference_loses_equilibrium_at_the_same_load(ragged_box: TetMesh) -> None:
    from palpate.reference.child import run_task
    from palpate.reference.errors import ReferenceNotConvergedError
    from palpate.reference.tasks import StaticTask

    problem = compressed_bar(ragged_box, 1.3 * LIMIT * SOFT.youngs_modulus)
    with pytest.raises(EquilibriumLostError) as ours:
        solve_static(problem)
    with pytest.raises(ReferenceNotConvergedError) as theirs:
        run_task(StaticTask(), problem)
    # Theirs is found to 1 / 1024 of the load.
    assert abs(ours.value.load_factor - theirs.value.load_factor) < 1.0 / 1024.0 + STEP


def test_just_below_the_peak_there_is_an_equilibrium(ragged_box: TetMesh) -> None:
    result = solve_static(compressed_bar(ragged_box, 0.99 * LIMIT * SOFT.youngs_modulus))
    roots = np.roots([0.5, 0.0, -0.5, 0.99 * LIMIT])
    stretch = max(r.real for r in roots if abs(r.imag) < 1e-12 and 0.0 < r.real < 1.0)
    assert smallest_stretches(Body(ragged_box, SOFT), result.displacement) == pytest.approx(
        stretch, rel=1e-8
    )


def test_the_place_is_where_the_neck_is() -> None:
    box = brick_box((16, 3, 3), (4.0, 1.0, 1.0))
    points = box.points.copy()
    points[:, 1:] *= (1.0 - 0.3 * np.exp(-(((points[:, 0] - 2.5) / 0.4) ** 2)))[:, None]
    mesh = TetMesh(points, box.cells)
    with pytest.raises(EquilibriumLostError) as caught:
        solve_static(compressed_bar(mesh, 0.3 * SOFT.youngs_modulus))
    error = caught.value
    assert abs(error.position[0] - 2.5) < 0.4
    assert error.position == pytest.approx(mesh.points[mesh.cells[error.cell]].mean(axis=0))
    assert error.smallest_stretch == smallest_stretches(Body(mesh, SOFT), error.displacement).min()


def test_a_column_that_would_buckle_is_not_followed_straight_on() -> None:
    """Symmetric mesh and load: the straight column stays an equilibrium, but not a stable one.

    Euler, clamped and free: sigma = pi^2 E (h / L)^2 / 48; shear and coarse P1 cells change it.
    """
    mesh = brick_box((20, 2, 2), (10.0, 1.0, 1.0))
    euler = np.pi**2 * SOFT.youngs_modulus / 100.0 / 48.0
    fixed = facets_at(mesh, 0, 0.0)
    push = Traction(facets_at(mesh, 0, 10.0), (-10.0 * euler, 0.0, 0.0))
    support = Support(np.unique(fixed).astype(np.int32), fixed)
    with pytest.raises(EquilibriumLostError) as caught:
        solve_static(Problem(mesh, SOFT, (support,), (push,)))
    error = caught.value
    assert 1.0 < 10.0 * error.load_factor < 5.0
    # Hardly shortened: it is not the material that gives way.
    assert error.smallest_stretch > 0.9
    assert "it buckles" in str(error)
    assert 0.0 <= error.stiffness < 0.25


def test_no_stress_no_softening_at_any_rotation(ragged_box: TetMesh) -> None:
    c, s = np.cos(1.0), np.sin(1.0)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    turned = ragged_box.points @ turn.T - ragged_box.points
    problem = compressed_bar(ragged_box, 0.0)
    assert smallest_stretches(Body(ragged_box, SOFT), turned) == pytest.approx(1.0, rel=1e-12)
    # K = K_m there.
    free = dataclasses.replace(problem, supports=(Support(points_at(ragged_box, 0, 0.0)),))
    newton = Newton(free, Strain.GREEN, 1e-10, 30)
    softening = find_softening(newton.body, turned, newton.solver_at(turned, 1.0))
    assert softening.stiffness == pytest.approx(1.0, rel=1e-6)
    assert softening.smallest_stretch == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("element", list(Element))
@pytest.mark.parametrize("law", list(Law))
def test_the_stiffness_without_stress_is_the_laws_own(
    ragged_box: TetMesh, law: Law, element: Element
) -> None:
    """K x = K_m x + sum of V grad x S grad N, whatever the law."""
    body = Body(ragged_box, example_material(law), element=element)
    rng = np.random.default_rng(3)
    u = 0.02 * rng.standard_normal(ragged_box.points.shape) - 0.1 * ragged_box.points
    x = rng.standard_normal(u.shape)
    body.core.assemble_tangent(u)
    whole = body.core.multiply(x)
    F = body.displacement_gradients(u) + np.eye(3)
    S = np.linalg.solve(F, body.first_piola_kirchhoff_stresses(u))
    P = body.mesh.cell_volumes[:, None, None] * (body.displacement_gradients(x) @ S)
    geometric = np.zeros_like(x)
    np.add.at(geometric, ragged_box.cells, body.shape_gradients @ P.transpose(0, 2, 1))
    found = _MaterialStiffness(body, u).times(x)
    assert np.abs(geometric).max() > 0.02 * np.abs(whole).max()
    assert np.abs(found + geometric - whole).max() < 1e-8 * np.abs(whole).max()


def test_an_iteration_cut_short_is_no_limit_of_the_material(ragged_box: TetMesh) -> None:
    fixed = points_at(ragged_box, 0, 0.0)
    problem = Problem(ragged_box, SOFT, (Support(fixed),), (BodyForce((0.0, 0.0, -200.0)),))
    with pytest.raises(NotConvergedError) as caught:
        solve_static(problem, max_iterations=1)
    assert not isinstance(caught.value, EquilibriumLostError)
