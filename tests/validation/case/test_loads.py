"""Loads of cases: over faces, in profiles, over time, as moments and weights."""

import dataclasses
import functools
import itertools
import math

import numpy as np
import pytest
from case_texts import FORCE, LIQUID, MOMENT, PARABOLA, VALUES
from judged import judge
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from palpate.fastsim.dynamics import simulate
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import InputError
from palpate.meshes.face_loads import Profile, hydrostatic_traction, profile_traction
from palpate.meshes.problem import Element, Strain
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.candidates.faults import Fault, with_fault
from palpate.validation.case import load_case
from palpate.validation.diagnosis.static_hypotheses import StaticResult, load_hypotheses
from palpate.validation.exchange.nodal_arrays import nodal_force
from palpate.validation.metrics.body import Body
from palpate.validation.report.pictures import draw_case
from palpate.validation.report.preview import describe_case
from palpate.validation.states import Verdict

NAMES = ("bend", "flight", "ring", "sphere", "submerged", "turned")


def expected(name, metric, *, strain=None, at=0):
    """The number that the checks of a metric expect, of the candidate and the truth alike."""
    case = load_case(name)
    found = []
    for check in case.checks:
        if check.metric == metric and check.strain is strain and check.expected is not None:
            found += [check.expected] if check.expected not in found else []
    return found[at]


def lame(name):
    """E in the case's unit, nu and the pressure."""
    spec = load_case(name).spec
    (load,) = spec.load
    assert load.kind == "pressure"
    return spec.material.youngs_modulus, spec.material.poissons_ratio, load.pressure


def test_the_ring_is_lames_in_plane_strain():
    E, nu, p = lame("ring")
    a, b, height = 10.0, 20.0, 2.0
    # Constants of the displacement c r + d / r from its stresses at both radii.
    lmbda, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    c, d = np.linalg.solve(
        [[2 * (lmbda + mu), -2 * mu / a**2], [2 * (lmbda + mu), -2 * mu / b**2]], [-p, 0.0]
    )
    assert expected("ring", "published_displacement") == pytest.approx(c * a + d / a, rel=1e-12)
    # Hoop stress, by Gauss's rule over the ring.
    nodes, weights = np.polynomial.legendre.leggauss(30)
    r = 0.5 * (a + b) + 0.5 * (b - a) * nodes
    hoop = 2 * (lmbda + mu) * c + 2 * mu * d / r**2
    mean = float((weights * hoop * r).sum() / (weights * r).sum())
    assert expected("ring", "published_stress") == pytest.approx(mean, rel=1e-9)
    # Through a cut the hoop stress sums to p a; along the plane's normal at 30 degrees.
    pull = float((weights * hoop).sum() * 0.5 * (b - a)) * height
    assert pull == pytest.approx(p * a * height, rel=1e-9)
    found = expected("ring", "published_reaction")
    assert found == pytest.approx(pull * math.cos(math.radians(30.0)), rel=1e-9)
    assert load_case("ring").problem.supports[1].normal == pytest.approx(
        (-0.5, math.cos(math.radians(30.0)), 0.0)
    )


def pressure_of_sphere(E, nu, outer):
    """Inner radius and pressure of a sphere of radii 1 and 2 whose outer one has become `outer`.

    From outside in: dr/dR = the radial stretch x with x (lmbda tr E + 2 mu E_R) = P, and
    dP/dR = -2 (P - T) / R, T = r / R (lmbda tr E + 2 mu E_T).
    """
    lmbda, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))

    def rates(R, at):
        r, P = at
        hoop = 0.5 * ((r / R) ** 2 - 1.0)
        M = lmbda / 2.0 + mu
        x = max(np.roots([M, 0.0, 2.0 * lmbda * hoop - M, -P]).real)
        T = r / R * (lmbda * (0.5 * (x**2 - 1.0) + 2.0 * hoop) + 2.0 * mu * hoop)
        return x, -2.0 * (P - T) / R

    r, P = solve_ivp(rates, (2.0, 1.0), (outer, 0.0), rtol=1e-10, atol=1e-12).y[:, -1]
    # The nominal stress is that of a pressure on the deformed area.
    return r, -P / r**2


