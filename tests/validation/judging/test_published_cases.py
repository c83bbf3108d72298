"""Numbers of the built-in cases: they are the closed forms and benchmarks that they name.

fastsim meets them, faults do not, and the truth is judged by them too.

Turek and Hron's bar, at rest (CSM1, CSM2) and swinging from rest (CSM3). S. Turek, J. Hron,
Proposal for numerical benchmarking of fluid-structure interaction between an elastic object and
laminar incompressible flow, 2006: circle of radius 0.05 about (0.2, 0.2), bar 0.02 high to x = 0.6,
clamped on the arc, plane strain, density 1000, body force 2 per mass. One layer of cells with uz =
0 on both sides. In motion the second bending mode rings along undamped, so the extremes of one
period differ by a few per cent from period to period and from time step to time step. What is
compared with the published extremes is the last period, as published; what is shown to converge is
the mean and the first harmonic of the whole run.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from judged import case_of, judge, references_of

from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Support, Traction
from palpate.meshes.bricks import brick_box, rollers, support_of
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, TimeSpan
from palpate.meshes.refinement import refine_problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.candidates.faults import Fault, with_fault
from palpate.validation.case import builtin_folder, load_case
from palpate.validation.judging.checks import judge_check
from palpate.validation.metrics.grid_convergence import assess_grid_convergence
from palpate.validation.references.bars import BarParts
from palpate.validation.states import Verdict

STRETCH = builtin_folder() / "stretch.toml"


def expected_of(name: str, component: str) -> float:
    """The number that a case expects, of candidate and truth alike."""
    (expected,) = {c.expected for c in case_of(name).checks if c.component == component}
    assert expected is not None
    return expected


def traction_of(name: str) -> tuple[float, float, float]:
    load = case_of(name).problem.loads[0]
    assert isinstance(load, Traction)
    return load.traction


def test_two_round_bodies_have_the_force_by_hertz() -> None:
    problem = case_of("hertz").problem
    E, nu = problem.material.youngs_modulus, problem.material.poissons_ratio
    radius, height, approach = 0.06, 0.03, problem.tools[0].path.positions[-1, 2]
    # Of both bodies: 1 / E* of the two added, 1 / R* as well, and both approaches.
    pair = E / (2.0 * (1.0 - nu**2)), radius / 2.0, 2.0 * approach
    force = 4.0 / 3.0 * pair[0] * math.sqrt(pair[1]) * pair[2] ** 1.5 / 4.0
    # Dimitriadis et al. 2002: a bonded layer of this height.
    a = (1.2876 - 1.4678 * nu + 1.3442 * nu**2) / (1.0 - nu) * 2.0 / math.pi
    ratio = math.sqrt(radius * approach) / height
    layer = 1.0 + a * ratio + (a * ratio) ** 2
    (own, truth) = (c for c in case_of("hertz").checks if c.expected is not None)
    assert own.expected == truth.expected == pytest.approx(-1e3 * force * (1 + layer) / 2, rel=1e-5)
    assert (
        own.uncertainty == truth.uncertainty == pytest.approx(1e3 * force * (layer - 1) / 2, 1e-4)
    )
    # The facets that touch are the sphere's in their mean, not at their corners.
    points, facets = problem.mesh.points, problem.tools[0].contact_facets
    above = points[facets].mean(axis=1)
    across = (points[facets] - np.roll(points[facets], 1, axis=1))[:, :, :2]
    means = (points[facets][:, :, :2] ** 2).sum(axis=2).mean(axis=1) / (2.0 * radius)
    means -= (across**2).sum(axis=(1, 2)) / (24.0 * radius)
    near = np.linalg.norm(above[:, :2], axis=1) < math.sqrt(radius * approach)
    assert np.abs(np.mean((above[:, 2] - means)[near])) < 0.005 * approach


def lame(material: Material) -> tuple[float, float]:
    E, nu = material.youngs_modulus, material.poissons_ratio
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def test_the_stretched_block_has_the_closed_form_of_its_side() -> None:
    # Lateral stretch sqrt(1 - nu (l^2 - 1)) of a 10 mm side at l = 1.25, nu = 0.3.
    lateral = 10.0 * (math.sqrt(1 - 0.3 * 0.5625) - 1)
    assert expected_of("stretch", "y") == pytest.approx(lateral, rel=1e-15)


def beam_tip(*, shear_factor: float, is_thick: bool) -> tuple[float, float]:
    """Where the tip of a bar of 20 x 1 x 1 goes under alpha = 1: u, w.

    Reissner's beam of Saint-Venant-Kirchhoff: of a fibre stretched by s = e + k z, the stress
    E (s + 3/2 s^2 + s^3 / 2) summed over the section is N and, times z, M; the axis goes by its
    stretch e and its shear V / (factor G A). The force is dead: M' = -P x'. Without thickness it
    is the elastica.
    """
    length, area, second, fourth = 20.0, 1.0, 1.0 / 12.0, 1.0 / 80.0
    force = second / length**2  # E = 1, nu = 0

    def rates(y: Points) -> Points:
        angle, moment = y[0], y[1]
        normal, across = force * math.sin(angle), force * math.cos(angle)
        e, k = 0.0, moment / second
        for _ in range(8 * is_thick):
            rest = 1.5 * (e**2 + k**2 * second / area) + 0.5 * (e**3 + 3 * e * k**2 * second / area)
            e = normal / area - rest
            k = moment / second - 3 * e * k - 1.5 * e**2 * k - 0.5 * k**3 * fourth / second
        slide = across / (shear_factor * 0.5 * area) if is_thick else 0.0
        x = (1.0 + e) * math.cos(angle) - slide * math.sin(angle)
        z = (1.0 + e) * math.sin(angle) + slide * math.cos(angle)
        return np.array([k, -force * x, x, z])

    def tip(moment: float, steps: int = 60) -> Points:
        y, h = np.array([0.0, moment, 0.0, 0.0]), length / steps
        for _ in range(steps):
            k1 = rates(y)
            k2 = rates(y + 0.5 * h * k1)
            k3 = rates(y + 0.5 * h * k2)
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rates(y + h * k3))
        return y

    # The moment at the clamp that leaves none at the tip, by the secant rule.
    one, other = 0.9 * force * length, force * length
    left, right = float(tip(one)[1]), float(tip(other)[1])
    while abs(right) > 1e-14 * force * length:
        one, other = other, other - right * (other - one) / (right - left)
        left, right = right, float(tip(other)[1])
    _, _, x, z = tip(other)
    return float(x) - length, float(z)


def test_the_cantilevers_numbers_are_those_of_a_beam_that_shears_and_stretches() -> None:
    # Elastica at alpha = 1: u/L, w/L = 0.05643324, 0.30172077.
    u, w = beam_tip(shear_factor=5.0 / 6.0, is_thick=False)
    assert (u, w) == pytest.approx((20.0 * -0.05643324, 20.0 * 0.30172077), rel=1e-6)
    u, w = beam_tip(shear_factor=5.0 / 6.0, is_thick=True)
    assert expected_of("cantilever", "x") == pytest.approx(u, rel=1e-6)
    assert expected_of("cantilever", "z") == pytest.approx(-w, rel=1e-6)
    # P L^2 / (E I) = 1 with P = traction x 1 mm2, I = 1/12 mm4.
    E = case_of("cantilever").problem.material.youngs_modulus
    alpha = -traction_of("cantilever")[2] * 1e-6 * 0.02**2 * 12.0 / (E * 1e-12)
    assert alpha == pytest.approx(1.0, rel=1e-12)


def test_the_columns_number_is_the_integral_of_its_stretch() -> None:
    column = case_of("column").problem
    (load,) = column.loads
    assert isinstance(load, BodyForce)
    lmbda, mu = lame(column.material)
    assert load.force_density[0] / (lmbda + 2.0 * mu) == pytest.approx(0.4, rel=1e-12)
    # (lmbda + 2 mu) a (a^2 - 1) / 2 = f (1 - x), by bisection, and Gauss's rule for a - 1.
    nodes, weights = np.polynomial.legendre.leggauss(40)
    x = 0.5 + 0.5 * nodes
    low, high = np.ones_like(x), np.full_like(x, 2.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        is_above = middle * (middle**2 - 1.0) / 2.0 > 0.4 * (1.0 - x)
        low, high = np.where(is_above, low, middle), np.where(is_above, middle, high)
    assert expected_of("column", "x") == pytest.approx(0.5 * float(weights @ (low - 1.0)), rel=1e-9)


def test_szes_cantilever_is_the_published_one() -> None:
    # P = 4 at the end of 10 x 1 x 0.1, E = 1.2e6, nu = 0; beside W, U those of the elastica.
    sze = case_of("sze").problem
    assert traction_of("sze")[2] * 1.0 * 0.1 == pytest.approx(4.0, rel=1e-12)
    assert np.ptp(sze.mesh.points, axis=0) == pytest.approx([10.0, 1.0, 0.1])
    assert (sze.material.youngs_modulus, sze.material.poissons_ratio) == (1.2e6, 0.0)
    numbers = [c.expected for c in case_of("sze").checks if c.expected is not None]
    assert numbers == pytest.approx([6.698, 6.6996418, -3.286, -3.2894124], rel=1e-12)


def test_the_loads_of_confined_stretch_and_shear_are_the_closed_forms() -> None:
    confined, shear = case_of("confined").problem, case_of("shear").problem
    # P = a (lmbda + 2 mu)(a^2 - 1)/2 at a = 1.1; code_aster SSNV121 has 31 096.154 MPa.
    assert traction_of("confined")[0] == pytest.approx(31096.154e6, rel=1e-8)
    # P12 = mu k + k (lmbda + 2 mu) k^2 / 2.
    (lmbda, mu), k = lame(shear.material), 0.5
    wanted = mu * k + k * (lmbda + 2 * mu) * k**2 / 2
    assert traction_of("shear")[0] == pytest.approx(wanted, rel=1e-14)
    # The whole field, not the corner alone: u = (k y, 0, 0) and ((a - 1) x, 0, 0).
    x, y, _ = confined.mesh.points.T
    for problem, u in ((confined, 0.1 * x), (shear, 0.5 * y)):
        off = solve_static(problem).displacement - np.outer(u, [1.0, 0.0, 0.0])
        assert np.abs(off).max() < 1e-11 * np.ptp(x)


@pytest.mark.parametrize(
    ("name", "faults"),
    [
        ("stretch", ()),
        # Under a given load a softer law is seen without a reference.
        *((name, (Fault.SOFTER, Fault.DROPPED_LOAD)) for name in ("confined", "shear", "column")),
    ],
)
def test_fastsim_meets_the_number_and_faults_do_not(name: str, faults: tuple[Fault, ...]) -> None:
    common = (Fault.LINEAR_INSTEAD_OF_GREEN, Fault.SWAPPED_LAME, Fault.UNIT_ERROR)
    for fault in (Fault.NONE, *common, *faults):
        result = judge(case_of(name), candidate=with_fault(fastsim_candidate(), fault))
        (check,) = (
            c
            for c in result.checks
            if c.metric == "published_displacement" and c.against == "candidate"
        )
        assert check.verdict is (Verdict.PASSED if fault is Fault.NONE else Verdict.FAILED), fault


@pytest.mark.parametrize(
    "name", ["confined", "shear", "csm1", "csm2", "cantilever", "sze", "column"]
)
def test_the_truth_is_judged_as_well(name: str) -> None:
    case = case_of(name)
    truth = references_of(name).truth(case.strain)
    assert truth is not None
    specs = [c for c in case.checks if c.metric == "published_displacement"]
    specs = [c for c in specs if c.against == "truth"]
    assert specs
    perturbed = dataclasses.replace(truth, displacement=1.02 * truth.displacement)
    for spec in specs:
        for state, bar, wanted in (
            (truth, 0.0, Verdict.PASSED),
            (perturbed, 0.0, Verdict.FAILED),
            # A truth that knows too little about itself allows no verdict, nor does none at all.
            (truth, math.inf, Verdict.INCONCLUSIVE),
            (None, 0.0, Verdict.INCONCLUSIVE),
        ):
            units = case.spec.units
            found = judge_check(spec, truth.strain, case.problem, None, state, bar, "", units)
            assert found.verdict is wanted, found.message
        # What the polyhedron leaves out of a curved body widens the bar.
        chords = BarParts(discretisation=0.5, geometry=0.5)
        found = judge_check(
            spec, truth.strain, case.problem, None, truth, 0.5, "", case.spec.units, parts=chords
        )
        assert found.verdict is Verdict.INCONCLUSIVE


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('component = "y"\n', "", "published_displacement needs component"),
        ("expected = -0.88", "expected = 0.0 #", "no scale"),
        ("at = [20.0, 10.0, 10.0]", "at = [20.0, 10.0, 9.0]", "no point of the mesh"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = STRETCH.read_text("utf-8")
    assert old in text
    (tmp_path / "stretch.toml").write_text(text.replace(old, new), encoding="utf-8")
    (tmp_path / "stretch.vtu").write_bytes((builtin_folder() / "stretch.vtu").read_bytes())
    references = tmp_path / "references"
    references.mkdir()
    stored = builtin_folder().parent / "references" / "stretch.npz"
    (references / "stretch.npz").write_bytes(stored.read_bytes())
    with pytest.raises(InputError, match=message):
        judge(load_case(tmp_path / "stretch.toml"))


# --------------------------------------------------------------------- the bar of Turek and Hron
# Mean of A along x and y, amplitude along x and y [mm], frequency [1/s]: converged, and the
# published row of level 2+0 with steps of 0.02 s.
CONVERGED = np.array([-14.305, -63.607, 14.305, 65.160, 1.0995])
COARSE = np.array([-14.384, -64.271, 14.389, 64.595, 1.0956])
END, HARMONICS = 10.0, 3


def bar_body(divisions: tuple[int, int, int]) -> tuple[TetMesh, tuple[Support, ...], int]:
    """The bar, how it is held in plane strain, and the number of its point A = (0.6, 0.2).

    Args:
        divisions: Bricks of six tetrahedra along, over the height (even) and through; the body is
            as thick as its bricks are high for each of the last.
    """
    thickness = 0.02 * divisions[2] / divisions[1]
    flat = brick_box(divisions, (1.0, 1.0, thickness))
    points = flat.points.copy()
    points[:, 1] = 0.19 + 0.02 * flat.points[:, 1]
    arc = 0.2 + np.sqrt(0.05**2 - (points[:, 1] - 0.2) ** 2)
    points[:, 0] = arc + (0.6 - arc) * flat.points[:, 0] ** 1.5  # finer towards the clamp
    mesh = TetMesh(points, flat.cells)
    facets = mesh.boundary_facets
    clamped = facets[(flat.points[facets, 0] == 0.0).all(axis=1)]
    supports = (support_of(clamped), *rollers(mesh, ((2, 0.0), (2, thickness))))
    return mesh, supports, int(np.argmin(np.linalg.norm(points - [0.6, 0.2, 0.0], axis=1)))


@pytest.mark.parametrize("name", ["csm1", "csm2", "csm3"])
def test_the_mesh_of_the_cases_is_the_published_bar(name: str) -> None:
    problem = case_of(name).problem
    mesh, supports, tip = bar_body((20, 4, 1))
    assert np.abs(problem.mesh.points - mesh.points).max() < 1e-15
    assert np.array_equal(problem.mesh.cells, mesh.cells)
    for own, known in zip(problem.supports, supports, strict=True):
        assert np.array_equal(own.points, known.points)
        assert own.components == known.components
    (load,) = problem.loads
    assert isinstance(load, BodyForce)
    assert load.force_density == (0.0, -2000.0, 0.0)
    mu = {"csm1": 0.5e6, "csm2": 2e6, "csm3": 0.5e6}[name]
    assert problem.material.youngs_modulus == pytest.approx(2.8 * mu, rel=1e-14)
    at = next(c.at for c in case_of(name).checks if c.at)
    assert np.abs(1e3 * mesh.points[tip] - at).max() < 1e-12


@pytest.mark.parametrize("name", ["csm1", "csm2"])
def test_fastsims_own_error_bar_contains_the_published_number(name: str) -> None:
    problems = [case_of(name).problem]
    for _ in range(2):
        problems.append(refine_problem(problems[-1]))
    tip = bar_body((20, 4, 1))[2]
    values = [1e3 * solve_static(p).displacement[tip] for p in reversed(problems)]
    for axis, component in enumerate("xy"):
        target = expected_of(name, component)
        # Order 2 of linear tetrahedra inside; less at the clamped corners.
        bar = assess_grid_convergence(
            [float(v[axis]) for v in values], (1.0, 2.0, 4.0), expected_order=2.0
        )
        assert bar.error_bar is not None, bar.behaviour
        assert abs(bar.value - target) <= bar.error_bar
        # A bar that says something: half of the number at most.
        assert bar.error_bar < 0.5 * abs(target)


def fit(times: Points, values: Points) -> tuple[float, float, float]:
    """Frequency of the harmonics that fit best, their mean, and the first one's amplitude."""

    def leftover(frequency: float) -> tuple[float, Points]:
        angles = 2.0 * math.pi * frequency * np.outer(times, np.arange(1, HARMONICS + 1))
        basis = np.hstack([np.ones((len(times), 1)), np.cos(angles), np.sin(angles)])
        weights, *_ = np.linalg.lstsq(basis, values, rcond=None)
        return float(np.sum((basis @ weights - values) ** 2)), weights

    low, high = 0.9, 1.3
    for _ in range(4):
        tried = np.linspace(low, high, 41)
        best = float(tried[int(np.argmin([leftover(float(f))[0] for f in tried]))])
        step = float(tried[1] - tried[0])
        low, high = best - step, best + step
    weights = leftover(best)[1]
    return best, float(weights[0]), float(np.hypot(weights[1], weights[1 + HARMONICS]))


