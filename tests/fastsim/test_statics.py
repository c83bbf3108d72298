"""Static equilibria: closed forms, convergence, and honest failure."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import SOFT, facets_at, points_at

from palpate.fastsim.body import Body
from palpate.fastsim.errors import NotConvergedError
from palpate.fastsim.forces import external_force
from palpate.fastsim.statics import Iteration, solve_static
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Support, Traction
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.rigid_modes import UnsupportedBodyError
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.diagnosis.law_simulators import example_material

BOTH = pytest.mark.parametrize("strain", list(Strain))


def symmetry_supports(mesh: TetMesh) -> tuple[Support, ...]:
    """Rollers on the three planes through the origin: no force but a normal one."""
    return tuple(
        Support(points_at(mesh, axis, 0.0), components=tuple(k == axis for k in range(3)))  # type: ignore[arg-type]
        for axis in range(3)
    )


def cantilever(mesh: TetMesh, weight: float, tilt: float = 0.2) -> Problem:
    fixed = facets_at(mesh, 0, 0.0)
    support = Support(np.unique(fixed).astype(np.int32), fixed)
    return Problem(mesh, SOFT, (support,), (BodyForce((0.0, tilt * weight, -weight)),))


def free_norm(problem: Problem, force: np.ndarray) -> float:
    fixed = np.unique(np.concatenate([s.points for s in problem.supports]))
    return float(np.linalg.norm(np.delete(force, fixed, axis=0)))


@pytest.mark.parametrize("stretch", [0.8, 0.9, 1.1, 1.25, 1.5])
def test_dead_traction_stretches_a_ragged_bar_to_the_closed_form(
    ragged_box: TetMesh, stretch: float
) -> None:
    stress = SOFT.youngs_modulus * stretch * (stretch**2 - 1.0) / 2.0
    pull = Traction(facets_at(ragged_box, 0, 1.6), (stress, 0.0, 0.0))
    problem = Problem(ragged_box, SOFT, symmetry_supports(ragged_box), (pull,))
    result = solve_static(problem, relative_tolerance=1e-12)
    lateral = np.sqrt(1.0 - 0.3 * (stretch**2 - 1.0))
    exact = ragged_box.points * (np.array([stretch, lateral, lateral]) - 1.0)
    assert np.abs(result.displacement - exact).max() < 1e-10
    assert result.smallest_det_f == pytest.approx(stretch * lateral**2, rel=1e-9)


def test_prescribed_stretch_gives_the_same_state(ragged_box: TetMesh) -> None:
    supports = (
        *symmetry_supports(ragged_box),
        Support(
            points_at(ragged_box, 0, 1.6), components=(True, False, False), displacement=(0.4, 0, 0)
        ),
    )
    result = solve_static(Problem(ragged_box, SOFT, supports, ()), relative_tolerance=1e-12)
    stretch = 2.0 / 1.6
    lateral = np.sqrt(1.0 - 0.3 * (stretch**2 - 1.0))
    exact = ragged_box.points * (np.array([stretch, lateral, lateral]) - 1.0)
    assert np.abs(result.displacement - exact).max() < 1e-10


def test_linear_stretch_gives_hookes_law(ragged_box: TetMesh) -> None:
    pull = Traction(facets_at(ragged_box, 0, 1.6), (1500.0, 0.0, 0.0))
    problem = Problem(ragged_box, SOFT, symmetry_supports(ragged_box), (pull,))
    result = solve_static(problem, strain=Strain.LINEAR)
    exact = ragged_box.points * np.array([0.15, -0.045, -0.045])
    assert np.abs(result.displacement - exact).max() < 1e-10


@BOTH
def test_equilibrium_has_a_small_residual(strain: Strain) -> None:
    mesh = brick_box((12, 2, 2), (6.0, 1.0, 1.0), ragged=0.1)
    problem = cantilever(mesh, 10.0)
    result = solve_static(problem, strain=strain)
    load = external_force(problem)
    internal = Body(mesh, SOFT, strain).internal_force(result.displacement)
    assert free_norm(problem, load - internal) < 1e-10 * np.linalg.norm(load)
    assert np.abs(result.displacement).max() > 0.3


def test_newton_converges_quadratically() -> None:
    mesh = brick_box((12, 2, 2), (6.0, 1.0, 1.0), ragged=0.1)
    history = solve_static(cantilever(mesh, 10.0)).residual_history
    # Near the solution one step about doubles the number of right digits; a fixed-point
    # iteration such as eq. 10 as printed gains a constant number, and its ratio falls to 1.
    digits = -np.log10([r for r in history if 1e-12 < r < 1e-1])
    assert len(digits) >= 2
    assert (digits[1:] / digits[:-1]).max() > 1.6


def test_secant_matrix_times_displacement_is_the_internal_force(ragged_box: TetMesh) -> None:
    """R(a) = (K + P(a)) a, eq. 8."""
    u = 0.05 * np.random.default_rng(8).standard_normal(ragged_box.points.shape)
    body = Body(ragged_box, SOFT)
    body.core.assemble_secant(u)
    product = body.core.multiply(u)
    force = body.internal_force(u)
    assert np.abs(product - force).max() < 1e-13 * np.abs(force).max()


def test_secant_iteration_finds_the_same_equilibrium_slower() -> None:
    problem = cantilever(brick_box((6, 2, 2), (3.0, 1.0, 1.0)), 10.0)
    newton = solve_static(problem)
    secant = solve_static(problem, iteration=Iteration.SECANT, max_iterations=300)
    difference = np.linalg.norm(secant.displacement - newton.displacement)
    assert difference < 1e-8 * np.linalg.norm(newton.displacement)
    assert secant.iterations > 2 * newton.iterations


def test_a_warm_start_finds_the_same_equilibrium_sooner() -> None:
    mesh = brick_box((12, 2, 2), (6.0, 1.0, 1.0), ragged=0.1)
    before = solve_static(cantilever(mesh, 10.0))
    problem = cantilever(mesh, 10.5)
    cold = solve_static(problem)
    warm = solve_static(problem, start=before.displacement)
    difference = np.linalg.norm(warm.displacement - cold.displacement)
    assert difference < 1e-9 * np.linalg.norm(cold.displacement)
    assert warm.iterations < cold.iterations
    assert warm.load_steps == (1.0,)


def test_a_useless_warm_start_falls_back_to_rest() -> None:
    mesh = brick_box((6, 2, 2), (3.0, 1.0, 1.0))
    problem = cantilever(mesh, 10.0)
    lines: list[str] = []
    wild = 3.0 * np.random.default_rng(0).standard_normal(mesh.points.shape)
    found = solve_static(problem, start=wild, progress=lines.append)
    cold = solve_static(problem)
    np.testing.assert_array_equal(found.displacement, cold.displacement)
    assert "warm start" in lines[0]
    with pytest.raises(InputError, match="shape"):
        solve_static(problem, start=np.zeros((2, 3)))


def test_small_loads_make_green_and_linear_agree() -> None:
    mesh = brick_box((8, 2, 2), (4.0, 1.0, 1.0), ragged=0.1)
    problem = cantilever(mesh, 1e-4)
    green = solve_static(problem, strain=Strain.GREEN).displacement
    linear = solve_static(problem, strain=Strain.LINEAR).displacement
    relative = np.linalg.norm(green - linear) / np.linalg.norm(linear)
    assert 0.0 < relative < 1e-4


def test_linear_strain_stretches_a_bent_beam_and_green_does_not() -> None:
    """Fig. 2 of the paper, as the length of the bottom edge's chord of points."""
    mesh = brick_box((16, 2, 2), (8.0, 1.0, 1.0))
    edge = np.flatnonzero(
        (np.abs(mesh.points[:, 1] - 0.5) < 1e-9) & (np.abs(mesh.points[:, 2] - 0.5) < 1e-9)
    )
    lengths = {}
    for strain in Strain:
        u = solve_static(cantilever(mesh, 10.0, tilt=0.0), strain=strain).displacement
        line = (mesh.points + u)[edge]
        lengths[strain] = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    assert lengths[Strain.LINEAR] > 8.3
    assert abs(lengths[Strain.GREEN] - 8.0) < 0.2


