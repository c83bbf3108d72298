"""Stress in a part of the body, and forces through supports and cuts, by known solutions."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain
from palpate.meshes.refinement import mean_over_parents, refine_uniformly
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.candidates.fastsim import run_fastsim
from palpate.validation.candidates.result_states import with_own_mesh
from palpate.validation.exchange.point_location import locate_points
from palpate.validation.metrics import Part, make_state, measure, stress_integrals
from palpate.validation.metrics.body import Body, body_of
from palpate.validation.states import CellStresses, OwnMesh, State, in_silence

Field = NDArray[np.float64]
BOTH = pytest.mark.parametrize("element", list(Element))


def state_of(problem: Problem, u: Field, strain: Strain = Strain.GREEN, **more: object) -> State:
    return make_state(problem.mesh, u, label="x", simulator="x", strain=strain, **more)


def cells_of(problem: Problem, *, right_of: float = -math.inf) -> Part:
    centroids = problem.mesh.points[problem.mesh.cells].mean(axis=1)
    cells = np.flatnonzero(centroids[:, 0] > right_of).astype(np.int32)
    return Part(cells, np.zeros_like(problem.mesh.points))


def support(problem: Problem, number: int = 0) -> Part:
    weights = np.zeros_like(problem.mesh.points)
    weights[problem.supports[number].points] = problem.supports[number].components
    return Part(np.zeros(0, np.int32), weights, support=number)


def cut(problem: Problem, x: float) -> Part:
    weights = np.zeros_like(problem.mesh.points)
    weights[problem.mesh.points[:, 0] > x] = 1.0
    return Part(np.zeros(0, np.int32), weights)


def turn(angle: float) -> Field:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@BOTH
def test_a_body_turned_as_a_whole_has_the_right_stress(
    problem: Problem, solution: Field, element: Element
) -> None:
    right = state_of(problem, solution, element=element)
    R = turn(1.1)
    moved = (problem.mesh.points + solution) @ R.T - problem.mesh.points
    turned = state_of(problem, moved, element=element)
    found = measure("stress_l2", problem, turned, right, cells_of(problem))
    assert found.value <= 1e-12
    # As it is found in space it would be quite another.
    there = dataclasses.replace(turned, strain=Strain.LINEAR)
    assert measure("stress_l2", problem, there, right, cells_of(problem)).value > 0.5


def test_stress_ten_per_cent_too_large_is_ten_per_cent_off(
    problem: Problem, solution: Field
) -> None:
    right = state_of(problem, solution, Strain.LINEAR)
    more = state_of(problem, 1.1 * solution, Strain.LINEAR)
    for part in (cells_of(problem), cells_of(problem, right_of=1.0)):
        found = measure("stress_l2", problem, more, right, part)
        assert found.value == pytest.approx(0.1, rel=1e-9)
        assert found.uncertainty == 0.0


def test_a_norm_of_two_cells_is_the_sum_by_volume(problem: Problem, solution: Field) -> None:
    """Of two cells by hand, with all of nine components."""
    rng = np.random.default_rng(1)
    mesh = problem.mesh
    sigma = rng.uniform(-1.0, 1.0, (mesh.num_cells, 3, 3))
    sigma = sigma + sigma.transpose(0, 2, 1)
    other = sigma.copy()
    other[3, 0, 1] += 0.5
    other[3, 1, 0] += 0.5
    right, wrong = (
        state_of(problem, 1e-9 * solution, Strain.LINEAR, sent_stress=s) for s in (sigma, other)
    )
    part = Part(np.array([3, 7], np.int32), np.zeros_like(mesh.points))
    v = signed_volumes(mesh.points, mesh.cells)[[3, 7]]
    below = v[0] * (sigma[3] ** 2).sum() + v[1] * (sigma[7] ** 2).sum()
    found = measure("stress_l2", problem, wrong, right, part)
    assert found.value == pytest.approx(math.sqrt(v[0] * 0.5 / below), rel=1e-12)
    elsewhere = Part(np.array([4, 7], np.int32), np.zeros_like(mesh.points))
    assert measure("stress_l2", problem, wrong, right, elsewhere).value == 0.0


@BOTH
def test_the_judges_own_stress_is_that_of_fastsim(problem: Problem, element: Element) -> None:
    hard = np.arange(0, problem.mesh.num_cells, 3, dtype=np.int32)
    mixed = dataclasses.replace(problem, inclusions=(Inclusion(hard, Material(4000.0, 0.2)),))
    for strain in Strain:
        found = run_fastsim(mixed, strain, in_silence, element=element)
        assert found.stresses is not None
        by_judge = dataclasses.replace(found, stresses=None)
        assert measure("stress_l2", mixed, found, by_judge, cells_of(mixed)).value <= 1e-12
        # What it says is judged, not what follows from its displacement.
        twice = CellStresses(found.stresses.second_piola_kirchhoff, 2.0 * found.stresses.cauchy)
        wrong = dataclasses.replace(found, stresses=twice)
        assert measure("stress_l2", mixed, wrong, by_judge, cells_of(mixed)).value == (
            pytest.approx(1.0)
        )


def test_the_second_piola_kirchhoff_stress_sent_for_cauchys_is_seen(
    problem: Problem, solution: Field
) -> None:
    right = state_of(problem, solution)
    found = run_fastsim(problem, Strain.GREEN, in_silence)
    assert found.stresses is not None
    sent = found.stresses.second_piola_kirchhoff
    wrong = state_of(problem, solution, sent_stress=sent)
    assert measure("stress_l2", problem, wrong, right, cells_of(problem)).value > 0.05
    sigma = found.stresses.cauchy
    F = np.eye(3) + body_of(problem, Strain.GREEN).gradient(solution)
    deviator = sigma - np.trace(sigma, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    for reported_stress, words in (
        (sent, "second Piola-Kirchhoff stress"),
        (-sigma, "compression positive"),
        (sigma / 1000.0, "in kPa"),
        (sigma / 1e6, "in MPa"),
        (deviator, "deviator"),
        (np.linalg.det(F)[:, None, None] * sigma, "Kirchhoff stress, det F"),
        (sigma, ""),
        (1.03 * sigma, ""),
    ):
        reported = measure(
            "stress_l2",
            problem,
            state_of(problem, solution, sent_stress=reported_stress),
            right,
            cells_of(problem),
        )
        assert words in reported.remark
        assert bool(words) == bool(reported.remark)
    broken = sent.copy()
    broken[5] = math.nan
    unusable = state_of(problem, solution, sent_stress=broken)
    assert measure("stress_l2", problem, unusable, right, cells_of(problem)).value == math.inf


@BOTH
def test_a_support_carries_the_loads_and_a_cut_what_lies_beyond(element: Element) -> None:
    mesh = brick_box((6, 2, 2), (3.0, 1.0, 1.0), ragged=0.2)
    facets = mesh.boundary_facets
    x = mesh.points[facets][:, :, 0]
    fixed = facets[(x < 1e-9).all(axis=1)]
    weight = BodyForce((0.0, 0.0, -9.0))
    problem = Problem(
        mesh, Material(1000.0, 0.3), (Support(np.unique(fixed).astype(np.int32), fixed),), (weight,)
    )
    u = solve_static(problem, element=element).displacement
    right = state_of(problem, u, element=element)
    still = dataclasses.replace(state_of(problem, 0.0 * u), element=element)
    # 27 N of weight; a solution without stress misses all but what lies on the fixed points.
    volumes = signed_volumes(mesh.points, mesh.cells)
    is_free = mesh.points[mesh.cells][:, :, 0] > 1e-9
    carried = 9.0 * (volumes * is_free.mean(axis=1)).sum()
    found = measure("traction_resultant", problem, still, right, support(problem))
    assert found.scale == pytest.approx(27.0, rel=1e-9)
    assert found.value * found.scale == pytest.approx(carried, rel=1e-7)
    # Through a cut goes the weight of the points beyond, a quarter of each of their cells.
    beyond = mesh.points[mesh.cells][:, :, 0] > 1.8
    share = (volumes * beyond.mean(axis=1)).sum()
    found = measure("traction_resultant", problem, still, right, cut(problem, 1.8))
    assert found.value * found.scale == pytest.approx(9.0 * share, rel=1e-7)
    # Too soft is not out of balance; a weight too small is.
    light = dataclasses.replace(problem, loads=(BodyForce((0.0, 0.0, -8.1)),))
    w = state_of(problem, solve_static(light, element=element).displacement, element=element)
    for part in (cut(problem, 1.8), support(problem)):
        found = measure("traction_resultant", problem, w, right, part)
        assert found.value * found.scale == pytest.approx(
            0.1 * (carried if part.support is not None else 9.0 * share), rel=1e-6
        )


def test_where_no_load_has_a_force_the_limit_is_in_newtons() -> None:
    """A body pressed from all sides: its supports carry nothing, and nothing scales."""
    mesh = brick_box((3, 3, 3), (1.0, 1.0, 1.0))
    axes = np.eye(3, dtype=bool)
    corner = np.flatnonzero((mesh.points == 0.0).all(axis=1)).astype(np.int32)
    pairs = [
        (np.flatnonzero((mesh.points == np.eye(3)[k]).all(axis=1)).astype(np.int32), axes[j])
        for k, j in ((0, 1), (0, 2), (1, 2))
    ]
    supports = (Support(corner), *(Support(p, components=tuple(c)) for p, c in pairs))
    problem = Problem(
        mesh, Material(1000.0, 0.3), supports, (Pressure(mesh.boundary_facets, 50.0),)
    )
    u = solve_static(problem).displacement
    right, wrong = state_of(problem, u), state_of(problem, 1.01 * u)
    found = measure("traction_resultant", problem, wrong, right, cut(problem, 0.5))
    assert found.scale == 1.0
    assert "1 N" in found.scale_name
    # The pressure on a face of 1 m2, 1 % of it, and what is not linear in it.
    assert found.value == pytest.approx(0.5, rel=0.1)


@BOTH
def test_the_reference_itself_on_a_finer_mesh_is_met_exactly(
    problem: Problem, solution: Field, element: Element
) -> None:
    own = refine_uniformly(problem.mesh)
    u = locate_points(problem.mesh, own).read(problem.mesh.cells, solution)
    right = state_of(problem, solution)
    mine = with_own_mesh(right, problem.mesh, OwnMesh(own, u[None]))
    for metric, part in (
        ("stress_l2", cells_of(problem)),
        ("traction_resultant", support(problem)),
        ("traction_resultant", cut(problem, 1.0)),
    ):
        found = measure(metric, problem, mine, right, part)
        assert found.value <= 1e-12
        assert found.uncertainty <= 1e-12
    # With smoothed strains it is another solution, and the doubt is not all of the difference.
    smoothed = dataclasses.replace(mine, element=element)
    found = measure("stress_l2", problem, smoothed, right, cells_of(problem))
    assert (found.value > 0.05) == (element is Element.SMOOTHED)


def test_an_own_mesh_is_read_within_its_doubt() -> None:
    """A smooth displacement on two meshes that have nothing in common."""
    case, own = (brick_box(n, (1.0, 1.0, 1.0), ragged=0.15) for n in ((4, 4, 4), (9, 7, 8)))
    problem = Problem(case, Material(1000.0, 0.3), (), ())

    def field(points: Field) -> Field:
        x, y, z = points.T
        return 0.01 * np.column_stack([np.sin(2.0 * y), x * z, np.cos(2.0 * x)])

    # Every cell of the case cut in 512 has the field nearly to itself.
    fine = case
    for _ in range(3):
        fine = refine_uniformly(fine)
    very_fine = Problem(fine, problem.material, (), ())
    sigma, P = Body(very_fine, Strain.LINEAR).stresses(field(fine.points))
    for _ in range(3):
        sigma, P = mean_over_parents(sigma), mean_over_parents(P)
    integrals = stress_integrals(case, CellStresses(sigma, sigma, P))
    assert integrals is not None
    right = state_of(problem, field(case.points), Strain.LINEAR, degree=2, integrals=integrals)
    at_points = state_of(problem, field(case.points), Strain.LINEAR)
    mine = with_own_mesh(at_points, case, OwnMesh(own, field(own.points)[None]))
    found = measure("stress_l2", problem, mine, right, cells_of(problem))
    assert found.value < 0.15
    assert 0.2 * found.value < found.uncertainty < 2.0 * found.value
    wrong = with_own_mesh(at_points, case, OwnMesh(own, 1.5 * field(own.points)[None]))
    found = measure("stress_l2", problem, wrong, right, cells_of(problem))
    assert found.value - found.uncertainty > 0.3


def test_means_of_a_refined_mesh_are_means_of_the_cells_they_came_from() -> None:
    mesh = brick_box((2, 1, 1), (2.0, 1.0, 1.0), ragged=0.2)
    finer = refine_uniformly(mesh)
    # The middle of a cell is the mean of the middles of its eight, of equal volume.
    middles = mean_over_parents(finer.points[finer.cells].mean(axis=1))
    assert np.abs(middles - mesh.points[mesh.cells].mean(axis=1)).max() <= 1e-14
    volumes = signed_volumes(finer.points, finer.cells)
    expected = signed_volumes(mesh.points, mesh.cells) / 8.0
    assert np.abs(mean_over_parents(volumes) - expected).max() <= 1e-15


def test_a_metric_of_a_part_says_that_it_needs_one(problem: Problem, solution: Field) -> None:
    state = state_of(problem, solution)
    with pytest.raises(InputError, match="say which"):
        measure("stress_l2", problem, state, state)
