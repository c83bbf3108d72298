"""A swing that its samples cannot tell is never passed."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from bank import made_state

from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.reference.schemes import Integrator, Steps
from palpate.validation.case import load_case
from palpate.validation.case.schema import CheckSpec
from palpate.validation.exchange.time_reading import read_at
from palpate.validation.judging.case_references import find_references
from palpate.validation.judging.checks import judge_check
from palpate.validation.judging.results import CheckResult
from palpate.validation.metrics import measure
from palpate.validation.metrics.motion import (
    OSCILLATION,
    content_frequency,
    departure,
    may_be_alias,
    swinging_most,
)
from palpate.validation.metrics.time_series import fit_oscillation
from palpate.validation.states import State, Trajectory, Verdict, in_silence

MESH = brick_box((4, 2, 2), (2.0, 1.0, 1.0))
SHAPE = np.zeros_like(MESH.points)
SHAPE[:, 1] = MESH.points[:, 0] ** 2
END = 2.0


def times_of(rate: float) -> np.ndarray:  # type: ignore[type-arg]
    return np.linspace(0.0, END, round(END * rate) + 1)


def swinging(frequency: float, rate: float, sent_rate: float | None = None) -> State:
    """1 - cos, sampled at a rate [1/s], and sent at another one if asked."""
    times = times_of(rate)
    given = times if sent_rate is None else times_of(sent_rate)
    fields = 0.02 * (1.0 - np.cos(2.0 * math.pi * frequency * given))[:, None, None] * SHAPE
    read = read_at(given, fields, times, slack=1e-9)
    states = [
        made_state(MESH, u[-1], strain=Strain.LINEAR, trajectory=Trajectory(times, u))
        for u in (read.states, read.others)
    ]
    return dataclasses.replace(
        states[0],
        sent=None if sent_rate is None else Trajectory(given, fields),
        other_reading=None if read.were_sent.all() else states[1],
    )


def problem_of(frequency: float) -> Problem:
    """A body that this swing takes this frequency of: stiffness goes with its square."""
    soft = Problem(MESH, Material(1.0, 0.3), (), (), TimeSpan(END, num_outputs=10))
    motion = swinging(1.0, 50.0).trajectory
    assert motion is not None
    own = content_frequency(soft, Strain.LINEAR, motion)
    return dataclasses.replace(soft, material=Material((frequency / own) ** 2, 0.3))


def judged(name: str, candidate: State, reference: State, limit: float = 0.1) -> CheckResult:
    spec = CheckSpec(metric=name, limit=limit, reason="r")
    return judge_check(spec, Strain.LINEAR, problem_of(10.0), candidate, reference, 0.0, "")


@pytest.mark.parametrize("name", OSCILLATION)
def test_three_hertz_taken_for_ten_at_thirteen_samples_a_second_never_pass(name: str) -> None:
    # cos(2 pi 10 k / 13) = cos(2 pi 3 k / 13): the same numbers at every sample.
    reference = swinging(10.0, 13.0)
    assert measure("trajectory_l2", problem_of(10.0), swinging(3.0, 13.0), reference).value < 1e-9
    for candidate in (
        swinging(3.0, 13.0),  # nothing but the same samples
        swinging(3.0, 13.0, 130.0),  # the wrong swing, sent in full
        swinging(10.0, 13.0, 130.0),  # the right one, against a reference that does not tell
    ):
        check = judged(name, candidate, reference)
        assert check.verdict in (Verdict.INCONCLUSIVE, Verdict.FAILED)
        assert check.verdict is Verdict.FAILED or "may be an alias" in check.message


@pytest.mark.parametrize("name", OSCILLATION)
def test_a_candidate_sampled_too_coarsely_is_inconclusive_and_the_right_one_passes(
    name: str,
) -> None:
    reference = swinging(10.0, 100.0)
    assert judged(name, swinging(10.0, 100.0), reference).verdict is Verdict.PASSED
    assert judged(name, swinging(10.0, 100.0, 200.0), reference).verdict is Verdict.PASSED
    for frequency in (3.0, 10.0):
        check = judged(name, swinging(frequency, 100.0, 13.0), reference)
        assert check.verdict is Verdict.INCONCLUSIVE
        assert "tell frequencies up to 5.2 Hz, not 10 Hz" in check.message  # 13 / 2.5
    assert judged("trajectory_l2", swinging(10.0, 100.0, 13.0), reference).verdict is not (
        Verdict.PASSED
    )
    wrong = judged("oscillation_frequency", swinging(3.0, 100.0, 200.0), reference)
    assert wrong.verdict is Verdict.FAILED
    assert wrong.value == pytest.approx(0.7, rel=1e-6)


def test_the_samples_that_were_sent_tell_an_alias_of_the_outputs() -> None:
    """Outputs that tell the reference's 3 Hz well see the same of 10 Hz; all states do not."""
    problem, reference = problem_of(3.0), swinging(3.0, 13.0)
    found = measure("oscillation_frequency", problem, swinging(10.0, 13.0, 130.0), reference)
    assert found.value == pytest.approx(7.0 / 3.0, rel=1e-6)
    honest = measure("oscillation_frequency", problem, swinging(3.0, 13.0, 130.0), reference)
    assert honest.value < 1e-6
    assert honest.uncertainty == 0.0


