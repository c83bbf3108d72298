"""`--element linear|smoothed|both`: which tetrahedra solve, and which are judged beside them."""

from __future__ import annotations

import json
import sys

import pytest

import palpate
from palpate.meshes.errors import InputError


def written(path):
    return json.loads(path.read_text("utf-8"))["cases"]


def on_same_mesh(case):
    return {c["verdict"] for c in case["checks"] if c["against"] == "same_mesh"}


@pytest.mark.parametrize("element", ["linear", "smoothed", "both"])
def test_the_gate_judges_the_element_that_is_asked_for(command_line, tmp_path, element):
    path, junit = tmp_path / "r.json", tmp_path / "j.xml"
    command_line("gate", "block", "--element", element, "--json", path, "--junit", junit)
    (case,) = written(path)
    names = {"linear": ["fastsim"], "smoothed": ["fastsim (smoothed)"]}
    names["both"] = names["linear"] + names["smoothed"]
    assert [one["name"] for one in case["candidates"]] == names[element]
    assert on_same_mesh(case) == {"passed"}
    assert ("smoothed)" in junit.read_text("utf-8")) == (element != "linear")


def test_what_is_solved_with_an_element_is_judged_as_such(command_line, tmp_path):
    reported = tmp_path / "reported.json"
    for kind in ("npz", "vtu"):
        solution = tmp_path / f"mine.{kind}"
        assert command_line("solve", "block", "--element", "smoothed", "-o", solution) == 0
        command_line("compare", "block", solution, "--json", reported, "--element", "smoothed")
        passed = {c["verdict"] for c in written(reported)[0]["checks"]
                  if (c["against"], c["strain"]) == ("same_mesh", "green")}  # fmt: skip
        assert passed == {"passed"}
        # Which element it is judged by is not the result's to choose; .vtu cannot even state one.
        command_line("compare", "block", solution, "--json", reported)
        checks = written(reported)[0]["checks"]
        assert "failed" in on_same_mesh(written(reported)[0])
        stated = [check["message"] for check in checks if check["metric"] == "stated_equations"]
        assert len(stated) == (kind == "npz")
        assert all("--element smoothed" in message for message in stated)
    smoothed = tmp_path / "mine.npz"
    audit = ("audit", "block", smoothed, "--degree", 1, "--limit", 1e-8)
    assert command_line(*audit) == 2
    assert command_line(*audit, "--element", "smoothed") == 0


def test_the_caller_says_which_element_another_simulator_is_judged_by(
    command_line, capsys, tmp_path
):
    program, path = tmp_path / "theirs.py", tmp_path / "r.json"
    program.write_text(
        "import sys, palpate, numpy as np\n"
        "u = palpate.solve(palpate.load_case('block').problem, element='smoothed').displacement\n"
        "np.savez(sys.argv[2], displacement=u)\n",
        encoding="utf-8",
    )
    theirs = ("gate", "block", "--simulator", f"{sys.executable} {program} {{case}} {{result}}")
    assert command_line(*theirs, "--element", "smoothed", "--json", path) == 0
    (case,) = written(path)
    assert [one["element"] for one in case["candidates"]] == ["smoothed"]
    assert "passed" in on_same_mesh(case)
    assert command_line(*theirs) == 1
    capsys.readouterr()
    assert command_line(*theirs, "--element", "both") == 2
    assert "say which one" in capsys.readouterr().err
    with pytest.raises(InputError, match="say which one"):
        palpate.judge("block", lambda problem: 0.0 * problem.mesh.points, element="both")
    with pytest.raises(InputError, match="use one of linear, smoothed, both"):
        palpate.judge("block", element="quadratic")


def test_relations_hold_for_both(command_line, tmp_path):
    path = tmp_path / "r.json"
    arguments = ("gate", "block", "--metamorphic", "--element", "both", "--json", path)
    assert command_line(*arguments) == 0
    checks = written(path)[0]["checks"]
    names = [(check["metric"], check["element"]) for check in checks]
    assert len(set(names)) == len(names)
    assert {name for name, _ in names} >= {"turned", "mirrored", "renumbered", "patch"}
    assert {element for _, element in names} == {"linear", "smoothed"}


def test_the_front_door_takes_the_word_too():
    both = palpate.judge("block", element="both")
    assert [one.name for one in both.candidates] == ["fastsim", "fastsim (smoothed)"]
    problem = palpate.load_case("block").problem
    plain, smoothed = (palpate.solve(problem, element=word) for word in ("linear", "smoothed"))
    # Smoothing softens: never stiffer than the plain tetrahedra.
    assert smoothed.max_displacement > plain.max_displacement
    assert both.state("fastsim (smoothed)", smoothed.strain).max_displacement == pytest.approx(
        smoothed.max_displacement, rel=1e-12
    )


@pytest.mark.dolfinx
@pytest.mark.long
@pytest.mark.nightly
def test_the_reference_solves_it_live(command_line, tmp_path):
    path = tmp_path / "r.json"
    command_line("gate", "block", "--live", "--element", "both", "--json", path)
    (case,) = written(path)
    assert on_same_mesh(case) == {"passed"}
    assert "smoothed tetrahedra" in case["provenance"]["reference"]["origin"]
    solution = tmp_path / "theirs.npz"
    arguments = ("solve", "block", "--with", "reference", "--element", "smoothed", "-o", solution)
    assert command_line(*arguments) == 0
    smoothed = ("--element", "smoothed")
    command_line("compare", "block", solution, "--json", path, *smoothed)
    assert "failed" not in on_same_mesh(written(path)[0])
    assert command_line("audit", "block", solution, "--degree", 1, "--limit", 1e-8, *smoothed) == 0
