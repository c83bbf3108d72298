"""A motion has a truth: implicit, quadratic, with bars; it asks no time step of the candidate."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
from bank import made_state
from judged import judge

from palpate.fastsim.dynamics import simulate
from palpate.meshes.problem import Element, Problem, Strain, TimeSpan
from palpate.reference.errors import ReferenceStepError, ReferenceUnavailableError
from palpate.validation.candidates.candidate import fastsim_candidate, result_candidate
from palpate.validation.candidates.faults import Fault, with_fault
from palpate.validation.case import load_case
from palpate.validation.judging.case_references import find_references
from palpate.validation.judging.checks import judge_check
from palpate.validation.metrics import measure
from palpate.validation.metrics.grid_convergence import Convergence
from palpate.validation.references import motions
from palpate.validation.references.motions import (
    STEPS,
    assess_sequence,
    difference,
    refine_where_rough,
    solve_motion_set,
)
from palpate.validation.references.reference_set import QUADRATIC, SAME_MESH
from palpate.validation.states import State, Trajectory, Verdict

SPEED = math.sqrt(0.3 / (1.3 * 0.4) + 1.0 / 1.3)  # of confined waves, E = 1, nu = 0.3, rho = 1


def truth_of(name: str) -> State:
    case = load_case(name)
    truth = find_references(case, live=False, progress=lambda _line: None).truth(case.strain)
    assert truth is not None
    assert truth.trajectory is not None
    return truth


def moved_otherwise(state: State, displacements: np.ndarray) -> State:  # type: ignore[type-arg]
    """The same times with other displacements."""
    assert state.trajectory is not None
    motion = Trajectory(state.trajectory.times, displacements)
    return dataclasses.replace(state, displacement=displacements[-1], trajectory=motion)


def slower(state: State, factor: float) -> State:
    """The same motion with time stretched."""
    motion = state.trajectory
    assert motion is not None
    early = motion.times / factor
    flat = motion.displacements.reshape(len(motion.times), -1)
    fields = np.array([np.interp(early, motion.times, column) for column in flat.T]).T
    return moved_otherwise(state, fields.reshape(motion.displacements.shape))


def test_the_numbers_of_the_wave_cases_are_the_closed_forms() -> None:
    expected = {
        (name, check.quantity): check.expected
        for name in ("wave", "decay")
        for check in load_case(name).checks
        if check.metric == "published_oscillation"
    }
    omega = 0.5 * math.pi * SPEED  # L = 1
    damped = math.sqrt(omega**2 - 0.1**2)
    assert expected["wave", "frequency"] == pytest.approx(SPEED / 4.0, rel=1e-14)
    assert expected["wave", "amplitude"] == pytest.approx(
        16.0 * 1e-3 / (math.pi**3 * SPEED**2), rel=1e-14
    )
    assert expected["decay", "frequency"] == pytest.approx(damped / (2.0 * math.pi), rel=1e-14)
    assert expected["decay", "damping"] == 0.1
    span = load_case("wave").problem.time
    assert span is not None
    assert span.end_time == pytest.approx(20.0 / SPEED, rel=1e-14)  # five periods


@pytest.mark.parametrize(
    ("name", "fault", "metric"),
    [
        ("wave", Fault.WRONG_MASS, "published_oscillation"),
        ("wave", Fault.SOFTER, "published_oscillation"),
        ("wave", Fault.SWAPPED_LAME, "oscillation_frequency"),
        ("decay", Fault.NO_DAMPING, "published_oscillation"),
        ("decay", Fault.WRONG_MASS, "oscillation_frequency"),
        ("wave", Fault.DROPPED_LOAD, "published_oscillation"),
    ],
)
@pytest.mark.long
def test_faults_of_motion_are_seen_without_the_twin(name: str, fault: Fault, metric: str) -> None:
    result = judge(load_case(name), candidate=with_fault(fastsim_candidate(), fault))
    failed = [c for c in result.checks if c.verdict is Verdict.FAILED and c.against != "same_mesh"]
    assert metric in {check.metric for check in failed}


@pytest.mark.parametrize("name", ["wave", "decay", "csm3"])
def test_the_truth_of_a_motion_is_compared_with_the_published_numbers(name: str) -> None:
    case = load_case(name)
    truth = truth_of(name)
    specs = [c for c in case.checks if c.against == "truth" and c.quantity == "frequency"]
    specs = [spec for spec in specs if spec.metric == "published_oscillation"]
    assert specs
    for spec in specs:
        for state, bar, wanted in (
            (truth, 0.0, Verdict.PASSED),
            (slower(truth, 1.02), 0.0, Verdict.FAILED),
            (truth, math.inf, Verdict.INCONCLUSIVE),
            (None, 0.0, Verdict.INCONCLUSIVE),
        ):
            found = judge_check(
                spec, case.strain, case.problem, None, state, bar, "", case.spec.units
            )
            assert found.verdict is wanted, found.message


def test_a_candidate_that_does_not_swing_has_failed() -> None:
    case = load_case("wave")
    still = truth_of("wave")
    assert still.trajectory is not None
    rest = Trajectory(still.trajectory.times, 0.0 * still.trajectory.displacements)
    still = dataclasses.replace(still, trajectory=rest)
    spec = next(c for c in case.checks if c.quantity == "amplitude" and c.against == "candidate")
    found = judge_check(spec, case.strain, case.problem, still, None, 0.0, "", case.spec.units)
    assert found.verdict is Verdict.FAILED
    assert "oscillate" in found.message


@pytest.mark.long
@pytest.mark.nightly
def test_a_candidate_with_steps_of_its_own_is_judged_by_the_truth(tmp_path: Path) -> None:
    case = load_case("decay")
    span = case.problem.time
    assert span is not None
    assert span.time_step is not None
    own = dataclasses.replace(span, time_step=span.time_step / 3.0, num_outputs=400)
    run = simulate(dataclasses.replace(case.problem, time=own), strain=case.strain)
    path = tmp_path / "result.npz"
    np.savez(path, displacement=run.displacements, times=run.times)
    result = judge(case, candidate=result_candidate(path))
    by_kind = {(c.metric, c.against): c.verdict for c in result.checks}
    assert by_kind["trajectory_l2", "truth"] is Verdict.PASSED
    assert by_kind["oscillation_frequency", "truth"] is Verdict.PASSED
    # The explicit run takes the case's steps: other ones are seen there, as they should.
    assert by_kind["trajectory_l2", "same_mesh"] is Verdict.FAILED


def swinging(frequency: float) -> tuple[Problem, State]:
    problem = load_case("wave").problem
    assert problem.time is not None
    times = np.linspace(0.0, problem.time.end_time, problem.time.num_outputs + 1)
    shape = 1e-3 * problem.mesh.points * [1.0, 0.0, 0.0]
    fields = np.cos(2.0 * math.pi * frequency * times)[:, None, None] * shape
    return problem, made_state(problem.mesh, fields[-1], trajectory=Trajectory(times, fields))


def test_swings_that_meet_at_the_end_by_chance_are_not_near_each_other() -> None:
    problem, one = swinging(0.3)
    span = problem.time
    assert span is not None
    # cos is even: as far on one side of a turning point as the other is on the other one.
    turns = 2.0 * round(0.3 * span.end_time)
    _, other = swinging(turns / span.end_time - 0.3)
    assert measure("displacement_l2", problem, one, other).value < 1e-12
    for metric in ("displacement_l2", "displacement_max", "max_displacement"):
        assert difference(metric, problem, one, other) > 0.2
        assert difference(metric, problem, one, one) == 0.0


def test_steps_of_second_order_give_a_bar_that_holds_the_limit() -> None:
    def run(step: float) -> State:
        return swinging(0.3 * (1.0 - 0.01 * step**2))[1]

    problem, exact = swinging(0.3)
    found = assess_sequence(problem, [run(step) for step in (0.25, 0.5, 1.0)])
    frequency = found["oscillation_frequency"]
    assert frequency.order == pytest.approx(2.0, abs=0.01)
    for metric in ("oscillation_frequency", "oscillation_phase", "trajectory_l2"):
        error = measure(metric, problem, run(0.25), exact).value
        bar = found[metric].error_bar
        assert bar is not None
        assert error <= bar <= 1.5 * error
    # First order is not what the method has: no conclusion from far outside.
    odd = [swinging(0.3 * (1.0 - 0.01 * step**0.3))[1] for step in (0.25, 0.5, 1.0)]
    assess = assess_sequence(problem, odd)["oscillation_frequency"]
    assert assess.behaviour is Convergence.ORDER_OUT_OF_RANGE
    assert assess.error_bar is None


def test_what_leaks_into_the_fit_of_a_swing_is_no_noise_between_runs() -> None:
    """A second mode makes the fit uncertain, and is the same in every run."""

    def run(size: float) -> State:
        _, state = swinging(0.3)
        motion = state.trajectory
        assert motion is not None
        rough = 0.05 * np.sin(41.0 * motion.times)[:, None, None]
        mixed = size * (motion.displacements + rough * np.abs(motion.displacements).max())
        return moved_otherwise(state, mixed)

    problem, _ = swinging(0.3)
    # Second order; then to and fro, which shows no order, but less than one fit can tell.
    reported = assess_sequence(problem, [run(1.0 + e) for e in (1e-4, 4e-4, 16e-4)])
    assert reported["oscillation_amplitude"].error_bar == pytest.approx(1.25e-4, rel=0.02)
    swayed = assess_sequence(problem, [run(1.0 + e) for e in (1e-4, 3e-4, 2e-4)])
    assert swayed["oscillation_amplitude"].behaviour is Convergence.BELOW_NOISE
    assert swayed["oscillation_amplitude"].error_bar == pytest.approx(6e-4, rel=0.02)
    # Where a fit can tell, what shows no order has no bar.
    far = assess_sequence(problem, [run(1.0 + e) for e in (0.1, 0.5, 0.3)])
    assert far["oscillation_amplitude"].error_bar is None


def test_norms_that_show_no_order_have_three_times_their_range() -> None:
    def bar(*sizes: float) -> float | None:
        runs = []
        for size in sizes:
            problem, state = swinging(0.3)
            runs.append(moved_otherwise(state, (1.0 + size) * state.displacements))
        return assess_sequence(problem, runs)["trajectory_l2"].error_bar

    # Slowly falling differences, and such that grow a little; of more nothing is concluded.
    assert bar(0.0, 2e-3, 4.2e-3) == pytest.approx(3.0 * 4.2e-3, rel=0.01)
    assert bar(0.0, 2.2e-3, 4.2e-3) == pytest.approx(3.0 * 4.2e-3, rel=0.01)
    assert bar(0.0, 2e-3, 3e-3) is None
    # Faster than of second order is not believed.
    assert bar(0.0, 1e-4, 16e-4) == pytest.approx(1.25 * 1e-4 / 3.0, rel=0.01)


def test_what_no_check_asks_for_is_not_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    case = load_case("wave")
    stored = find_references(case, live=False, progress=lambda _line: None)
    calls: list[tuple[str, Strain]] = []

    def explicit(
        _problem: Problem, strain: Strain, *_rest: object, element: Element, **_options: object
    ) -> State:
        assert element is Element.LINEAR
        calls.append(("explicit", strain))
        return stored.states[SAME_MESH, strain]

    def implicit(_problem: Problem, strain: Strain, *_rest: object, **_options: object) -> State:
        calls.append(("implicit", strain))
        return dataclasses.replace(truth_of("wave"), label=QUADRATIC, strain=strain)

    monkeypatch.setattr(motions, "solve_by_steps", explicit)
    monkeypatch.setattr(motions, "solve_implicit", implicit)

    def say(_line: str) -> None:
        pass

    found = solve_motion_set(case.problem, say, wanted={"same_mesh", "candidate"}, stored=stored)
    assert {who for who, _ in calls} == {"explicit"}
    assert found.truth(Strain.GREEN) is None
    calls.clear()
    found = solve_motion_set(case.problem, say, wanted={"truth"}, stored=stored)
    assert not calls
    assert found.truth(Strain.LINEAR) is not None
    assert found.bars == stored.bars
    found = solve_motion_set(case.problem, say, wanted={"truth"})
    assert {who for who, _ in calls} == {"implicit"}
    assert found.states.keys() == {(QUADRATIC, strain) for strain in Strain}


def test_a_motion_without_a_result_is_reported_and_never_stored(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    case = load_case("wave")

    def lost(*_given: object, **_options: object) -> State:
        raise ReferenceStepError(0.06, 1e-4, "a cell would invert", case.problem.mesh.points)

    def unavailable(*_given: object, **_options: object) -> State:
        raise ReferenceUnavailableError("no FEniCSx")

    def say(_line: str) -> None:
        pass

    monkeypatch.setattr(motions, "solve_implicit", lost)
    found = solve_motion_set(case.problem, say, wanted={"truth"})
    assert found.truth(Strain.GREEN) is None
    assert "a cell would invert" in found.failure("truth", Strain.GREEN)
    with pytest.raises(ReferenceStepError):
        solve_motion_set(case.problem, say, wanted={"truth"}, is_for_storing=True)
    monkeypatch.setattr(motions, "solve_by_steps", unavailable)
    with pytest.raises(ReferenceUnavailableError):
        solve_motion_set(case.problem, say, wanted={"same_mesh"})


@pytest.mark.dolfinx
@pytest.mark.nightly
def test_the_bar_of_a_live_truth_holds_what_finer_steps_and_cells_find() -> None:
    case = load_case("block-motion")
    span = TimeSpan(0.1, None, 4.0, 20)
    problem = dataclasses.replace(case.problem, time=span)

    def say(_line: str) -> None:
        pass

    found = solve_motion_set(problem, say, wanted={"truth"})
    better = motions.solve_implicit(problem, Strain.GREEN, 6, say)
    truth = found.truth(Strain.GREEN)
    assert truth is not None
    for metric in ("trajectory_l2", "displacement_max"):
        error = measure(metric, problem, truth, better).value
        assert 0.0 < error <= found.bars[metric, Strain.GREEN]


@pytest.mark.dolfinx
@pytest.mark.parametrize("name", ["block-motion", "decay", "slide", "wave"])
def test_this_version_finds_the_stored_twin(name: str) -> None:
    """Whichever version stored it: 0.5.2 and 0.11 both run this."""
    case = load_case(name)
    stored = find_references(case, live=False, progress=lambda _line: None)
    kept = stored.states[SAME_MESH, case.strain]
    found = motions.solve_by_steps(case.problem, case.strain, None, lambda _line: None)
    assert measure("trajectory_l2", case.problem, found, kept).value < 1e-11
    if case.problem.tools:
        assert measure("tool_force", case.problem, found, kept).value < 1e-11


@pytest.mark.dolfinx
@pytest.mark.nightly
def test_this_version_finds_the_stored_truth() -> None:
    """The meshes by the whole motion, the states by its first tenth."""
    case, quiet = load_case("block-motion"), lambda _line: None
    kept = truth_of("block-motion").trajectory
    assert kept is not None
    current, span = case.problem, case.problem.time
    assert span is not None
    for _ in range(2):
        run = motions.solve_implicit(current, case.strain, STEPS[0], quiet)
        current = refine_where_rough(current, run)[0]
    few = span.num_outputs // 10
    begun = dataclasses.replace(
        span, end_time=span.end_time * few / span.num_outputs, num_outputs=few
    )
    found = motions.solve_implicit(
        dataclasses.replace(current, time=begun),
        case.strain,
        STEPS[-1],
        quiet,
        at=case.problem.mesh,
    ).trajectory
    assert found is not None
    apart = np.abs(found.displacements - kept.displacements[: few + 1]).max()
    # Kept in seven digits.
    assert apart < 1e-6 * np.abs(kept.displacements[: few + 1]).max()


def test_a_truth_that_would_take_too_long_is_not_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    case = load_case("wave")
    calls: list[float] = []

    def implicit(
        _problem: Problem, strain: Strain, *_rest: object, time_limit: float, **_options: object
    ) -> State:
        calls.append(time_limit)
        assert strain is Strain.LINEAR
        return dataclasses.replace(truth_of("wave"), label=QUADRATIC, seconds=30.0)

    monkeypatch.setattr(motions, "solve_implicit", implicit)
    found = solve_motion_set(
        case.problem, lambda _line: None, wanted={"truth"}, strains=(case.strain,), seconds=60.0
    )
    assert len(calls) == 1
    assert calls[0] == pytest.approx(60.0, abs=5.0)
    assert found.truth(case.strain) is None
    assert re.search(
        r"would take \d+ s or more, and may take 60 s", found.failure("truth", case.strain)
    )
