"""A closed form stands in a case file: fastsim keeps it, faults do not, mistakes are named."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.candidates.faults import Fault, with_fault
from palpate.validation.case import builtin_folder, load_case
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.case_references import find_references
from palpate.validation.judging.checks import judge_check
from palpate.validation.judging.judge import judge_case
from palpate.validation.states import State, Verdict

STRETCH = builtin_folder() / "stretch.toml"


def published(fault: Fault, name: str) -> Verdict:
    result = judge_case(load_case(name), candidate=with_fault(fastsim_candidate(), fault))
    (check,) = (
        c
        for c in result.checks
        if c.metric == "published_displacement" and c.against == "candidate"
    )
    return check.verdict


def expected_of(name: str, component: str) -> float:
    """The number that a case expects, told to candidate and truth alike."""
    found = {c.expected for c in load_case(name).checks if c.component == component}
    assert len(found) == 1
    (expected,) = found
    assert expected is not None
    return expected


def test_the_numbers_in_the_cases_are_the_closed_forms() -> None:
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
    cantilever = load_case("cantilever").problem
    (load,) = cantilever.loads
    assert isinstance(load, Traction)
    # P L^2 / (E I) = 1 with P = traction x 1 mm2, I = 1/12 mm4.
    alpha = -load.traction[2] * 1e-6 * 0.02**2 * 12.0 / (cantilever.material.youngs_modulus * 1e-12)
    assert alpha == pytest.approx(1.0, rel=1e-12)


def test_the_columns_number_is_the_integral_of_its_stretch() -> None:
    column = load_case("column").problem
    (load,) = column.loads
    assert isinstance(load, BodyForce)
    E, nu = column.material.youngs_modulus, column.material.poissons_ratio
    modulus = E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))
    assert load.force_density[0] / modulus == pytest.approx(0.4, rel=1e-12)
    # (lmbda + 2 mu) a (a^2 - 1) / 2 = f (1 - x), by bisection, and Gauss's rule for a - 1.
    nodes, weights = np.polynomial.legendre.leggauss(40)
    places = 0.5 + 0.5 * nodes
    low, high = np.ones_like(places), np.full_like(places, 2.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        is_above = middle * (middle**2 - 1.0) / 2.0 > 0.4 * (1.0 - places)
        low, high = np.where(is_above, low, middle), np.where(is_above, middle, high)
    assert expected_of("column", "x") == pytest.approx(0.5 * float(weights @ (low - 1.0)), rel=1e-9)


def test_szes_cantilever_is_the_published_one() -> None:
    # P = 4 at the end of 10 x 1 x 0.1, E = 1.2e6, nu = 0; beside W, U those of the elastica.
    sze = load_case("sze").problem
    (load,) = sze.loads
    assert isinstance(load, Traction)
    assert load.traction[2] * 1.0 * 0.1 == pytest.approx(4.0, rel=1e-12)
    assert np.ptp(sze.mesh.points, axis=0) == pytest.approx([10.0, 1.0, 0.1])
    assert (sze.material.youngs_modulus, sze.material.poissons_ratio) == (1.2e6, 0.0)
    numbers = [c.expected for c in load_case("sze").checks if c.expected is not None]
    assert numbers == pytest.approx([6.698, 6.6996418, -3.286, -3.2894124], rel=1e-12)


def test_the_loads_of_confined_stretch_and_shear_are_the_closed_forms() -> None:
    confined, shear = load_case("confined").problem, load_case("shear").problem
    # P = a (lmbda + 2 mu)(a^2 - 1)/2 at a = 1.1; code_aster SSNV121 has 31 096.154 MPa.
    (pull,) = confined.loads
    assert isinstance(pull, Traction)
    assert pull.traction[0] == pytest.approx(31096.154e6, rel=1e-8)
    E, nu, k = shear.material.youngs_modulus, shear.material.poissons_ratio, 0.5
    lmbda, mu = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))
    top = shear.loads[0]
    assert isinstance(top, Traction)
    # P12 = mu k + k (lmbda + 2 mu) k^2 / 2.
    assert top.traction[0] == pytest.approx(mu * k + k * (lmbda + 2 * mu) * k**2 / 2, rel=1e-14)
    # The whole field, not the corner alone: u = (k y, 0, 0) and ((a - 1) x, 0, 0).
    x, y, _ = confined.mesh.points.T
    size = 1e-11 * np.ptp(x)
    moved = solve_static(confined).displacement
    assert np.abs(moved - np.outer(0.1 * x, [1.0, 0.0, 0.0])).max() < size
    moved = solve_static(shear).displacement
    assert np.abs(moved - np.outer(0.5 * y, [1.0, 0.0, 0.0])).max() < size


@pytest.mark.parametrize("name", ["stretch", "confined", "shear", "column"])
def test_fastsim_keeps_it_and_faults_do_not(name: str) -> None:
    assert published(Fault.NONE, name) is Verdict.PASSED
    assert published(Fault.LINEAR_INSTEAD_OF_GREEN, name) is Verdict.FAILED
    assert published(Fault.SWAPPED_LAME, name) is Verdict.FAILED
    assert published(Fault.UNIT_ERROR, name) is Verdict.FAILED


@pytest.mark.parametrize("name", ["confined", "shear", "column"])
def test_under_a_given_load_a_softer_law_is_seen_without_a_reference(name: str) -> None:
    assert published(Fault.SOFTER, name) is Verdict.FAILED
    assert published(Fault.DROPPED_LOAD, name) is Verdict.FAILED


def truth_of(name: str) -> tuple[Problem, State, list[CheckSpec]]:
    case = load_case(name)
    truth = find_references(case, live=False, progress=lambda _line: None).truth(case.strain)
    assert truth is not None
    checks = [c for c in case.checks if c.metric == "published_displacement"]
    return case.problem, truth, [c for c in checks if c.against == "truth"]


@pytest.mark.parametrize(
    "name", ["confined", "shear", "csm1", "csm2", "cantilever", "sze", "column"]
)
def test_the_truth_is_judged_as_well(name: str) -> None:
    problem, truth, specs = truth_of(name)
    units = load_case(name).spec.units
    assert specs
    spoiled = dataclasses.replace(truth, displacement=1.02 * truth.displacement)
    for spec in specs:
        for state, bar, wanted in (
            (truth, 0.0, Verdict.PASSED),
            (spoiled, 0.0, Verdict.FAILED),
            # A truth that knows too little about itself allows no verdict, nor does none at all.
            (truth, math.inf, Verdict.INCONCLUSIVE),
            (None, 0.0, Verdict.INCONCLUSIVE),
        ):
            found = judge_check(spec, truth.strain, problem, None, state, bar, "", units)
            assert found.verdict is wanted, found.message


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
        judge_case(load_case(tmp_path / "stretch.toml"))