def test_pressure_inside_linear_range_compresses_to_hookes_law(ragged_box: TetMesh) -> None:
    faces = [facets_at(ragged_box, k, ragged_box.points[:, k].max()) for k in range(3)]
    loads = tuple(Pressure(f, 100.0) for f in faces)
    problem = Problem(ragged_box, SOFT, symmetry_supports(ragged_box), loads)
    result = solve_static(problem, strain=Strain.LINEAR)
    # Bulk modulus E / (3 (1 - 2 nu)); each strain is -p (1 - 2 nu) / E = -0.004.
    assert np.abs(result.displacement + 0.004 * ragged_box.points).max() < 1e-10


def test_follower_pressure_compresses_to_the_closed_form(ragged_box: TetMesh) -> None:
    """Equal stretch l: P = l (3 lmbda + 2 mu)(l^2 - 1)/2, pressure on the deformed area l^2."""
    stretch = 0.93
    bulk = SOFT.youngs_modulus / (1.0 - 2.0 * SOFT.poissons_ratio)  # 3 lmbda + 2 mu
    pressure = -stretch * bulk * (stretch**2 - 1.0) / 2.0 / stretch**2
    faces = [facets_at(ragged_box, k, ragged_box.points[:, k].max()) for k in range(3)]
    loads = tuple(Pressure(f, pressure) for f in faces)
    result = solve_static(Problem(ragged_box, SOFT, symmetry_supports(ragged_box), loads))
    exact = ragged_box.points * (stretch - 1.0)
    assert np.abs(result.displacement - exact).max() < 1e-8


