"""Each fault changes what it says, and only that; the self-test catches every one."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from palpate.fastsim.dynamics import simulate
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.validation.case import load_case
from palpate.validation.evidence.self_test import REFERENCE_FAULTS, TRIALS, run_self_test
from palpate.validation.metrics import inverted_cells
from palpate.validation.simulators import CandidateFailedError, faults
from palpate.validation.simulators.faults import Fault
from palpate.validation.simulators.transposed import simulate_in_numpy

NAMED = {
    "wrong-mass", "transposed-gradient", "swapped-lame", "softer", "mirrored-mesh", "dropped-load",
    "inverted-cell", "stale-reference", "missing-reference", "nan", "unit-error",
    "linear-instead-of-green",
}  # fmt: skip


def test_every_fault_is_tried() -> None:
    tried = {fault.value for fault, _ in TRIALS} | set(REFERENCE_FAULTS)
    assert set(Fault) - {Fault.NONE} <= {fault for fault, _ in TRIALS}
    assert tried >= NAMED
    assert len(tried) >= 12


def test_swapped_lame_parameters_are_those_of_the_problem_exchanged(problem: Problem) -> None:
    def lame(of: Problem) -> tuple[float, float]:
        E, nu = of.material.youngs_modulus, of.material.poissons_ratio
        return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))

    lmbda, mu = lame(faults.spoil_problem(problem, Fault.SWAPPED_LAME))
    assert (mu, lmbda) == pytest.approx(lame(problem), rel=1e-12)


def test_an_inverted_cell_is_one_or_its_neighbours(
    problem: Problem,
    answer: np.ndarray,  # type: ignore[type-arg]
) -> None:
    spoiled = faults.spoil_displacement(problem.mesh, answer, Fault.INVERTED_CELL)
    moved = np.flatnonzero((spoiled != answer).any(axis=1))
    assert len(moved) == 1
    assert inverted_cells(problem.mesh, answer) == 0
    assert inverted_cells(problem.mesh, spoiled) >= 1


def test_the_numpy_steps_are_fastsims_and_transposed_ones_are_not() -> None:
    problem = load_case("block-motion").problem
    ours = simulate(problem).displacements
    scale = np.abs(ours).max()
    right = simulate_in_numpy(problem, is_transposed=False).displacements
    assert np.abs(right - ours).max() <= 1e-11 * scale
    short = dataclasses.replace(problem, time=dataclasses.replace(problem.time, end_time=0.04))
    short = dataclasses.replace(short, time=dataclasses.replace(short.time, num_outputs=4))
    wrong = simulate_in_numpy(short, is_transposed=True).displacements
    gap = np.abs(wrong - ours[:5]).max(axis=(1, 2)) / scale
    # The right ones agree to 1e-11; these part from the first output on.
    assert gap[1] > 1e-4
    assert gap[-1] > 1e-2
    assert (np.diff(gap) > 0.0).all()
    # A softer block turns more, and is pushed out of all bounds.
    soft = dataclasses.replace(problem, material=Material(1e4, 0.4, 1000.0))
    with pytest.raises(CandidateFailedError, match="left its bounds"):
        simulate_in_numpy(soft, is_transposed=True)
    with pytest.raises(InputError, match="time_step"):
        simulate_in_numpy(load_case("csm3").problem, is_transposed=True)


def test_faults_leave_the_rest_alone(problem: Problem) -> None:
    assert faults.spoil_problem(problem, Fault.NAN) is problem
    assert faults.spoil_strain(Strain.GREEN, Fault.SOFTER) is Strain.GREEN
    assert faults.spoil_problem(problem, Fault.DROPPED_LOAD).loads == problem.loads[:-1]


@pytest.mark.slow
def test_the_self_test_catches_every_fault_by_name(tmp_path: Path) -> None:
    from palpate.validation.judging import outputs

    result = run_self_test(lambda _line: None)
    assert result.verdict == "passed"
    by_name = {check.metric: check.message for check in result.checks}
    healthy = {name for name in by_name if name.startswith("healthy on ")}
    assert healthy == {f"healthy on {case}" for _, case in TRIALS}
    for fault, case in TRIALS:
        assert by_name[f"{fault} on {case}"].startswith("caught by ")
    for word in REFERENCE_FAULTS:
        assert by_name[f"{word} on block"].startswith("exit 2: ")
    out = tmp_path / "r.json"
    out.write_text(outputs.results_json([result], "x"), "utf-8")
    assert json.loads(out.read_text("utf-8"))["cases"][0]["verdict"] == "passed"


def test_a_gate_that_sees_nothing_fails_the_self_test(monkeypatch: pytest.MonkeyPatch) -> None:
    from palpate.validation.evidence import self_test
    from palpate.validation.simulators.candidate import fastsim_candidate

    # A blind harness: whatever fault is asked for, the healthy candidate is judged.
    monkeypatch.setattr(self_test, "TRIALS", ((Fault.SOFTER, "block"),))
    monkeypatch.setattr(self_test, "fastsim_candidate", lambda _fault: fastsim_candidate())
    result = self_test.run_self_test(lambda _line: None)
    assert result.verdict == "failed"


def test_a_fault_of_what_is_not_there_is_refused(problem: Problem) -> None:
    with pytest.raises(InputError, match="press or slide"):
        faults.spoil_problem(problem, Fault.DROPPED_TOOL)
    with pytest.raises(InputError, match="try beam"):
        faults.spoil_problem(dataclasses.replace(problem, loads=()), Fault.REVERSED_LOAD)


@pytest.mark.parametrize("fault", [Fault.WRONG_MASS, Fault.NO_DAMPING, Fault.TRANSPOSED_GRADIENT])
def test_a_fault_of_motion_is_refused_where_nothing_moves(problem: Problem, fault: Fault) -> None:
    with pytest.raises(InputError, match="block-motion"):
        faults.spoil_problem(problem, fault)
