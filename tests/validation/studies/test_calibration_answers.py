"""Known solutions of the study of calibration: round bodies, motions and contact."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from calibration_recipe.plane import Cylinder, Plane, PlaneLoads, Section
from calibration_recipe.pressed import settled
from calibration_recipe.round import Radial, inflation_problem, material_of, torsion_problem
from calibration_recipe.smooth import smooth_problem
from calibration_recipe.swings import breathe, flight, ring_problem

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Strain
from palpate.validation.references.geometry import _without_chance
from palpate.validation.states import in_silence
from palpate.validation.studies.calibration import STORED, Known, compare, known_problems, summarise

NU = 0.49999
MU = 0.5 / (1.0 + NU)


def of_sphere(a: float, b: float) -> float:
    """Pressure in an incompressible neo-Hookean sphere by its stretches inside and outside."""
    return 0.5 * MU * ((b**-4 + 4.0 / b) - (a**-4 + 4.0 / a))


def of_tube(a: float, b: float) -> float:
    """The same of a tube in plane strain: the integral of mu (l^2 - l^-2) over dr / r."""
    return MU * (math.log(a / b) + 0.5 * (b**-2 - a**-2))


@pytest.mark.parametrize("law", ["neo-hookean", "neo-hookean-isochoric", "neo-hookean-stable"])
@pytest.mark.parametrize(("k", "exact"), [(2, of_sphere), (1, of_tube)])
def test_a_body_that_keeps_its_volume_bears_the_integral_of_its_stress(law, k, exact) -> None:
    equation, outer, n = Radial(material_of(law, NU), k), 1.5, k + 1
    for a in (1.1, 1.6):
        b = (1.0 + (a**n - 1.0) / outer**n) ** (1.0 / n)
        assert equation.inflated(a, outer)[1] == pytest.approx(exact(a, b), rel=2e-4)


def test_mooney_and_rivlins_sphere_bears_its_second_constant_too() -> None:
    # Of W(l^-2, l, l): p = integral of W'(l) / (l^3 - 1) dl from b to a, W = c10 (l^-4 + 2 l^2 - 3)
    # + c01 (l^4 + 2 l^-2 - 3).
    material, a, outer = material_of("mooney-rivlin", NU), 1.5, 2.0
    b = (1.0 + (a**3 - 1.0) / outer**3) ** (1.0 / 3.0)
    x, w = np.polynomial.legendre.leggauss(30)
    l = b + 0.5 * (a - b) * (1.0 + x)  # noqa: E741
    c01 = material.c01
    rate = (0.5 * MU - c01) * 4.0 * (l - l**-5) + c01 * 4.0 * (l**3 - l**-3)
    wanted = 0.5 * (a - b) * float(w @ (rate / (l**3 - 1.0)))
    assert Radial(material, 2).inflated(a, outer)[1] == pytest.approx(wanted, rel=2e-4)


def test_the_widest_sphere_bears_the_most() -> None:
    equation = Radial(material_of("neo-hookean", 0.45), 2)
    widest = equation.widest(2.0)
    assert 1.3 < widest < 2.0
    there, before, after = (equation.inflated(widest + off, 2.0)[1] for off in (0.0, -0.15, 0.15))
    assert there > max(before, after)


def test_ogdens_law_with_one_term_of_two_is_neo_hookean() -> None:
    one = Material(1.0, 0.45, 1.0, Law.OGDEN, ogden_terms=((1.0, 2.0),))
    other = material_of("neo-hookean-isochoric", 0.45)
    pressures = [Radial(m, 2).inflated(1.4, 1.5)[1] for m in (one, other)]
    assert pressures[0] == pytest.approx(pressures[1], rel=1e-8)


def test_sizes_of_a_wedge_follow_from_its_radii() -> None:
    for body in ("sphere", "tube"):
        problem, _, answer = inflation_problem(
            body=body, law="neo-hookean-stable", nu=0.4, outer=1.5, part=0.3, bricks=6
        )
        mesh, state = problem.mesh, answer.state
        moved = mesh.points + state.displacement
        by_corners = type(mesh)(moved, mesh.cells)
        # Chords and straight edges in between: a few per cent of the change.
        change = state.volume - mesh.volume
        assert by_corners.volume - mesh.volume == pytest.approx(change, rel=0.05)
        change = state.surface_area - mesh.surface_area
        assert by_corners.surface_area - mesh.surface_area == pytest.approx(change, rel=0.05)


def test_a_twisted_cylinder_keeps_its_radius_as_far_as_its_volume() -> None:
    doubts = [
        torsion_problem(law="mooney-rivlin", nu=nu, angle=0.8, bricks=2)[2].doubts
        for nu in (0.49, 0.4999)
    ]
    assert doubts[1]["displacement_l2"] < 3e-5
    assert doubts[0]["displacement_l2"] > 50.0 * doubts[1]["displacement_l2"]


def test_a_damped_ring_comes_to_lames_rest() -> None:
    nu, b = 0.3, 1.5
    rise = TabularAmplitude((0.0, 1.0), (0.0, 1.0), is_smooth=True)
    radii, times = np.array([1.0, 1.2, b]), np.array([0.0, 60.0])
    u = breathe(Material(1.0, nu, 1.0), b, 1.0, rise, times, radii, 8)[-1]
    A = 0.02 / (b**2 - 1.0)
    np.testing.assert_allclose(
        u, (1.0 + nu) * A * ((1.0 - 2.0 * nu) * radii + b**2 / radii), rtol=1e-6
    )


def test_a_ring_begins_at_rest_and_is_known() -> None:
    _, strain, answer = ring_problem(nu=0.45, outer=1.25, damping=0.0, outputs=12)
    assert strain is Strain.LINEAR
    assert answer.doubts[""] < 1e-4
    assert answer.state.trajectory is not None
    assert not answer.state.trajectory.displacements[0].any()


def test_the_flight_of_a_bar_keeps_its_energy() -> None:
    x, t, h = np.linspace(0.0, 1.0, 2001), np.array([[0.2], [0.9], [1.7], [2.6], [3.5]]), 1e-6
    v, gap = 0.02, 0.5
    speed = (flight(t + h, x, v, gap) - flight(t - h, x, v, gap)) / (2.0 * h)
    slope = np.gradient(flight(t, x, v, gap), x, axis=1)
    energy = 0.5 * np.mean(speed**2 + slope**2, axis=1)
    np.testing.assert_allclose(energy, 0.5 * v**2, rtol=3e-3)
    # Away with the speed it came with; never beyond the wall.
    np.testing.assert_allclose(speed[-1], v, rtol=1e-6)
    assert flight(t, x[:1], v, gap).min() >= -gap * v - 1e-12


def test_means_of_stress_are_those_of_the_gradient() -> None:
    problem, _, answer = smooth_problem(shape="box", nu=0.45, seed=2)
    mesh, field = problem.mesh, answer.field
    assert field is not None
    assert answer.cauchy is not None
    x, w = np.polynomial.legendre.leggauss(3)
    corners, h = mesh.points[mesh.cells[:5]], 1e-5
    # Gauss's points of a cube folded into the tetrahedron.
    a, b, c = (0.5 * (1.0 + g).ravel() for g in np.meshgrid(x, x, x, indexing="ij"))
    weights = np.einsum("i,j,k->ijk", w, w, w).ravel() / 8.0 * a**2 * b
    places = np.column_stack([1 - a, a * (1 - b), a * b * (1 - c), a * b * c])
    X = np.einsum("qn,cni->cqi", places, corners).reshape(-1, 3)
    H = np.stack([(field(X + d) - field(X - d)) / (2 * h) for d in h * np.eye(3)], axis=-1)
    mu = 0.5 / 1.45
    lmbda = 2.0 * mu * 0.45 / 0.1
    sigma = mu * (H + H.transpose(0, 2, 1)) + lmbda * np.trace(H, axis1=1, axis2=2)[
        :, None, None
    ] * np.eye(3)
    means = np.einsum("q,cqij->cij", weights / weights.sum(), sigma.reshape(5, -1, 3, 3))
    np.testing.assert_allclose(answer.cauchy[:5], means, atol=1e-6 * np.abs(means).max())


@pytest.mark.nightly
def test_a_cylinder_on_a_deep_layer_is_hertzs() -> None:
    # K. L. Johnson, Contact Mechanics, 1985, section 4.2: P = pi a^2 E* / (4 R), and a pressure of
    # p0 (1 - x^2 / a^2)^(1/2), p0 = a E* / (2 R).
    nu, radius, a = 0.3, 1.0, 0.06
    stiff = 1.0 / (1.0 - nu**2)
    lines = np.array([0.0, a, 1.0])
    section = Section(lines, np.array([0.0, 1.0]), np.ones((2, 1), dtype=bool), lambda g: g)

    def stay(X, s):
        return 0.0 * s * X

    force = {}
    for depth in (0.0032,):
        cylinder = Cylinder(np.array([0.0, 1.0 + radius - depth]), radius, 1e4)
        loads = PlaneLoads(
            {"under": stay, "near": stay, "far": stay}, slides={"near": 0, "far": 0},
            cylinder=cylinder,
        )  # fmt: skip
        plane = Plane(section, Material(1.0, nu, 1.0), Strain.LINEAR, loads, degree=5, layers=2)
        settled(plane, height=1.0)
        assert cylinder.pressure is not None
        of = plane.elements[plane.on["top"]][:, plane.edges["top"]]
        x = (plane.touch_value @ plane.positions[of])[:, :, 0]
        t = np.abs(plane.touch_slope @ plane.positions[of])[:, :, 0]
        whole = 2.0 * float((plane.touch_weight * t * cylinder.pressure).sum())
        # p^2 is a line in x^2: its two numbers say p0 and a.
        touching = cylinder.pressure > 0.0
        p, x = cylinder.pressure[touching], x[touching]
        top, fall = np.linalg.lstsq(np.column_stack([x**0, -(x**2)]), p**2, rcond=None)[0]
        half = float(np.sqrt(top / fall))
        assert float(np.sqrt(top)) == pytest.approx(half * stiff / (2.0 * radius), rel=0.05)
        force[depth] = whole / (np.pi * half**2 * stiff / (4.0 * radius))
    assert list(force.values()) == pytest.approx([1.0] * len(force), abs=0.05)


def test_the_largest_displacement_of_two_bodies_may_agree_by_chance() -> None:
    found = _without_chance({"displacement_max": 0.02, "max_displacement": 0.001, "volume": 0.1})
    assert found == {"displacement_max": 0.02, "max_displacement": 0.02, "volume": 0.1}


@pytest.mark.dolfinx
@pytest.mark.nightly
def test_without_its_geometry_part_a_bar_covers_no_round_body() -> None:
    (known,) = (k for k in known_problems() if k.name == "inflated-04")
    assert known.surface == "cylinders"
    facets = np.concatenate([part.facets for part in known.curved_parts])
    lengths = np.linalg.norm(known.problem.mesh.points[facets][:, :, :2], axis=2)
    assert np.ptp(lengths, axis=1).max() < 1e-9
    whole = summarise(compare(known, STORED, in_silence))
    assert whole.covered == 1.0
    polyhedron: Known = dataclasses.replace(known, surface="", radii=())
    assert summarise(compare(polyhedron, STORED, in_silence)).worst > 1.5
