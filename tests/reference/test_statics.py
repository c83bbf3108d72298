"""Closed-form states of the Saint-Venant-Kirchhoff material, steps of the load, and honest ends."""

from __future__ import annotations

import numpy as np
import pytest
from bank import rollers, support

from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Support, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.availability import is_available
from palpate.reference.errors import ReferenceNotConvergedError

if is_available():
    from palpate.reference.discrete_problem import internal_force
    from palpate.reference.statics import solve_static

pytestmark = pytest.mark.dolfinx

E, NU = 3000.0, 0.3
MATERIAL = Material(E, NU, 1000.0)
LMBDA, MU = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
# TARGETS: closed homogeneous states to 1e-10.
CLOSED = 1e-10


def point_supports(mesh, displacement):
    """Every boundary point held at its own displacement."""
    points = np.unique(mesh.boundary_facets)
    return tuple(
        Support(np.array([p], dtype=np.int32), displacement=tuple(displacement[p])) for p in points
    )


def force_on(mesh, face, forces):
    return forces[np.unique(mesh.facet_groups[face])].sum(axis=0)


@pytest.mark.parametrize("stretch", [0.60, 0.55, 0.50])
def test_compression_by_displacement_passes_the_peak_of_stress(box, stretch):
    # One cube of linear cells: finer ones find shears in which the material is unstable earlier.
    mesh = box((1, 1, 1))
    pushed = support(mesh, "x1", (True, False, False), (stretch - 1, 0.0, 0.0))
    result = solve_static(Problem(mesh, MATERIAL, (*rollers(mesh), pushed), ()))
    side = np.sqrt(1 - NU * (stretch**2 - 1))
    expected = mesh.points * (np.array([stretch, side, side]) - 1)
    assert np.max(np.abs(result.displacement - expected)) <= CLOSED
    forces = internal_force(mesh, result.displacement, material=MATERIAL)
    stress_over_E = force_on(mesh, "x1", forces)[0] / E
    assert stress_over_E == pytest.approx(stretch * (stretch**2 - 1) / 2, rel=1e-9)
    # Peak at 1 / sqrt(3): -1 / (3 sqrt(3)) = -0.1924501.
    assert -0.1924501 < stress_over_E < -0.18


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("strain", list(Strain))
def test_affine_displacement_is_reproduced_on_a_ragged_mesh(box, strain, degree):
    mesh = box((3, 3, 3), jitter=0.3)
    gradient = np.array([[0.1, 0.05, -0.02], [0.03, -0.08, 0.04], [-0.06, 0.02, 0.12]])
    # Point supports hold no edges, so a quadratic body is driven by the tractions instead.
    affine = mesh.points @ gradient.T
    if degree == 1:
        problem = Problem(mesh, MATERIAL, point_supports(mesh, affine), ())
        expected = affine
    else:
        # Tractions P N of the affine state, and only the rigid motions held.
        problem, expected = affine_by_tractions(mesh, gradient, strain)
    result = solve_static(problem, strain=strain, degree=degree)
    assert np.max(np.abs(result.displacement - expected)) <= CLOSED


def affine_by_tractions(mesh: TetMesh, gradient, strain):
    F = np.eye(3) + gradient
    green = (F.T @ F - np.eye(3)) / 2
    eps = (gradient + gradient.T) / 2
    law = lambda e: LMBDA * np.trace(e) * np.eye(3) + 2 * MU * e  # noqa: E731
    P = F @ law(green) if strain is Strain.GREEN else law(eps)
    normals = {"x0": -P[:, 0], "x1": P[:, 0], "y0": -P[:, 1]}
    normals |= {"y1": P[:, 1], "z0": -P[:, 2], "z1": P[:, 2]}
    loads = tuple(Traction(mesh.facet_groups[f], tuple(t)) for f, t in normals.items())
    at = lambda *x: int(np.flatnonzero(np.all(mesh.points == x, axis=1))[0])  # noqa: E731
    affine = mesh.points @ gradient.T
    fixed = [  # 3-2-1: origin, then y and z on the x axis, then z on the y axis
        (at(0, 0, 0), (True, True, True)),
        (at(1, 0, 0), (False, True, True)),
        (at(0, 1, 0), (False, False, True)),
    ]
    supports = tuple(
        Support(np.array([p], dtype=np.int32), components=c, displacement=tuple(affine[p]))
        for p, c in fixed
    )
    return Problem(mesh, MATERIAL, supports, loads), affine


