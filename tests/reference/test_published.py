"""Published tables, other codes, Cook's membrane and Hertz: numbers that others found."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest
from bank import fixed, support

from palpate.meshes.boundary_conditions import BodyForce, PointForce, Traction
from palpate.meshes.bricks import brick_box, rollers, side, support_of
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.adaptivity.goals import Goal, Quantity
from palpate.reference.availability import is_available
from palpate.reference.result import Formulation, formulation_for
from palpate.validation.case import load_case
from palpate.validation.exchange.nodal_arrays import rest_arrays
from palpate.validation.metrics.grid_convergence import assess_grid_convergence
from palpate.validation.peers import adapters

if is_available():
    from palpate.reference.adaptivity.adaptive import solve_adaptively
    from palpate.reference.discrete_problem import DiscreteProblem
    from palpate.reference.statics import solve_static

pytestmark = [pytest.mark.dolfinx, pytest.mark.slow]


def turek_hron_bar(box, mu, num_layers):
    """The bar behind the cylinder, one layer of cells thick, held in plane strain.

    S. Turek, J. Hron, Proposal for numerical benchmarking of fluid-structure interaction, 2006:
    circle of radius 0.05 about (0.2, 0.2), bar 0.02 high up to x = 0.6, clamped on the arc,
    nu = 0.4, density 1000, body force 2 per mass downward. Returns the problem and point A.
    """
    thickness = 0.02 / num_layers
    flat = box((10 * num_layers, num_layers, 1), (1.0, 1.0, thickness))
    points = flat.points.copy()
    along = flat.points[:, 0] ** 1.5  # finer towards the clamp
    points[:, 1] = 0.19 + 0.02 * flat.points[:, 1]
    arc = 0.2 + np.sqrt(0.05**2 - (points[:, 1] - 0.2) ** 2)
    points[:, 0] = arc + (0.6 - arc) * along
    mesh = TetMesh(points, flat.cells, flat.facet_groups)
    in_plane = (False, False, True)
    supports = (
        fixed(mesh.facet_groups["x0"]),
        fixed(mesh.facet_groups["z0"], in_plane),
        fixed(mesh.facet_groups["z1"], in_plane),
    )
    nu = 0.4
    material = Material(2 * mu * (1 + nu), nu, 1000.0)
    end = int(np.argmin(np.abs(points - [0.6, 0.2, 0.0]).sum(axis=1)))
    assert np.abs(points[end] - [0.6, 0.2, 0.0]).max() < 1e-12
    return Problem(mesh, material, supports, (BodyForce((0.0, -2000.0, 0.0)),)), end


@pytest.mark.parametrize(
    ("mu", "published", "independent"),
    [  # displacement of A in mm: featflow tables, finest level; an independent Q2 solver
        pytest.param(
            0.5e6, (-7.18767, -66.1023), (-7.18763, -66.1021), id="CSM1", marks=pytest.mark.nightly
        ),
        pytest.param(2.0e6, (-0.469000, -16.9739), (-0.468996, -16.9738), id="CSM2"),
    ],
)
def test_turek_hron_lies_within_the_error_bar(box, mu, published, independent):
    values = []
    for num_layers in (6, 4, 2):
        problem, end = turek_hron_bar(box, mu, num_layers)
        values.append(1e3 * solve_static(problem, degree=3).displacement[end])
    for axis in (0, 1):
        # The clamped corner is singular: order 2 Re(exponent), 1.4 for nu = 0.4, not 6.
        bar = assess_grid_convergence(
            [v[axis] for v in values], [1 / 6, 1 / 4, 1 / 2], expected_order=1.4
        )
        assert bar.error_bar is not None, bar.behaviour
        for target in (published[axis], independent[axis]):
            assert bar.value == pytest.approx(target, rel=1e-3)
            assert abs(bar.value - target) <= bar.error_bar
    problem, end = turek_hron_bar(box, mu, 4)
    control = 1e3 * solve_static(problem, strain=Strain.LINEAR, degree=3).displacement[end]
    # Linear elasticity, as a control: no shortening, and a larger deflection.
    assert abs(control[0]) < 1e-3
    assert control[1] == pytest.approx({0.5e6: -68.019, 2.0e6: -17.005}[mu], rel=1e-3)


@pytest.mark.parametrize(
    ("load_factor", "elastica", "sze"),
    [
        # P L^2 / (E I) = 4 load_factor; L = 10. Elastica in closed form; Sze, Liu, Lo 2004.
        (0.25, (-0.5643324, 3.0172077), (-0.563, 3.015)),
        (0.50, (-1.6064172, 4.9345748), (-1.604, 4.933)),
        (1.00, (-3.2894124, 6.6996418), (-3.286, 6.698)),
        (2.50, (-5.5499560, 8.1060902), None),
    ],
)
def test_cantilever_under_end_shear(box, load_factor, elastica, sze):
    mesh = box((40, 2, 2), (10.0, 1.0, 0.1))
    shear = (0.0, 0.0, 4.0 * load_factor / 0.1)
    problem = Problem(
        mesh,
        Material(1.2e6, 0.0),
        (fixed(mesh.facet_groups["x0"]),),
        (Traction(mesh.facet_groups["x1"], shear),),
    )
    result = solve_static(problem, degree=2)
    tip = int(np.argmin(np.abs(mesh.points - [10.0, 0.5, 0.05]).sum(axis=1)))
    moved = result.displacement[tip, [0, 2]]
    # 0.1 %: the beam's own shear and stretch are (h/L)^2 = 1e-4 of it.
    for published in (elastica, sze):
        if published is not None:
            scale = np.abs(published).max()
            assert np.abs(moved - published).max() <= 1e-3 * scale
    assert result.volume == pytest.approx(1.0, rel=1e-3)


LIMIT = 0.005
MIDDLE, CORNER = (48.0, 52.0, 0.0), (48.0, 60.0, 0.0)


def membrane(count, thickness, grading=1):
    """`count` bricks a side, the smaller the nearer to a side, by a power of their number."""
    mesh = brick_box((count, count, 1), (1.0, 1.0, thickness))
    x, y, z = mesh.points.T
    x, y = (
        np.where(t < 0.5, (2.0 * t) ** grading, 2.0 - (2.0 - 2.0 * t) ** grading) / 2.0
        for t in (x, y)
    )
    tapered = np.column_stack([48.0 * x, 44.0 * x + y * (44.0 - 28.0 * x), z])
    plates = rollers(mesh, ((2, 0.0), (2, thickness)))
    supports = (support_of(side(mesh, 0, 0.0)), *plates)
    shear = Traction(side(mesh, 0, 1.0), (0.0, 1e-3 * 100.0 / 16.0, 0.0))
    mesh = dataclasses.replace(mesh, points=tapered)
    return Problem(mesh, Material(240.565, 0.499), supports, (shear,))


def displacement(problem, found, position):
    distance = np.linalg.norm(problem.mesh.points - position, axis=1)
    assert distance.min() < 1e-9
    return found.displacement[np.argmin(distance)]


@functools.cache
def cubic(count):
    """Mixed, of degree 3, on a mesh graded to all four corners: strain is not bounded at them."""
    problem = membrane(count, 4.0, grading=3)
    found = solve_static(problem, strain=Strain.LINEAR, degree=3, formulation=Formulation.MIXED)
    return {position: displacement(problem, found, position) for position in (MIDDLE, CORNER)}


@functools.cache
def truth(strain):
    problem = membrane(4, 8.0)
    # The bar of a point is that of the largest difference.
    asked = [Goal(Quantity.DISPLACEMENT_L2, LIMIT), Goal(Quantity.DISPLACEMENT_MAX, 2.0 * LIMIT)]
    form = formulation_for(problem, 2)
    found = solve_adaptively(problem, asked, strain=strain, formulation=form)
    assert found.ended == "every bar is met"
    assert found.formulation is Formulation.MIXED
    return problem, found


def off(found, wanted):
    return np.linalg.norm(found - wanted) / np.linalg.norm(wanted)


def apart_and_bar(strain, position):
    """From the cubic answer, and the bar, both over the largest displacement."""
    problem, found = truth(strain)
    apart = np.linalg.norm(displacement(problem, found, position) - cubic(12)[position])
    largest = np.linalg.norm(found.displacement, axis=1).max()
    return apart / largest, found.bar(Quantity.DISPLACEMENT_MAX)


def test_the_cubic_answer_has_converged():
    # To a fifth of the limit from 8 to 12 bricks, in which its error falls to less than a half.
    assert off(cubic(8)[MIDDLE], cubic(12)[MIDDLE]) < LIMIT / 5.0


@pytest.mark.parametrize("strain", list(Strain))
def test_the_truth_is_right_to_half_a_per_cent_and_within_its_bar(strain):
    problem, found = truth(strain)
    assert off(displacement(problem, found, MIDDLE), cubic(12)[MIDDLE]) < LIMIT
    apart, bar = apart_and_bar(strain, MIDDLE)
    assert apart < bar <= 2.0 * LIMIT


def test_the_corner_where_the_shear_ends_is_within_its_bar():
    # There the displacement goes as r log r; meshes that are not refined for it leave 1.5 %.
    apart, bar = apart_and_bar(Strain.LINEAR, CORNER)
    assert apart < bar <= 2.0 * LIMIT


@pytest.mark.parametrize(("degree", "least"), [(1, 0.5), (2, 2.0 * LIMIT)])
def test_the_displacement_alone_locks(degree, least):
    # Of degree 2 about as many unknowns as the truth's last mesh has.
    problem = membrane(12, 4.0)
    plain = solve_static(problem, strain=Strain.LINEAR, degree=degree)
    assert off(displacement(problem, plain, MIDDLE), cubic(12)[MIDDLE]) > least


def bent_and_twisted_bar(box):
    mesh = box((8, 2, 2), (0.4, 0.1, 0.1), jitter=0.2)
    corners = np.flatnonzero(
        (mesh.points[:, 0] == 0.4) & (np.abs(mesh.points[:, 1:] - 0.05) == 0.05).all(axis=1)
    )
    spin = np.cross([1.0, 0.0, 0.0], mesh.points[corners] - [0.4, 0.05, 0.05])
    return Problem(
        mesh,
        Material(2e4, 0.4),
        (support(mesh, "x0"),),
        (
            BodyForce((0.0, 200.0, -600.0)),
            Traction(mesh.facet_groups["x1"], (30.0, 0.0, 10.0)),
            PointForce(corners.astype(np.int32), 20.0 * spin),
        ),
    )


def job_of(problem, strain):
    """What every code is given, with the reference's own nodal forces."""
    discrete = DiscreteProblem(problem, strain=strain, degree=1)
    dead = discrete.external_force(np.zeros(discrete.num_dofs))
    return rest_arrays(problem) | {
        "external_force": discrete.space.at_points(dead),
        "strain": strain.value,
        "relative_tolerance": 1e-11,
        "load_parts": 1,
    }


