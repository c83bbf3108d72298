"""Linear beside smoothed tetrahedra: findings go red on perturbed results; what smoothing does."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

from palpate.fastsim.body import Body, lame_parameters
from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InvertedCellError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.quality import measure_quality
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.peers import frontier
from palpate.validation.peers.registry import Peer
from palpate.validation.references.field_truth import STVK, time_fastsim
from palpate.validation.report.estimates import expected_error
from palpate.validation.states import Verdict, in_silence
from palpate.validation.studies import elements
from palpate.validation.studies.elements import (
    OURS,
    RATIOS,
    Found,
    Run,
    follow_bars,
    judge,
    make_bar,
    orders,
    present,
    quickness,
    seconds_to,
    solve_truth,
)

LINEAR, SMOOTHED = OURS[Element.LINEAR], OURS[Element.SMOOTHED]


def curve(who: str, times: list[float], errors: list[float], law: str = STVK) -> list[Run]:
    runs = zip((4, 8, 16), times, errors, strict=True)
    return [Run(0.49, who, law, n, 24 * n**3, seconds, error) for n, seconds, error in runs]


FAST = curve(SMOOTHED, [0.1, 1.0, 10.0], [0.1, 0.025, 0.00625])
SLOW = curve(LINEAR, [0.1, 1.0, 10.0], [0.8, 0.4, 0.2])
QUICK = curve(LINEAR, [0.01, 0.1, 1.0], [0.1, 0.025, 0.00625])
# Half a decade of error in a decade and a half of time: level at 1 s, quicker before it.
CROSSING = curve(LINEAR, [0.01, 1.0, 100.0], [0.1, 0.025, 0.00625])
RIVAL = curve("Rival 1", [0.01, 0.1, 1.0], [0.1, 0.025, 0.00625], "neo-Hookean")
LOCKED = [run._replace(error=0.06) if run.divisions == 8 else run for run in FAST]


def found_of(*curves: list[Run]) -> Found:
    runs = [run for runs in curves for run in runs]
    return Found(runs, {0.49: 0.001}, ["other: not here"])


def test_a_time_to_an_error_lies_between_meshes_on_a_power() -> None:
    # From 0.1 to 0.025 in one decade of time: 0.05 is half way in both logarithms.
    assert seconds_to(FAST, 0.05) == pytest.approx(math.sqrt(0.1))
    assert seconds_to(FAST, 0.5) == 0.1
    assert seconds_to(FAST, 0.001) is None
    assert orders(FAST) == [None, pytest.approx(2.0), pytest.approx(2.0)]


def test_who_is_quicker_is_found_error_by_error() -> None:
    same = curve(LINEAR, [0.4, 4.0, 40.0], [0.1, 0.025, 0.00625])
    assert list(quickness(same, FAST).values()) == pytest.approx([4.0] * 91)
    found = quickness(CROSSING, FAST)
    assert all((ratio > 1.0) == (level < 0.025) for level, ratio in found.items())
    words = judge(found_of(CROSSING, FAST))[1].found
    assert words == "0.1 to 4.6 times as quick; not quicker 10 to 2.5 %"
    # A solver that gets only so far loses from there on.
    short = curve(LINEAR, [0.4, 4.0, 5.0], [0.1, 0.025, 0.02])
    assert min(quickness(short, FAST).items())[1] == math.inf
    assert judge(found_of(short, FAST))[1].found.endswith("the other never gets to 2 to 1 %")


# The claims are, at nu = 0.49: within 5 % of the truth, then quicker than each other solver.
@pytest.mark.parametrize(
    ("curves", "verdicts"),
    [
        ((SLOW, FAST), [Verdict.PASSED, Verdict.PASSED]),
        ((SLOW, LOCKED), [Verdict.FAILED, Verdict.PASSED]),
        ((QUICK, FAST), [Verdict.PASSED, Verdict.FAILED]),
        ((CROSSING, FAST), [Verdict.PASSED, Verdict.FAILED]),
        ((SLOW, FAST, RIVAL), [Verdict.PASSED, Verdict.PASSED, Verdict.FAILED]),
        # Nobody comes to ten per cent.
        (
            ([r._replace(error=8.0 * r.error) for r in SLOW],
             [r._replace(error=8.0 * r.error, who=SMOOTHED) for r in SLOW]),
            [Verdict.FAILED, Verdict.INCONCLUSIVE],
        ),
    ],
)  # fmt: skip
def test_the_claims_go_green_and_red(curves: Any, verdicts: list[Verdict]) -> None:
    assert [finding.verdict for finding in judge(found_of(*curves))] == verdicts


def test_the_page_has_every_run() -> None:
    page = present(found_of(SLOW, FAST, RIVAL))
    svg = page.figures["bar"].svg
    for word in (LINEAR, SMOOTHED, "Rival 1, neo-Hookean", "Poisson's ratio 0.49"):
        assert word in svg
    assert page.remarks == ["Left out: other: not here"]
    assert [row[-1] for row in page.tables["bar"].texts] == [
        "-", "1.00", "1.00", "-", "2.00", "2.00", "-", "2.00", "2.00"
    ]  # fmt: skip
    # Linear ones never come to 10 %, smoothed ones at once.
    assert [row[2] for row in page.tables["times"].texts] == ["-", "0.1", "0.01"]


@pytest.mark.dolfinx
@pytest.mark.nightly
def test_tiny_bars_are_followed_and_a_perturbed_element_is_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    absent = Peer(name="none", title="none", module="no_such_module", install="soon", frontier=8)
    monkeypatch.setattr(frontier, "read_peers", lambda: (absent,))
    monkeypatch.setattr(elements, "LIMIT_DIVISIONS", 4)
    monkeypatch.setattr(elements, "LIMITS", {0.49: 0.1})

    def follow(factor: float) -> Found:
        def solve(problem: Problem, element: Element) -> tuple[float, Points]:
            seconds, u = time_fastsim(problem, element)
            return seconds, factor * u if element is Element.SMOOTHED else u

        sizes = {Element.LINEAR: (2, 4), Element.SMOOTHED: (2, 4)}
        return follow_bars(
            in_silence, ratios=(0.49,), divisions=sizes, truth_divisions=4, solve=solve
        )

    found = follow(1.0)
    assert found.left_out == [
        "none: not run here, as it is not installed: soon "
        "(PALPATE_BENCH_PYTHON names other interpreters)"
    ]
    assert min(run.error for run in found.of(0.49, LINEAR)) > 0.5
    assert 0.0 < found.truth_changes[0.49] < 0.03
    assert judge(found)[0].verdict is Verdict.PASSED
    assert judge(follow(0.8))[0].verdict is Verdict.FAILED


# ------------------------------- the rule of `palpate check` for few cells through the thickness
def test_the_rule_is_as_written() -> None:
    # Four cells at nu = 0.3: x = 1.5, k = (2 + 1.4 + 1.5) / 16, and smoothed 0.5 / 64 + 1.4 * 1.5 /
    # 29.5 / 16.
    k, smooth = 4.9 / 16, 0.5 / 64 + 1.4 * 1.5 / 29.5 / 16
    rules = [expected_error(4, 1, 0.3, element) for element in Element]
    assert rules == pytest.approx([k / (1 + k), smooth / (1 + smooth)])


@pytest.mark.dolfinx
@pytest.mark.parametrize(
    ("nu", "truth_divisions", "through"),
    [
        pytest.param(0.3, 4, (1, 2), marks=pytest.mark.once),
        *(pytest.param(nu, 8, (1, 2, 3, 4, 8), marks=pytest.mark.nightly) for nu in RATIOS),
    ],
)
def test_thin_bars_miss_what_the_rule_says(
    nu: float, truth_divisions: int, through: tuple[int, ...]
) -> None:
    # A rule to choose a mesh by. Of linear tetrahedra it is to be right but for a fifth; of
    # smoothed ones, which are soon good, it may say three times too much, and half as much again
    # too little, where one of both is above the 1 % that nobody asks for.
    truth = solve_truth(make_bar(truth_divisions, nu), in_silence)
    missed = {}
    for a, n in product((1, 2, 4), through):
        if 4 * n % a == 0:
            problem = make_bar(n, nu, slenderness=a)
            errors = [
                truth.error_of(problem.mesh, solve_static(problem, element=element).displacement)
                for element in Element
            ]
            rules = [expected_error(n, a, nu, element) for element in Element]
            assert errors[0] == pytest.approx(rules[0], rel=0.2)
            if max(errors[1], rules[1]) >= 0.01:
                assert 1.0 / 3.0 <= errors[1] / rules[1] <= 1.5
            missed[n, a] = errors
    if nu == 0.3:
        # Cells four times as long as high are worse than half as many that are not.
        assert missed[2, 4][0] > missed[1, 1][0]
        assert missed[2, 4][1] > missed[1, 1][1] > 5.0 * missed[2, 1][1]


# ------------------------------------------------------------------ what smoothing does to a mesh
SLIVER = 5.0  # degrees, the smallest dihedral angle of the distorted mesh


def distorted_bar(divisions: int, poissons_ratio: float) -> Problem:
    """Inner points moved as far as leaves a smallest dihedral angle of `SLIVER` or little more."""
    for ragged in np.arange(0.3, 0.0, -0.002):
        try:
            problem = make_bar(divisions, poissons_ratio, ragged=float(ragged))
        except InvertedCellError:
            continue
        if measure_quality(problem.mesh).smallest_dihedral_deg >= SLIVER:
            return problem
    raise AssertionError("bricks as they are have angles of 45 degrees")


def node_pressures(problem: Problem, displacement: Points) -> tuple[Floats, Floats]:
    """-lmbda theta at the nodes of smoothed tetrahedra, and averages of cells there [Pa]."""
    mesh = problem.mesh
    body = Body.of(problem, Strain.GREEN, element=Element.SMOOTHED)
    H = body.displacement_gradients(displacement).reshape(-1, 3, 3)
    trace = np.trace(H, axis1=1, axis2=2) + 0.5 * (H**2).sum(axis=(1, 2))
    corners = mesh.cells.ravel()
    weights = np.repeat(signed_volumes(mesh.points, mesh.cells), 4)

    def at_nodes(of_cells: Floats) -> Floats:
        sums = np.bincount(corners, weights * np.repeat(of_cells, 4), mesh.num_points)
        averages: Floats = sums / np.bincount(corners, weights, mesh.num_points)
        return averages

    pressure = -lame_parameters(problem.material)[0] * at_nodes(trace)
    return pressure, at_nodes(pressure[mesh.cells].mean(axis=1))


@pytest.mark.dolfinx
@pytest.mark.parametrize(
    ("divisions", "nu"),
    [
        pytest.param(4, 0.49, marks=pytest.mark.once),
        *(pytest.param(8, nu, marks=pytest.mark.nightly) for nu in RATIOS),
    ],
)
def test_slivers_cost_less_than_smoothing_gains_and_pressures_alternate(
    divisions: int, nu: float
) -> None:
    truth = solve_truth(make_bar(divisions, nu), in_silence)
    regular, distorted = make_bar(divisions, nu), distorted_bar(divisions, nu)
    assert distorted.mesh.volume == pytest.approx(regular.mesh.volume, rel=1e-12)
    assert SLIVER <= measure_quality(distorted.mesh).smallest_dihedral_deg < SLIVER + 1.0

    def error(problem: Problem, element: Element) -> float:
        return truth.error_of(problem.mesh, solve_static(problem, element=element).displacement)

    assert error(distorted, Element.SMOOTHED) < error(regular, Element.LINEAR)
    if nu >= 0.49:  # the checkerboard of which the documentation warns
        smoothed = solve_static(regular, element=Element.SMOOTHED).displacement
        pressure, averages = node_pressures(regular, smoothed)
        assert np.linalg.norm(pressure - averages) > 0.1 * np.linalg.norm(averages)


# ---------------------------------------------- is any of the lowest frequencies one too many?
NUM_MODES, NUM_RIGID = 20, 6
# Squares of frequencies of rigid motions, over the largest of the mesh.
ROUNDING = 1e-12


def squared_frequencies(problem: Problem, element: Element, free: Any) -> Floats:
    """fastsim's stiffness at rest with the consistent mass of linear tetrahedra [1/s2]."""
    mesh = problem.mesh
    body = Body.of(problem, Strain.LINEAR, element=element)
    units = np.eye(3 * mesh.num_points)
    K = np.column_stack([body.internal_force(unit.reshape(-1, 3)).ravel() for unit in units])
    assert np.linalg.norm(K - K.T) <= 2.0 * ROUNDING * np.linalg.norm(K)
    mass = np.zeros((mesh.num_points, mesh.num_points))
    volumes = problem.material.density * signed_volumes(mesh.points, mesh.cells)
    for a in range(4):
        for b in range(4):
            part = volumes / (10.0 if a == b else 20.0)
            np.add.at(mass, (mesh.cells[:, a], mesh.cells[:, b]), part)
    M = np.kron(mass, np.eye(3))
    chosen = np.ix_(free, free)
    squares: Floats = eigh(0.5 * (K + K.T)[chosen], M[chosen], eigvals_only=True)
    return squares


