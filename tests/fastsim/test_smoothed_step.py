"""How long a step of smoothed tetrahedra may be: a bound that holds, and how sharp it is."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.fastsim.explicit_body import SAFETY, ExplicitBody
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh

SOFT = Material(1e4, 0.3, 1000.0)


def exact_step(body: Body) -> float:
    """2 / omega_max by the eigenvalues of the whole matrix."""
    rest = np.zeros_like(body.mesh.points)
    body.core.assemble_tangent(rest)
    K = np.empty((rest.size, rest.size))
    for k in range(rest.size):
        unit = np.zeros(rest.size)
        unit[k] = 1.0
        K[:, k] = body.core.multiply(unit.reshape(rest.shape)).ravel()
    scale = 1.0 / np.sqrt(np.repeat(body.lumped_mass, 3))
    return float(2.0 / np.sqrt(np.linalg.eigvalsh(scale[:, None] * K * scale)[-1]))


@pytest.mark.parametrize("nu", [-0.5, 0.0, 0.3, 0.49, 0.499])
@pytest.mark.parametrize("ragged", [0.0, 0.2, 0.33])
def test_the_bound_is_below_the_critical_step_and_near_it(nu: float, ragged: float) -> None:
    mesh = brick_box((3, 3, 3), (1.0, 1.0, 1.3), ragged=ragged)
    body = Body(mesh, Material(1e4, nu), element=Element.SMOOTHED)
    # A user who steps by it loses a quarter at most. A negative lmbda is not counted.
    assert 0.75 < body.critical_time_step_bound() / exact_step(body) <= 1.0


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.499])
@pytest.mark.parametrize("thickness", [0.3, 0.1, 0.03])
def test_the_bound_holds_for_flat_cells(nu: float, thickness: float) -> None:
    mesh = brick_box((3, 3, 3), (1.0, 1.0, thickness), ragged=0.3)
    body = Body(mesh, Material(1e4, nu), element=Element.SMOOTHED)
    assert 0.75 < body.critical_time_step_bound() / exact_step(body) <= 1.0


def test_the_bound_holds_for_several_materials_and_densities() -> None:
    mesh = brick_box((4, 3, 2), (1.0, 1.0, 1.0), ragged=0.3)
    rng = np.random.default_rng(2)
    for _ in range(6):
        cells = np.flatnonzero(rng.random(mesh.num_cells) < 0.3).astype(np.int32)
        other = Material(10.0 ** rng.uniform(2, 6), rng.uniform(-0.3, 0.49), rng.uniform(500, 5000))
        body = Body(mesh, SOFT, element=Element.SMOOTHED, inclusions=(Inclusion(cells, other),))
        assert 0.5 < body.critical_time_step_bound() / exact_step(body) <= 1.0


@pytest.mark.parametrize("strain", list(Strain))
def test_the_product_at_rest_is_that_of_the_tangent(ragged_box: TetMesh, strain: Strain) -> None:
    body = Body(ragged_box, SOFT, strain, element=Element.SMOOTHED)
    x = np.random.default_rng(0).standard_normal(ragged_box.points.shape)
    body.core.assemble_tangent(np.zeros_like(x))
    expected = body.core.multiply(x)
    for instruction_set in _core.InstructionSet:
        product = _core.StiffnessAtRest(body.core, instruction_set).multiply(x)
        assert np.abs(product - expected).max() < 1e-13 * np.abs(expected).max()
    assert body.critical_time_step() == pytest.approx(exact_step(body), rel=1e-3)


def test_one_cell_is_all_patches(single_cell: TetMesh) -> None:
    """Every patch of a single cell has its strain: the element is the plain one."""
    smoothed = Body(single_cell, SOFT, element=Element.SMOOTHED)
    plain = exact_step(Body(single_cell, SOFT))
    assert exact_step(smoothed) == pytest.approx(plain, rel=1e-12)
    assert 0.6 * plain < smoothed.critical_time_step_bound() <= plain


def test_more_rounds_never_shorten_it(ragged_box: TetMesh) -> None:
    body = Body(ragged_box, SOFT, element=Element.SMOOTHED)
    bounds = [body.core.smoothed_bound(body.lumped_mass, rounds) for rounds in range(1, 12)]
    assert (np.diff(bounds) <= 0.0).all()
    assert bounds[7] < 0.6 * bounds[0]


@pytest.mark.parametrize("nu", [0.3, 0.49])
def test_steps_are_longer_than_the_linear_elements(ragged_box: TetMesh, nu: float) -> None:
    material = Material(1e4, nu)
    linear = Body(ragged_box, material)
    smoothed = Body(ragged_box, material, element=Element.SMOOTHED)
    assert smoothed.critical_time_step() > 1.2 * linear.critical_time_step()
    assert smoothed.critical_time_step_bound() > 1.5 * linear.critical_time_step_bound()


def test_a_run_takes_its_step_from_its_element(ragged_box: TetMesh) -> None:
    fixed = Support(np.flatnonzero(ragged_box.points[:, 0] < 1e-9).astype(np.int32))
    problem = Problem(ragged_box, SOFT, (fixed,), ())
    for element in Element:
        body = Body(ragged_box, SOFT, Strain.GREEN, element=element)
        run = ExplicitBody(problem, element=element)
        assert run.time_step == pytest.approx(SAFETY * body.critical_time_step(), rel=1e-12)
