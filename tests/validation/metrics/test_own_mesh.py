"""Garbage anywhere on a candidate's own mesh fails; an honest solution on another mesh does not."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bank import made_state
from numpy.typing import NDArray

from palpate.fastsim.statics import solve_static
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Support, Traction
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Inclusion, Material, Problem, Strain, TimeSpan
from palpate.meshes.refinement import refine_uniformly
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.candidates.result_states import with_own_mesh
from palpate.validation.case.schema import CheckSpec
from palpate.validation.exchange.point_location import locate, locate_points
from palpate.validation.judging.checks import judge_check
from palpate.validation.metrics import CATALOGUE, comparison, measure
from palpate.validation.metrics.body import body_of
from palpate.validation.metrics.difference import Difference
from palpate.validation.metrics.own_mesh import own_reactions
from palpate.validation.states import OwnMesh, State, Trajectory, Verdict

Field = NDArray[np.float64]
# What does not depend on a mesh: the force on a tool, and how one point of the case swings.
AT_POINTS = {"tool_force", *(name for name in CATALOGUE if name.startswith("oscillation_"))}
IN_SPACE = sorted(
    metric.name
    for metric in CATALOGUE.values()
    if metric.error and not metric.needs_time and metric.name not in AT_POINTS
)
# What garbage within the body cannot change: the surface and what it encloses.
OF_SURFACE = {"volume", "surface_area", "surface_hausdorff", "surface_mean_distance"}
# Sizes of whole bodies hardly feel one point.
OF_WHOLE = {"displacement_l2", "surface_mean_distance", "volume", "surface_area", "local_volume"}


def bar(divisions: tuple[int, int, int]) -> Problem:
    """A bar held at x = 0, pulled sideways at x = 2."""
    mesh = brick_box(divisions, (2.0, 1.0, 1.0), ragged=0.2)
    facets = mesh.boundary_facets
    x = mesh.points[facets][:, :, 0]
    fixed, pulled = facets[(x < 1e-9).all(axis=1)], facets[(x > 2.0 - 1e-9).all(axis=1)]
    return Problem(
        mesh,
        Material(1000.0, 0.3),
        (Support(np.unique(fixed).astype(np.int32), fixed),),
        (Traction(pulled, (60.0, 20.0, -10.0)), BodyForce((0.0, 0.0, -20.0))),
    )


CASE = bar((6, 3, 3))


@lru_cache(maxsize=8)
def solved(divisions: tuple[int, int, int]) -> tuple[Problem, Field]:
    problem = bar(divisions)
    return problem, solve_static(problem, strain=Strain.GREEN).displacement


def state_of(problem: Problem, displacement: Field, *, degree: int = 1) -> State:
    return made_state(problem.mesh, displacement, degree=degree)


def solution(own: TetMesh, displacement: Field) -> State:
    """A solution to CASE on another mesh."""
    location = locate(own.points, own.cells, CASE.mesh.points)
    read = state_of(CASE, location.read(own.cells, displacement))
    return with_own_mesh(read, CASE.mesh, OwnMesh(own, displacement[None]))


def same_on_finer() -> tuple[TetMesh, Field]:
    """The reference itself on the case's mesh cut in eight: nothing differs anywhere."""
    own = refine_uniformly(CASE.mesh)
    u = solved((6, 3, 3))[1]
    return own, locate_points(CASE.mesh, own).read(CASE.mesh.cells, u)


REFERENCE = state_of(CASE, solved((6, 3, 3))[1])


def judged(metric: str, candidate: State, limit: float, reference: State = REFERENCE) -> Verdict:
    spec = CheckSpec(metric=metric, limit=limit, reason="r")
    return judge_check(spec, Strain.GREEN, CASE, candidate, reference, 0.0, "").verdict


def test_every_comparison_is_made_on_the_own_mesh_or_depends_on_none() -> None:
    at_points = {metric.name for metric in CATALOGUE.values() if metric.compare}
    assert at_points == AT_POINTS - {"tool_force"}


# Not of a support's force: on the finer mesh the reference is no longer in balance.
@pytest.mark.parametrize("metric", sorted(set(IN_SPACE) - {"reaction_force"}))
def test_the_reference_itself_on_a_finer_mesh_is_met_exactly(metric: str) -> None:
    found = measure(metric, CASE, solution(*same_on_finer()), REFERENCE)
    assert found.value < 1e-9
    assert found.uncertainty < 1e-9


