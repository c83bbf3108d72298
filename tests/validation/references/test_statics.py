"""Truths solved on the spot: their bars hold the error where the answer is known."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from bank import made_state

from palpate.meshes.boundary_conditions import PointForce, Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.reference.adaptivity.error_bars import error_bar_of_few, error_bar_of_two
from palpate.reference.adaptivity.goals import Budget
from palpate.reference.result import LOST, AdaptiveResult
from palpate.validation.case import load_case
from palpate.validation.metrics import WHOLE_BODY_METRICS, measure
from palpate.validation.metrics.body import dead_force
from palpate.validation.references import statics
from palpate.validation.references.adaptive_truth import TruthRequest
from palpate.validation.references.bars import has_point_forces, without_limits
from palpate.validation.references.reference_set import QUADRATIC, SAME_MESH, TRUTH
from palpate.validation.references.statics import estimate_bars, graded_bars, solve_live
from palpate.validation.references.stored import load_stored
from palpate.validation.states import State, StressIntegrals


def quiet(_line: str) -> None:
    pass


def state(problem: Problem, factor: float, strain: Strain = Strain.LINEAR) -> State:
    return made_state(problem.mesh, factor * problem.mesh.points, strain=strain)


@pytest.fixture(scope="module")
def block() -> Problem:
    return load_case("block").problem


def test_p1_more_than_half_away_shows_nothing(block: Problem) -> None:
    def bars(linear: float) -> dict[str, float]:
        states = {
            (SAME_MESH, Strain.LINEAR): state(block, linear),
            (QUADRATIC, Strain.LINEAR): state(block, 0.01),
        }
        found = estimate_bars(block, states)
        assert set(found) == {(metric, Strain.LINEAR) for metric in WHOLE_BODY_METRICS}
        return {metric: bar for (metric, _), bar in found.items()}

    assert bars(0.006)["displacement_l2"] == pytest.approx(0.4)
    assert bars(0.0049)["displacement_l2"] == math.inf


def test_numbers_that_agree_by_chance_have_no_bar_of_nothing(block: Problem) -> None:
    fine = state(block, 0.01)

    def bars(coarse: State) -> dict[str, float]:
        alike = dataclasses.replace(
            coarse, volume=fine.volume, max_displacement=fine.max_displacement
        )
        states = {(SAME_MESH, Strain.LINEAR): alike, (QUADRATIC, Strain.LINEAR): fine}
        return {metric: bar for (metric, _), bar in estimate_bars(block, states).items()}

    near = bars(state(block, 0.008))
    assert near["max_displacement"] == near["displacement_max"] == pytest.approx(0.2)
    assert set(bars(state(block, 0.001)).values()) == {math.inf}


def test_two_meshes_have_a_wider_bar_than_three() -> None:
    # Estimates that halve: what is left is the difference, three times over.
    assert error_bar_of_two(0.01, (0.04, 0.02)) == pytest.approx(0.03)
    # A faster rate is never believed, a slower one is.
    assert error_bar_of_two(0.01, (0.04, 0.001)) == pytest.approx(0.03)
    assert error_bar_of_two(0.01, (0.04, 0.03)) == pytest.approx(0.09)
    assert error_bar_of_two(0.01, (0.04, 0.039)) == math.inf
    assert error_bar_of_two(math.inf, (0.04, 0.02)) == math.inf


def test_three_meshes_near_to_each_other_have_the_bar_of_the_first_and_the_last() -> None:
    # The second difference is no smaller than the first; the estimates halve in two steps.
    near = error_bar_of_few(math.inf, [0.01, 0.01], [0.04, 0.03, 0.02])
    assert near == error_bar_of_two(0.0201, (0.04, 0.02))
    # A faster rate is believed as far as three meshes are.
    fast = error_bar_of_few(math.inf, [0.01, 0.01], [0.04, 0.02, 0.012])
    assert fast == pytest.approx(3.0 * 0.0201 * 0.3 / 0.7)
    faster = error_bar_of_few(math.inf, [0.01, 0.01], [0.04, 0.02, 0.001])
    assert faster == pytest.approx(3.0 * 0.0201 * 0.25 / 0.75)
    assert error_bar_of_few(math.inf, [0.01, 0.01], [0.04, 0.039, 0.038]) == math.inf
    assert error_bar_of_few(math.inf, [0.01], [0.04, 0.02]) == error_bar_of_two(0.01, (0.04, 0.02))
    # A bar that there is stays, and more meshes than three that do not settle have none.
    assert error_bar_of_few(0.05, [0.01, 0.01], [0.04, 0.03, 0.02]) == 0.05
    assert error_bar_of_few(math.inf, [0.01] * 3, [0.04, 0.03, 0.02, 0.01]) == math.inf


def result(problem: Problem, meshes: int, ended: str = "", bars: float = 0.002) -> AdaptiveResult:
    """Of so many meshes, each half as far from the next."""
    names = tuple(WHOLE_BODY_METRICS)
    shape = (meshes, len(names))
    halving = 0.1 * 0.5 ** np.arange(meshes)[:, None] * np.ones(shape)
    return AdaptiveResult(
        displacement=0.01 * problem.mesh.points,
        strain=Strain.LINEAR,
        degree=2,
        load_factor=1.0,
        converged=True,
        relative_residual=0.0,
        smallest_det_f=1.0,
        volume=problem.mesh.volume,
        surface_area=problem.mesh.surface_area,
        rest_volume=problem.mesh.volume,
        rest_surface_area=problem.mesh.surface_area,
        strain_energy=1.0,
        newton_iterations=1,
        support_forces=np.ones((len(problem.supports), 3)),
        quantities=names,
        num_cells=np.arange(meshes),
        estimates=halving,
        differences=halving,
        bars=np.full(shape, bars),
        ended=ended,
    )


def test_the_bars_of_graded_meshes_are_those_of_stored_truths(block: Problem) -> None:
    assert graded_bars(block, Strain.LINEAR, result(block, 1)) == {}
    assert graded_bars(block, Strain.LINEAR, result(block, 2))["volume"] == pytest.approx(0.15)
    assert graded_bars(block, Strain.LINEAR, result(block, 3))["volume"] == 0.002
    unsettled = result(block, 3, bars=math.inf)
    assert graded_bars(block, Strain.LINEAR, unsettled)["volume"] == math.inf
    judged = graded_bars(block, Strain.LINEAR, unsettled, is_judged=True)
    # The first of three has four times the estimate of the last.
    assert judged["volume"] == pytest.approx(3.0 * (0.025 + 1.025 * 0.05) * 0.25 / 0.75)
    lost = result(block, 2, f"{LOST}, 900 cells", math.inf)
    assert set(graded_bars(block, Strain.LINEAR, lost).values()) == {math.inf}


def pulled_at_a_point(problem: Problem) -> Problem:
    load = PointForce(np.array([3], dtype=np.int32), np.array([[0.0, 0.0, 1.0]]))
    return dataclasses.replace(problem, loads=(load,))


def test_forces_on_points_leave_bars_of_integrals_alone(block: Problem) -> None:
    pulled = pulled_at_a_point(block)
    bars = dict.fromkeys(WHOLE_BODY_METRICS, 0.01)
    assert without_limits(block, Strain.GREEN, bars) == bars
    assert set(without_limits(pulled, Strain.GREEN, bars).values()) == {math.inf}
    linear = without_limits(pulled, Strain.LINEAR, bars)
    assert linear.pop("displacement_l2") == 0.01
    assert set(linear.values()) == {math.inf}
    of_two = graded_bars(pulled, Strain.LINEAR, result(pulled, 2))
    assert math.isfinite(of_two.pop("displacement_l2"))
    assert set(of_two.values()) == {math.inf}


def test_a_single_point_that_is_fixed_counts_where_it_carries_force(block: Problem) -> None:
    none = np.zeros((0, 3), dtype=np.int32)
    pin = Support(np.array([0], dtype=np.int32), none)
    pinned = dataclasses.replace(block, supports=(*block.supports, pin))
    # In balance with the loads there, it holds nothing.
    forces = dead_force(pinned)
    forces[1] = 2.0
    stresses = np.zeros((block.mesh.num_cells, 3, 3))
    reported = dataclasses.replace(state(block, 0.01), integrals=StressIntegrals(stresses, forces))
    assert not has_point_forces(pinned, reported)
    forces[0] += 1e-3
    assert has_point_forces(pinned, reported)
    # Along x alone: that is another support's, or a load's.
    roller = dataclasses.replace(pin, components=(False, False, True))
    rolling = dataclasses.replace(block, supports=(*block.supports, roller))
    forces[0] = dead_force(rolling)[0] + [1e-3, 0.0, 0.0]
    assert not has_point_forces(rolling, reported)
    # Nothing is known of its force.
    assert has_point_forces(pinned)
    assert not has_point_forces(block)


def test_a_budget_of_no_unknowns_is_refused() -> None:
    with pytest.raises(InputError, match="0 unknowns"):
        Budget(unknowns=0.0)


@pytest.mark.dolfinx
@pytest.mark.long
@pytest.mark.nightly
def test_on_a_slender_bar_the_bar_is_small_and_holds_the_error() -> None:
    """P1 and P2 are 97 % apart there; the stored truth is known to 0.003 %."""
    case = load_case("sze")
    stored = load_stored("sze", case.problem)
    request = TruthRequest(0.01, metrics={Strain.LINEAR: ("displacement_l2", "volume")})
    found = solve_live(case.problem, quiet, request=request, has_stress=False)
    truth, known = found.truth(Strain.LINEAR), stored.truth(Strain.LINEAR)
    assert truth is found.states[TRUTH, Strain.LINEAR]
    assert known is not None
    assert (QUADRATIC, Strain.LINEAR) not in found.states
    for metric in ("displacement_l2", "displacement_max", "volume", "surface_area"):
        bar = found.bars[metric, Strain.LINEAR]
        error = measure(metric, case.problem, truth, known).value
        assert error <= bar + stored.bars[metric, Strain.LINEAR]
        assert bar <= 0.01
    assert any("97% apart" in line and "linear strain" in line for line in found.remarks)
    assert any("every bar is met" in line for line in found.remarks)


@pytest.mark.dolfinx
@pytest.mark.long
def test_without_room_for_a_second_mesh_p1_says_how_far_p2_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mesh = brick_box((4, 2, 2), (2.0, 1.0, 1.0))
    facets = mesh.boundary_facets
    fixed = facets[(mesh.points[facets][:, :, 0] < 1e-9).all(axis=1)]
    support = Support(np.unique(fixed).astype(np.int32), fixed)
    problem = pulled_at_a_point(Problem(mesh, Material(1e3, 0.3), (support,), ()))
    monkeypatch.setattr(statics, "UNKNOWNS", 900.0)
    found = solve_live(problem, quiet)
    assert (TRUTH, Strain.LINEAR) not in found.states
    truth = found.truth(Strain.LINEAR)
    assert truth is found.states[QUADRATIC, Strain.LINEAR]
    linear = found.states[SAME_MESH, Strain.LINEAR]
    apart = measure("displacement_l2", problem, linear, truth).value
    assert found.bars["displacement_l2", Strain.LINEAR] == pytest.approx(apart)
    assert {bar for (m, s), bar in found.bars.items() if s is Strain.GREEN} == {math.inf}
    assert found.bars["max_displacement", Strain.LINEAR] == math.inf
    assert "differences from P1" in found.origin
