"""Manufactured solutions, varying tractions and the thick sphere: rates of convergence."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.fastsim.forces import external_force
from palpate.fastsim.statics import solve_static as fast_static
from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.face_loads import Profile, moment_traction, profile_traction
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.meshes.transforms import rotation, turn
from palpate.reference.availability import is_available
from palpate.validation.case import load_case
from palpate.validation.exchange.nodal_arrays import nodal_force

if is_available():
    from palpate.reference import fenicsx
    from palpate.reference.deformed_state import DetFSampler
    from palpate.reference.discrete_problem import DiscreteProblem
    from palpate.reference.fenicsx import ufl
    from palpate.reference.laws import lame_parameters
    from palpate.reference.newton import Newton
    from palpate.reference.statics import solve_static

pytestmark = pytest.mark.dolfinx

MATERIAL = Material(1.0, 0.3)
# Gradients up to about 0.2: the quadratic part of the strain matters, and nothing softens much.
AMPLITUDE = 0.06


@dataclass
class Pinned:
    """Degrees of freedom held each at a value of its own."""

    dofs: NDArray[np.int32]
    values: NDArray[np.float64]

    def at(self, factor):
        return factor * self.values


def chosen_displacement(x):
    """Smooth, of all orders, different along each axis."""
    return AMPLITUDE * ufl.as_vector(
        [
            ufl.sin(1.7 * x[1]) * ufl.cos(x[0]) + x[2] ** 2,
            ufl.cos(1.3 * x[2]) * x[0] - ufl.sin(x[1]) ** 2,
            ufl.sin(x[0] * x[1]) + ufl.cos(2.0 * x[2]) * x[1],
        ]
    )


def chosen_values(x):
    x, y, z = x.T
    return AMPLITUDE * np.stack(
        [
            np.sin(1.7 * y) * np.cos(x) + z**2,
            np.cos(1.3 * z) * x - np.sin(y) ** 2,
            np.sin(x * y) + np.cos(2.0 * z) * y,
        ],
        axis=1,
    )


def body_force(u, strain):
    lmbda, mu = lame_parameters(MATERIAL)
    gradient = ufl.variable(ufl.grad(u))
    identity = ufl.Identity(3)
    if strain is Strain.GREEN:
        F = identity + gradient
        e = (F.T * F - identity) / 2
    else:
        e = (gradient + gradient.T) / 2
    energy = lmbda / 2 * ufl.tr(e) ** 2 + mu * ufl.tr(e * e)
    return -ufl.div(ufl.diff(energy, gradient))


def solve_errors(mesh, degree, strain, *, force_strain=None):
    """L2 and H1 errors of the discrete solution."""
    discrete = DiscreteProblem(Problem(mesh, MATERIAL, (), ()), strain=strain, degree=degree)
    domain = discrete.space.transferred.mesh
    x = ufl.SpatialCoordinate(domain)
    dx = ufl.dx(domain=domain, metadata={"quadrature_degree": 2 * degree + 4})
    exact = chosen_displacement(x)
    force = body_force(exact, force_strain or strain)
    discrete.dead_force = fenicsx.assemble_vector(fenicsx.form(ufl.inner(force, discrete.v) * dx))
    nodes = discrete.space.space.tabulate_dof_coordinates()
    values = chosen_values(nodes)
    outside = np.any((nodes < 1e-12) | (nodes > 1 - 1e-12), axis=1)
    dofs = (3 * np.flatnonzero(outside)[:, None] + np.arange(3)).ravel()
    discrete.fixed = Pinned(dofs.astype(np.int32), values.ravel()[dofs])
    discrete.free = np.setdiff1d(np.arange(discrete.num_dofs), dofs)
    newton = Newton(discrete, DetFSampler(discrete), relative_tolerance=1e-11)
    outcome = newton.solve(values.ravel(), 1.0)
    assert outcome.converged, outcome.reason
    discrete.set_displacement(outcome.displacement)
    error = discrete.u - exact
    squares = (
        ufl.inner(error, error) * dx,
        ufl.inner(ufl.grad(error), ufl.grad(error)) * dx,
    )
    return [np.sqrt(fenicsx.assemble_scalar(fenicsx.form(s))) for s in squares]


@pytest.mark.slow
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize(("degree", "counts"), [(1, (4, 8, 16)), (2, (2, 4, 8)), (3, (1, 2, 4))])
def test_errors_fall_at_the_order_of_theory(box, strain, degree, counts):
    errors = np.array([solve_errors(box((n, n, n)), degree, strain) for n in counts])
    orders = np.log2(errors[:-1] / errors[1:])
    # Theory: degree + 1 in L2, degree in H1; within 0.2 on the finest pair.
    assert orders[-1] == pytest.approx([degree + 1, degree], abs=0.2)
    assert errors[-1, 0] > 1e-8


@pytest.mark.slow
def test_the_nonlinear_part_is_exercised(box):
    # The Green solution with the linear body force is off by far more than the discretisation.
    mesh = box((4, 4, 4))
    green = solve_errors(mesh, 2, Strain.GREEN)
    mixed = solve_errors(mesh, 2, Strain.GREEN, force_strain=Strain.LINEAR)
    assert mixed[0] > 20 * green[0]


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

    def one(position, components):
        point = int(np.linalg.norm(MESH.points - position, axis=1).argmin())
        assert np.linalg.norm(MESH.points[point] - position) < 1e-12
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


A, B, SPHERE_E, NU, P = 0.5, 1.0, 1e4, 0.3, 100.0
CASE = """
schema = 1
title = "A thick sphere under pressure"
strain = "linear"

[geometry]
shape = "hollow_octant"
radius = 1.0
inner_radius = 0.5
edge_length = {edge}

