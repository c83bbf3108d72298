"""Annotations, diagnoses in every output, and the pytest fixture."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from judged import GREEN, LINEAR, case_of, failed
from rich.console import Console

from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.candidates.faults import Fault, with_fault
from palpate.validation.diagnosis.explanation import Cause, Diagnosis, Explanation
from palpate.validation.judging import outputs
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.outputs import github_annotations
from palpate.validation.judging.self_test import MetricRow, table_lines
from palpate.validation.report import html
from palpate.validation.states import Verdict


@pytest.fixture(scope="module")
def healthy():
    return judge_case(case_of("block"))


@pytest.fixture(scope="module")
def softer():
    return judge_case(case_of("block"), candidate=with_fault(fastsim_candidate(), Fault.SOFTER))


@pytest.fixture(scope="module")
def bad(softer):
    """A check that failed."""
    return failed(softer)[0]


def test_the_metrics_are_all_that_compare_with_each_reference(healthy):
    names = set(healthy.metrics)
    assert {f"error.{word}.green.displacement_l2" for word in ("same_mesh", "truth")} <= names
    # What needs the same mesh is measured there, and not of the truth.
    assert "error.same_mesh.green.displacement_h1" in names
    assert "error.truth.green.displacement_h1" not in names
    assert not [name for name in names if "tool_force" in name or "trajectory" in name]


def test_every_number_of_the_results_states_its_unit(healthy):
    (case,) = json.loads(outputs.results_json([healthy], "0"))["cases"]
    units = case["units"]["metrics"]
    assert units.keys() == case["metrics"].keys()
    assert units["rest.volume"] == "m3"
    assert units["fastsim.green.max_displacement"] == "m"
    assert units["fastsim.green.smallest_det_f"] == "-"
    # The error of a volume is relative, though a volume is not.
    assert units["error.same_mesh.green.volume"] == "-"
    assert case["units"]["published"]["length"] == "mm"


def test_a_failure_is_an_error_and_its_text_cannot_break_out(healthy, softer):
    assert github_annotations([healthy]) == []
    assert github_annotations([softer])[0].startswith("::error ")
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


@pytest.mark.parametrize("count", [9, 10, 11, 25])
def test_at_most_ten_of_a_kind_and_a_count(softer, bad, count):
    checks = tuple(dataclasses.replace(bad, message=f"number {k};") for k in range(count))
    lines = github_annotations([dataclasses.replace(softer, checks=checks)])
    shown = min(count, 10) if count <= 10 else 9
    # The tenth of ten is shown, and not the first again.
    assert all(f"number {k};" in lines[k] for k in range(shown))
    assert lines[shown:] == (
        [f"::error title=palpate::and {count - 9} more checks"] if count > 10 else []
    )


def test_a_diagnosis_stands_in_every_output(softer, bad):
    fits = Explanation("half the load", Cause.LOAD, 1e-12, 0.5, "the largest force")
    diagnoses = (
        Diagnosis(GREEN, (fits,), 9, 0.5, "the largest force"),
        Diagnosis(LINEAR, (), 7, 0.3, "x"),
    )
    checks = tuple(dataclasses.replace(bad, strain=strain) for strain in (GREEN, LINEAR))
    result = dataclasses.replace(softer, checks=checks, diagnoses=diagnoses)
    rows = json.loads(outputs.results_json([result], "1"))["cases"][0]["diagnosis"]
    assert [(row["strain"], row["explanation"], row["tried"]) for row in rows] == [
        ("green", "half the load", 9), ("linear", None, 7)
    ]  # fmt: skip
    assert (rows[0]["residual"], rows[1]["stated"]) == (1e-12, 0.3)
    failures = ET.fromstring(outputs.junit_xml([result])).findall(".//failure")
    first, second = (ET.tostring(failure, encoding="unicode") for failure in failures)
    assert "half the load" in first
    assert "half the load" not in second
    assert "none of 7" in second


def test_the_gate_annotates_on_github(palpate_run, monkeypatch):
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    done = palpate_run("gate", "block", "--fault", "softer")
    assert done.returncode == 1, done.stderr
    assert "::error " in done.stdout


@pytest.mark.long
def test_the_pytest_fixture_passes_and_fails_with_the_checks(tmp_path):
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


def test_the_table_of_the_self_test_has_its_marks_under_their_letters() -> None:
    seen = {Fault.SOFTER: True, Fault.VERTICES_ONLY: False}
    lines = table_lines([MetricRow("volume", "statics", Verdict.PASSED, seen)])
    header, row = lines[-2:]
    letters = {line.split()[1].rstrip(":"): line.split()[0] for line in lines[1:-2]}
    for fault, mark in ((Fault.SOFTER, "x"), (Fault.VERTICES_ONLY, ".")):
        assert row[header.index(letters[fault])] == mark


UNREADABLE = """
import pathlib, sys
import numpy as np
case, result = map(pathlib.Path, sys.argv[1:])
points = np.load(case / "rest.npz")["points"]
is_block = len(points) == NUM_POINTS
np.savez(result, displacement=0.0 * points[: None if is_block else 7])
"""


@pytest.mark.parametrize("code", [2, 4])
def test_one_unreadable_result_takes_no_verdict_and_leaves_no_outputs_of_before(
    palpate_run, monkeypatch, tmp_path, code
):
    count = str(case_of("block").problem.mesh.num_points)
    (tmp_path / "sim.py").write_text(UNREADABLE.replace("NUM_POINTS", count), encoding="utf-8")
    paths = {name: tmp_path / name for name in ("json", "junit", "summary")}
    outputs.write_outputs([], **paths)
    if code == 4:  # an end without a verdict leaves no file that looks like one

        def broken(*_args, **_options):
            raise RuntimeError("broken")

        monkeypatch.setattr("palpate.validation.judging.judge.judge_case", broken)
    done = palpate_run(
        "gate", "column", "block", "--simulator", f"{sys.executable} sim.py {{case}} {{result}}",
        *(word for name, path in paths.items() for word in (f"--{name}", path)), folder=tmp_path,
    )  # fmt: skip
    assert done.returncode == code
    if code == 4:
        assert not any(path.exists() for path in paths.values())
        return
    column, block = json.loads(paths["json"].read_text("utf-8"))["cases"]
    assert "holds 7 points" in column["not_judged"]
    assert (column["verdict"], column["checks"]) == ("inconclusive", [])
    assert (block["verdict"], block["not_judged"]) == ("failed", "")
    first, second = ET.fromstring(paths["junit"].read_text("utf-8"))
    assert (first.get("name"), first.get("errors")) == ("column", "1")
    assert first.find(".//error").get("message") == column["not_judged"]
    assert int(second.get("failures")) > 0
    assert "**column**: not judged: " in paths["summary"].read_text("utf-8")
    assert "block: failed" in done.stdout
    last = done.stderr.splitlines()[-1]
    assert last.startswith("palpate: 1 of 2 cases not judged: column: ")


def test_a_gate_that_is_refused_at_the_door_leaves_no_outputs_of_before(palpate_run, tmp_path):
    paths = {name: tmp_path / f"out-{name}" for name in ("json", "junit", "summary")}
    words = [word for name, path in paths.items() for word in (f"--{name}", path)]
    (tmp_path / "broken.toml").write_text("schema = 2\n", encoding="utf-8")
    assert palpate_run("gate", "stretch", *words).returncode == 0
    # Whoever finds them later sees of when they are.
    when = json.loads(paths["json"].read_text("utf-8"))["cases"][0]["provenance"]["time"]
    assert ET.fromstring(paths["junit"].read_text("utf-8"))[0].get("timestamp") == when
    assert when in paths["summary"].read_text("utf-8").splitlines()[0]
    assert palpate_run("gate", tmp_path / "broken.toml", *words).returncode == 2
    assert not any(path.exists() for path in paths.values())
    # What is no output of a gate stays, though palpate wrote it.
    mesh = tmp_path / "mesh.vtu"
    assert palpate_run("solve", "stretch", "-o", mesh).returncode == 0
    assert palpate_run("gate", tmp_path / "broken.toml", "--json", mesh).returncode == 2
    assert mesh.exists()


def test_a_report_of_several_cases_lists_the_one_that_cannot_be_judged(
    palpate_run, tmp_path, monkeypatch
):
    monkeypatch.setattr(html, "draw_pictures", lambda _result, _folder: {})
    text = case_of("stretch").text.replace('mesh = "stretch.vtu"', 'mesh = "lost.vtu"')
    assert "lost.vtu" in text
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    (tmp_path / "lost.vtu").write_text("no mesh", encoding="utf-8")
    out = tmp_path / "out"
    done = palpate_run("report", tmp_path / "mine.toml", "column", "-o", out)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("palpate: 1 of 2 cases not judged: mine: ")
    assert sorted(page.name for page in out.glob("*.html")) == ["column.html", "index.html"]
    index = (out / "index.html").read_text("utf-8")
    assert "not judged" in index
    assert "lost.vtu" in index
    mine, column = json.loads((out / "results.json").read_text("utf-8"))["cases"]
    assert (mine["checks"], column["verdict"]) == ([], "passed")


def test_results_and_states_are_printed_without_their_arrays(softer):
    lines = repr(softer).splitlines()
    assert lines[0] == "block: failed"
    assert all(check.message in str(softer) for check in failed(softer))
    assert any(line.startswith("  Diagnosis, green strain: fits ") for line in lines)
    mesh = softer.problem.mesh
    assert "array(" not in str([softer, softer.states, mesh, mesh.surface()])
    assert "44 points" in repr(softer.states[0])


def test_no_name_of_a_metric_is_broken_and_no_row_is_cut_off_in_a_narrow_table(softer):
    metrics = ("published_displacement", "volume")
    checks = tuple(dataclasses.replace(softer.checks[0], metric=metric) for metric in metrics)
    console = Console(record=True, width=80)
    outputs.print_results([dataclasses.replace(softer, checks=checks)], console)
    text = console.export_text()
    rows = [line for line in text.splitlines() if line.startswith(("┃", "│"))]
    assert any("published_displacement" in row for row in rows)
    assert all(len(row) <= 80 and row[-1] in "┃│" for row in rows)