def test_samples_at_other_times_are_fitted_themselves_and_as_uncertain_as_their_fits() -> None:
    found = measure(
        "oscillation_frequency", problem_of(3.0), swinging(3.0, 40.0, 57.3), swinging(3.0, 40.0)
    )
    assert found.value < 1e-6
    assert found.uncertainty < 1e-6
    assert swinging(3.0, 40.0, 57.3).other_reading is not None


def test_a_published_frequency_is_not_known_by_an_alias() -> None:
    tip = int(np.argmax(MESH.points.sum(axis=1)))
    problem = problem_of(10.0)

    def check_of(quantity: str, expected: float, state: State) -> CheckResult:
        spec = CheckSpec.model_validate(
            {
                "metric": "published_oscillation", "against": "candidate", "reason": "r",
                "at": list(MESH.points[tip]), "component": "y", "quantity": quantity,
                "expected": expected, "limit": 0.1,
            }
        )  # fmt: skip
        return judge_check(spec, Strain.LINEAR, problem, state, None, 0.0, "")

    seen = check_of("frequency", 3.0, swinging(10.0, 13.0))
    assert seen.verdict is Verdict.INCONCLUSIVE
    assert "may be an alias" in seen.message
    coarse = check_of("frequency", 10.0, swinging(10.0, 13.0))
    assert coarse.verdict is Verdict.INCONCLUSIVE
    assert "not 10 Hz: send more" in coarse.message
    assert check_of("frequency", 10.0, swinging(10.0, 100.0)).verdict is Verdict.PASSED
    # 0.02 x^2 at x = 2: wrong by twice its size at any frequency.
    assert check_of("mean", 0.08, swinging(10.0, 100.0)).verdict is Verdict.PASSED
    assert check_of("mean", -0.08, swinging(10.0, 13.0)).verdict is Verdict.FAILED


def test_the_bodys_stiffness_says_how_fast_the_built_in_waves_are() -> None:
    # First mode of the confined bar, c / (4 L) = 0.29006 Hz; higher ones have 1/27 and less of it.
    case = load_case("wave")
    references = find_references(case, live=False, progress=in_silence)
    motion = references.states["reference P1", Strain.LINEAR].trajectory
    assert motion is not None
    found = content_frequency(case.problem, Strain.LINEAR, motion)
    assert found == pytest.approx(0.29006, rel=1e-2)
    # Every tenth state, 1.72 s apart, is less than Nyquist's 0.29 Hz; every eighth is more.
    for every, is_told in ((10, False), (8, True)):
        fewer = Trajectory(motion.times[::every], motion.displacements[::every])
        said = may_be_alias(case.problem, Strain.LINEAR, fewer)
        assert (said == "") is is_told


def test_of_states_at_the_same_times_the_reading_of_the_difference_is_uncertain() -> None:
    # Both sides sent 15 states a second and are read at 20: alone each may be off by much.
    problem, reference = problem_of(1.0), swinging(1.0, 20.0, 15.0)
    alone = measure("trajectory_l2", problem, swinging(1.0, 20.0), reference)
    beside = measure("trajectory_l2", problem, swinging(1.0, 20.0, 15.0), reference)
    assert (beside.value, beside.uncertainty) == (0.0, 0.0)
    assert alone.uncertainty > alone.value > 1e-4
    # Another frequency is another motion, read alike or not.
    other = measure("trajectory_l2", problem, swinging(1.1, 20.0, 15.0), reference)
    assert other.value > 5.0 * other.uncertainty > 0.0


def test_a_motion_says_when_it_left_and_by_how_much() -> None:
    problem, reference = problem_of(1.0), swinging(1.0, 10.0)
    assert reference.trajectory is not None
    fields = reference.trajectory.displacements.copy()
    fields[7:] *= 1.25
    late = dataclasses.replace(reference, trajectory=Trajectory(times_of(10.0), fields))
    # A quarter more where 1 - cos is largest, at 1.5 s; from 0.7 s on.
    assert departure(problem, late, reference) == (
        "its motion is off by 25 % of the largest displacement at 1.5 s, and by more than 1 % from "
        "0.7 s on (output 7)"
    )
    stepped = dataclasses.replace(late, steps=Steps(Integrator.BACKWARD_EULER, 0.05))
    assert departure(problem, stepped, reference).endswith("(output 7, step 14)")
    assert departure(problem, reference, reference) == ""


def test_smoothed_tetrahedra_swing_as_fast_as_their_own_stiffness_says() -> None:
    case = load_case("block-motion")
    references = find_references(case, live=False, elements={Element.SMOOTHED}, progress=in_silence)
    motion = references.states["reference smoothed", Strain.GREEN].trajectory
    assert motion is not None
    point, axis = swinging_most(motion)
    swing = fit_oscillation(motion.times, motion.displacements[:, point] @ axis).frequency
    own, plain = (
        content_frequency(case.problem, Strain.GREEN, motion, element)
        for element in (Element.SMOOTHED, Element.LINEAR)
    )
    # Higher modes and Green strain have a little of it; linear tetrahedra lock.
    assert swing < own < 1.05 * swing
    assert plain > 1.3 * own
    # Every fourth state, 0.04 s apart, tells up to 12.5 Hz: that of linear ones is above, not this.
    fewer = Trajectory(motion.times[::4], motion.displacements[::4])
    assert "may be an alias" in may_be_alias(case.problem, Strain.GREEN, fewer)
    said = may_be_alias(case.problem, Strain.GREEN, fewer, element=Element.SMOOTHED)
    assert said == ""
