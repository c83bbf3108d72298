"""Loads that vary over a face: nodal forces by three ways, and polynomial solutions hit exactly."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.forces import external_force
from palpate.fastsim.statics import solve_static as fast_static
from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.face_loads import Profile, moment_traction, profile_traction
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.reference.availability import is_available
from palpate.validation.exchange.nodal_arrays import nodal_force

if is_available():
    from palpate.reference.discrete_problem import DiscreteProblem
    from palpate.reference.statics import solve_static

pytestmark = pytest.mark.dolfinx

L, D, T = 2.0, 0.6, 0.4
MESH = brick_box((3, 2, 1), (L, D, T), ragged=0.2)
E = 1e3


def general_load() -> Traction:
    rng = np.random.default_rng(5)
    bent = rng.standard_normal((3, 3, 3))
    facets = np.vstack([side(MESH, 0, L), side(MESH, 2, T)])
    gradient, curvature = rng.standard_normal((3, 3)), bent + bent.transpose(0, 2, 1)
    return Traction(facets, (1.0, -2.0, 0.5), gradient=gradient, curvature=curvature)


def statically_held(displacement) -> tuple[Support, ...]:
    """Three points that hold the six rigid motions and no more, where a solution puts them."""

    def one(place, components):
        point = int(np.linalg.norm(MESH.points - place, axis=1).argmin())
        assert np.linalg.norm(MESH.points[point] - place) < 1e-12
        moved = tuple(displacement(MESH.points[point : point + 1])[0].tolist())
        return Support(np.array([point], np.int32), components=components, displacement=moved)

    return (
        one([0.0, 0.0, 0.0], (True, True, True)),
        one([L, 0.0, 0.0], (False, True, True)),
        one([0.0, D, 0.0], (False, False, True)),
    )


def test_nodal_forces_by_hand_from_ufl_and_for_others_are_the_same():
    held = statically_held(np.zeros_like)
    problem = Problem(MESH, Material(E, 0.3), held, (general_load(),))
    by_hand = external_force(problem)
    discrete = DiscreteProblem(problem, strain=Strain.LINEAR, degree=1)
    by_ufl = discrete.at_points(discrete.dead_force)
    scale = np.abs(by_ufl).max()
    assert scale > 0.1
    assert np.abs(by_hand - by_ufl).max() < 1e-13 * scale
    assert np.abs(nodal_force(MESH, problem.loads[0]) - by_ufl).max() < 1e-13 * scale


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_the_work_on_a_polynomial_displacement_is_exact(degree):
    """Work on u = (s^degree, 0, 0), s along y, of a parabola over the end, by hand."""
    problem = Problem(
        MESH,
        Material(E, 0.3),
        statically_held(np.zeros_like),
        (profile_traction(side(MESH, 0, L), (1, 0, 0), Profile.PARABOLIC, (L, 0, 0), (L, D, 0)),),
    )
    discrete = DiscreteProblem(problem, strain=Strain.LINEAR, degree=degree)
    y = discrete.space.coordinates[:, 1] / D
    u = np.zeros((len(y), 3))
    u[:, 0] = y**degree
    # int_0^1 4 s (1 - s) s^p ds = 4 (1/(p + 2) - 1/(p + 3)), times the area.
    expected = D * T * 4.0 * (1.0 / (degree + 2) - 1.0 / (degree + 3))
    assert discrete.dead_force @ u.ravel() == pytest.approx(expected, rel=1e-13)


def test_a_cantilever_with_parabolic_shear_is_the_solution_of_elasticity():
    """Timoshenko and Goodier, Theory of Elasticity, 3rd ed., art. 21, with nu = 0.

    Force P up at x = L, y from the middle: s_xx = -P (L - x) y / I, s_xy = P (D^2/4 - y^2) / 2 I;
    integrated, u_x = P/(E I) (-(L x - x^2/2) y + D^2 y/4 - y^3/3), u_y = P/(E I) (L x^2/2 - x^3/6).
    Cubic, so that cubic tetrahedra have it exactly, the nodal forces being exact.
    """
    force = 0.05
    inertia = T * D**3 / 12.0

    def exact(points):
        x, y = points[:, 0], points[:, 1] - D / 2.0
        u = np.zeros_like(points)
        u[:, 0] = -(L * x - x**2 / 2.0) * y + D**2 * y / 4.0 - y**3 / 3.0
        u[:, 1] = L * x**2 / 2.0 - x**3 / 6.0
        return force / (E * inertia) * u

    peak = force * D**2 / (8.0 * inertia)
    assert peak == pytest.approx(1.5 * force / (D * T), rel=1e-12)
    root, end = side(MESH, 0, 0.0), side(MESH, 0, L)
    bending = force * L * D / (2.0 * inertia)
    loads = (
        profile_traction(end, (0, peak, 0), Profile.PARABOLIC, (L, 0, 0), (L, D, 0)),
        profile_traction(root, (0, -peak, 0), Profile.PARABOLIC, (0, 0, 0), (0, D, 0)),
        # P L y / I, y from the middle.
        profile_traction(root, (bending, 0, 0), Profile.LINEAR, (0, D / 2, 0), (0, D, 0)),
    )
    problem = Problem(MESH, Material(E, 0.0), statically_held(exact), loads)
    found = solve_static(problem, strain=Strain.LINEAR, degree=3, relative_tolerance=1e-12)
    wanted = exact(MESH.points)
    assert np.abs(found.displacement - wanted).max() < 1e-9 * np.abs(wanted).max()
    # The same numbers, on a finer mesh.
    finer = solve_static(refine_problem(problem), strain=Strain.LINEAR, degree=3)
    there = finer.displacement[: MESH.num_points]
    assert np.abs(there - wanted).max() < 1e-8 * np.abs(wanted).max()


def bent_bar(moment=0.05, poissons_ratio=0.3):
    """Pure bending about z by a moment on both ends, and its solution, quadratic."""
    curvature = moment / (E * T * D**3 / 12.0)

    def exact(points):
        x, y, z = (points - [0.0, D / 2.0, T / 2.0]).T
        nu = poissons_ratio
        return curvature * np.stack([-x * y, (x**2 + nu * (y**2 - z**2)) / 2.0, nu * y * z], axis=1)

    loads = (
        moment_traction(MESH, side(MESH, 0, L), (0.0, 0.0, moment)),
        moment_traction(MESH, side(MESH, 0, 0.0), (0.0, 0.0, -moment)),
    )
    problem = Problem(MESH, Material(E, poissons_ratio), statically_held(exact), loads)
    return problem, exact(MESH.points)


def test_a_bar_bent_by_moments_is_the_solution_of_elasticity():
    problem, exact = bent_bar()
    found = solve_static(problem, strain=Strain.LINEAR, degree=2, relative_tolerance=1e-12)
    assert np.abs(found.displacement - exact).max() < 1e-9 * np.abs(exact).max()


@pytest.mark.parametrize("element", list(Element))
@pytest.mark.parametrize("strain", list(Strain))
def test_both_solvers_have_the_same_equilibrium_under_moments(strain, element):
    problem, _ = bent_bar(moment=1.0)
    ours = fast_static(problem, strain=strain, element=element).displacement
    theirs = solve_static(problem, strain=strain, element=element).displacement
    assert np.abs(ours).max() > 0.02
    assert np.abs(ours - theirs).max() < 1e-8 * np.abs(theirs).max()