def test_stretch_after_a_large_rotation_meets_code_aster_ssnv121(box):
    # V6.04.121: stretch 1.1, confined, E = 200 000 MPa, nu = 0.3: 31 096.154 MPa.
    mesh = box(jitter=0.2)
    steel = Material(2e11, 0.3, 7800.0)
    angle = np.radians(60.0)
    c, s = np.cos(angle), np.sin(angle)
    Q = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    F = Q @ np.diag([1.1, 1.0, 1.0])
    moved = mesh.points @ (F - np.eye(3)).T
    result = solve_static(Problem(mesh, steel, point_supports(mesh, moved), ()))
    assert np.max(np.abs(result.displacement - moved)) <= CLOSED
    forces = internal_force(mesh, result.displacement, material=steel)
    # Work of the stretching mode u = Q e1 x over the unit cube is P11 of the unrotated frame.
    stress = (forces @ Q[:, 0] * mesh.points[:, 0]).sum()
    assert stress / 1e6 == pytest.approx(31096.153846, rel=1e-9)
    linear = internal_force(mesh, result.displacement, material=steel, strain=Strain.LINEAR)
    assert abs((linear @ Q[:, 0] * mesh.points[:, 0]).sum() / 1e6 - 31096.15) > 1000.0


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("stretch", [0.93, 1.05])
def test_follower_pressure_on_all_faces_scales_a_cube_evenly(box, degree, stretch):
    mesh = box(jitter=0.2)
    # P = l (3 lmbda + 2 mu) (l^2 - 1) / 2 balances -p l^2 per rest area.
    pressure = -(3 * LMBDA + 2 * MU) * (stretch**2 - 1) / (2 * stretch)
    problem, _ = affine_by_tractions(mesh, (stretch - 1) * np.eye(3), Strain.GREEN)
    loads = (Pressure(mesh.boundary_facets, pressure),)
    result = solve_static(Problem(mesh, MATERIAL, problem.supports, loads), degree=degree)
    assert np.max(np.abs(result.displacement - (stretch - 1) * mesh.points)) <= CLOSED


def test_a_dead_load_is_not_a_follower(box):
    # The same suction by dead tractions: P = l (3 lmbda + 2 mu) (l^2 - 1) / 2 = t, without l^2.
    mesh = box(jitter=0.2)
    stretch = 1.05
    t = stretch * (3 * LMBDA + 2 * MU) * (stretch**2 - 1) / 2
    fixed, _ = affine_by_tractions(mesh, (stretch - 1) * np.eye(3), Strain.GREEN)
    result = solve_static(fixed)
    assert np.max(np.abs(result.displacement - (stretch - 1) * mesh.points)) <= CLOSED
    followed = Problem(mesh, MATERIAL, fixed.supports, (Pressure(mesh.boundary_facets, -t),))
    other = solve_static(followed)
    assert np.max(np.abs(other.displacement - result.displacement)) > 1e-3


def test_dead_pressure_on_a_loosely_held_body_is_not_stable(box):
    # Turning the body about its support lets every dead push do work: no stable equilibrium.
    problem, _ = affine_by_tractions(box(), -0.07 * np.eye(3), Strain.GREEN)
    with pytest.raises(ReferenceNotConvergedError, match="not stable"):
        solve_static(problem)


def test_linear_pressure_acts_on_the_rest_surface(box):
    mesh = box()
    pressure = Problem(mesh, MATERIAL, rollers(mesh), (Pressure(mesh.facet_groups["x1"], 50.0),))
    traction = Problem(
        mesh, MATERIAL, rollers(mesh), (Traction(mesh.facet_groups["x1"], (-50.0, 0.0, 0.0)),)
    )
    left, right = (solve_static(p, strain=Strain.LINEAR) for p in (pressure, traction))
    scale = np.max(np.abs(right.displacement))
    assert np.max(np.abs(left.displacement - right.displacement)) <= 1e-12 * scale
    assert right.displacement[-1, 0] == pytest.approx(-50.0 / E, rel=CLOSED)


