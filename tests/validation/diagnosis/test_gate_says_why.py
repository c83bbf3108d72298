"""A red gate of an outside program carries what explains it, in every output."""

from __future__ import annotations

import dataclasses
import json
import shlex
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from judged import case_of, state_of
from typer.testing import CliRunner

from palpate.meshes.problem import Problem, Strain
from palpate.validation.candidates.candidate import Candidate, fastsim_candidate
from palpate.validation.candidates.faults import Fault, with_fault
from palpate.validation.cli import app
from palpate.validation.diagnosis import diagnose
from palpate.validation.judging.judge import judge_case
from palpate.validation.report.html import write_report
from palpate.validation.states import Progress, State, Verdict, in_silence

SIMULATOR = Path(__file__).parent / "one_file_simulator.py"


def gate(case: str, mistake: str, folder: Path) -> tuple[int, str, dict[str, Any]]:
    """Exit code, what a person sees, and results.json of the gate of one seeded mistake."""
    words = [sys.executable, str(SIMULATOR), "{case}", "{result}", "--mistake", mistake]
    command = " ".join(w if w.startswith("{") else shlex.quote(w) for w in words)
    outputs = [f"--{kind}={folder / kind}" for kind in ("json", "junit", "summary")]
    done = CliRunner().invoke(app, ["gate", case, "--simulator", command, *outputs])
    (found,) = json.loads((folder / "json").read_text("utf-8"))["cases"]
    return done.exit_code, done.output, found


@pytest.mark.parametrize(
    ("case", "mistake", "name", "cause"),
    [
        (
            "block",
            "engineering-shear",
            "engineering shear strain taken for tensor shear: shear stresses doubled",
            "law",
        ),
        ("block-motion", "heavier", "density 1.02 times what was asked", "mass"),
    ],
)
@pytest.mark.long
def test_an_outside_program_is_informed_of_what_it_did_wrong(
    case: str, mistake: str, name: str, cause: str, tmp_path: Path
) -> None:
    code, output, found = gate(case, mistake, tmp_path)
    assert code == 1
    assert f"fits '{name}'" in " ".join(output.split())
    (row,) = found["diagnosis"]
    assert (row["explanation"], row["cause"], row["strain"]) == (name, cause, "green")
    assert 0.0 <= row["residual"] <= 1e-6 < row["stated"]
    failures = list(ET.parse(tmp_path / "junit").getroot().iter("failure"))
    assert failures
    assert all(f"fits '{name}'" in (failure.text or "") for failure in failures)
    assert f"  - diagnosis, green strain: fits '{name}'" in (tmp_path / "summary").read_text(
        "utf-8"
    )


def test_an_outside_program_that_nothing_explains_gets_no_cause(tmp_path: Path) -> None:
    code, output, found = gate("block", "dropped-cell", tmp_path)
    assert code == 1
    (row,) = found["diagnosis"]
    assert row["explanation"] is None
    assert f"none of {row['tried']} explanations fits" in " ".join(output.split())


def test_a_right_program_is_not_diagnosed(tmp_path: Path) -> None:
    code, output, found = gate("block", "", tmp_path)
    assert code == 0
    assert found["diagnosis"] == []
    assert "Diagnosis" not in output


def test_the_report_has_a_section_for_it(tmp_path: Path) -> None:
    result = judge_case(
        case_of("block"), candidate=with_fault(fastsim_candidate(), Fault.SWAPPED_LAME)
    )
    page = write_report([result], tmp_path).read_text("utf-8")
    assert "Diagnosis: what would explain it" in page
    assert page.count("Lamé&#39;s parameters exchanged") >= 2
    healthy = judge_case(case_of("block"))
    assert "Diagnosis" not in write_report([healthy], tmp_path).read_text("utf-8")


@pytest.mark.parametrize("size", [1e150, 1e300, 1.7e308])
def test_numbers_beyond_all_bounds_are_diagnosed_without_a_crash(size: float) -> None:
    """Finite, but their squares are not: the verdict must not be lost to the diagnosis."""
    problem = case_of("block").problem
    rng = np.random.default_rng(0)
    displacement = size * rng.choice([-1.0, 1.0], size=problem.mesh.points.shape)
    with np.errstate(all="ignore"):
        state = state_of(problem, displacement)
        truth = fastsim_candidate().solve(problem, state.strain, in_silence)
    for reference in (truth, None):
        assert diagnose(problem, state, reference).explanations == ()


@pytest.mark.parametrize(("seconds", "is_asked_again"), [(9.9, True), (10.0, False)])
def test_only_a_quick_candidate_is_asked_again(seconds: float, is_asked_again: bool) -> None:
    asked = []

    def solve(problem: Problem, strain: Strain, progress: Progress) -> State:
        asked.append(problem)
        state = fastsim_candidate().solve(problem, strain, progress)
        # Nothing that the diagnosis knows: without asking, no explanation fits.
        bent = state.displacement + 1e-3 * np.sin(300.0 * problem.mesh.points[:, [1, 2, 0]])
        return dataclasses.replace(state, displacement=bent, seconds=seconds)

    result = judge_case(case_of("block"), candidate=Candidate("mine", solve))
    assert result.verdict is Verdict.FAILED
    assert (len(asked) > 1) is is_asked_again