def largest_difference(problem, strain, adapter, monkeypatch):
    monkeypatch.syspath_prepend(Path(adapters.__file__).parent)
    code = importlib.import_module(adapter).Static(job_of(problem, strain))
    code.advance(1)
    ours = solve_static(problem, strain=strain, relative_tolerance=1e-12).displacement
    theirs = code.result["displacement"]
    assert theirs.shape == ours.shape
    scale = np.abs(ours).max()
    # Large: linear strain would be told apart at once.
    assert scale > 0.05 * np.ptp(problem.mesh.points, axis=0).max()
    return float(np.abs(theirs - ours).max() / scale)


CASES = ["bar", "beam", "kidney"]


def problem_of(name, box):
    return bent_and_twisted_bar(box) if name == "bar" else load_case(name).problem


@pytest.mark.skipif(importlib.util.find_spec("felupe") is None, reason="FElupe is not installed")
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize("name", CASES)
def test_felupe_agrees_to_eight_digits(box, name, strain, monkeypatch):
    problem = problem_of(name, box)
    assert largest_difference(problem, strain, "felupe_svk", monkeypatch) < 1e-8


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize("name", CASES)
def test_calculix_agrees_to_five_digits(box, name, strain, monkeypatch):
    problem = problem_of(name, box)
    # Its .dat file holds seven digits.
    assert largest_difference(problem, strain, "calculix", monkeypatch) < 1e-5