def test_the_sphere_obeys_its_differential_equation():
    E, nu, p = lame("sphere")
    outer = brentq(lambda outer: pressure_of_sphere(E, nu, outer)[1] - p, 2.0, 2.1)
    inner = 10.0 * (pressure_of_sphere(E, nu, outer)[0] - 1.0)
    # Of a point in the middle of the inner face.
    part = 4.0 / math.sqrt(34.0)
    found = expected("sphere", "published_displacement") / part
    assert found == pytest.approx(inner, rel=1e-7)
    a, b = 10.0, 20.0
    linear = p * a**3 / (E * (b**3 - a**3)) * ((1 - 2 * nu) * a + (1 + nu) * b**3 / (2 * a**2))
    by_lame = expected("sphere", "published_displacement", strain=Strain.LINEAR) / part
    assert by_lame == pytest.approx(linear, rel=1e-12)
    # Large strain: a fifth apart.
    assert found > 1.2 * by_lame


def test_the_turned_bar_is_homogeneous():
    case = load_case("turned")
    problem = case.problem
    one, other = problem.supports
    assert one.rotation == other.rotation
    turn = one.rotation
    K = np.cross(np.eye(3), turn.axis)
    # exp of the cross product's matrix, as a power series.
    R = sum(np.linalg.matrix_power(turn.angle * K, k) / float(math.factorial(k)) for k in range(30))
    F = R @ np.diag([1.1, 1.0, 1.0])
    exact = problem.mesh.points @ F.T - problem.mesh.points
    for element in Element:
        found = solve_static(problem, element=element).displacement
        assert np.abs(found - exact).max() < 1e-10 * np.abs(exact).max()
    E = case.spec.material.youngs_modulus
    P = F @ np.diag([E * 0.105, 0.0, 0.0])
    assert expected("turned", "published_reaction") == pytest.approx(P[1, 0] * 100.0, rel=1e-12)
    assert expected("turned", "published_stress") == pytest.approx(np.linalg.norm(P), rel=1e-12)
    assert expected("turned", "published_energy") == pytest.approx(E * 0.105**2 / 2 * 2000.0)
    assert expected("turned", "published_volume_change") == 200.0
    u = F @ [10.0, 10.0, 10.0] - 10.0
    assert expected("turned", "published_displacement") == pytest.approx(u[1], rel=1e-12)


def test_the_bent_beam_is_saint_venants():
    case = load_case("bend")
    (load,) = case.problem.loads
    assert isinstance(load, Traction)
    k, L = 1.0 / 200.0, 20.0
    E, nu = case.spec.material.youngs_modulus, case.spec.material.poissons_ratio
    points = 1e3 * case.problem.mesh.points
    x, y, z = points.T - np.array([[0.0], [0.0], [0.5]])
    # Stress -E k z at the end, and nothing else.
    face = np.unique(load.facets)
    t = load.at(case.problem.mesh.points[face])
    assert t == pytest.approx(np.outer(-1e3 * E * k * z[face], [1.0, 0.0, 0.0]), abs=1e-9)
    u = k * np.stack([-x * z, nu * y * z, 0.5 * (x**2 + nu * (z**2 - y**2))], axis=1)
    corner = np.flatnonzero((points == 0.0).all(axis=1))[0]
    end = np.flatnonzero((points == [L, 0.0, 0.0]).all(axis=1))[0]
    number = expected("bend", "published_displacement")
    assert u[end, 2] - u[corner, 2] == pytest.approx(number, rel=1e-12)
    energy = 0.5 * E * k**2 * (1.0 / 12.0) * L
    assert expected("bend", "published_energy") == pytest.approx(energy, rel=1e-12)


