"""Annotations, diagnoses in every output, and the pytest fixture."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from palpate.meshes.problem import Strain
from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.candidates.faults import Fault, with_fault
from palpate.validation.case import load_case
from palpate.validation.diagnosis.explanation import Cause, Diagnosis, Explanation
from palpate.validation.judging import outputs
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.outputs import github_annotations
from palpate.validation.judging.results import CaseResult
from palpate.validation.states import Verdict


@pytest.fixture(scope="module")
def healthy() -> CaseResult:
    return judge_case(load_case("block"))


@pytest.fixture(scope="module")
def softer() -> CaseResult:
    return judge_case(load_case("block"), candidate=with_fault(fastsim_candidate(), Fault.SOFTER))


def test_the_metrics_are_all_that_compare_with_each_reference(healthy: CaseResult) -> None:
    told = set(healthy.metrics)
    assert {f"error.{word}.green.displacement_l2" for word in ("same_mesh", "truth")} <= told
    # What needs the same mesh is told there, and not of the truth.
    assert "error.same_mesh.green.displacement_h1" in told
    assert "error.truth.green.displacement_h1" not in told
    assert not [name for name in told if "tool_force" in name or "trajectory" in name]


def test_nothing_is_annotated_where_all_passed(healthy: CaseResult) -> None:
    assert github_annotations([healthy]) == []


def test_a_failure_is_an_error_and_its_text_cannot_break_out(softer: CaseResult) -> None:
    check = dataclasses.replace(
        softer.checks[0], message="50 %\n::set-output name=x::y", verdict=Verdict.INCONCLUSIVE
    )
    nasty = dataclasses.replace(
        softer, checks=(check,), name="a,b:c", provenance={"case_file": "cases/a,b.toml"}
    )
    (line,) = github_annotations([nasty])
    assert line.startswith("::warning file=cases/a%2Cb.toml,title=a%2Cb%3Ac%3A displacement_l2")
    assert "\n" not in line
    assert "50 %25%0A" in line
    assert github_annotations([softer])[0].startswith("::error ")


def test_at_most_ten_of_a_kind_and_a_count(softer: CaseResult) -> None:
    bad = next(c for c in softer.checks if c.verdict is Verdict.FAILED)
    for count, lines in ((9, 9), (10, 10), (11, 10), (25, 10)):
        many = dataclasses.replace(softer, checks=(bad,) * count)
        found = github_annotations([many])
        assert len(found) == lines
        assert ("and " in found[-1].split("::")[-1][:4]) == (count > 10)
    assert found[-1].endswith("and 16 more checks")


def test_the_tenth_of_ten_is_shown_and_not_the_first_again(softer: CaseResult) -> None:
    bad = next(c for c in softer.checks if c.verdict is Verdict.FAILED)
    ten = [dataclasses.replace(bad, message=f"number {k}") for k in range(10)]
    found = github_annotations([dataclasses.replace(softer, checks=tuple(ten))])
    assert [line.split("number ")[1][:1] for line in found] == list("0123456789")


def test_a_diagnosis_stands_in_every_output(softer: CaseResult) -> None:
    green, linear = Strain.GREEN, Strain.LINEAR
    fits = Explanation("half the load", Cause.LOAD, 1e-12, 0.5, "the largest force")
    told = (
        Diagnosis(green, (fits,), 9, 0.5, "the largest force"),
        Diagnosis(linear, (), 7, 0.3, "x"),
    )
    bad = next(c for c in softer.checks if c.verdict is Verdict.FAILED)
    checks = tuple(dataclasses.replace(bad, strain=strain) for strain in (green, linear))
    result = dataclasses.replace(softer, checks=checks, diagnoses=told)
    rows = json.loads(outputs.results_json([result], "1"))["cases"][0]["diagnosis"]
    assert [(row["strain"], row["explanation"], row["tried"]) for row in rows] == [
        ("green", "half the load", 9), ("linear", None, 7)
    ]  # fmt: skip
    assert (rows[0]["residual"], rows[1]["stated"]) == (1e-12, 0.3)
    failures = ET.fromstring(outputs.junit_xml([result])).findall(".//failure")
    texts = [ET.tostring(failure, encoding="unicode") for failure in failures]
    assert "half the load" in texts[0]
    assert "none of 7" in texts[1]
    assert "half the load" not in texts[1]


def test_the_gate_tells_github(
    palpate_run: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    done = palpate_run("gate", "block", "--fault", "softer")
    assert done.returncode == 1, done.stderr
    assert "::error " in done.stdout


def test_the_pytest_fixture_passes_and_fails_with_the_checks(tmp_path: Path) -> None:
    example = Path(__file__).parents[3] / "validation" / "examples" / "gate_your_simulator"
    command = f"{sys.executable} {example / 'toy_simulator.py'} {{case}} {{result}}"
    (tmp_path / "test_mine.py").write_text(
        f"""
CASE = {str(example / "bar.toml")!r}

def test_good(palpate_case):
    judged = palpate_case(CASE, simulator={command!r})
    assert judged.verdict == "passed"

def test_crashing(palpate_case):
    palpate_case(CASE, simulator="false {{case}} {{result}}")
""",
        encoding="utf-8",
    )
    done = subprocess.run(
        # Where palpate is installed, its entry point has loaded the same plugin already.
        [sys.executable, "-m", "pytest", "-q", "-p", "no:palpate", "-p",
         "palpate.validation.pytest_plugin", "-p", "no:cacheprovider", str(tmp_path)],
        capture_output=True, text=True, timeout=300, check=False, cwd=tmp_path,
    )  # fmt: skip
    assert "1 failed, 1 passed" in done.stdout, done.stdout + done.stderr
    assert "bar: failed" in done.stdout
    assert "it ended with 1" in done.stdout
