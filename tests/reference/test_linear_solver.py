"""One tangent system: direct, by multigrid, and what happens where multigrid is none."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Support
from palpate.meshes.problem import Material, Problem, Strain
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference import linear_solver
    from palpate.reference.discrete_problem import DiscreteProblem
    from palpate.reference.linear_solver import (
        LaggedFactors,
        LinearSolveError,
        LinearSolver,
        PreconditionerError,
    )

pytestmark = pytest.mark.dolfinx
E = 1e4


def equilibrium(box):
    mesh = box((4, 2, 2), jitter=0.2)
    held = mesh.facet_groups["x0"]
    problem = Problem(
        mesh, Material(E, 0.3), (Support(np.unique(held).astype(np.int32), held),), ()
    )
    return DiscreteProblem(problem, strain=Strain.GREEN, degree=1)


def crushed(eq):
    """Squeezed to 0.45 of its length: past the peak at 0.577, the tangent is indefinite."""
    return (-0.55 * eq.space.coordinates * [1.0, 0.0, 0.0]).ravel()


def solver(eq, monkeypatch, largest_direct):
    monkeypatch.setattr(linear_solver, "LARGEST_DIRECT", largest_direct)
    return LinearSolver(eq.space.coordinates, is_symmetric=True)


def solution(eq, linear, u, rhs):
    return linear.solve(
        eq.tangent(u, 1.0), rhs, eq.held.dofs, np.zeros(len(eq.held.dofs)), tolerance=1e-12
    )


def test_multigrid_and_factors_agree(box, monkeypatch):
    eq = equilibrium(box)
    rest = np.zeros(eq.num_dofs)
    rhs = np.random.default_rng(1).standard_normal(eq.num_dofs)
    direct = solver(eq, monkeypatch, 10**6)
    multigrid = solver(eq, monkeypatch, 0)
    assert "MUMPS" in direct.name
    assert "GAMG" in multigrid.name
    one, other = (solution(eq, linear, rest, rhs) for linear in (direct, multigrid))
    assert np.linalg.norm(one - other) < 1e-9 * np.linalg.norm(one)
    for linear in (direct, multigrid):
        assert linear.is_positive_definite(eq.tangent(rest, 1.0), eq.held.dofs)
        assert not linear.is_positive_definite(eq.tangent(crushed(eq), 1.0), eq.held.dofs)


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
    assert multigrid.is_positive_definite(eq.tangent(rest, 1.0), eq.held.dofs)
    assert not multigrid.is_positive_definite(eq.tangent(crushed(eq), 1.0), eq.held.dofs)
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
