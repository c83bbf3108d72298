"""Forces as the explicit step computes them are those of the plain loop, on every path of it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from bodies import EPS, FINITE_LAWS, SOFT, body_of, distance, force_of_step, shake

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.fastsim.explicit_body import ExplicitBody
from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.meshes.bricks import brick_box
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.diagnosis.law_simulators import example_material

LAWS = pytest.mark.parametrize("law", FINITE_LAWS)
STRAINS = pytest.mark.parametrize("strain", list(Strain))
MIXED = pytest.mark.parametrize("mixed", [False, True])
SINGLE = pytest.mark.parametrize("is_single", [False, True])
SETS = pytest.mark.parametrize("at_most", list(_core.InstructionSet))


def shuffled(mesh: TetMesh) -> TetMesh:
    rng = np.random.default_rng(0)
    order = rng.permutation(mesh.num_points)
    number = np.argsort(order).astype(np.int32)
    return TetMesh(mesh.points[order], number[mesh.cells][rng.permutation(mesh.num_cells)])


@pytest.fixture(scope="module")
def long_box() -> TetMesh:
    """4800 cells, shuffled: twenty chunks of the sweep, of which its rings hold a few."""
    return shuffled(brick_box((32, 5, 5), (6.4, 1.0, 1.0), ragged=0.2))


@pytest.mark.parametrize(
    ("element", "is_long", "num_threads"),
    [(e, False, n) for e in Element for n in (1, 2, 3)]
    + [(Element.SMOOTHED, True, n) for n in (1, 2, 5)],
)
@MIXED
@SINGLE
@SETS
@STRAINS
def test_every_kernel_gives_the_plain_loops_force(
    ragged_box: TetMesh,
    long_box: TetMesh,
    strain: Strain,
    at_most: _core.InstructionSet,
    is_single: bool,
    num_threads: int,
    mixed: bool,
    element: Element,
    is_long: bool,
) -> None:
    mesh = long_box if is_long else ragged_box
    u = shake(mesh, 0.02 if is_long else 0.03, seed=1)
    parts = np.arange(0, 100, 3)
    if is_long:
        parts = np.flatnonzero(mesh.points[mesh.cells].mean(axis=1)[:, 1] > 0.5)
    other = Inclusion(parts.astype(np.int32), Material(5e4, 0.1))
    body = Body(mesh, SOFT, strain, element=element, inclusions=(other,) if mixed else ())
    force = force_of_step(body, u, is_single=is_single, num_threads=num_threads, at_most=at_most)
    # Displacements of 2 or 3 % of the size are rounded first: some tens of roundings of each force.
    assert distance(force, body.internal_force(u)) < 50 * (2.0**-23 if is_single else EPS)


def test_the_sweep_follows_a_graded_mesh() -> None:
    """Cells of many sizes, and points of many cells."""
    graded = GradedMesh(brick_box((3, 3, 3), (1.0, 1.0, 1.0)))
    for _ in range(4):
        centres = graded.mesh.points[graded.mesh.cells].mean(axis=1)
        graded.refine(np.linalg.norm(centres - 0.3, axis=1) < 0.25)
    mesh = shuffled(graded.mesh)
    body, u = Body(mesh, SOFT, element=Element.SMOOTHED), shake(mesh, 0.005, seed=1)
    for num_threads in (1, 3):
        force = force_of_step(body, u, num_threads=num_threads)
        assert distance(force, body.internal_force(u)) < 1e-13


@SETS
def test_the_sweep_of_a_body_beyond_the_cache_gives_the_plain_force(
    at_most: _core.InstructionSet,
) -> None:
    """18 432 cells in double precision: their data are asked for ahead."""
    mesh = brick_box((48, 8, 8), (6.0, 1.0, 1.0), ragged=0.2)
    body, u = Body(mesh, SOFT, element=Element.SMOOTHED), shake(mesh, 0.01, seed=1)
    assert distance(force_of_step(body, u, at_most=at_most), body.internal_force(u)) < 1e-13


@SETS
@SINGLE
def test_the_sweep_goes_over_to_plain_cells_where_they_are_compressed(
    at_most: _core.InstructionSet, is_single: bool
) -> None:
    """Edges between the two elements and beyond, of two materials."""
    mesh = brick_box((6, 4, 4), (1.5, 1.0, 1.0), ragged=0.2)
    other = Inclusion(np.arange(0, 100, 3, dtype=np.int32), Material(5e4, 0.1))
    body = Body(mesh, SOFT, element=Element.SMOOTHED, inclusions=(other,))
    u = mesh.points * [-0.04, -0.03, -0.1] + shake(mesh, 0.01)
    force = force_of_step(body, u, is_single=is_single, num_threads=2, at_most=at_most)
    assert distance(force, body.internal_force(u)) < (2e-5 if is_single else 1e-12)


@LAWS
@pytest.mark.parametrize(
    ("element", "at_most", "num_threads"),
    [(Element.LINEAR, at_most, 1) for at_most in _core.InstructionSet]
    + [(Element.SMOOTHED, _core.InstructionSet.avx512, 2)],
)
@SINGLE
@MIXED
def test_the_step_has_the_forces_of_every_law(
    law: Law,
    element: Element,
    at_most: _core.InstructionSet,
    num_threads: int,
    is_single: bool,
    mixed: bool,
) -> None:
    """Also where the volume changes by half: logarithms and roots far from 1."""
    mesh = brick_box((3, 3, 3), (1.0, 1.0, 1.0), ragged=0.2)
    if element is Element.SMOOTHED:
        body = body_of(mesh, law, element, mixed=mixed)
    else:
        stiff = dataclasses.replace(example_material(law), youngs_modulus=3e4)
        inclusions = (Inclusion(np.arange(0, 60, 2), stiff),) if mixed else ()
        body = Body(mesh, example_material(law), inclusions=inclusions)
    for stretch in (-0.25, 0.0, 0.3):
        u = shake(mesh, 0.02) + stretch * mesh.points
        force = force_of_step(
            body, u, is_single=is_single, num_threads=num_threads, at_most=at_most
        )
        assert distance(force, body.internal_force(u)) < (1e-5 if is_single else 1e-12), stretch


@LAWS
@pytest.mark.parametrize("volume", [1e-3, 0.03, 0.7, 1.45, 3.0, 400.0])
def test_logarithm_and_root_hold_from_crushed_to_blown_up(law: Law, volume: float) -> None:
    mesh = brick_box((1, 1, 1), (1.0, 1.0, 1.0))
    u = (np.cbrt(volume) - 1.0) * mesh.points
    problem = Problem(mesh, example_material(law), (), ())
    stepped = ExplicitBody(problem, displacement=u, time_step=1e-6)
    u = stepped.displacement
    force = np.empty_like(u)
    stepped.run.internal_force(force)
    assert distance(force, stepped.elastic.internal_force(u)) < 2e-6
