"""The indicator: zero where the stress is uniform, right in size, and the right cells marked."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.fastsim.body import Body, cell_stress
from palpate.fastsim.grading.graded_mesh import (
    GradedMesh,
    carry_problem,
    estimate_error,
    mark_largest,
)
from palpate.fastsim.grading.symbolic_cube import SymbolicCube
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh


def bricks() -> TetMesh:
    """A box of 2 x 1 x 1 in Kuhn's tetrahedra: the same whatever the mesher does."""
    cube = SymbolicCube()
    for _ in range(3):
        cube.refine(np.ones(cube.num_cells, dtype=bool))
    return TetMesh(cube.mesh.points * np.array([2.0, 1.0, 1.0]), cube.mesh.cells)


MESH = bricks()
MATERIAL = Material(1e4, 0.3)


@pytest.mark.parametrize("strain", list(Strain))
def test_uniform_stretch_has_its_stress_and_no_error(strain: Strain) -> None:
    stretch = 1.2
    displacement = MESH.points * np.array([stretch - 1.0, 0.0, 0.0])
    E = 0.5 * (stretch**2 - 1.0) if strain is Strain.GREEN else stretch - 1.0
    lmbda, mu = 1e4 * 0.3 / (1.3 * 0.4), 1e4 / 2.6
    expected = lmbda * E * np.eye(3) + np.diag([2.0 * mu * E, 0.0, 0.0])
    stress = cell_stress(Body(MESH, MATERIAL, strain), displacement)
    # Rounding of gradients: some eps times the modulus over the strain's digits.
    assert stress == pytest.approx(np.broadcast_to(expected, stress.shape), abs=1e-9 * 1e4)
    errors = estimate_error(Body(MESH, MATERIAL, strain), displacement)
    energy = Body(MESH, MATERIAL, strain).strain_energy(displacement)
    assert errors.max() < 1e-10 * np.sqrt(energy)


def test_a_finite_rotation_is_no_error_with_green_strain() -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    displacement = MESH.points @ turn.T - MESH.points
    errors = estimate_error(Body(MESH, MATERIAL), displacement)
    assert np.linalg.norm(errors) < 1e-9 * np.sqrt(1e4)


def test_the_estimate_is_near_the_true_error_in_energy() -> None:
    """Linear strain: the squared energy error is the gap in strain energy to a fine solution."""
    facets = MESH.boundary_facets
    fixed = facets[(MESH.points[facets][:, :, 0] == 0.0).all(axis=1)]
    problem = Problem(
        MESH, MATERIAL, (Support(np.unique(fixed), fixed),), (BodyForce((0.0, 0.0, -10.0)),)
    )
    graded = GradedMesh(MESH)
    energies, estimates = [], []
    for _ in range(10):
        carried = carry_problem(problem, graded)
        displacement = solve_static(carried, strain=Strain.LINEAR).displacement
        options = {"material": MATERIAL, "strain": Strain.LINEAR}
        energies.append(Body(carried.mesh, **options).strain_energy(displacement))
        errors = estimate_error(Body(carried.mesh, **options), displacement)
        estimates.append(float(np.linalg.norm(errors)))
        graded.refine(np.ones(len(errors), dtype=bool))
        if len(graded.cells) > 60_000:
            break
    # Energies approach the limit like h^2 to h (a clamped edge): Aitken's value is near enough.
    a, b, c = energies[-3:]
    limit = c + (c - b) ** 2 / (2.0 * b - a - c) if b - a > c - b else c + (c - b)
    true = np.sqrt(2.0 * (limit - np.array(energies)))
    ratio = np.array(estimates)[:-2] / true[:-2]
    assert np.all((ratio > 0.3) & (ratio < 1.5)), ratio


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0.0, 1e3), min_size=1, max_size=40), st.floats(0.05, 1.0))
def test_the_fewest_cells_that_hold_the_share(errors: list[float], part: float) -> None:
    squared = np.array(errors) ** 2
    marked = mark_largest(errors, part=part)
    if squared.sum() == 0.0:
        assert not marked.any()
        return
    assert squared[marked].sum() >= part * squared.sum() * (1.0 - 1e-9)
    smallest = np.flatnonzero(marked)[np.argmin(squared[marked])]
    assert squared[marked].sum() - squared[smallest] < part * squared.sum()
    assert squared[marked].min() >= squared[~marked].max(initial=0.0)


def test_refusals() -> None:
    for bad in (0.0, 1.5, np.nan):
        with pytest.raises(InputError, match="part"):
            mark_largest([1.0], part=bad)
    with pytest.raises(InputError, match="finite"):
        mark_largest([1.0, np.nan])
    with pytest.raises(InputError):
        estimate_error(Body(MESH, MATERIAL), np.zeros((2, 3)))
