"""Each fault changes what it says, and only that; the self-test catches every one."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, Strain
from palpate.validation.candidates import faults
from palpate.validation.candidates.candidate import Candidate, fastsim_candidate
from palpate.validation.candidates.faults import Fault, on_own_mesh, with_fault
from palpate.validation.case import load_case
from palpate.validation.judging.self_test import (
    KINDS,
    REFERENCE_FAULTS,
    TRIALS,
    metric_table,
    run_self_test,
    table_lines,
)
from palpate.validation.metrics import CATALOGUE, inverted_cells
from palpate.validation.states import State, in_silence

NAMED = {
    "wrong-mass", "late", "swapped-lame", "softer", "mirrored-mesh", "dropped-load",
    "inverted-cell", "stale-reference", "missing-reference", "nan", "unit-error",
    "linear-instead-of-green",
}  # fmt: skip


def test_every_fault_is_tried() -> None:
    tried = {fault.value for fault, _ in TRIALS} | set(REFERENCE_FAULTS)
    # Garbage between the case's points is seen where a solution has a mesh of its own: the table,
    # and every case in judging/test_own_mesh_gates.py.
    assert set(Fault) - {Fault.NONE, Fault.INNER_NODES} <= {fault for fault, _ in TRIALS}
    assert tried >= NAMED
    assert len(tried) >= 12


def test_swapped_lame_parameters_are_those_of_the_problem_exchanged(problem: Problem) -> None:
    def lame(of: Problem) -> tuple[float, float]:
        E, nu = of.material.youngs_modulus, of.material.poissons_ratio
        return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))

    lmbda, mu = lame(faults.corrupt_problem(problem, Fault.SWAPPED_LAME))
    assert (mu, lmbda) == pytest.approx(lame(problem), rel=1e-12)


def test_without_a_poissons_ratio_lames_parameters_cannot_be_exchanged() -> None:
    with pytest.raises(faults.CannotShowError, match="Poisson's ratio of 0"):
        faults.corrupt_problem(load_case("turned").problem, Fault.SWAPPED_LAME)


def test_an_inverted_cell_is_one_or_its_neighbours(
    problem: Problem,
    solution: np.ndarray,  # type: ignore[type-arg]
) -> None:
    (perturbed,) = faults.corrupt_displacement(problem.mesh, solution[None], Fault.INVERTED_CELL)
    moved = np.flatnonzero((perturbed != solution).any(axis=1))
    assert len(moved) == 1
    assert inverted_cells(problem.mesh, solution) == 0
    assert inverted_cells(problem.mesh, perturbed) >= 1


def test_faults_leave_the_rest_alone(problem: Problem) -> None:
    assert faults.corrupt_problem(problem, Fault.NAN) is problem
    assert faults.corrupt_strain(Strain.GREEN, Fault.SOFTER) is Strain.GREEN
    assert faults.corrupt_problem(problem, Fault.DROPPED_LOAD).loads == problem.loads[:-1]


@pytest.mark.nightly
def test_the_self_test_catches_every_fault_by_name(tmp_path: Path) -> None:
    from palpate.validation.judging import outputs

    result = run_self_test(in_silence)
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


def test_the_self_test_catches_every_perturbed_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    from palpate.validation.judging import self_test

    monkeypatch.setattr(self_test, "TRIALS", ((Fault.SOFTER, "block"),))
    monkeypatch.setattr(self_test, "metric_table", lambda *_arguments: [])
    reported = {c.metric: c.message for c in self_test.run_self_test(in_silence).checks}
    for word, why in (
        ("missing-reference", "no stored reference"),
        ("stale-reference", "is stale"),
        ("damaged-reference", "damaged"),
        ("altered-reference", "was altered"),
        ("unhashed-reference", "has no hash"),
    ):
        assert reported[f"{word} on block"].startswith("exit 2: ")
        assert why in reported[f"{word} on block"]


def test_a_gate_that_sees_nothing_fails_the_self_test(monkeypatch: pytest.MonkeyPatch) -> None:
    from palpate.validation.judging import self_test

    # A blind harness: whatever fault is asked for, the healthy candidate is judged.
    monkeypatch.setattr(self_test, "TRIALS", ((Fault.SOFTER, "block"),))
    monkeypatch.setattr(self_test, "metric_table", lambda *_arguments: [])
    monkeypatch.setattr(self_test, "with_fault", lambda candidate, _fault: candidate)
    result = self_test.run_self_test(in_silence)
    assert result.verdict == "failed"
    with pytest.raises(InputError, match="no fault shows"):
        self_test.run_self_test(in_silence, cases=[load_case("block")])


def test_the_faults_of_one_case_are_tried_on_any_candidate() -> None:
    named: list[str] = []

    def solve(*arguments: Any) -> State:
        named.append("solved")
        return dataclasses.replace(fastsim_candidate().solve(*arguments), label="mine")

    mine = Candidate("mine", solve)
    result = run_self_test(in_silence, cases=[load_case("shear")], candidate=mine)
    assert result.verdict == "passed"
    verdicts = {check.metric.split(" on ")[0]: check.verdict for check in result.checks}
    # Plain shear has no tool, no motion and no mesh of its own.
    skipped = {fault for fault, verdict in verdicts.items() if verdict == "skipped"}
    assert skipped >= {"dropped-tool", "late", "inner-nodes", "wrong-mass"}
    # Nor does anything move along y, so that its sign cannot show.
    assert "mirrored" in skipped
    assert {verdicts[f] for f in ("unit-error", "nan", "shifted-numbers")} == {"passed"}
    assert len(named) >= len(verdicts) - len(skipped)


def test_a_solution_on_its_own_mesh_that_is_right_is_not_red() -> None:
    case = load_case("block")
    mine = dataclasses.replace(on_own_mesh(fastsim_candidate()), has_both_strains=False)
    state = mine.solve(case.problem, Strain.GREEN, in_silence)
    assert state.own is not None
    assert state.own.mesh.num_cells == 8 * case.problem.mesh.num_cells
    perturbed = with_fault(mine, Fault.INNER_NODES).solve(case.problem, Strain.GREEN, in_silence)
    # The points of the case are as they were, those between them are garbage.
    assert np.abs(perturbed.displacement - state.displacement).max() <= 1e-12
    assert perturbed.smallest_det_f < 0.0 < state.smallest_det_f


@pytest.mark.long
@pytest.mark.nightly
def test_every_metric_goes_red_alone_on_each_kind_of_case() -> None:
    rows = metric_table(fastsim_candidate(), in_silence)
    blind = [(row.metric, row.kind) for row in rows if not row.seen]
    assert not blind
    assert not [(row.metric, row.kind) for row in rows if row.healthy == "failed"]
    assert {row.metric for row in rows} == set(CATALOGUE)
    by_kind = {kind: {row.metric for row in rows if row.kind == kind} for kind, *_ in KINDS}
    assert all(len(metrics) >= 8 for metrics in by_kind.values()), by_kind
    lines = table_lines(rows)
    assert sum("x" in line for line in lines) >= len(rows)


def test_a_fault_of_what_is_not_there_is_refused(problem: Problem) -> None:
    with pytest.raises(InputError, match="press or slide"):
        faults.corrupt_problem(problem, Fault.DROPPED_TOOL)
    with pytest.raises(InputError, match="try beam"):
        faults.corrupt_problem(dataclasses.replace(problem, loads=()), Fault.REVERSED_LOAD)


@pytest.mark.parametrize("fault", faults.OF_MOTION)
def test_a_fault_of_motion_is_refused_where_nothing_moves(problem: Problem, fault: Fault) -> None:
    with pytest.raises(InputError, match="block-motion"):
        faults.corrupt_problem(problem, fault)