def test_hanging_bar_is_quadratic_in_its_length(box):
    # nu = 0, linear: u = b (L x - x^2 / 2) / E, in the quadratic space: exact at its vertices.
    mesh = box((4, 1, 1), (2.0, 0.5, 0.5))
    material = Material(E, 0.0)
    b, x = 100.0, mesh.points[:, 0]
    problem = Problem(mesh, material, rollers(mesh), (BodyForce((b, 0.0, 0.0)),))
    result = solve_static(problem, strain=Strain.LINEAR, degree=2)
    exact = b * (2.0 * x - x**2 / 2) / E
    assert np.max(np.abs(result.displacement[:, 0] - exact)) <= CLOSED * np.max(exact)
    # volume = integral of 1 + du/dx, a polynomial: 0.25 (2 + u(2))
    assert result.volume == pytest.approx(0.25 * (2.0 + exact.max()), rel=CLOSED)


@pytest.mark.parametrize("push", [-1.0, -1e3])
def test_absurd_loads_are_not_called_converged(box, push):
    mesh = box((3, 3, 3))
    loads = (Traction(mesh.facet_groups["x1"], (push * E, 0.3 * push * E, 0.0)),)
    with pytest.raises(ReferenceNotConvergedError) as caught:
        solve_static(Problem(mesh, MATERIAL, (support(mesh, "x0"),), loads))
    assert caught.value.load_factor < 1.0
    assert caught.value.smallest_det_f > 0.0
    assert np.isfinite(caught.value.displacement).all()


def test_the_answer_does_not_depend_on_the_numbering(box):
    mesh = box((3, 2, 2), (0.6, 0.2, 0.2), jitter=0.2)
    loads = (BodyForce((0.0, 30.0, -80.0)),)
    material = Material(1e4, 0.4)
    result = solve_static(Problem(mesh, material, (support(mesh, "x0"),), loads))
    random = np.random.default_rng(3)
    new = random.permutation(mesh.num_points)
    points = np.empty_like(mesh.points)
    points[new] = mesh.points
    cells = new[mesh.cells][random.permutation(mesh.num_cells)][:, [1, 2, 0, 3]]
    shuffled = TetMesh(points, cells, {"x0": new[mesh.facet_groups["x0"]]})
    other = solve_static(Problem(shuffled, material, (support(shuffled, "x0"),), loads))
    scale = np.max(np.abs(result.displacement))
    assert np.max(np.abs(other.displacement[new] - result.displacement)) <= 1e-11 * scale


def test_nothing_happens_without_loads(box):
    mesh = box()
    result = solve_static(Problem(mesh, MATERIAL, (support(mesh, "x0"),), ()))
    assert not result.displacement.any()
    assert result.relative_residual == 0.0
    assert result.volume == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"supports": ()}, "no support"),
        ({"loads": (BodyForce((0.0, float("nan"), 0.0)),)}, "force_density"),
        ({"degree": 4}, "degree = 4"),
        ({"relative_tolerance": 0.0}, "relative_tolerance"),
    ],
)
def test_unusable_input_is_named(box, change, words):
    mesh = box()
    options = {k: v for k, v in change.items() if k in ("degree", "relative_tolerance")}
    problem = Problem(
        mesh,
        MATERIAL,
        change.get("supports", (support(mesh, "x0"),)),
        change.get("loads", ()),
    )
    with pytest.raises(InputError, match=words):
        solve_static(problem, **options)


COLUMN_E = 3000.0


def test_a_straight_column_ends_at_eulers_load(box):
    # Clamped-free: P = pi^2 E I / (4 L^2); nothing bends it, so only stability tells.
    mesh = box((10, 1, 1), (1.0, 0.1, 0.1))
    euler = np.pi**2 * COLUMN_E * 0.1**4 / 12 / 4
    loads = (Traction(mesh.facet_groups["x1"], (-2.0 * euler / 0.01, 0.0, 0.0)),)
    problem = Problem(mesh, Material(COLUMN_E, 0.0), (support(mesh, "x0"),), loads)
    with pytest.raises(ReferenceNotConvergedError, match="not stable") as caught:
        solve_static(problem, degree=2)
    # 2 %: shear and shortening, (h / L)^2 each, and the coarse mesh.
    assert 2.0 * caught.value.load_factor == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("kind", ["pushed by the pressure", "beside a small one"])