def test_crushing_load_is_reported_with_the_load_reached(ragged_box: TetMesh) -> None:
    """Free compression has no equilibrium past P/E = -0.19245 (stretch 0.577)."""
    push = Traction(facets_at(ragged_box, 0, 1.6), (-0.25 * SOFT.youngs_modulus, 0.0, 0.0))
    problem = Problem(ragged_box, SOFT, symmetry_supports(ragged_box), (push,))
    with pytest.raises(NotConvergedError) as caught:
        solve_static(problem)
    error = caught.value
    limit = 0.1924501 / 0.25
    assert 0.9 * limit < error.load_factor <= limit
    assert 0.577 * (1.0 - 0.3 * (0.577**2 - 1.0)) * 0.95 < error.smallest_det_f < 1.0
    assert np.isfinite(error.displacement).all()
    assert f"{error.load_factor:.4g} of the load" in str(error)
    # What it carries is an equilibrium at that load.
    internal = Body(ragged_box, SOFT).internal_force(error.displacement)
    load = error.load_factor * external_force(problem)
    free = ragged_box.points.min(axis=1) > 1e-9
    assert np.linalg.norm((load - internal)[free]) < 1e-9 * np.linalg.norm(load)


def test_a_floating_body_is_refused(ragged_box: TetMesh) -> None:
    problem = Problem(ragged_box, SOFT, (), (BodyForce((0.0, 0.0, -1.0)),))
    with pytest.raises(UnsupportedBodyError):
        solve_static(problem)


def test_no_load_gives_no_displacement(ragged_box: TetMesh) -> None:
    problem = Problem(ragged_box, SOFT, (Support(points_at(ragged_box, 0, 0.0)),), ())
    assert not solve_static(problem).displacement.any()


@BOTH
def test_solving_twice_gives_the_same_bits(strain: Strain) -> None:
    problem = cantilever(brick_box((6, 2, 2), (3.0, 1.0, 1.0), ragged=0.1), 20.0)
    first, second = (solve_static(problem, strain=strain).displacement for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.dolfinx
@BOTH
def test_agrees_with_fenicsx_to_eight_digits(strain: Strain) -> None:
    from palpate.reference.child import run_task
    from palpate.reference.tasks import StaticTask

    mesh = brick_box((8, 2, 2), (4.0, 1.0, 1.0), ragged=0.15)
    problem = cantilever(mesh, 20.0)
    ours = solve_static(problem, strain=strain).displacement
    theirs = run_task(StaticTask(strain), problem).displacement
    assert np.linalg.norm(ours - theirs) < 1e-8 * np.linalg.norm(theirs)


def test_the_secant_iteration_of_another_law_is_refused() -> None:
    mesh = brick_box((1, 1, 1), (1.0, 1.0, 1.0))
    rubber = example_material(Law.NEO_HOOKEAN)
    fixed = Support(np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32))
    problem = Problem(mesh, rubber, (fixed,), (Pressure(facets_at(mesh, 0, 1.0), 10.0),))
    with pytest.raises(InputError, match=r"secant.*follows neo-hookean"):
        solve_static(problem, iteration=Iteration.SECANT)
