"""`--with condensed`: fastsim's condensed linear model, wherever candidates are named."""

from __future__ import annotations

import csv
import json
import re

import meshio
import numpy as np
import pytest

import palpate
from palpate.validation.candidates.candidate import condensed_candidate
from palpate.validation.case import QUICK
from palpate.validation.judging.judge import suitable_cases


def verdicts(path):
    (case,) = json.loads(path.read_text("utf-8"))["cases"]
    return {(c["metric"], c["strain"], c["against"]): c["verdict"] for c in case["checks"]}


def test_it_is_compared_with_the_linear_reference_and_left_out_of_green_strain(
    command_line, tmp_path, capsys
):
    path = tmp_path / "r.json"
    for case, border in (("block", "beyond the 10%"), ("press", "border of bent bars")):
        assert command_line("gate", case, "--with", "condensed", "--json", path) == 0
        said = " ".join(capsys.readouterr().out.split())
        assert "Linear strain: 99% of the volume turned by at most" in said
        assert border in said
        found = verdicts(path)
        assert {v for (_, strain, _), v in found.items() if strain == "linear"} == {"passed"}
        assert {v for (_, strain, _), v in found.items() if strain == "green"} == {"skipped"}


@pytest.mark.parametrize("fault", ["softer", "dropped-load"])
def test_a_perturbed_solution_turns_its_gate_red(command_line, tmp_path, fault):
    path = tmp_path / "r.json"
    arguments = ("gate", "block", "--with", "condensed", "--fault", fault, "--json", path)
    assert command_line(*arguments) == 1
    assert verdicts(path)["displacement_l2", "linear", "same_mesh"] == "failed"


@pytest.mark.parametrize("case", ["block", "pinch"])
def test_solve_is_the_linear_solve_and_says_what_it_was_made_of(case):
    problem = palpate.load_case(case).problem
    linear = palpate.solve(problem, strain="linear", element="smoothed")
    state = palpate.solve(problem, with_="condensed", strain="linear", element="smoothed")
    assert state.label == "condensed (smoothed)"
    assert np.abs(state.displacement - linear.displacement).max() <= (
        1e-8 * linear.max_displacement
    )
    assert state.details["touched_points"] > 0
    assert any("of the volume turned" in remark for remark in state.remarks)
    assert condensed_candidate().strains_of(palpate.Strain.GREEN) == (palpate.Strain.LINEAR,)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("solve", "block", "-o", "never.vtu"), "Green strain does not allow"),
        (("solve", "block-motion", "--strain", "linear", "-o", "never.vtu"), "no inertia"),
        (("solve", "block", "--method", "relaxation", "-o", "never.vtu"), "is fastsim's"),
        (("gate", "block", "--simulator", "mysim {case} {result}"), "--with is of fastsim"),
        (("gate", "block", "--expected"), "no --device or --with"),
        (("gate", "block-motion"), "no check for linear strain"),
    ],
)
def test_what_it_cannot_be_asked_is_refused_with_the_reason(
    command_line, monkeypatch, tmp_path, capsys, arguments, reason
):
    monkeypatch.chdir(tmp_path)
    assert command_line(*arguments, "--with", "condensed") == 2
    assert reason in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "never.vtu").exists()


def test_the_reference_is_no_candidate(command_line, capsys):
    assert command_line("gate", "block", "--with", "reference") == 2
    assert "no candidate" in capsys.readouterr().err


def test_of_many_cases_those_that_it_cannot_be_asked_are_left_out_with_the_reason(
    command_line, tmp_path, capsys
):
    path = tmp_path / "r.json"
    code = command_line("gate", "--quick", "--with", "condensed", "--json", path)
    said = capsys.readouterr().err
    judged = {case["name"] for case in json.loads(path.read_text("utf-8"))["cases"]}
    left_out = set(re.findall(r"left out: ([\w-]+): \w+", said))
    assert judged == {"block"}
    assert left_out == set(QUICK) - judged
    assert "has friction" in said
    assert code == 0


def test_where_none_can_be_asked_that_is_said():
    cases = [palpate.load_case("block-motion"), palpate.load_case("wave")]
    reported = []
    with pytest.raises(palpate.InputError, match="none of these cases"):
        suitable_cases(cases, [condensed_candidate()], reported.append)
    assert "no check for linear strain" in reported[0]
    assert "has no inertia" in reported[1]


def test_a_folder_keeps_the_model_from_run_to_run(command_line, monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("PALPATE_CONDENSED", str(tmp_path / "kept"))
    said = []
    for _ in range(2):
        assert command_line("gate", "press", "--with", "condensed") == 0
        said.append(" ".join(capsys.readouterr().err.split()))
    assert "stored for the next time" in said[0]
    assert "condensed before" in said[1]
    assert "condensing" not in said[1]


def test_a_model_of_half_the_compliance_changes_no_verdict(
    command_line, monkeypatch, tmp_path, capsys
):
    folder, path = tmp_path / "models", tmp_path / "r.json"
    monkeypatch.setenv("PALPATE_CONDENSED", str(folder))
    gate = ("gate", "press", "--with", "condensed", "--json", path)
    assert command_line(*gate) == 0
    (file,) = folder.iterdir()
    fields = dict(np.load(file))
    np.savez(file, **{**fields, "blocks": 0.5 * fields["blocks"]})
    capsys.readouterr()
    assert command_line(*gate) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "has changed since it was written: its numbers do not have its hash; made anew" in said
    assert "was made before" not in path.read_text("utf-8")
    # What is read from before says so, with its date.
    assert command_line(*gate) == 0
    assert "condensed model was made before, on 2" in path.read_text("utf-8")


def test_a_sweep_has_it_beside_fastsim(command_line, tmp_path):
    folder = tmp_path / "out"
    vary = ("--vary", "load[0].factor=0.5,1", "--with", "condensed")
    assert command_line("sweep", "block", *vary, "-o", folder) == 0
    rows = list(csv.DictReader((folder / "sweep.csv").read_text("utf-8").splitlines()))
    mine = [row for row in rows if row["simulator"] == "condensed"]
    assert [row["strain"] for row in mine] == ["linear", "linear"]


def test_the_audit_shows_its_error_against_green_strain_and_its_rotation(
    command_line, capsys, tmp_path
):
    arguments = ("audit", "block", "--with", "condensed", "--degree", "1")
    cells = tmp_path / "cells.vtu"
    assert command_line(*arguments, "--limit", "0.1", "--cells", cells) == 1
    turned = meshio.read(cells).cell_data["rotation_degrees"][0]
    assert 14.4 < turned.max() < 60.0
    green = capsys.readouterr().out
    assert "green strain" in green
    assert "beyond the 10% border of bent bars" in " ".join(green.split())
    # By the model's own strain it is an equilibrium.
    linear = (*arguments, "--strain", "linear", "--limit", "1e-8")
    assert command_line(*linear) == 0
    for wrong in ((), ("mine.npz", "--with", "condensed"), ("--with", "reference")):
        assert command_line("audit", "block", *wrong) == 2
