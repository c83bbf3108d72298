"""Linear solvers, what they leave in memory, and meshes on their way to dolfinx."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bank import fixed, support

from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference import fenicsx, linear_solver
    from palpate.reference import multigrid as multigrid_of
    from palpate.reference.discrete_problem import DiscreteProblem
    from palpate.reference.fenicsx import fem, ufl
    from palpate.reference.linear_solver import (
        LaggedFactors,
        LinearSolveError,
        LinearSolver,
        PreconditionerError,
    )
    from palpate.reference.mesh_transfer import create_space, transfer
    from palpate.reference.statics import find_equilibrium, solve_static

pytestmark = pytest.mark.dolfinx

E = 1e4


def equilibrium(box, degree=1, supports=None, divisions=(4, 2, 2)):
    mesh = box(divisions, jitter=0.2)
    problem = Problem(mesh, Material(E, 0.3), supports or (support(mesh, "x0"),), ())
    return DiscreteProblem(problem, strain=Strain.GREEN, degree=degree)


def crushed(eq):
    """Squeezed to 0.45 of its length: past the peak at 0.577, the tangent is indefinite."""
    return (-0.55 * eq.space.coordinates * [1.0, 0.0, 0.0]).ravel()


def solver(eq, monkeypatch, largest_direct):
    monkeypatch.setattr(linear_solver, "LARGEST_DIRECT", largest_direct)
    return LinearSolver(eq.space, is_symmetric=True, frames=eq.frames)


def solution(eq, linear, u, rhs):
    return linear.solve(
        eq.tangent(u, 1.0), rhs, eq.fixed.dofs, np.zeros(len(eq.fixed.dofs)), tolerance=1e-12
    )


def wedge(mesh):
    """One side fixed, another that slides along a slanted plane."""
    other = support(mesh, "x1")
    slanted = Support(other.points, other.facets, normal=(0.6, 0.8, 0.0))
    return support(mesh, "x0"), slanted


@pytest.mark.parametrize("levels", ["aggregated", "factored"])
@pytest.mark.parametrize(("degree", "is_slanted"), [(1, False), (2, False), (2, True), (3, False)])
def test_multigrid_and_factors_agree(box, monkeypatch, degree, is_slanted, levels):
    monkeypatch.setattr(multigrid_of, "LARGEST_FACTORED", 0 if levels == "aggregated" else 10**6)
    mesh = box((4, 2, 2), jitter=0.2)
    eq = equilibrium(box, degree, wedge(mesh) if is_slanted else None)
    rest = np.zeros(eq.num_dofs)
    rhs = np.random.default_rng(1).standard_normal(eq.num_dofs)
    direct = solver(eq, monkeypatch, 10**6)
    multigrid = solver(eq, monkeypatch, 0)
    assert "MUMPS" in direct.name
    assert ("GAMG" if degree == 1 else f"degree {degree} to 1") in multigrid.name
    one, other = (solution(eq, linear, rest, rhs) for linear in (direct, multigrid))
    assert np.linalg.norm(one - other) < 1e-9 * np.linalg.norm(one)
    for linear in (direct, multigrid):
        assert linear.is_positive_definite(eq.tangent(rest, 1.0), eq.fixed.dofs)
        if is_slanted:  # `crushed` is of axes x, y, z
            continue
        assert not linear.is_positive_definite(eq.tangent(crushed(eq), 1.0), eq.fixed.dofs)


def test_stability_is_tested_by_the_multigrid_of_the_last_solve(box, monkeypatch):
    eq = equilibrium(box, 2)
    rest = np.zeros(eq.num_dofs)
    multigrid = solver(eq, monkeypatch, 0)
    solution(eq, multigrid, rest, np.ones(eq.num_dofs))

    def refuse(_matrix, _fixed):
        raise AssertionError("a second multigrid")

    monkeypatch.setattr(multigrid, "_prepare", refuse)
    assert multigrid.is_positive_definite(eq.tangent(rest, 1.0), eq.fixed.dofs)
    assert not multigrid.is_positive_definite(eq.tangent(crushed(eq), 1.0), eq.fixed.dofs)


def test_the_linear_level_takes_what_is_smooth(box, monkeypatch):
    """The iterations do not grow with the mesh; without the level below they would double."""
    counts = []
    for divisions in ((6, 3, 3), (12, 6, 6)):
        eq = equilibrium(box, 2, divisions=divisions)
        multigrid = solver(eq, monkeypatch, 0)
        rhs = np.random.default_rng(1).standard_normal(eq.num_dofs)
        solution(eq, multigrid, np.zeros(eq.num_dofs), rhs)
        counts.append(multigrid._ksp.getIterationNumber())
    # A bound of Chebyshev's smoother of degree 2 with an exact level below: 20 to 30 for 1e-12.
    assert max(counts) <= 40, counts
    assert counts[1] <= 1.25 * counts[0], counts


def test_a_failing_preconditioner_is_no_verdict_on_the_matrix(box, monkeypatch):
    """Seen with contact: smoothing that overshoots made a good tangent look indefinite."""
    eq = equilibrium(box)
    rest = np.zeros(eq.num_dofs)
    rhs = np.random.default_rng(1).standard_normal(eq.num_dofs)
    expected = solution(eq, solver(eq, monkeypatch, 10**6), rest, rhs)
    multigrid = solver(eq, monkeypatch, 0)

    def fail(_b, _x):
        raise PreconditionerError

    monkeypatch.setattr(multigrid, "_run", fail)
    found = solution(eq, multigrid, rest, rhs)
    assert np.linalg.norm(found - expected) < 1e-10 * np.linalg.norm(expected)
    assert multigrid.is_positive_definite(eq.tangent(rest, 1.0), eq.fixed.dofs)
    assert not multigrid.is_positive_definite(eq.tangent(crushed(eq), 1.0), eq.fixed.dofs)
    monkeypatch.setattr(linear_solver, "LARGEST_FALLBACK", 0)
    too_large = solver(eq, monkeypatch, 0)
    monkeypatch.setattr(too_large, "_run", fail)
    with pytest.raises(LinearSolveError, match="preconditioner"):
        solution(eq, too_large, rest, rhs)


def test_earlier_factors_serve_until_they_do_not(box, monkeypatch):
    eq = equilibrium(box)
    rest = np.zeros(eq.num_dofs)
    rhs = np.random.default_rng(1).standard_normal(eq.num_dofs)
    direct, lagged = solver(eq, monkeypatch, 10**6), LaggedFactors(is_symmetric=True)
    # At rest, nearly so, and where it is indefinite: there nothing but factors of its own solve.
    for u in (rest, 0.01 * crushed(eq), crushed(eq)):
        one, other = (solution(eq, linear, u, rhs) for linear in (direct, lagged))
        assert np.linalg.norm(one - other) < 1e-3 * np.linalg.norm(one)
    # 1e-4 is asked of the factors of another matrix, rounding is left by its own.
    assert np.linalg.norm(one - other) < 1e-9 * np.linalg.norm(one)


STATUS = Path("/proc/self/status")
# Matrix and factors of 8 000 quadratic unknowns take about 40 MB.
NUM_BODIES, ONE_BODY = 4, 40.0


def resident() -> float:
    """Memory of this process [MB]."""
    (line,) = (row for row in STATUS.read_text("utf-8").splitlines() if row.startswith("VmRSS"))
    return float(line.split()[1]) / 1024.0


def beam() -> Problem:
    mesh = brick_box((10, 5, 5), (2.0, 1.0, 1.0), ragged=0.2)
    facets = mesh.boundary_facets
    held = facets[(mesh.points[facets][:, :, 0] < 1e-9).all(axis=1)]
    support = fixed(held)
    return Problem(mesh, Material(1e4, 0.3, 1000.0), (support,), (BodyForce((0.0, 0.0, -9.8)),))


def solve(problem: Problem, *, is_dropped: bool) -> None:
    if is_dropped:  # matrices and factors that nobody destroys by hand
        find_equilibrium(problem, strain=Strain.LINEAR, degree=2)
    else:
        solve_static(problem, strain=Strain.LINEAR, degree=2)


@pytest.mark.skipif(not STATUS.is_file(), reason="/proc tells a process its memory on Linux only")
@pytest.mark.parametrize("is_dropped", [False, True])
def test_body_after_body_takes_no_more_memory(is_dropped: bool) -> None:
    problem = beam()
    for _ in range(2):
        solve(problem, is_dropped=is_dropped)
    before = resident()
    for _ in range(NUM_BODIES):
        solve(problem, is_dropped=is_dropped)
    assert resident() - before < 0.5 * NUM_BODIES * ONE_BODY


@pytest.fixture
def shuffled(box):
    """A ragged box in a random numbering, so that dolfinx has something to reorder."""
    mesh = box((4, 3, 2), (1.0, 0.7, 0.4), jitter=0.2)
    random = np.random.default_rng(11)
    new = random.permutation(mesh.num_points)
    points = np.empty_like(mesh.points)
    points[new] = mesh.points
    cells = new[mesh.cells][random.permutation(mesh.num_cells)]
    groups = {name: new[rows] for name, rows in mesh.facet_groups.items()}
    return TetMesh(points, cells, groups)


def test_nodes_and_cells_arrive_with_their_maps(shuffled):
    arrived = transfer(shuffled)
    nodes = arrived.mesh.geometry.x
    assert np.array_equal(nodes, shuffled.points[arrived.point_of_node])
    assert not np.array_equal(arrived.point_of_node, np.arange(shuffled.num_points))
    received = arrived.point_of_node[fenicsx.cell_nodes(arrived.mesh)]
    sent = shuffled.cells[arrived.cell_of_cell]
    assert np.array_equal(np.sort(received, axis=1), np.sort(sent, axis=1))


def test_what_was_compiled_for_one_mesh_serves_the_next(box, tmp_path, monkeypatch):
    """Also where the first form of the next one is found compiled: FFCx changes meshes."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    counts = []
    for _ in range(2):
        mesh = transfer(box((1, 1, 1))).mesh
        for degree in (1, 2):
            dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": degree})
            fenicsx.form(fem.Constant(mesh, 1.0) * dx)
        counts.append(len(list(tmp_path.rglob("*.c"))))
    assert counts[0] == counts[1] > 1


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_dofs_of_points_sit_at_the_points(shuffled, degree):
    space = create_space(transfer(shuffled), degree)
    coordinates = space.space.tabulate_dof_coordinates()[space.dof_of_point]
    assert np.abs(coordinates - shuffled.points).max() <= 4 * np.finfo(float).eps
    there = space.at_points(space.from_points(shuffled.points))
    assert np.array_equal(there, shuffled.points) or degree > 1
    assert np.abs(there - shuffled.points).max() <= 10 * np.finfo(float).eps


def test_facets_are_found_by_their_points(shuffled):
    arrived = transfer(shuffled)
    for name, (axis, value) in {"x1": (0, 1.0), "z0": (2, 0.0)}.items():
        measure = arrived.facet_measure(shuffled.facet_groups[name], name, degree=2)
        area = fenicsx.assemble_scalar(fenicsx.form(fem.Constant(arrived.mesh, 1.0) * measure))
        assert area == pytest.approx({"x1": 0.28, "z0": 0.7}[name], rel=1e-14)
        x = ufl.SpatialCoordinate(arrived.mesh)
        off = fenicsx.assemble_scalar(fenicsx.form((x[axis] - value) ** 2 * measure))
        assert abs(off) <= np.finfo(float).eps