def perturbed(where: str) -> tuple[TetMesh, Field]:
    """Garbage at points that the case does not have; what is read at the case's is right."""
    own, u = same_on_finer()
    is_new = np.arange(own.num_points) >= CASE.mesh.num_points
    is_border = np.zeros(own.num_points, dtype=bool)
    is_border[np.unique(own.boundary_facets)] = True
    rows = np.flatnonzero(
        {"all": is_new, "inside": is_new & ~is_border, "border": is_new & is_border}[where]
    )
    u = u.copy()
    u[rows] += np.random.default_rng(0).uniform(-0.3, 0.3, (len(rows), 3))
    return own, u


@pytest.mark.parametrize("where", ["all", "inside", "border"])
@pytest.mark.parametrize("metric", IN_SPACE)
def test_garbage_between_the_cases_points_fails(metric: str, where: str) -> None:
    own, u = perturbed(where)
    candidate = solution(own, u)
    # At the case's points alone nothing is to be seen.
    bare = dataclasses.replace(candidate, own=None)
    np.testing.assert_allclose(bare.displacement, REFERENCE.displacement, atol=1e-7)
    # Displacements reach 0.4 m, garbage 0.3 m: a tenth of any scale is left far behind.
    verdict = judged(metric, candidate, 0.02 if metric in OF_WHOLE else 0.1)
    is_blind = where == "inside" and metric in OF_SURFACE
    if metric == "reaction_force" and where == "inside":
        # Which points are held is not known for sure, so that it may be left open.
        assert verdict is not Verdict.PASSED
        return
    assert verdict is (Verdict.PASSED if is_blind else Verdict.FAILED)


@pytest.mark.parametrize("metric", sorted(set(IN_SPACE) - OF_WHOLE - {"reaction_force"}))
def test_a_single_garbage_point_of_the_own_mesh_fails(metric: str) -> None:
    own, u = same_on_finer()
    u = u.copy()
    edge = np.flatnonzero((own.points[:, 0] > 1.0) & (own.points[:, 2] > 1.0 - 1e-9))
    u[edge[edge >= CASE.mesh.num_points][0]] += [0.0, 0.0, 1.0]
    assert judged(metric, solution(own, u), 0.1) is Verdict.FAILED


@pytest.mark.parametrize("metric", ["inverted_cells", "smallest_det_f"])
@pytest.mark.parametrize("where", ["all", "inside", "border"])
def test_own_cells_turned_inside_out_fail(metric: str, where: str) -> None:
    spec = CheckSpec(metric=metric, against="candidate", limit=0.0, reason="r")
    check = judge_check(spec, Strain.GREEN, CASE, solution(*perturbed(where)), None, 0.0, "")
    assert check.verdict is Verdict.FAILED
    right = judge_check(spec, Strain.GREEN, CASE, solution(*same_on_finer()), None, 0.0, "")
    assert right.verdict is Verdict.PASSED


@pytest.mark.parametrize("divisions", [(4, 2, 2), (9, 5, 4), (12, 6, 6)])
@pytest.mark.parametrize("metric", sorted(set(IN_SPACE) - {"reaction_force"}))
def test_an_honest_solution_is_as_good_on_its_own_mesh_as_at_the_cases_points(
    metric: str, divisions: tuple[int, int, int]
) -> None:
    # The truth at the case's points: twelve cells along, of which every other point is one.
    fine, u = solved((12, 6, 6))
    at = locate(fine.mesh.points, fine.mesh.cells, CASE.mesh.points)
    truth = state_of(CASE, at.read(fine.mesh.cells, u), degree=2)
    problem, displacement = solved(divisions)
    candidate = solution(problem.mesh, displacement)
    own = measure(metric, CASE, candidate, truth)
    at_points = measure(metric, CASE, dataclasses.replace(candidate, own=None), truth)
    assert np.isfinite(own.uncertainty)
    if metric in ("displacement_h1", "energy_norm", "local_volume", "strain_energy"):
        # Gradients of what was read at the points are not those of the solution: no more is known.
        return
    # A thousandth for the edges of the clamped end, where no polynomial is near.
    assert own.value - own.uncertainty <= at_points.value + 1e-3


def test_a_verdict_that_the_reading_leaves_open_says_what_to_do() -> None:
    fine, u = solved((12, 6, 6))
    at = locate(fine.mesh.points, fine.mesh.cells, CASE.mesh.points)
    truth = state_of(CASE, at.read(fine.mesh.cells, u), degree=2)
    candidate = solution(fine.mesh, u)
    found = measure("displacement_max", CASE, candidate, truth)
    assert found.uncertainty > 1e-3
    spec = CheckSpec(metric="displacement_max", limit=found.value, reason="r")
    check = judge_check(spec, Strain.GREEN, CASE, candidate, truth, 0.0, "")
    assert check.verdict is Verdict.INCONCLUSIVE
    assert "send the result at the case's points" in check.message
    assert "palpate reference build" in check.message
    assert check.reference_error == pytest.approx(found.uncertainty, rel=1e-12)


