"""The study of calibration: known answers that are right, a fixed split, findings that go red."""

from __future__ import annotations

import dataclasses
import math
import re
import tarfile
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from calibration_recipe.bars import column_problem, motion_problem
from calibration_recipe.drawn import TABLE, draw_problems, write_store
from calibration_recipe.layers import layer_problem
from calibration_recipe.plane import Plane, PlaneLoads, Section
from calibration_recipe.shapes import confined_modulus
from calibration_recipe.smooth import smooth_problem
from scipy.optimize import brentq

from palpate.meshes.errors import FileFormatError
from palpate.meshes.field_norms import l2_norm
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Strain
from palpate.meshes.problem_files import problem_arrays
from palpate.validation.states import Verdict, in_silence
from palpate.validation.studies import STUDIES, calibration
from palpate.validation.studies.calibration import (
    LOG,
    STORE,
    STORED,
    WAYS,
    Found,
    Known,
    Number,
    compare,
    compare_all,
    judge,
    known_problems,
    present,
    summarise,
)

# One of each family, of the open half, for every change; the nightly script runs all.
QUICK = ("smooth-12", "layer-02", "column-05", "clamped-02", "slender-06", "motion-08",
         "stress-06")  # fmt: skip


def require_same(one: Known, other: Known, rtol: float) -> None:
    assert (one.name, one.family, one.is_apart, one.strain) == (
        other.name, other.family, other.is_apart, other.strain
    )  # fmt: skip
    assert one.given == other.given
    assert (one.surface, list(one.radii)) == (other.surface, list(other.radii))
    ours, theirs = (problem_arrays(known.problem) for known in (one, other))
    assert ours.keys() == theirs.keys()
    for key, values in ours.items():
        if values.dtype.kind == "f":
            np.testing.assert_allclose(values, theirs[key], rtol=1e-12, atol=1e-13)
        elif key != "header":
            np.testing.assert_array_equal(values, theirs[key])
    if one.solution is None or other.solution is None:
        assert one.solution is other.solution
        return
    size = one.solution.max_displacement
    u, v = one.solution.displacement, other.solution.displacement
    np.testing.assert_allclose(u, v, rtol=0.0, atol=rtol * size)
    assert one.solution.volume == pytest.approx(other.solution.volume, rel=rtol)
    assert one.solution.surface_area == pytest.approx(other.solution.surface_area, rel=rtol)
    if one.solution.integrals is not None:
        assert other.solution.integrals is not None
        np.testing.assert_allclose(
            one.solution.integrals.cauchy, other.solution.integrals.cauchy, rtol=1e-6, atol=1e-9
        )
    assert one.doubts == pytest.approx(other.doubts, rel=0.1, abs=1e-7)


@pytest.mark.parametrize("names", [
    pytest.param(("smooth-12", "layer-02", "column-05", "slender-06", "inflated-03", "twisted-01",
                  "stress-06", "ring-02", "impact-01", "pressed-02"), id="quick"),
    pytest.param((), id="all", marks=pytest.mark.nightly),
])  # fmt: skip
def test_the_store_is_what_the_recipe_makes(names, tmp_path) -> None:
    drawn = [one for one in draw_problems() if not names or one.name in names]
    write_store(tmp_path / "made.tar.xz", drawn)
    stored = {known.name: known for known in known_problems()}
    assert list(stored) == [one.name for one in draw_problems()]
    for made in known_problems(tmp_path / "made.tar.xz"):
        require_same(made, stored[made.name], 1e-6)


@pytest.mark.parametrize("name", ["index.json", "layer-02.answer.npz", "sha256", None])
def test_a_store_that_has_changed_is_refused(tmp_path, name) -> None:
    with tarfile.open(STORE) as tar:
        tar.extraction_filter = lambda member, _: member  # palpate's own file
        tar.extractall(tmp_path / "in")
    file = tmp_path / "in" / (name or "more.npz")
    data = bytearray(file.read_bytes() if name else b"more")
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    with tarfile.open(tmp_path / "altered.tar.xz", "w:xz") as tar:
        for each in sorted(file.parent.iterdir()):
            tar.add(each, each.name)
    with pytest.raises(FileFormatError, match="it has not its hash"):
        known_problems(tmp_path / "altered.tar.xz")