def true_frequencies(problem: Problem, is_free: bool) -> Floats:
    """Quadratic tetrahedra with consistent mass, rigid motions left out [1/s]."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.linalg import eigsh

    from palpate.reference import fenicsx
    from palpate.reference.discrete_problem import DiscreteProblem

    body = DiscreteProblem(problem, strain=Strain.LINEAR, degree=2)
    ufl = fenicsx.ufl
    dx = ufl.dx(domain=body.space.transferred.mesh, metadata={"quadrature_degree": 4})
    trial = ufl.TrialFunction(body.space.space)
    form = fenicsx.form(problem.material.density * ufl.inner(trial, body.v) * dx)
    mass = fenicsx.create_matrix(form)
    fenicsx.assemble_into_matrix(mass, form)
    free = np.arange(body.num_dofs) if is_free else body.free

    def sparse(matrix: Any) -> Any:
        starts, columns, values = matrix.getValuesCSR()
        return csr_matrix((values, columns, starts), shape=matrix.getSize())[free][:, free].tocsc()

    stiffness = sparse(body.tangent(np.zeros(body.num_dofs), 0.0))
    skipped = NUM_RIGID if is_free else 0
    # A little below zero, where the matrix of a free body is regular: squares of 1 rad/s.
    squares = eigsh(
        stiffness, NUM_MODES + skipped, sparse(mass), sigma=-1.0, return_eigenvectors=False
    )
    found: Floats = np.sqrt(np.abs(np.sort(squares)[skipped:]))
    return found


@pytest.mark.dolfinx
@pytest.mark.parametrize("is_free", [True, False])
@pytest.mark.parametrize(
    ("divisions", "nu", "count", "within"),
    [
        pytest.param(2, 0.3, 6, 0.1, marks=pytest.mark.once),
        *(pytest.param(4, nu, NUM_MODES, 0.05, marks=pytest.mark.nightly) for nu in (0.3, 0.49)),
    ],
)
def test_smoothed_tetrahedra_have_no_spurious_mode(
    divisions: int, nu: float, count: int, within: float, is_free: bool
) -> None:
    problem = make_bar(divisions, nu, ragged=0.1)
    fixed = [] if is_free else problem.supports[0].points
    free = np.setdiff1d(np.arange(problem.mesh.num_points), fixed)
    unknowns = (3 * free[:, None] + np.arange(3)).ravel()
    found = {}
    for element in Element:
        squares = squared_frequencies(problem, element, unknowns)
        num_zero = int((np.abs(squares) <= ROUNDING * squares[-1]).sum())
        assert num_zero == (NUM_RIGID if is_free else 0)
        found[element] = np.sqrt(squares[num_zero : num_zero + NUM_MODES])
    true = true_frequencies(problem, is_free)
    # A frequency that is not there would move all above it down by a place.
    np.testing.assert_allclose(found[Element.SMOOTHED][:count], true[:count], rtol=within)
    if divisions == 2:  # two cells across: bending of linear tetrahedra is a third too stiff
        assert found[Element.LINEAR][0] > 1.2 * true[0]
