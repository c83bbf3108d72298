"""Dynamic relaxation: Newton's equilibria without a matrix, and honest failure."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from bodies import facets_at

from palpate.fastsim.body import Body
from palpate.fastsim.dynamic_relaxation import relax
from palpate.fastsim.errors import EquilibriumLostError, RelaxationFailedError
from palpate.fastsim.forces import external_force
from palpate.fastsim.statics import solve_static
from palpate.fastsim.supports import FixedPoints
from palpate.meshes.boundary_conditions import BodyForce, Load, Pressure, Support, Traction
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.meshes.rigid_modes import UnsupportedBodyError
from palpate.meshes.spring import AnchorPath, Spring
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.case import load_case

SOFT = Material(1e4, 0.3, 1000.0)
BOTH = pytest.mark.parametrize("strain", list(Strain))


def held_block(mesh: TetMesh, *loads: Load, supports: tuple[Support, ...] = ()) -> Problem:
    fixed = facets_at(mesh, 0, 0.0)
    return Problem(
        mesh, SOFT, (Support(np.unique(fixed).astype(np.int32), fixed), *supports), tuple(loads)
    )


def difference(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


@BOTH
@pytest.mark.parametrize("name", ["kidney", "beam"])
def test_newtons_equilibrium_to_eight_digits(name: str, strain: Strain) -> None:
    problem = load_case(name).problem
    newton = solve_static(problem, strain=strain)
    relaxed = relax(problem, strain=strain)
    assert difference(relaxed.displacement, newton.displacement) < 1e-8
    assert relaxed.smallest_det_f == pytest.approx(newton.smallest_det_f, rel=1e-6)
    assert relaxed.history[-1] == (relaxed.steps, relaxed.relative_residual)
    assert relaxed.starts == 1


@pytest.mark.parametrize("element", list(Element))
@BOTH
def test_pressure_and_moved_supports(ragged_box: TetMesh, strain: Strain, element: Element) -> None:
    end = facets_at(ragged_box, 0, 1.6)
    moved = Support(np.unique(end).astype(np.int32), displacement=(0.2, 0.1, 0.0))
    press = Pressure(facets_at(ragged_box, 2, 1.2), 400.0)
    problem = held_block(ragged_box, press, supports=(moved,))
    relaxed = relax(problem, strain=strain, element=element)
    newton = solve_static(problem, strain=strain, element=element)
    assert difference(relaxed.displacement, newton.displacement) < 1e-8
    assert relaxed.displacement[np.unique(end)] == pytest.approx(
        np.tile([0.2, 0.1, 0.0], (len(np.unique(end)), 1))
    )


def test_from_a_start_springs_pull_too(ragged_box: TetMesh) -> None:
    path = AnchorPath(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.1]]))
    spring = Spring.on(ragged_box, (1.6, 0.6, 0.6), 0.7, 2e3, path)
    problem = dataclasses.replace(held_block(ragged_box), springs=(spring,))
    newton = solve_static(problem)
    found = relax(problem, start=0.9 * newton.displacement)
    assert difference(found.displacement, newton.displacement) < 1e-8
    with pytest.raises(InputError, match="knows no springs"):
        relax(problem)


def test_what_is_returned_balances(ragged_box: TetMesh) -> None:
    problem = held_block(ragged_box, BodyForce((0.0, 100.0, -500.0)))
    relaxed = relax(problem, relative_tolerance=1e-6)
    load = external_force(problem)
    residual = load - Body(ragged_box, SOFT).internal_force(relaxed.displacement)
    free = FixedPoints(problem).is_free.astype(bool)
    relative = np.linalg.norm(residual[free]) / np.linalg.norm(load)
    assert relative == pytest.approx(relaxed.relative_residual, rel=1e-6)
    assert relative <= 1e-6


def test_the_number_of_steps_grows_with_the_slenderness() -> None:
    """As omega_max / omega_min does, with the square of the length of a beam."""
    steps = []
    for length in (4, 8, 16):
        mesh = brick_box((2 * length, 2, 2), (float(length), 1.0, 1.0))
        weight = BodyForce((0.0, 0.0, -30.0 / length**3))
        steps.append(relax(held_block(mesh, weight), strain=Strain.LINEAR).steps)
    assert steps[2] > 2.5 * steps[1] > 2.5 * 1.5 * steps[0]


def test_a_stiffening_pull_makes_it_start_again_with_larger_masses(ragged_box: TetMesh) -> None:
    pull = Traction(facets_at(ragged_box, 0, 1.6), (2.2e4, 0.0, 0.0))
    lines: list[str] = []
    problem = held_block(ragged_box, pull)
    relaxed = relax(problem, progress=lines.append)
    assert relaxed.starts > 1
    assert any("slower again" in line for line in lines)
    assert difference(relaxed.displacement, solve_static(problem).displacement) < 1e-8


def test_a_crushing_load_fails_with_the_last_good_state(ragged_box: TetMesh) -> None:
    push = Traction(facets_at(ragged_box, 0, 1.6), (-SOFT.youngs_modulus, 0.0, 0.0))
    problem = held_block(ragged_box, push)
    with pytest.raises(RelaxationFailedError, match="inverted") as caught:
        relax(problem)
    error = caught.value
    assert np.isfinite(error.displacement).all()
    # Raised slowly, the load passes the limit that Newton's method finds, and not by much.
    with pytest.raises(EquilibriumLostError) as newton:
        solve_static(problem)
    assert 1.0 < error.load_factor / newton.value.load_factor < 1.1
    assert "Newton" in str(error)


def test_too_few_steps_are_no_solution(ragged_box: TetMesh) -> None:
    problem = held_block(ragged_box, BodyForce((0.0, 0.0, -300.0)))
    with pytest.raises(RelaxationFailedError, match="did not come to rest") as caught:
        relax(problem, max_steps=100)
    assert caught.value.steps == 100
    assert np.isfinite(caught.value.displacement).all()


@BOTH
def test_the_masses_make_a_step_of_one_second_stable_and_not_much_more(
    ragged_box: TetMesh, strain: Strain
) -> None:
    body = Body(ragged_box, SOFT, strain)
    rest = np.zeros_like(ragged_box.points)
    body.core.assemble_tangent(rest)
    sums = body.core.absolute_row_sums()
    columns = [body.core.multiply(unit.reshape(-1, 3)).ravel() for unit in np.eye(rest.size)]
    np.testing.assert_allclose(sums.ravel(), np.abs(columns).sum(axis=0), rtol=1e-12)
    mass = 0.25 * sums.max(axis=1)
    critical = body.critical_time_step(mass=mass)
    assert 1.0 <= critical < 2.0


def test_a_floating_body_is_refused(ragged_box: TetMesh) -> None:
    with pytest.raises(UnsupportedBodyError):
        relax(Problem(ragged_box, SOFT, (), (BodyForce((0.0, 0.0, -1.0)),)))
