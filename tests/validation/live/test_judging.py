"""What the page says of a pose: each verdict once it is there, and the truth for so long only."""

from __future__ import annotations

import math
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.meshes.problem import Element, Strain
from palpate.reference.result import LOST
from palpate.validation.case import load_case
from palpate.validation.live import verdict
from palpate.validation.live.judging import LIMITS, Judging
from palpate.validation.live.live_case import Touch, live_case
from palpate.validation.live.panes import BetweenVertices
from palpate.validation.references.reference_set import SAME_MESH, TRUTH, ReferenceSet

# Verdicts on the same mesh, then does what stands in LATER.
STUB = """
import sys, time
from pathlib import Path
import numpy as np
from palpate.validation.live.verdict import SAME_MESH, TRUTH, PaneVerdict, say
case, pose = map(Path, sys.argv[1:])
panes = [
    PaneVerdict("Green strain", "passed", ["displacement_l2 passed"], np.array(error))
    for error in ([0.0, 1e-3], [np.nan, np.nan])
]
say(case, SAME_MESH, panes, np.array([0, 1]))
"""


def said(
    later: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: float = 60.0
) -> list[dict[str, Any]]:
    """What is said."""
    (tmp_path / "stub_of_judging.py").write_text(STUB + later)
    monkeypatch.setattr("palpate.validation.live.judging.VERDICT", "stub_of_judging")
    monkeypatch.setattr("palpate.reference.availability.is_available", lambda: True)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.pathsep.join(sys.path)}")
    monkeypatch.setitem(LIMITS, verdict.TRUTH, limit)
    monkeypatch.setattr("palpate.validation.live.judging._BREATH", 0.0)
    notes: list[dict[str, Any]] = []
    thread = Judging(tmp_path / "a.toml", tmp_path / "a.npz", notes.append)
    thread.run()
    return notes


def judged(
    later: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: float = 60.0
) -> list[dict[str, Any]]:
    """What is found."""
    notes = said(later, tmp_path, monkeypatch, limit)
    return [note for note in notes if note["kind"] == "judged"]


def test_a_truth_that_is_not_found_in_time_leaves_the_verdict_on_the_same_mesh(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, last = judged("time.sleep(600)", tmp_path, monkeypatch, limit=0.5)
    assert first["more"] is True
    assert first["against"] == "same mesh"
    assert first["verdicts"] == ["passed", "passed"]
    assert first["largest"] == pytest.approx(1.0)
    assert first["question"] == "is it solved right?"
    assert first["rows"][0] == {
        "name": "Green strain", "verdict": "passed", "words": "displacement_l2 passed"
    }  # fmt: skip
    assert last["question"] == "is it what tissue does?"
    # Of the second pane there is no reference, so no colour either.
    assert first["errors"][0] is not None
    assert first["errors"][1] is None
    assert last["more"] is False
    assert last["errors"] == []
    assert last["text"] == (
        "the truth was not found within 0.5 s; the verdict on the same mesh stands"
    )


def test_what_stood_in_the_way_is_said_when_the_time_is_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    line = "tools from 0 to 1, 0.9610: a cell would invert; back to 0.8829, step 0.0390"
    later = f"print({line!r}, flush=True); time.sleep(600)"
    _, last = judged(later, tmp_path, monkeypatch, limit=0.5)
    assert "within 0.5 s; at 96% of the tool's way a cell would invert;" in last["text"]


def test_a_missing_truth_is_reported_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, last = judged("sys.exit('a cell would invert')", tmp_path, monkeypatch)
    assert first["verdicts"]
    assert last["text"] == (
        "the truth was not found: a cell would invert; the verdict on the same mesh stands"
    )


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("from nearby, iteration 3: relative residual 6.68e-01, smallest det F 0.4855",
         "looking for the equilibrium near the pose"),
        ("tools from 0 to 1, 0.7313, iteration 8: relative residual 5.67e-13",
         "pressing the tool in by small steps"),
        ("22542 degrees of freedom, LDL (MUMPS)", "starting the solver"),
        ("linear strain: bringing it to rest", "bringing the bodies to rest"),
        ("something else", "something else"),
    ],
)  # fmt: skip
def test_progress_is_in_words_and_a_part_of_the_longest_wait(
    line: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    notes = said(f"print({line!r}, flush=True)", tmp_path, monkeypatch)
    seen = [note for note in notes if note["kind"] == "progress"]
    assert words in [note["text"].removeprefix(f"{verdict.ASKED[verdict.TRUTH]} ") for note in seen]
    assert all(0.0 <= note["share"] < 0.5 for note in seen)


def test_both_verdicts_are_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, last = judged("say(case, TRUTH, panes, np.array([0, 1]))", tmp_path, monkeypatch)
    assert (first["against"], first["more"]) == ("same mesh", True)
    assert (last["against"], last["more"]) == ("truth", False)


def test_a_tool_between_the_vertices_is_measured() -> None:
    """A ball before the middle of the block's end, which is flat."""
    live = live_case(load_case("block"), Touch(), (Element.LINEAR,))
    still = np.zeros_like(live.problem.mesh.points)
    radius = live.data["tool"][0]["radius"] * 1e-3
    outside = np.array([0.041 + radius, 0.0125, 0.01])
    between = BetweenVertices(live.problem)
    assert between.depth(outside, still) == 0.0
    inside = outside - [0.003, 0.0, 0.0]
    found = between.depth(inside, still)
    assert 0.0 < found <= 0.002 + 1e-12


@pytest.mark.parametrize(
    ("cells", "ended", "bar"),
    [
        ([90, 300], "the budget is 120 s", 0.25),
        ([90, 300], f"{LOST}, 300 cells", math.inf),
        ([90, 300, 900], "the budget is 120 s", math.inf),
    ],
)
def test_two_meshes_that_tell_no_rate_have_the_bar_of_one(
    cells: list[int], ended: str, bar: float
) -> None:
    problem = load_case("block").problem
    moved = 0.01 * problem.mesh.points * [0.0, 0.0, 1.0]
    states = {
        (label, Strain.GREEN): verdict.PoseOfPane(
            label, Strain.GREEN, Element.LINEAR, part * moved, np.zeros(3)
        ).state(problem, Strain.GREEN)
        for label, part in ((SAME_MESH, 0.75), (TRUTH, 1.0))
    }
    bars = {("displacement_l2", Strain.GREEN): math.inf, ("volume", Strain.GREEN): 0.03}
    record = {"adaptive": {"green": {"cells": cells, "ended": ended}}}
    found = verdict.with_bars_of_two(problem, ReferenceSet(states, bars, "", {}, record))
    assert found.bars["displacement_l2", Strain.GREEN] == pytest.approx(bar)
    # What the meshes do tell stays.
    assert found.bars["volume", Strain.GREEN] == 0.03