[material]
youngs_modulus = 1e4
poissons_ratio = 0.3

[[load]]
kind = "pressure"
pressure = 100.0
region = {{ ball = {{ center = [0, 0, 0], radius = 0.5 }} }}
{supports}
[[check]]
metric = "smallest_det_f"
against = "candidate"
limit = 0.0
reason = "nothing inverted"
"""
WALL = """
[[support]]
sliding = true
region = {{ half_space = {{ point = {point}, normal = {normal} }} }}
"""


def exact(points):
    r = np.linalg.norm(points, axis=1, keepdims=True)
    radial = (1.0 - 2.0 * NU) * r + (1.0 + NU) * B**3 / (2.0 * r**2)
    return P * A**3 / (SPHERE_E * (B**3 - A**3)) * radial * points / r


def octant(tmp_path, edge):
    walls = [
        WALL.format(point=[1e-6 * (k == axis) for k in range(3)], normal=normal)
        for axis, normal in enumerate(([-1, 0, 0], [0, -1, 0], [0, 0, -1]))
    ]
    path = tmp_path / "octant.toml"
    path.write_text(CASE.format(edge=edge, supports="".join(walls)))
    return load_case(path).problem


def error(problem, displacement):
    wanted = exact(problem.mesh.points)
    return float(np.linalg.norm(displacement - wanted) / np.linalg.norm(wanted))


def test_the_reference_comes_to_lames_solution(tmp_path):
    problem = octant(tmp_path, 0.25)
    assert [sum(s.components) for s in problem.supports] == [1, 1, 1]
    assert len(problem.loads[0].facets) > 10
    coarse = error(problem, solve_static(problem, strain=Strain.LINEAR, degree=2).displacement)
    finer = octant(tmp_path, 0.125)
    fine = error(finer, solve_static(finer, strain=Strain.LINEAR, degree=2).displacement)
    # What is left is that facets are flat: second order.
    assert fine < 0.4 * coarse < 0.02


def test_turned_the_planes_slant_and_the_sphere_is_the_same(tmp_path):
    problem = octant(tmp_path, 0.25)
    turned, back = turn(problem, rotation((1.0, 2.0, 3.0), 50.0))
    assert all(s.normal is not None for s in turned.supports)
    plain = fast_static(problem, strain=Strain.LINEAR).displacement
    ours = fast_static(turned, strain=Strain.LINEAR).displacement
    theirs = solve_static(turned, strain=Strain.LINEAR).displacement
    size = np.abs(plain).max()
    assert np.abs(back(ours) - plain).max() < 1e-8 * size
    assert np.abs(ours - theirs).max() < 1e-8 * size


def test_a_wedge_of_a_sphere_has_the_same_solution_on_planes_that_meet_at_any_angle(tmp_path):
    """Half the octant by the plane x = y: cut by holding its normal at points on it."""
    problem = octant(tmp_path, 0.25)
    mesh = problem.mesh
    on_plane = np.flatnonzero(np.abs(mesh.points[:, 0] - mesh.points[:, 1]) < 1e-12)
    assert len(on_plane) > 3
    plane = dataclasses.replace(
        problem.supports[0],
        points=on_plane.astype(np.int32),
        facets=np.zeros((0, 3), dtype=np.int32),
        components=(True, True, True),
        normal=(1.0, -1.0, 0.0),
    )
    more = dataclasses.replace(problem, supports=(*problem.supports, plane))
    found = fast_static(more, strain=Strain.LINEAR).displacement
    theirs = solve_static(more, strain=Strain.LINEAR).displacement
    assert np.abs(found - theirs).max() < 1e-8 * np.abs(found).max()
    assert np.abs(found[on_plane] @ [1.0, -1.0, 0.0]).max() < 1e-15
    # Two linear cells across the wall.
    assert error(problem, found) < 0.2


def test_a_slab_that_slides_on_both_sides_is_in_plane_strain(tmp_path):
    """A tube under pressure between two smooth plates: Lame's ring, u_z = 0 on both."""
    text = CASE.replace("hollow_octant", "tube").replace(
        "inner_radius = 0.5", "inner_radius = 0.5\nheight = 0.3"
    )
    text = text.replace(
        "ball = {{ center = [0, 0, 0], radius = 0.5 }}",
        "box = {{ min = [-0.4999, -0.4999, 0.01], max = [0.4999, 0.4999, 0.29] }}",
    )
    plates = "[[support]]\nsliding = true\nregion = { box = { min = [-2, -2, 0.299], "
    plates += "max = [2, 2, 0.301] } }\n"
    plates += plates.replace("0.299", "-0.001").replace("0.301", "0.001")
    pins = "".join(
        f"[[support]]\ncomponents = ['{c}']\nregion = {{ nearest = {p} }}\n"
        for c, p in (("y", [1, 0, 0]), ("y", [-1, 0, 0]), ("x", [0, 1, 0]))
    )
    path = tmp_path / "tube.toml"
    path.write_text(text.format(edge=0.2, supports=plates + pins))
    problem = load_case(path).problem
    found = solve_static(problem, strain=Strain.LINEAR, degree=2).displacement
    for z in (0.0, 0.3):
        points = np.unique(side(problem.mesh, 2, z))
        assert np.abs(found[points, 2]).max() < 1e-15
    x, y, _ = problem.mesh.points.T
    r = np.hypot(x, y)
    # Timoshenko and Goodier, art. 28, with plane strain's constants.
    radial = P * A**2 * (1 + NU) / (SPHERE_E * (B**2 - A**2)) * ((1 - 2 * NU) * r + B**2 / r)
    ours = (found[:, 0] * x + found[:, 1] * y) / r
    assert np.linalg.norm(ours - radial) < 0.05 * np.linalg.norm(radial)