def test_what_is_submerged_is_in_hydrostatic_balance():
    case = load_case("submerged")
    E, nu = 1e3 * case.spec.material.youngs_modulus, case.spec.material.poissons_ratio
    K, weight, depth = E / (3.0 * (1.0 - 2.0 * nu)), 9810.0, 0.1
    size = np.array([0.04, 0.025, 0.02])
    c = weight / (3.0 * K)

    def strain(z):
        return -weight * (depth - z) / (3.0 * K)

    assert expected("submerged", "published_displacement") == pytest.approx(
        1e3 * size[0] * strain(size[2]), rel=1e-12
    )
    mean = weight * (depth - 0.5 * size[2])
    assert expected("submerged", "published_stress") == pytest.approx(-1e-3 * mean, rel=1e-12)
    assert expected("submerged", "published_reaction") == pytest.approx(mean * 5e-4, rel=1e-12)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    change = 0.0
    gauss = list(zip(0.5 * (nodes + 1.0), 0.5 * weights, strict=True))
    for (a, wa), (b, wb), (d, wd) in itertools.product(gauss, repeat=3):
        x, y, z = size * [a, b, d]
        e = strain(z)
        H = [[e, 0.0, c * x], [0.0, e, c * y], [-c * x, -c * y, e]]
        change += wa * wb * wd * (float(np.linalg.det(np.eye(3) + H)) - 1.0)
    number = 1e9 * change * float(size.prod())
    assert expected("submerged", "published_volume_change") == pytest.approx(number, rel=1e-9)
    # Each face bears what the water presses on it; all of them bear the weight.
    pressed = [load for load in case.problem.loads if isinstance(load, Traction)]
    assert len(pressed) == 4
    for load in pressed:
        x = case.problem.mesh.points[np.unique(load.facets)]
        assert np.abs(load.at(x)).max(axis=1) == pytest.approx(weight * (depth - x[:, 2]))


def test_what_flies_keeps_its_momentum_and_turns_as_a_rigid_body():
    problem = load_case("flight").problem
    mesh, start = problem.mesh, problem.initial_velocity
    mass = np.bincount(mesh.cells.ravel(), np.repeat(250.0 * mesh.cell_volumes, 4), mesh.num_points)
    motion = simulate(problem)
    assert problem.supports == problem.loads == ()
    centres = np.einsum("n,tni->ti", mass, motion.displacements) / mass.sum()
    assert np.abs(centres - np.outer(motion.times, start.velocity)).max() < 1e-14
    r = mesh.points - np.array(start.center)
    # Angular momentum about the centre, from velocities half-way between the outputs.
    positions = mesh.points + motion.displacements - np.array(start.center) - centres[:, None]
    spin = np.array(start.angular_velocity)
    angle = np.linalg.norm(spin) * motion.times[-1]
    assert angle == pytest.approx(math.radians(60.0))
    turned = np.stack(
        [
            r[:, 0] * math.cos(angle) - r[:, 1] * math.sin(angle),
            r[:, 0] * math.sin(angle) + r[:, 1] * math.cos(angle),
            r[:, 2],
        ],
        axis=1,
    )
    assert np.abs(positions[-1] - turned).max() < 1e-3 * np.abs(r).max()
    at = np.flatnonzero((np.abs(mesh.points - [0.04, 0.02, 0.01]) < 1e-9).all(axis=1))[0]
    rigid = 1e3 * (turned[at] - r[at] + 0.1 * np.array(start.velocity))
    numbers = [expected("flight", "published_displacement", at=k) for k in (0, 1)]
    assert numbers == pytest.approx([30.0, rigid[1]], rel=1e-12)


def test_the_meshes_are_what_the_cases_say():
    bricks = brick_box((4, 5, 1), (1.0, 1.0, 1.0))
    r, angle = 10.0 + 10.0 * bricks.points[:, 0], math.radians(30.0) * bricks.points[:, 1]
    places = np.stack([r * np.cos(angle), r * np.sin(angle), 2.0 * bricks.points[:, 2]], axis=1)
    ring = load_case("ring").problem.mesh
    assert np.abs(1e3 * ring.points - places).max() < 1e-13
    assert np.array_equal(ring.cells, bricks.cells)
    crossed = load_case("flight").problem.mesh
    corners = np.array([[i, j, k] for i in (0, 2) for j in (0, 2) for k in (0, 2)])
    middles = [1 + s * np.eye(3, dtype=int)[k] for k in range(3) for s in (-1, 1)]
    every = np.vstack([corners, middles, [[1, 1, 1]]]) * np.array([20.0, 10.0, 5.0])
    assert np.abs(1e3 * crossed.points - every).max() < 1e-13
    # Mirrored about the middle it is the same mesh, cell by cell.
    cells = {tuple(sorted(cell)) for cell in crossed.cells.tolist()}
    for axis in range(3):
        mirror = crossed.points.copy()
        mirror[:, axis] = np.ptp(crossed.points[:, axis]) - mirror[:, axis]
        apart = np.linalg.norm(crossed.points[:, None] - mirror, axis=2)
        new = apart.argmin(axis=1)
        assert apart.min(axis=1).max() < 1e-15
        assert {tuple(sorted(new[list(cell)].tolist())) for cell in cells} == cells
    sphere = load_case("sphere").problem.mesh
    on = np.linalg.norm(1e3 * sphere.points[np.unique(sphere.boundary_facets)], axis=1)
    assert on.min() == pytest.approx(10.0)
    assert on.max() == pytest.approx(20.0)
    assert isinstance(sphere, TetMesh)
    assert (signed_volumes(sphere.points, sphere.cells) > 0.0).all()