def test_support_forces_are_summed_on_the_own_mesh() -> None:
    # In equilibrium the support carries the loads: of every mesh, to what the solver leaves.
    for divisions in ((4, 2, 2), (9, 5, 4)):
        problem, u = solved(divisions)
        found = measure("reaction_force", CASE, solution(problem.mesh, u), REFERENCE)
        assert found.value < 1e-6
        carried = body_of(problem, Strain.GREEN).support_reactions(u)[0]
        np.testing.assert_allclose(carried, [-60.0, -20.0, 50.0], rtol=1e-6, atol=3.4)
        halved = measure("reaction_force", CASE, solution(problem.mesh, 0.5 * u), REFERENCE)
        assert halved.value - halved.uncertainty > 0.1


def test_on_the_cases_own_mesh_a_support_has_all_of_its_force() -> None:
    """Out of balance by a doubled displacement, and yet nothing may belong elsewhere."""
    u = solved((6, 3, 3))[1]
    right, doubled = state_of(CASE, u), state_of(CASE, 2.0 * u)
    error, doubt = own_reactions(CASE, CASE, 2.0 * u, doubled, right)
    assert error > 10.0
    assert doubt < 1e-9


@pytest.mark.parametrize(
    ("sideways", "is_open"), [((0.0, 1.0, 0.0), False), ((1.0, 1.0, 0.0), True)]
)
def test_two_supports_share_a_force_where_they_meet_unless_they_are_square_to_each_other(
    sideways: tuple[float, float, float], is_open: bool
) -> None:
    x, y, _ = CASE.mesh.points.T
    walls = tuple(
        Support(np.flatnonzero(at < 1e-9).astype(np.int32), normal=normal)
        for at, normal in ((x, (1.0, 0.0, 0.0)), (y, sideways))
    )
    problem = dataclasses.replace(CASE, supports=walls, loads=CASE.loads[1:])
    moved = 1e-2 * np.random.default_rng(1).normal(size=CASE.mesh.points.shape)
    state = state_of(problem, moved)
    doubt = own_reactions(problem, problem, moved, state, state)[1]
    assert (doubt > 1.0) is is_open
    assert is_open or doubt < 1e-9


def test_a_load_beside_a_support_leaves_its_force_open() -> None:
    problem, u = solved((9, 5, 4))
    beside = np.flatnonzero(CASE.mesh.points[:, 0] == CASE.mesh.points[:, 0].min())[:1]
    pushed = dataclasses.replace(
        CASE, loads=(*CASE.loads, PointForce(beside.astype(np.int32), np.array([[0.0, 7.0, 0.0]])))
    )
    found = measure("reaction_force", pushed, solution(problem.mesh, u), REFERENCE)
    # 7 N of a support that feels |(60, 20, -50)| N, 80.6 N.
    assert found.value + found.uncertainty >= 7.0 / 82.7


def test_a_pressure_beside_a_support_is_taken_where_the_solution_has_moved_it() -> None:
    # The case's own mesh sent as a mesh of one's own: then nothing differs, wherever one pushes.
    above = CASE.mesh.points[CASE.mesh.boundary_facets][:, :, 2]
    top = CASE.mesh.boundary_facets[(above > 1.0 - 1e-9).all(axis=1)]
    pressed = dataclasses.replace(CASE, loads=(*CASE.loads, Pressure(top, 30.0)))
    u = solve_static(pressed, strain=Strain.GREEN).displacement
    found = measure(
        "reaction_force", pressed, solution(CASE.mesh, u), state_of(pressed, np.asarray(u))
    )
    assert found.value - found.uncertainty <= 0.0
    assert (
        own_reactions(pressed, pressed, u, state_of(pressed, u), state_of(pressed, u))[0] < 1e-6
    )  # N, of some 100 N
    doubled = state_of(pressed, 2.0 * u)
    assert own_reactions(pressed, pressed, 2.0 * u, doubled, state_of(pressed, u))[0] > 10.0


def test_a_solution_sent_finer_than_it_was_solved_does_not_fail_by_its_weight() -> None:
    # The weight is lumped at other points then, which no support has to carry differently.
    found = measure("reaction_force", CASE, solution(*same_on_finer()), REFERENCE)
    assert found.value <= found.uncertainty * (1.0 + 1e-9)
    # All of the weight, 20 N/m3 of 2 m3, of a support that feels |(60, 20, -50)| N.
    assert found.uncertainty < 40.0 / 80.6