RADIUS, YOUNGS_MODULUS = 1.0, 1e4


def quarter_block(contact_radius):
    """A quarter of a block of 100 contact radii, with four cells to a contact radius at the top.

    A block of 50 is 0.8 % stiffer: a layer on a rigid ground, Dimitriadis et al. 2002.
    """
    gmsh = pytest.importorskip("gmsh")
    a, size = contact_radius, 100.0 * contact_radius
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 0)
        for source in ("ExtendFromBoundary", "FromPoints", "FromCurvature"):
            gmsh.option.setNumber(f"Mesh.MeshSize{source}", 0)
        gmsh.model.occ.addBox(0, 0, -size, size, size, size)
        gmsh.model.occ.synchronize()
        field = gmsh.model.mesh.field
        cell_size = field.add("MathEval")
        grown = f"{0.25 * a} + 0.4 * Max(0, Sqrt(x*x + y*y + z*z) - {1.3 * a})"
        field.setString(cell_size, "F", grown)
        field.setAsBackgroundMesh(cell_size)
        gmsh.model.mesh.generate(3)
        tags, points, _ = gmsh.model.mesh.getNodes()
        corners = gmsh.model.mesh.getElementsByType(4)[1]
    finally:
        gmsh.finalize()
    row = np.zeros(int(tags.max()) + 1, dtype=np.int32)
    row[tags] = np.arange(len(tags))
    used, cells = np.unique(row[corners.astype(np.int64)], return_inverse=True)
    return TetMesh(points.reshape(-1, 3)[used], cells.reshape(-1, 4).astype(np.int32)), size