@functools.cache
def healthy(name):
    """How many checks are red without a fault, by metric and what they are against."""
    return reds(name, Fault.NONE)


def reds(name, fault):
    candidate = with_fault(fastsim_candidate(), fault)
    found = {}
    for check in judge(load_case(name), candidate=candidate).checks:
        if check.verdict is Verdict.FAILED:
            key = check.metric, check.against
            found[key] = found.get(key, 0) + 1
    return found


FAULTS = {
    "bend": (Fault.SOFTER, Fault.DROPPED_LOAD, Fault.REVERSED_LOAD, Fault.SWAPPED_LAME),
    "flight": (Fault.LINEAR_INSTEAD_OF_GREEN, Fault.MIRRORED, Fault.LATE, Fault.UNIT_ERROR),
    "ring": (Fault.SOFTER, Fault.DROPPED_LOAD, Fault.REVERSED_LOAD, Fault.SWAPPED_LAME),
    "sphere": (Fault.SOFTER, Fault.LINEAR_INSTEAD_OF_GREEN, Fault.DROPPED_LOAD),
    "submerged": (Fault.SOFTER, Fault.DROPPED_LOAD, Fault.REVERSED_LOAD, Fault.SWAPPED_LAME),
    # Between given positions the stiffness shows nowhere.
    "turned": (Fault.LINEAR_INSTEAD_OF_GREEN, Fault.MIRRORED, Fault.UNIT_ERROR),
}


@pytest.mark.parametrize(
    ("name", "fault"), [(name, fault) for name in NAMES for fault in FAULTS[name]]
)
def test_a_perturbed_result_goes_red(name, fault):
    added = {key for key, count in reds(name, fault).items() if count > healthy(name).get(key, 0)}
    assert added


@pytest.mark.parametrize(
    ("name", "metric", "fault"),
    [
        ("turned", "published_reaction", Fault.LINEAR_INSTEAD_OF_GREEN),
        ("turned", "published_energy", Fault.LINEAR_INSTEAD_OF_GREEN),
        ("turned", "published_stress", Fault.LINEAR_INSTEAD_OF_GREEN),
        ("turned", "published_volume_change", Fault.MIRRORED_MESH),
        ("ring", "published_reaction", Fault.DROPPED_LOAD),
        ("ring", "published_stress", Fault.REVERSED_LOAD),
        ("submerged", "published_volume_change", Fault.SOFTER),
        ("submerged", "published_reaction", Fault.REVERSED_LOAD),
        ("submerged", "published_stress", Fault.DROPPED_LOAD),
    ],
)
def test_a_number_goes_red_without_any_reference(name, metric, fault):
    assert (metric, "candidate") not in healthy(name)
    assert (metric, "candidate") in reds(name, fault)


def test_the_cases_compare_every_kind_of_number_with_a_closed_form():
    checks = [check for name in NAMES for check in load_case(name).checks]
    kinds = {check.metric for check in checks if check.about.is_published}
    assert kinds == {
        "published_displacement",
        "published_energy",
        "published_reaction",
        "published_stress",
        "published_volume_change",
    }


MILLI = '\n[units]\nlength = "mm"\nforce = "mN"\nstress = "kPa"\n'
DENSE = LIQUID.replace("1000.0", "1.0")


def case_of(write_case, load, units=""):
    return load_case(write_case((FORCE, load), ("\n[geometry]", units + "\n[geometry]")))