def test_loads_count_in_support_forces_with_their_factor_at_the_end() -> None:
    halved = TabularAmplitude((0.0, 1.0), (0.0, 0.5))
    u = solved((6, 3, 3))[1]
    moving = dataclasses.replace(
        CASE,
        time=TimeSpan(1.0, 1e-4, 0.0, 1),
        loads=(BodyForce((0.0, 0.0, -40.0), halved), dataclasses.replace(CASE.loads[0])),
    )
    # Half of 40 N/m3 at the end are the 20 N/m3 that CASE has: the same balance.
    found = body_of(moving, Strain.GREEN).support_reactions(u)
    np.testing.assert_allclose(found, body_of(CASE, Strain.GREEN).support_reactions(u), rtol=1e-12)
    at_rest = state_of(moving, u)
    error, _doubt = own_reactions(moving, moving, u, at_rest, at_rest)
    assert error < 1e-6


def test_an_own_cell_has_the_material_of_the_cases_cell_that_holds_its_middle() -> None:
    stiff = np.flatnonzero(CASE.mesh.points[CASE.mesh.cells].mean(axis=1)[:, 0] > 1.0)
    part = Inclusion(stiff.astype(np.int32), Material(5000.0, 0.2))
    mixed = dataclasses.replace(CASE, inclusions=(part,))
    own, u = same_on_finer()
    assert measure("strain_energy", mixed, solution(own, u), REFERENCE).value < 1e-9
    # The energy of one material would be another: the inclusion counts.
    whole = body_of(mixed, Strain.GREEN).energy(REFERENCE.displacement)
    assert abs(whole / body_of(CASE, Strain.GREEN).energy(REFERENCE.displacement) - 1.0) > 0.1


def test_a_body_whose_rest_volume_differs_leaves_its_change_of_volume_open() -> None:
    own, u = same_on_finer()
    # A hundredth longer: so is the volume, and the change of it cannot be known any better.
    longer = TetMesh(own.points * [1.01, 1.0, 1.0], own.cells)
    found = measure("volume", CASE, solution(longer, u), REFERENCE)
    change = abs(REFERENCE.volume / CASE.mesh.volume - 1.0)
    assert change > 0.01
    candidate = solution(longer, u)
    moved = abs(candidate.volume - CASE.mesh.volume) / abs(REFERENCE.volume - CASE.mesh.volume)
    assert found.uncertainty == pytest.approx(0.01 * moved, rel=1e-6)


def test_garbage_at_one_time_of_a_motion_fails_its_trajectory() -> None:
    moving = dataclasses.replace(CASE, time=TimeSpan(1.0, num_outputs=4))
    times, own = np.linspace(0.0, 1.0, 5), refine_uniformly(CASE.mesh)
    right = np.linspace(0.0, 1.0, 5)[:, None, None] * same_on_finer()[1]
    theirs = np.linspace(0.0, 1.0, 5)[:, None, None] * REFERENCE.displacement
    reference = dataclasses.replace(REFERENCE, trajectory=Trajectory(times, theirs))

    def found(states: Field) -> Difference:
        candidate = dataclasses.replace(
            solution(own, states[-1]),
            trajectory=Trajectory(times, theirs),
            sent=Trajectory(times, theirs),
            own=OwnMesh(own, states),
        )
        return measure("trajectory_l2", moving, candidate, reference)

    assert found(right).value < 1e-9
    spoilt = right.copy()
    spoilt[2, CASE.mesh.num_points :] *= -1.0
    worst = found(spoilt)
    # Most points are the own mesh's, half way at that time: about as far off as the end is large.
    assert worst.value - worst.uncertainty > 0.5


@pytest.mark.parametrize("value", [1e308, np.inf, np.nan])
@pytest.mark.parametrize("metric", IN_SPACE)
def test_numbers_that_overflow_on_the_own_mesh_never_pass(metric: str, value: float) -> None:
    own, u = same_on_finer()
    u = u.copy()
    u[-1, 1] = value
    candidate = dataclasses.replace(
        solution(*same_on_finer()), own=OwnMesh(own, u[None]), volume=np.inf, surface_area=np.inf
    )
    assert judged(metric, candidate, 0.1) is Verdict.FAILED


def test_the_largest_displacement_of_the_reference_is_known_within_the_doubt_of_reading_it() -> (
    None
):
    # Read as 3 +- 0.5 between the case's points, 2 at most at them: 2.5 to 3.5.
    three = np.array([[3.0, 0.0, 0.0]])
    pair: Any = SimpleNamespace(
        read=SimpleNamespace(value=three, doubt=np.array([0.5])),
        displacement=three,
        is_own=True,
        candidate=SimpleNamespace(displacement=three),
        reference=SimpleNamespace(max_displacement=2.0),
    )
    assert comparison.max_displacement(pair) == (0.0, 0.5)
    pair.reference = SimpleNamespace(max_displacement=3.2)
    error, doubt = comparison.max_displacement(pair)
    assert (error, doubt) == (pytest.approx(0.35), pytest.approx(0.15))
