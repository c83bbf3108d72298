"""Motions that others send: at their own times, garbage between the outputs, states too late."""

from __future__ import annotations

import dataclasses
import functools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from judged import case_of, judge
from numpy.typing import NDArray

from palpate.fastsim.dynamics import DynamicResult, simulate
from palpate.meshes.problem import Element
from palpate.meshes.refinement import refine_uniformly
from palpate.validation.candidates.candidate import result_candidate
from palpate.validation.candidates.result_states import state_of_result
from palpate.validation.exchange.result_files import ResultFileError, read_result
from palpate.validation.judging.results import CaseResult
from palpate.validation.metrics import most_inverted, smallest_det_f
from palpate.validation.states import State, Verdict

MOTIONS = ("block-motion", "slide", "wave", "decay", "csm3")
Field = NDArray[np.float64]


@functools.cache
def run(name: str, num_states: int) -> DynamicResult:
    """fastsim on a built-in case, with so many states after the first."""
    case = case_of(name)
    assert case.problem.time is not None
    span = dataclasses.replace(case.problem.time, num_outputs=num_states)
    # What bends needs smoothed tetrahedra to come near enough to the truth.
    element = Element.SMOOTHED if name == "csm3" else Element.LINEAR
    moving = dataclasses.replace(case.problem, time=span)
    return simulate(moving, strain=case.strain, element=element)


def sent(name: str, rate: float) -> tuple[Field, Field, NDArray[np.int64]]:
    """Times and states at a multiple of the case's outputs, and which lie between those."""
    span = case_of(name).problem.time
    assert span is not None
    found = run(name, round(rate * span.num_outputs))
    outputs = found.times * span.num_outputs / span.end_time
    between = np.flatnonzero(np.abs(outputs - np.round(outputs)) > 1e-6)
    return found.times, found.displacements.copy(), between


def write(folder: Path, name: str, times: Field, states: Field, **more: Any) -> Path:
    case = case_of(name)
    about = {}
    if case.problem.tools:
        assert case.problem.time is not None
        tracks = run(name, case.problem.time.num_outputs).tools
        about["tool_forces"] = [track.mean_forces.tolist() for track in tracks]
    path = folder / "theirs.npz"
    np.savez(path, times=times, displacement=states, about=np.array(json.dumps(about)), **more)
    return path


def judged(folder: Path, name: str, times: Field, states: Field) -> CaseResult:
    path = write(folder, name, times, states)
    return judge(case_of(name), candidate=result_candidate(path))


def state_of(path: Path, name: str) -> State:
    case = case_of(name)
    return state_of_result(read_result(path), case.problem, "them", case.strain)


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.long
def test_an_honest_motion_with_states_between_the_outputs_passes_and_they_are_counted(
    name: str, tmp_path: Path
) -> None:
    times, states, between = sent(name, 2)
    result = judged(tmp_path, name, times, states)
    failed = {(c.metric, c.against) for c in result.checks if c.verdict is Verdict.FAILED}
    # Cells of 5 mm under a probe are too coarse for the truth.
    known = {("tool_force", "truth"), ("trajectory_l2", "truth")} if name == "slide" else set()
    assert failed == known
    assert result.verdict is (Verdict.FAILED if known else Verdict.PASSED)
    assert any(f"{len(between)} of {len(times)} states were sent at other" in n
               for n in result.notes)  # fmt: skip


@pytest.mark.parametrize("kind", ["last state repeated", "every second state still", "noise"])
@pytest.mark.parametrize("name", MOTIONS)
def test_states_perturbed_between_the_outputs_alone_fail(
    name: str, kind: str, tmp_path: Path
) -> None:
    times, states, between = sent(name, 2)
    match kind:
        case "last state repeated":
            states[between] = states[-1]
        case "every second state still":
            states[between] = 0.0
        case "noise":
            size = np.abs(states).max()
            states[between] += size * np.random.default_rng(3).standard_normal(states[0].shape)
    result = judged(tmp_path, name, times, states)
    assert result.verdict is Verdict.FAILED
    failed = [c for c in result.checks if c.verdict is Verdict.FAILED]
    assert all("out of the body's reach" in check.message for check in failed)