def load_of(case):
    (load,) = case.problem.loads
    assert isinstance(load, Traction)
    return load


@pytest.mark.parametrize(
    ("load", "units", "at", "traction"),
    [
        (VALUES, "", [2.0, 0.5, 0.5], [2.0, 0.0, 4.0]),
        (VALUES, MILLI, [2.0, 0.5, 0.5], [2e3, 0.0, 4e3]),
        # 4 * 0.25 * 0.75 of 30.
        (PARABOLA, "", [2.0, 0.3, 0.25], [0.0, 0.0, 22.5]),
        # 5 mN mm on a square of 1 mm: t = M z / I = 5 (0.5) 12 kPa, z from the middle.
        (MOMENT, MILLI, [2.0, 0.2, 1.0], [30e3, 0.0, 0.0]),
        # rho g (1.5 - z) against +x, the outward normal of the end.
        (LIQUID, "", [2.0, 0.3, 0.25], [-12.5e3, 0.0, 0.0]),
        (DENSE, f'{MILLI}density = "g/cm3"\n', [2.0, 0.3, 0.25], [-12.5, 0.0, 0.0]),
    ],
)
def test_a_traction_that_varies_is_in_the_cases_units(write_case, load, units, at, traction):
    metre = 1e-3 if units else 1.0
    found = load_of(case_of(write_case, load, units)).at(metre * np.array(at))
    # The moment's are differences of large numbers.
    assert found == pytest.approx(traction, abs=1e-6 if load == MOMENT else None)


def test_a_box_in_a_liquid_feels_the_weight_of_what_it_displaces(write_case):
    mesh = case_of(write_case, LIQUID).problem.mesh
    faces = [side(mesh, axis, end) for axis in range(3) for end in (0.0, (2.0, 1.0, 1.0)[axis])]
    pressed = sum(
        nodal_force(mesh, hydrostatic_traction(mesh, face, 1e3, (1.0, 2.0, -10.0), (0.0, 0.0, 9.0)))
        for face in faces
    )
    assert np.sum(pressed, axis=0) == pytest.approx([-2e3, -4e3, 2e4], rel=1e-12)
    lines = "\n".join(describe_case(case_of(write_case, LIQUID)).lines)
    assert "force on a surface, varying, [-1e+04, 0, 0] N" in lines


def test_a_liquid_on_what_is_no_flat_face_is_refused(write_case):
    corner = ("point = [1.999, 0.0, 0.0], normal = [1.0", "point = [1.5, 0.0, 0.0], normal = [1.0")
    with pytest.raises(InputError, match=r"load 1: .* needs a flat face"):
        assert load_case(write_case((FORCE, LIQUID), corner)).problem
    mesh = case_of(write_case, LIQUID).problem.mesh
    end = side(mesh, 0, 2.0)
    with pytest.raises(InputError, match="density = -1"):
        hydrostatic_traction(mesh, end, -1.0, (0, 0, -10), (0, 0, 9))
    with pytest.raises(InputError, match="needs gravity"):
        hydrostatic_traction(mesh, end, 1.0, (0, 0, 0), (0, 0, 9))
    with pytest.raises(InputError, match="see hydrostatic_traction"):
        profile_traction(end, (1, 0, 0), Profile.HYDROSTATIC, (0, 0, 0), (1, 0, 0))


def test_a_moment_is_described_and_drawn(write_case, tmp_path):
    case = case_of(write_case, MOMENT)
    lines = "\n".join(describe_case(case).lines)
    assert "moment, its force [0, 0, 0] N" in lines
    assert "moment [0, 5, 0] N m about its middle" in lines
    draw_case(case, tmp_path / "case.png")
    assert (tmp_path / "case.png").stat().st_size > 5000


def test_a_profile_taken_as_uniform_is_found(write_case):
    case = case_of(write_case, VALUES)
    problem, load = case.problem, load_of(case)
    mean = Traction(load.facets, (2.0, 0.0, 4.0))
    wrong = dataclasses.replace(problem, loads=(mean,))
    result = StaticResult(Body(problem, case.strain), solve_static(wrong).displacement)
    fits = [found.name for found in load_hypotheses(result) if found.fits]
    assert fits == ["load 1 (traction) taken as uniform, at its mean"]