def test_follower_pressure_does_not_hide_that_a_column_buckles(box, kind):
    mesh = box((10, 1, 1), (1.0, 0.1, 0.1))
    if kind == "pushed by the pressure":
        # The top may slide and turn, so that the pressure has a potential: 20.19 E I / L^2.
        critical = 20.19 * COLUMN_E * 0.1**4 / 12
        supports = (
            support(mesh, "x0"),
            support(mesh, "x1", (False, True, True)),
        )
        loads = (Pressure(mesh.facet_groups["x1"], 2.0 * critical / 0.01),)
    else:
        critical = np.pi**2 * COLUMN_E * 0.1**4 / 12 / 4
        supports = (support(mesh, "x0"),)
        loads = (
            Traction(mesh.facet_groups["x1"], (-2.0 * critical / 0.01, 0.0, 0.0)),
            Pressure(mesh.facet_groups["y1"], 1e-9 * COLUMN_E),
        )
    with pytest.raises(ReferenceNotConvergedError, match="not stable") as caught:
        solve_static(Problem(mesh, Material(COLUMN_E, 0.0), supports, loads), degree=2)
    # Shear and shortening, some (pi h / l)^2 of the half wave l, which is 0.7 L where it is short.
    assert 2.0 * caught.value.load_factor == pytest.approx(1.0, rel=0.08)


TISSUE = Material(1e4, 0.3)


@pytest.fixture
def bar(box):
    return box((20, 4, 4), (1.0, 0.2, 0.2))


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
    result = solve_static(Problem(bar, TISSUE, (support(bar), *twist(bar, 90.0)), ()))
    assert len(result.load_steps) > 1
    assert result.smallest_det_f > 0.9
    middle = np.flatnonzero(np.all(np.isclose(bar.points, [0.5, 0.2, 0.1]), axis=1))[0]
    moved = bar.points[middle] + result.displacement[middle] - [0.5, 0.1, 0.1]
    assert np.degrees(np.arctan2(moved[2], moved[1])) == pytest.approx(45.0, abs=3.0)


def test_a_bar_bends_far_down_in_several_steps(bar):
    result = solve_static(Problem(bar, TISSUE, (support(bar),), (BodyForce((0.0, 0.0, -200.0)),)))
    assert result.displacement[:, 2].min() < -0.4
    assert result.relative_residual <= 1e-10
    assert result.volume == pytest.approx(0.04, rel=0.01)


def test_a_bar_squeezed_between_its_ends_buckles(bar):
    # Clamped at both ends: Euler's strain 4 pi^2 I / (A L^2) = 4 pi^2 0.2^2 / 12 = 0.13.
    supports = (support(bar), support(bar, "x1", displacement=(-0.3, 0.0, 0.0)))
    with pytest.raises(ReferenceNotConvergedError, match="not stable") as caught:
        solve_static(Problem(bar, TISSUE, supports, ()))
    # Shear at L / h = 5 lowers it by about a fifth.
    assert 0.3 * caught.value.load_factor == pytest.approx(0.13, rel=0.25)


@pytest.mark.parametrize(
    ("kind", "strength"),
    [("bend", 1.0), ("pull down", 30.0), ("press", 1.0), ("poke", 30.0), ("squeeze", 1.0)],
)
def test_overload_ends_with_the_last_good_state(box, kind, strength):
    mesh = box((10, 2, 2), (1.0, 0.2, 0.2))
    loads, supports = (), (support(mesh),)
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
        supports = (
            *supports,
            support(mesh, "x1", displacement=(-min(0.9, 0.5 * strength), 0.0, 0.0)),
        )
    lines: list[str] = []
    with pytest.raises(ReferenceNotConvergedError) as caught:
        solve_static(Problem(mesh, TISSUE, supports, loads), progress=lines.append)
    error = caught.value
    assert 0.0 < error.load_factor < 1.0
    assert error.smallest_det_f > 0.0
    assert error.displacement.any()
    assert f"{error.load_factor:.3f}" in str(error)
    assert any("back to" in line for line in lines)
