"""Frequencies of smoothed tetrahedra: six zeros of a free body, and no mode that should not be."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import eigsh

from palpate.meshes.boundary_conditions import Support
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.reference.availability import is_available
from palpate.validation.case import load_case

if is_available():
    from palpate.reference import fenicsx
    from palpate.reference.discrete_problem import DiscreteProblem
    from palpate.reference.fenicsx import ufl
    from palpate.reference.motion import row_sums_of_mass

pytestmark = pytest.mark.dolfinx

RATIOS = pytest.mark.parametrize("poissons_ratio", [0.3, 0.49])


def sparse(matrix):
    starts, columns, values = matrix.getValuesCSR()
    return csr_matrix((values, columns, starts), shape=matrix.getSize())


def stiffness_and_masses(problem, *, degree=1, element=Element.SMOOTHED):
    """K at rest, the consistent mass, and its row sums (degree 1), on the free entries."""
    body = DiscreteProblem(problem, strain=Strain.GREEN, degree=degree, element=element)
    K = sparse(body.tangent(np.zeros(body.num_dofs), 0.0))
    dx = ufl.dx(domain=body.space.transferred.mesh, metadata={"quadrature_degree": 2 * degree})
    du = ufl.TrialFunction(body.space.space)
    form = fenicsx.form(problem.material.density * ufl.inner(du, body.v) * dx)
    matrix = fenicsx.create_matrix(form)
    fenicsx.assemble_into_matrix(matrix, form)
    lumped = diags(row_sums_of_mass(body, problem)).tocsr()
    return [A[body.free][:, body.free].tocsc() for A in (K, sparse(matrix), lumped)]


def lowest_frequencies(K, M, count=16):
    squared = eigsh(K, count, M, sigma=0.0, which="LM", return_eigenvectors=False)
    return np.sqrt(np.sort(squared)) / (2 * np.pi)


@RATIOS
def test_a_free_body_has_six_zero_frequencies_and_then_true_ones(box, poissons_ratio):
    mesh = box((6, 3, 3), (2.0, 1.0, 1.0), jitter=0.2)
    problem = Problem(mesh, Material(1e4, poissons_ratio), (), ())
    K, consistent, lumped = stiffness_and_masses(problem)
    true_K, true_M, _ = stiffness_and_masses(problem, degree=2, element=Element.LINEAR)
    true = eigh(true_K.toarray(), true_M.toarray(), eigvals_only=True)
    for M, nearness in ((consistent, 0.1), (lumped, 0.4)):
        found = eigh(K.toarray(), M.toarray(), eigvals_only=True)
        assert np.abs(found[:6]).max() <= 1e-12 * found[-1]
        # Squares of frequencies; this mesh is three cells thick.
        assert found[6:12] == pytest.approx(true[6:12], rel=nearness)


@RATIOS
def test_a_clamped_beam_has_the_frequencies_of_quadratic_cells(box, poissons_ratio):
    mesh = box((16, 4, 4), (0.4, 0.1, 0.1), jitter=0.2)
    held = mesh.facet_groups["x0"]
    supports = (Support(np.unique(held).astype(np.int32), held),)
    problem = Problem(mesh, Material(2e4, poissons_ratio), supports, ())
    true = lowest_frequencies(*stiffness_and_masses(problem, degree=2, element=Element.LINEAR)[:2])
    K, consistent, lumped = stiffness_and_masses(problem)
    # Quadratic cells half as large have frequencies lower by up to 0.5 % (0.9 % for nu = 0.49).
    assert lowest_frequencies(K, consistent) == pytest.approx(true, rel=0.05)
    by_row_sums = lowest_frequencies(K, lumped) / true
    assert (by_row_sums < 1.03).all()
    # What the row sums of the mass, not the stiffness, take off the shorter waves.
    assert (by_row_sums > 0.9).all()
    K, consistent, _ = stiffness_and_masses(problem, element=Element.LINEAR)
    locked = lowest_frequencies(K, consistent) / true
    assert locked.max() > (1.15 if poissons_ratio == 0.3 else 1.9)


@pytest.mark.nightly
@pytest.mark.slow
@RATIOS
@pytest.mark.parametrize(("name", "lowest"), [("beam", 0.95), ("kidney", 0.92)])
def test_clamped_cases_have_the_frequencies_of_quadratic_cells(name, lowest, poissons_ratio):
    case = load_case(name).problem
    material = dataclasses.replace(case.material, poissons_ratio=poissons_ratio)
    problem = dataclasses.replace(case, material=material)
    true = lowest_frequencies(*stiffness_and_masses(problem, degree=2, element=Element.LINEAR)[:2])
    K, consistent, lumped = stiffness_and_masses(problem)
    assert lowest_frequencies(K, consistent) == pytest.approx(true, rel=0.02)
    by_row_sums = lowest_frequencies(K, lumped) / true
    assert by_row_sums.max() < 1.05
    assert by_row_sums.min() > lowest