def swing(num_layers: int, time_step: float) -> tuple[Points, float]:
    """The numbers of a published row, and the first harmonic along y of the whole run [mm]."""
    from palpate.reference.child import run_task
    from palpate.reference.tasks import ImplicitTask

    mesh, supports, tip = bar_body((10 * num_layers, num_layers, 1))
    span = TimeSpan(END, time_step, 0.0, round(END / time_step))
    load = BodyForce((0.0, -2000.0, 0.0))
    problem = Problem(mesh, Material(1.4e6, 0.4, 1000.0), supports, (load,), span)
    found = run_task(ImplicitTask(degree=2, spectral_radius=1.0), problem, time_limit=7200.0)
    path = 1e3 * found.displacements[:, tip, :2]
    frequency, _, harmonic = fit(found.times, path[:, 1])
    last = path[found.times >= END - 1.0 / frequency]
    high, low = last.max(axis=0), last.min(axis=0)
    return np.array([*(high + low) / 2.0, *(high - low) / 2.0, frequency]), harmonic


def test_the_fit_finds_a_swing_beside_a_second_mode() -> None:
    times = np.arange(0.0, 10.0, 0.02)
    values = -64.0 + 65.0 * np.cos(2.0 * math.pi * 1.0955 * times + 0.3)
    values += 0.8 * np.sin(2.0 * math.pi * 6.9 * times)
    frequency, level, harmonic = fit(times, values)
    assert frequency == pytest.approx(1.0955, abs=5e-5)
    assert (level, harmonic) == pytest.approx((-64.0, 65.0), abs=0.05)


@pytest.mark.nightly
@pytest.mark.dolfinx
@pytest.mark.slow
def test_the_published_swing_is_met_and_converges_with_the_square_of_the_time_step() -> None:
    runs = ((2, 0.02), (2, 0.01), (2, 0.005), (4, 0.01))
    found = {run: swing(*run) for run in runs}
    # All five numbers within 1 % of the published row of this step.
    assert np.abs(found[2, 0.02][0] / COARSE - 1.0).max() <= 0.01
    a, b, c, fine = (found[run][0][-1] for run in runs)
    assert math.log2(abs(b - a) / abs(c - b)) == pytest.approx(2.0, abs=0.3)
    # Extrapolated to no time step, on the fine mesh.
    frequency = c + (c - b) / 3.0 + fine - b
    assert frequency == pytest.approx(CONVERGED[-1], rel=0.005)
    assert found[4, 0.01][1] == pytest.approx(CONVERGED[3], rel=0.005)
