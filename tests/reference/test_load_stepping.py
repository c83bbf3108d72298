"""Hard loads end converged and stable, or with an honest diagnosis."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Support, Traction
from palpate.meshes.problem import Material, Problem
from palpate.reference.availability import is_available
from palpate.reference.errors import ReferenceNotConvergedError

if is_available():
    from palpate.reference.statics import solve_static

pytestmark = pytest.mark.dolfinx

MATERIAL = Material(1e4, 0.3)


@pytest.fixture
def bar(box):
    return box((20, 4, 4), (1.0, 0.2, 0.2))


def clamp(mesh, face="x0", displacement=(0.0, 0.0, 0.0)):
    facets = mesh.facet_groups[face]
    return Support(np.unique(facets).astype(np.int32), facets, displacement=displacement)


def twist(mesh, degrees):
    """Each point of the end x1 turned about the bar's axis."""
    a = np.radians(degrees)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(a), -np.sin(a)], [0.0, np.sin(a), np.cos(a)]])
    points = np.unique(mesh.facet_groups["x1"])
    arms = mesh.points[points] - [1.0, 0.1, 0.1]
    return tuple(
        Support(np.array([p], dtype=np.int32), displacement=tuple(u))
        for p, u in zip(points, arms @ turn.T - arms, strict=True)
    )


def test_a_bar_is_twisted_by_a_quarter_turn(bar):
    # From rest under prescribed displacements alone the first residual is zero.
    result = solve_static(Problem(bar, MATERIAL, (clamp(bar), *twist(bar, 90.0)), ()))
    assert len(result.load_steps) > 1
    assert result.smallest_det_f > 0.9
    middle = np.flatnonzero(np.all(np.isclose(bar.points, [0.5, 0.2, 0.1]), axis=1))[0]
    moved = bar.points[middle] + result.displacement[middle] - [0.5, 0.1, 0.1]
    assert np.degrees(np.arctan2(moved[2], moved[1])) == pytest.approx(45.0, abs=3.0)


def test_a_bar_bends_far_down_in_several_steps(bar):
    result = solve_static(Problem(bar, MATERIAL, (clamp(bar),), (BodyForce((0.0, 0.0, -200.0)),)))
    assert result.displacement[:, 2].min() < -0.4
    assert result.relative_residual <= 1e-10
    assert result.volume == pytest.approx(0.04, rel=0.01)


def test_a_bar_squeezed_between_its_ends_buckles(bar):
    # Clamped at both ends: Euler's strain 4 pi^2 I / (A L^2) = 4 pi^2 0.2^2 / 12 = 0.13.
    supports = (clamp(bar), clamp(bar, "x1", (-0.3, 0.0, 0.0)))
    with pytest.raises(ReferenceNotConvergedError, match="not stable") as caught:
        solve_static(Problem(bar, MATERIAL, supports, ()))
    # Shear at L / h = 5 lowers it by about a fifth.
    assert 0.3 * caught.value.load_factor == pytest.approx(0.13, rel=0.25)


@pytest.mark.parametrize("kind", ["bend", "pull down", "press", "poke", "squeeze"])
@pytest.mark.parametrize("strength", [1.0, 30.0])
def test_overload_ends_with_the_last_good_state(bar, kind, strength):
    mesh = bar
    loads, supports = (), (clamp(mesh),)
    if kind == "bend":
        loads = (BodyForce((0.0, 0.0, -1000.0 * strength)),)
    elif kind == "pull down":
        loads = (Traction(mesh.facet_groups["x1"], (0.0, 0.0, -500.0 * strength)),)
    elif kind == "press":
        loads = (Pressure(mesh.facet_groups["z1"], 300.0 * strength),)
    elif kind == "poke":
        corner = np.array([mesh.num_points - 1], dtype=np.int32)
        loads = (PointForce(corner, np.array([[0.0, 0.0, -100.0 * strength]])),)
    else:
        supports = (*supports, clamp(mesh, "x1", (-min(0.9, 0.5 * strength), 0.0, 0.0)))
    lines: list[str] = []
    with pytest.raises(ReferenceNotConvergedError) as caught:
        solve_static(Problem(mesh, MATERIAL, supports, loads), progress=lines.append)
    error = caught.value
    assert 0.0 < error.load_factor < 1.0
    assert error.smallest_det_f > 0.0
    assert error.displacement.any()
    assert f"{error.load_factor:.3f}" in str(error)
    assert any("back to" in line for line in lines)