def test_a_motion_at_other_times_is_read_with_an_error_bar_and_never_passes_what_it_cannot_tell(
    tmp_path: Path,
) -> None:
    times, states, _ = sent("wave", 1.3)
    result = judged(tmp_path, "wave", times, states)
    by_limit = {(c.metric, c.against, c.limit): c for c in result.checks}
    twin = by_limit["trajectory_l2", "same_mesh", 1e-9]
    # Right to a few parts in a thousand, which is all that a reading between states can tell.
    assert twin.verdict is Verdict.INCONCLUSIVE
    assert 1e-9 < twin.reference_error < 1e-2
    assert by_limit["trajectory_l2", "truth", 3e-2].verdict is Verdict.PASSED
    assert by_limit["oscillation_frequency", "truth", 2e-3].verdict is Verdict.PASSED
    assert any("of 101 output times were not sent" in note for note in result.notes)
    assert result.verdict is Verdict.INCONCLUSIVE


def test_too_few_states_of_a_wave_pass_no_check_of_its_motion(tmp_path: Path) -> None:
    times, states, _ = sent("wave", 0.1)
    assert len(times) == 11  # two a period
    result = judged(tmp_path, "wave", times, states)
    for check in result.checks:
        if check.against != "truth" or check.metric != "published_oscillation":
            assert check.verdict is not Verdict.PASSED or check.is_vacuous, check.metric


def test_a_number_too_large_to_measure_in_one_state_fails_every_check(tmp_path: Path) -> None:
    times, states, between = sent("block-motion", 1.3)
    states[between[3], 5, 2] = 1e308
    result = judged(tmp_path, "block-motion", times, states)
    checks = [c for c in result.checks if c.verdict is not Verdict.SKIPPED]
    assert {check.verdict for check in checks} == {Verdict.FAILED}
    assert f"its state at {times[between[3]]:.4g} s" in checks[0].message


def test_inverted_cells_between_the_outputs_are_counted_with_their_time(tmp_path: Path) -> None:
    times, states, between = sent("block-motion", 2)
    mesh, k = case_of("block-motion").problem.mesh, between[7]
    corner, *others = mesh.cells[0]
    facing = (mesh.points + states[k])[others].mean(axis=0)
    states[k, corner] = 1.05 * facing - 0.05 * mesh.points[corner] - mesh.points[corner]
    state = state_of(write(tmp_path, "block-motion", times, states), "block-motion")
    most, least = most_inverted(mesh, state), smallest_det_f(mesh, state)
    assert most.value >= 1.0
    assert least.value < 0.0
    assert most.time == least.time == times[k]
    assert most.when == f" at {times[k]:.4g} s"
    # The end alone has none.
    assert state.smallest_det_f > 0.0


def test_cells_of_an_own_mesh_are_looked_at_in_every_state(tmp_path: Path) -> None:
    case = case_of("block-motion")
    times, states, between = sent("block-motion", 2)
    finer = refine_uniformly(case.problem.mesh)
    own = np.zeros((len(times), finer.num_points, 3))
    own[:, : case.problem.mesh.num_points] = states
    own[between[4], -1] = [0.0, 0.0, 1.0]
    path = write(tmp_path, "block-motion", times, own, points=finer.points, cells=finer.cells)
    worst = most_inverted(case.problem.mesh, state_of(path, "block-motion"))
    assert worst.value >= 1.0
    assert worst.time == times[between[4]]


def test_an_end_that_was_not_sent_is_read_and_what_comes_later_is_reported(tmp_path: Path) -> None:
    times, states, _ = sent("block-motion", 2)
    later = np.append(times[:-1], [0.5 + 1e-3, 0.6])
    more = np.concatenate([states, states[-1:]])
    state = state_of(write(tmp_path, "block-motion", later, more), "block-motion")
    assert state.other_reading is not None
    assert state.sent is not None
    assert state.sent.times[-1] == 0.5
    assert len(state.sent.times) == len(times)
    np.testing.assert_array_equal(state.sent.displacements[-1], state.displacement)
    assert any("2 of 102 states come after the end" in remark for remark in state.remarks)


@pytest.mark.parametrize("times", [[0.1, 0.5], [0.0, 0.4], [-0.1, 0.5]])
def test_times_that_do_not_run_from_the_start_to_the_end_are_refused(
    times: list[float], tmp_path: Path
) -> None:
    _, states, _ = sent("block-motion", 2)
    path = write(tmp_path, "block-motion", np.array(times), states[:2])
    with pytest.raises(ResultFileError, match=r"from 0 to 0\.5 s"):
        state_of(path, "block-motion")