def over_hertz(depth, poissons_ratio, strain, *, contact="vertices", degree=2, **options):
    """Force of a sphere pressed in by a depth over 4/3 E* sqrt(R) d^1.5."""
    a = np.sqrt(RADIUS * depth)
    mesh, size = quarter_block(a)
    facets = mesh.boundary_facets
    corners = mesh.points[facets]

    def face(axis, value):
        return facets[np.all(np.abs(corners[:, :, axis] - value) < 1e-9 * size, axis=1)]

    supports = (
        fixed(face(0, 0.0), (True, False, False)),
        fixed(face(1, 0.0), (False, True, False)),
        fixed(face(2, -size)),
    )
    top = face(2, 0.0)
    near = top[np.linalg.norm(mesh.points[top].mean(axis=1), axis=1) < 4.0 * a]
    knots = np.array([[0.0, 0.0, RADIUS], [0.0, 0.0, RADIUS - depth]])
    path = ToolPath(np.arange(2.0), knots)
    tool = RigidTool(SphereShape(RADIUS), path, contact_facets=near, contact=contact)
    problem = Problem(mesh, Material(YOUNGS_MODULUS, poissons_ratio), supports, (), tools=(tool,))
    result = solve_static(problem, strain=strain, degree=degree, **options)
    (felt,) = result.tools
    # The last of it, between the nodes of flat facets.
    assert felt.penetrations[-1] < 0.01 * depth
    assert 4.0 * felt.active_areas[-1] == pytest.approx(np.pi * a**2, rel=0.2)
    modulus = YOUNGS_MODULUS / (1.0 - poissons_ratio**2)
    return 4.0 * felt.forces[-1][2] / (4.0 / 3.0 * modulus * np.sqrt(RADIUS) * depth**1.5)


@pytest.mark.parametrize("strain", list(Strain))
def test_a_shallow_sphere_meets_hertz(strain):
    assert over_hertz(0.01 * RADIUS, 0.3, strain) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(
    ("element", "off"), [(Element.SMOOTHED, 0.03), (Element.LINEAR, 0.15)], ids=str
)
def test_contact_over_facets_meets_hertz_with_tetrahedra_of_degree_1(element, off):
    found = over_hertz(
        0.01 * RADIUS, 0.3, Strain.LINEAR, contact="facets", degree=1, element=element
    )
    assert found == pytest.approx(1.0, abs=off)


@pytest.mark.parametrize(
    ("poissons_ratio", "strain", "expected"),
    [  # at a depth of 0.05 R, by an axisymmetric solver of its own
        (0.3, Strain.LINEAR, 1.04),
        (0.3, Strain.GREEN, 0.936),
        (0.45, Strain.LINEAR, 1.01),
        (0.45, Strain.GREEN, 0.903),
    ],
)
def test_a_deeper_one_leaves_it_as_an_independent_solver_says(poissons_ratio, strain, expected):
    found = over_hertz(0.05 * RADIUS, poissons_ratio, strain)
    assert found == pytest.approx(expected, abs=0.01)
