"""`--element linear|smoothed|both`: which tetrahedra solve, and which are judged beside them."""

from __future__ import annotations

import json

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
        answer = tmp_path / f"mine.{kind}"
        assert command_line("solve", "block", "--element", "smoothed", "-o", answer) == 0
        # .npz says it by itself; .vtu cannot.
        says = () if kind == "npz" else ("--element", "smoothed")
        command_line("compare", "block", answer, "--json", reported, *says)
        passed = {c["verdict"] for c in written(reported)[0]["checks"]
                  if (c["against"], c["strain"]) == ("same_mesh", "green")}  # fmt: skip
        assert passed == {"passed"}
    command_line("compare", "block", tmp_path / "mine.vtu", "--json", reported)
    assert "failed" in on_same_mesh(written(reported)[0])


def test_another_simulator_says_its_element_itself(command_line, capsys):
    asked = ("--element", "both", "--simulator", "mysim {case} {result}")
    assert command_line("gate", "block", *asked) == 2
    assert "only fastsim is asked for one" in capsys.readouterr().err
    with pytest.raises(InputError, match="goes with fastsim"):
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
@pytest.mark.once
@pytest.mark.long
def test_the_reference_solves_it_live(command_line, tmp_path):
    path = tmp_path / "r.json"
    command_line("gate", "block", "--live", "--element", "both", "--json", path)
    (case,) = written(path)
    assert on_same_mesh(case) == {"passed"}
    assert "smoothed tetrahedra" in case["provenance"]["reference"]["origin"]
    answer = tmp_path / "theirs.npz"
    arguments = ("solve", "block", "--with", "reference", "--element", "smoothed", "-o", answer)
    assert command_line(*arguments) == 0
    command_line("compare", "block", answer, "--json", path)
    assert "failed" not in on_same_mesh(written(path)[0])
    assert command_line("audit", "block", answer, "--degree", 1, "--limit", 1e-8) == 0