def test_documentation_counts_what_the_store_has() -> None:
    """One number is stated, in one place; the help of `palpate study` states none."""
    page = Path(__file__).parents[3] / "validation" / "documentation" / "meshing.md"
    stated = re.findall(r"against (\d+) known solutions", page.read_text("utf-8"))
    assert stated == [str(len(known_problems()))]
    assert not re.search(r"\d", STUDIES["calibration"])


def test_half_of_every_family_is_set_apart_by_its_names() -> None:
    problems = draw_problems()
    assert len(problems) >= 60
    for family in {p.family for p in problems}:
        of = [p for p in problems if p.family == family]
        assert abs(2 * sum(p.is_apart for p in of) - len(of)) <= 1
        assert len({tuple(p.given.items()) for p in of}) == len(of)


def test_another_generation_leaves_the_open_half_and_draws_the_rest_anew() -> None:
    table = tomllib.loads(TABLE.read_text("utf-8"))
    for family in table["family"]:
        family.pop("generation", None)
    first, second = (
        draw_problems(table | {"generation": 1}),
        draw_problems(table | {"generation": 2}),
    )
    for old, new in zip(first, second, strict=True):
        assert (old.name == new.name) == (not old.is_apart) == (not new.is_apart)
        assert old.is_apart or old.given == new.given
    assert any(a.given != b.given for a, b in zip(first, second, strict=True))


def test_the_log_is_of_generations_that_were() -> None:
    runs = tomllib.loads(LOG.read_text("utf-8")).get("run", [])
    table = tomllib.loads(TABLE.read_text("utf-8"))
    generation = max([table["generation"], *(f.get("generation", 1) for f in table["family"])])
    assert all(1 <= run["generation"] <= generation and run["truth"] in WAYS for run in runs)


def residual(exact, positions, lmbda, mu, step):
    """Navier's operator by central differences, and its largest term."""
    e = np.eye(3) * step
    second = np.zeros((len(positions), 3, 3, 3))
    for j in range(3):
        for k in range(3):
            corners = [
                a * b * exact(positions + a * e[j] + b * e[k]) for a in (1, -1) for b in (1, -1)
            ]
            second[:, :, j, k] = sum(corners) / (4.0 * step**2)
    parts = (lmbda + mu) * np.einsum("njji->ni", second), mu * np.einsum("nikk->ni", second)
    return parts[0] + parts[1], max(np.abs(part).max() for part in parts)


@pytest.mark.parametrize("load", ["press", "rub", "swell"])
@pytest.mark.parametrize("bottom", ["bonded", "smooth"])
def test_a_layer_is_in_equilibrium_and_carries_its_load(load: str, bottom: str) -> None:
    nu, height = 0.45, 0.5
    problem, strain, answer = layer_problem(
        nu=nu, height=height, load=load, bottom=bottom, width=0.25
    )
    assert strain is Strain.LINEAR
    exact = answer.field
    mu = 0.5 / (1.0 + nu)
    lmbda = confined_modulus(problem.material) - 2.0 * mu
    inside = np.array([[0.3, 0.1, 0.2], [0.62, 0.1, 0.3], [0.9, 0.1, 0.12]])
    left, largest = residual(exact, inside, lmbda, mu, 2e-3)
    assert np.abs(left).max() < 2e-3 * largest
    under = np.array([[0.2, 0.1, 0.0], [0.7, 0.1, 0.0]])
    fixed = np.abs(exact(under))[:, slice(None) if bottom == "bonded" else 2]
    assert fixed.max() < 1e-12
    # The stress just below the top, away from where the load begins.
    step = 1e-3
    top = np.array(
        [[0.2, 0.1, height - 0.01], [0.35, 0.1, height - 0.01], [0.8, 0.1, height - 0.01]]
    )
    H = np.stack(
        [(exact(top + d) - exact(top - d)) / (2 * step) for d in np.eye(3) * step], axis=-1
    )
    stress = mu * (H + H.transpose(0, 2, 1)) + lmbda * np.einsum("nii->n", H)[
        :, None, None
    ] * np.eye(3)
    (push,) = problem.loads
    wanted = push.at(np.column_stack([top[:, :2], np.full(3, height)])).copy()
    if load != "swell":
        wanted[2] = 0.0
    assert np.abs(stress[:, :, 2] - wanted).max() < 0.08 * np.abs(wanted).max()


