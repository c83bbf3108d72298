"""The sweep over smoothed cells, on meshes long enough for its rings to go round."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.explicit_body import Precision
from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh

MakeBox = Callable[..., TetMesh]
SOFT, STIFF = Material(1e4, 0.45, 1000.0), Material(5e4, 0.1, 1000.0)
EPS = {Precision.SINGLE: 2.0**-23, Precision.DOUBLE: 2.0**-52}


@pytest.fixture(scope="module")
def long_box(make_box: MakeBox) -> TetMesh:
    """4800 cells, shuffled: twenty chunks of the sweep, of which its rings hold a few."""
    return shuffled(make_box((32, 5, 5), (6.4, 1.0, 1.0), ragged=0.2))


def shuffled(mesh: TetMesh) -> TetMesh:
    rng = np.random.default_rng(0)
    order = rng.permutation(mesh.num_points)
    place = np.argsort(order).astype(np.int32)
    return TetMesh(mesh.points[order], place[mesh.cells][rng.permutation(mesh.num_cells)])


def force_of_step(
    body: Body, u: np.ndarray, precision: Precision, num_threads: int, at_most: _core.InstructionSet
) -> np.ndarray:
    run = _core.ExplicitRun.make(
        body.core,
        body.lumped_mass,
        np.ones(u.shape, np.uint8),
        time_step=1e-3,
        mass_damping=0.0,
        displacement_limit=1e3,
        num_threads=num_threads,
        at_most=at_most,
        stiffness_damping=0.0,
        is_single=precision is Precision.SINGLE,
        tracks_energy=False,
    )
    run.set_state(u, np.zeros_like(u), 0.0)
    first, second = np.empty_like(u), np.empty_like(u)
    run.internal_force(first)
    run.internal_force(second)
    np.testing.assert_array_equal(first, second)
    return first


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize("num_threads", [1, 2, 5])
@pytest.mark.parametrize("precision", list(Precision))
@pytest.mark.parametrize("instruction_set", list(_core.InstructionSet))
@pytest.mark.parametrize("strain", list(Strain))
def test_the_sweep_gives_the_plain_force(
    long_box: TetMesh,
    strain: Strain,
    instruction_set: _core.InstructionSet,
    precision: Precision,
    num_threads: int,
    mixed: bool,
) -> None:
    u = 0.02 * np.random.default_rng(1).standard_normal(long_box.points.shape)
    half = np.flatnonzero(long_box.points[long_box.cells].mean(axis=1)[:, 1] > 0.5)
    parts = (Inclusion(half.astype(np.int32), STIFF),) if mixed else ()
    body = Body(long_box, SOFT, strain, element=Element.SMOOTHED, inclusions=parts)
    plain = body.internal_force(u)
    force = force_of_step(body, u, precision, num_threads, instruction_set)
    # Displacements of 2 % of the size are rounded first: some tens of roundings of each force.
    assert np.abs(force - plain).max() < 50 * EPS[precision] * np.abs(plain).max()


def test_the_sweep_follows_a_graded_mesh(make_box: MakeBox) -> None:
    """Cells of many sizes, and points of many cells."""
    graded = GradedMesh(make_box((3, 3, 3), (1.0, 1.0, 1.0)))
    for _ in range(4):
        centres = graded.mesh.points[graded.mesh.cells].mean(axis=1)
        graded.refine(np.linalg.norm(centres - 0.3, axis=1) < 0.25)
    mesh = shuffled(graded.mesh)
    u = 0.005 * np.random.default_rng(1).standard_normal(mesh.points.shape)
    body = Body(mesh, SOFT, element=Element.SMOOTHED)
    plain = body.internal_force(u)
    for num_threads in (1, 3):
        force = force_of_step(
            body, u, Precision.DOUBLE, num_threads, _core.widest_instruction_set()
        )
        assert np.abs(force - plain).max() < 1e-13 * np.abs(plain).max()


def test_the_sweep_of_a_body_beyond_the_cache_gives_the_plain_force(make_box: MakeBox) -> None:
    """18 432 cells in double precision: their data are asked for ahead."""
    mesh = make_box((48, 8, 8), (6.0, 1.0, 1.0), ragged=0.2)
    u = 0.01 * np.random.default_rng(1).standard_normal(mesh.points.shape)
    body = Body(mesh, SOFT, element=Element.SMOOTHED)
    plain = body.internal_force(u)
    for instruction_set in _core.InstructionSet:
        force = force_of_step(body, u, Precision.DOUBLE, 1, instruction_set)
        assert np.abs(force - plain).max() < 1e-13 * np.abs(plain).max()


@pytest.mark.parametrize("element", list(Element))
def test_a_free_body_keeps_its_momentum_and_turns_on(make_box: MakeBox, element: Element) -> None:
    """Spun and stretched, over 2000 steps in double precision.

    Central differences conserve both: what is left is one rounding a step at positions up to
    eight lengths from the origin, at random root(2000) * 8 * eps / 2 = 4e-14.
    """
    mesh = make_box((6, 3, 3), (1.0, 0.5, 0.5), ragged=0.2)
    centred = mesh.points - mesh.points.mean(axis=0)
    speed = np.cross([0.0, 0.3, 0.5], centred) + np.array([0.4, 0.0, 0.1])
    speed[:, 0] += 0.2 * centred[:, 0]
    step = 0.5 * Body(mesh, SOFT, element=element).critical_time_step()
    span = TimeSpan(2000 * step, step, num_outputs=2)
    run = simulate(Problem(mesh, SOFT, (), (), span), element=element, velocity=speed)
    mass = Body(mesh, SOFT).lumped_mass[:, None]
    assert run.num_steps == 2000
    # How far it went: neither sum is of a body at rest.
    assert np.abs(run.displacements[-1]).max() > 5.0
    assert distance(mass * run.velocity, mass * speed) < 1e-13
    spun = np.cross(mesh.points + run.displacements[-1], mass * run.velocity)
    assert distance(spun, np.cross(mesh.points, mass * speed)) < 1e-13


def distance(after: np.ndarray, before: np.ndarray) -> float:
    """Between the sums of two tables, summed without rounding, over the sizes of all before."""
    change = [math.fsum(column) for column in np.vstack([after, -before]).T]
    return float(np.abs(change).max() / np.abs(before).sum())


def test_a_bar_swings_as_slowly_as_it_should(make_box: MakeBox) -> None:
    """Its weight, let go, bends it to twice the static deflection; plain cells stop far before."""
    mesh = make_box((12, 3, 3), (4.0, 1.0, 1.0))
    held = Support(np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32))
    deepest = {}
    for element in Element:
        span = TimeSpan(17.0, num_outputs=100)
        problem = Problem(mesh, SOFT, (held,), (BodyForce((0.0, 0.0, -10.0)),), span)
        run = simulate(problem, element=element, strain=Strain.LINEAR)
        deepest[element] = -float(run.displacements[:, :, 2].min())
    # E = 1e4, I = 1/12, q = 10 over 4 m: q L^4 / 8 E I = 0.384 by beam theory, and 4 % for shear;
    # half a period is pi / (3.516 root(E I / (rho A L^4))) = 15.7 s.
    assert deepest[Element.SMOOTHED] == pytest.approx(2 * 0.384 * 1.04, rel=0.07)
    assert deepest[Element.LINEAR] < 0.6 * deepest[Element.SMOOTHED]