def test_a_column_bears_what_hangs_below() -> None:
    problem, _, answer = column_problem(nu=0.3, weight=-0.5, end=-0.3, stiffer=3.0, bricks=4)
    M = confined_modulus(problem.material)
    own, push = problem.loads
    weight, end = own.force_density[0] / M, push.traction[0] / M
    # mu a^2 + M (a^2 - 1) / 2 = 0 at a^2 = 0.5 / (0.5 + mu / M), mu / M = 2 / 7.
    bears = math.sqrt(7.0 / 11.0) * (4.0 / 11.0) / 2.0
    assert (weight, end) == pytest.approx((-0.5 * bears, -0.3 * bears))
    x = np.array([0.1, 0.45, 0.55, 0.9])
    step = np.array([1e-5, 0.0, 0.0])
    positions = np.column_stack([x, 0 * x, 0 * x])
    slope = (answer.field(positions + step) - answer.field(positions - step))[:, 0] / 2e-5
    a = 1.0 + slope
    factor = np.where(x > 0.5, 3.0, 1.0)
    np.testing.assert_allclose(
        factor * a * (a**2 - 1.0) / 2.0, end + weight * (1.0 - x), rtol=1e-8, atol=0.0
    )


def test_a_bar_that_is_pulled_slowly_at_the_end_swings_about_its_rest() -> None:
    # After the load has been switched on, linear, without damping: the mean over whole periods of
    # the first mode, 4 s, is the equilibrium size * x; higher modes have periods 4 / (2 n + 1) s.
    _, _, answer = motion_problem(
        kind="shear", strain="linear", nu=0.3, drive="end", size=0.02, damping=0.0
    )
    motion = answer.state.trajectory
    assert motion is not None
    last = motion.times > motion.times[-1] - 4.0 + 1e-9
    mean = motion.displacements[last].mean(axis=0)
    np.testing.assert_allclose(mean[:, 1].max(), 0.02, rtol=2e-3, atol=0.0)


def williams(angle: float, nu: float, guess: float):
    """The first singular field of a wedge, clamped at theta = 0 and free at `angle`.

    2 mu (u_r + i u_t) from the Airy function r^(l + 1) f(theta) (M. L. Williams, J. Appl. Mech. 19,
    1952), f of sines and cosines of (l + 1) theta and (l - 1) theta.

    Returns:
        The exponent l, and the displacement (..., 2) at places (..., 2), mu = 1.
    """
    kappa = 3.0 - 4.0 * nu

    def rows(power, t):
        p, m = power + 1.0, power - 1.0
        s, c = np.sin, np.cos
        f = np.array([c(p * t), s(p * t), c(m * t), s(m * t)])
        d = np.array([-p * s(p * t), p * c(p * t), -m * s(m * t), m * c(m * t)])
        g = kappa + 1.0
        u_r = 0.5 * (-p * f + g * np.array([0 * t, 0 * t, c(m * t), s(m * t)]))
        u_t = 0.5 * (-d + g * np.array([0 * t, 0 * t, s(m * t), -c(m * t)]))
        return f, d, u_r, u_t

    def system(power):
        f, d, _, _ = rows(power, angle)
        _, _, u_r, u_t = rows(power, 0.0)
        return np.array([u_r, u_t, f, d])

    def squared(power):
        wave = np.sin(power * angle) ** 2
        return wave - ((kappa + 1.0) ** 2 - 4.0 * (power * np.sin(angle)) ** 2) / (4.0 * kappa)

    power = brentq(squared, guess - 0.1, guess + 0.1, xtol=1e-15)
    _, values, right = np.linalg.svd(system(power))
    assert values[-1] < 1e-10 * values[0]

    def exact(positions):
        r, t = np.hypot(*positions.T).T, np.arctan2(positions[..., 1], positions[..., 0])
        _, _, u_r, u_t = (np.einsum("k,k...->...", right[-1], part) for part in rows(power, t))
        scale = r**power
        c, s = np.cos(t), np.sin(t)
        return np.stack([scale * (c * u_r - s * u_t), scale * (s * u_r + c * u_t)], axis=-1)

    return power, exact


@pytest.mark.parametrize(
    ("lean", "nu"), [(0.0, 0.3), pytest.param(0.4, 0.499, marks=pytest.mark.nightly)]
)
@pytest.mark.long
def test_two_dimensions_find_the_singular_field_of_a_clamped_edge(lean: float, nu: float) -> None:
    # Clamped below, free at the left: displacement given at the right and on top.
    angle = 0.5 * np.pi - np.arctan(lean)
    power, exact = williams(angle, nu, 0.7)
    lines = np.array([0.0, 1.0])
    section = Section(lines, lines, np.ones((1, 1), dtype=bool),
                      lambda grid: grid + lean * grid[..., 1:] * [1.0, 0.0])  # fmt: skip
    fixed = dict.fromkeys(("far", "top"), lambda X, s: s * exact(X))
    loads = PlaneLoads({"under": lambda X, s: 0.0 * s * X, **fixed})
    off = []
    for degree, layers in ((4, 3), (8, 7)):
        plane = Plane(section, Material(2.0 * (1.0 + nu), nu, 1.0), Strain.LINEAR, loads,
                      degree=degree, layers=layers)  # fmt: skip
        u, right = plane.solve(), exact(plane.positions)
        off.append(np.abs(u - right).max() / np.abs(right).max())
    assert 0.5 < power < 1.0
    assert off[1] < 2e-5
    assert off[1] < 0.05 * off[0]


@pytest.mark.parametrize("law", [Law.SAINT_VENANT_KIRCHHOFF, Law.NEO_HOOKEAN_STABLE])
def test_tangents_in_two_dimensions_are_the_slope_of_the_forces(law: Law) -> None:
    section = Section(np.array([0.0, 1.0]), np.array([0.0, 0.7]), np.ones((1, 1), dtype=bool),
                      lambda grid: grid + 0.3 * grid[..., 1:] * [1.0, 0.0])  # fmt: skip
    loads = PlaneLoads({}, pressures={"top": 0.2, "far": 0.1})
    plane = Plane(section, Material(1.0, 0.4, 1.0, law), Strain.GREEN, loads, degree=3, layers=1)
    rng = np.random.default_rng(0)
    u, along = (0.1 * rng.standard_normal(plane.positions.shape) for _ in range(2))
    K, _ = plane.tangents(u, 1.0)
    h = 1e-6
    rise = (plane.tangents(u + h * along, 1.0)[1] - plane.tangents(u - h * along, 1.0)[1]) / (
        2.0 * h
    )
    wanted = -np.einsum("eij,ej->ei", K, along[plane.elements].reshape(len(K), -1))
    np.testing.assert_allclose(rise, wanted, rtol=0.0, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.dolfinx
@pytest.mark.parametrize("nu", [0.3, 0.499])
def test_cubic_tetrahedra_hold_a_smooth_answer(nu: float) -> None:
    from palpate.reference.statics import solve_static

    problem, strain, answer = smooth_problem(shape="box", nu=nu, seed=1)
    found = solve_static(problem, strain=strain, degree=3)
    size = answer.state.max_displacement
    np.testing.assert_allclose(
        found.displacement, answer.state.displacement, rtol=0.0, atol=1e-9 * size
    )
    assert found.volume == pytest.approx(answer.state.volume, rel=1e-8)
    assert found.surface_area == pytest.approx(answer.state.surface_area, rel=1e-8)


def number(bar: float, error: float, *, way: str = STORED, doubt: float = 0.0) -> Number:
    return Number("layer-01", "layer", True, way, "volume", bar, error, doubt)


def test_numbers_are_counted_as_they_should() -> None:
    of = [number(1.0, 0.5), number(1.0, 2.0), number(math.inf, 0.1), number(1.0, 0.3, doubt=0.2)]
    s = summarise(of)
    assert (s.numbers, s.infinite, s.unknown) == (2, 1, 1)
    assert s.covered == pytest.approx(0.5)
    assert s.worst == pytest.approx(2.0)
    # An answer that is known poorly hides no miss.
    assert summarise([number(0.1, 0.5, doubt=0.1)]).worst == pytest.approx(4.0)


@pytest.mark.parametrize(("error", "claim"), [(1.2, 0), (1.8, 1), (0.1, 2)])
def test_each_claim_goes_red(error: float, claim: int) -> None:
    good = [number(1.0, 0.5, way=way) for way in WAYS]
    assert all(f.verdict is Verdict.PASSED for f in judge(Found((*good,), ())))
    found = Found(tuple(number(1.0, error, way=way) for way in WAYS), ())
    assert judge(found)[claim].verdict is Verdict.FAILED
    page = present(found)
    assert len(page.tables["numbers"].rows) == 2


def test_what_is_nearly_the_same_on_the_spot_is_solved_once(monkeypatch) -> None:
    made: list[tuple[str, str]] = []

    def note(known, way, _progress):
        made.append((known.family, way))
        return []

    monkeypatch.setattr(calibration, "compare", note)
    problems = known_problems()
    assert compare_all(problems, in_silence) == []
    assert {f for f, way in made if way == STORED} == {p.family for p in problems}
    assert {p.family for p in problems} - {f for f, way in made if way != STORED} == set(
        calibration.STORED_ALONE
    )


@pytest.mark.dolfinx
@pytest.mark.dolfinx
@pytest.mark.nightly
@pytest.mark.timeout(3600)
def test_bars_of_three_meshes_near_to_each_other_hold() -> None:
    """As the live page has them (`error_bar_of_few`), begun at linear tetrahedra on every body."""
    from palpate.reference.adaptivity.adaptive import solve_adaptively
    from palpate.reference.adaptivity.error_bars import error_bar_of_few
    from palpate.reference.adaptivity.goals import Budget, Goal, JudgedSolution, Quantity
    from palpate.reference.result import formulation_for
    from palpate.reference.statics import solve_static

    goals = [Goal(Quantity.DISPLACEMENT_L2, 1e-9)]
    bars, errors = [], []
    for known in known_problems():
        problem, solution = known.problem, known.solution
        if solution is None or problem.time is not None or known.surface:
            continue
        start = solve_static(problem, strain=known.strain, degree=1).displacement
        nothing = np.zeros((len(problem.tools), 3))
        options: dict[str, Any] = {
            "strain": known.strain, "formulation": formulation_for(problem, 2), "start": start,
            "judged": (JudgedSolution(start, nothing, {}),), "relative_tolerance": 1e-6,
        }  # fmt: skip
        first = solve_adaptively(problem, goals, budget=Budget(unknowns=1.0), **options)
        budget = Budget(unknowns=2.5 * float(first.num_unknowns[0]))
        found = solve_adaptively(problem, goals, budget=budget, **options)
        if len(found.num_cells) != 3:
            continue
        differences, estimates = found.differences[1:, 0].tolist(), found.estimates[:, 0].tolist()
        bars.append(error_bar_of_few(found.bar("displacement_l2"), differences, estimates))
        apart = l2_norm(problem.mesh, solution.displacement - found.displacement)
        errors.append(apart / l2_norm(problem.mesh, found.displacement))
    # Displacements that are prescribed everywhere are exact.
    off = np.array(errors) > 1e-7
    misses = np.array(errors)[off] / np.array(bars)[off]
    assert off.sum() > 50
    assert (misses <= 1.0).all()
    assert np.isfinite(np.array(bars)[off]).mean() > 0.75


@pytest.mark.nightly
def test_some_problems_keep_their_word() -> None:
    chosen = [p for p in known_problems() if p.name in QUICK]
    assert len(chosen) == len(QUICK)
    assert not any(p.is_apart for p in chosen)
    found = compare_all(chosen, in_silence, ways=(STORED,))
    assert {n.problem for n in found} == set(QUICK)
    s = summarise(found)
    assert s.numbers >= 20
    assert s.covered >= 0.95
    assert s.worst <= 1.5


@pytest.mark.dolfinx
def test_a_truth_of_another_material_is_not_covered() -> None:
    (one,) = (p for p in known_problems() if p.name == "layer-02")
    softer = layer_problem(**{**one.given, "nu": 0.45})[2]
    wrong = dataclasses.replace(one, solution=softer.state, doubts=softer.doubts)
    assert summarise(compare(wrong, STORED, in_silence)).worst > 1.5
