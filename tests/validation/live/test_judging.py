"""What the page says of a pose: each verdict once it is there, and the truth for so long only."""

from __future__ import annotations

import math
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from judged import case_of, state_of

from palpate.fastsim.errors import BlowUpError
from palpate.meshes.problem import Element, Strain
from palpate.reference.errors import ReferenceFailedError, ReferenceNotConvergedError
from palpate.reference.result import LOST
from palpate.validation.case import load_case
from palpate.validation.live import verdict
from palpate.validation.live.judging import LIMITS, Judging
from palpate.validation.live.live_case import Touch, live_case
from palpate.validation.live.panes import BetweenVertices, Surface, make_panes
from palpate.validation.live.poses import PoseOfPane
from palpate.validation.references.adaptive_truth import ADAPTIVE
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
    assert "within 0.5 s; at 96 % of the tool's way a cell would invert;" in last["text"]


def test_a_missing_truth_is_reported_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, last = judged("sys.exit('a cell would invert')", tmp_path, monkeypatch)
    assert first["verdicts"]
    assert last["text"] == (
        "the truth was not found: a cell would invert; the verdict on the same mesh stands"
    )


PROGRESS = {
    "from nearby, iteration 3: relative residual 6.68e-01, smallest det F 0.4855":
        "looking for the equilibrium near the pose",
    "tools from 0 to 1, 0.7313, iteration 8: relative residual 5.67e-13":
        "pressing the tool in by small steps",
    "22542 degrees of freedom, LDL (MUMPS)": "starting the solver",
    "linear strain: bringing it to rest": "bringing the bodies to rest",
    "something else": "something else",
}  # fmt: skip


def test_progress_is_in_words_and_a_part_of_the_longest_wait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    notes = said(f"for line in {list(PROGRESS)!r}: print(line, flush=True)", tmp_path, monkeypatch)
    seen = [note for note in notes if note["kind"] == "progress"]
    texts = [note["text"].removeprefix(f"{verdict.ASKED[verdict.TRUTH]} ") for note in seen]
    assert [text for text in texts if text in PROGRESS.values()] == list(PROGRESS.values())
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


def crushed(part: float) -> PoseOfPane:
    """The block pressed along x to a part of its length, its pose under Green strain."""
    points = case_of("block").problem.mesh.points
    moved = (part - 1.0) * points * [1.0, 0.0, 0.0]
    return PoseOfPane("Green strain", Strain.GREEN, Element.LINEAR, moved, np.zeros(3))


def test_a_pose_in_which_the_law_gives_way_is_refused_before_anything_is_solved() -> None:
    nothing = ReferenceSet({}, {}, "", {})
    case, lines = case_of("block"), list[str]()
    with pytest.raises(ReferenceFailedError, match=r"in this pose is -\S+ of .* press less deep"):
        verdict.true_references(case, [crushed(0.5)], nothing, lines.append)
    assert lines == []


def test_a_body_too_large_for_a_live_truth_is_refused_with_the_limit_and_what_to_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(verdict, "LARGEST", 1000.0)
    nothing, lines = ReferenceSet({}, {}, "", {}), list[str]()
    with pytest.raises(ReferenceFailedError) as refused:
        verdict.true_references(case_of("block"), [crushed(0.9)], nothing, lines.append)
    assert lines == []
    # 44 points and 173 edges.
    assert str(refused.value) == (
        "the body is too large for a live verdict: quadratic tetrahedra on its 90 cells have 651 "
        "unknowns, and of all meshes of a truth the largest may have 1000, twice as many at least; "
        "take a mesh of at most 69 cells, or build its truth without this limit: palpate reference "
        "build block"
    )


def test_a_truth_that_ended_at_a_limit_says_so_where_a_verdict_is_inconclusive() -> None:
    """Its bars decide nothing: why no finer mesh was solved, and what to do."""
    case, pose = case_of("block"), crushed(0.99)
    ended = "the next mesh would have 90000 unknowns; the budget is 80000"
    truth = state_of(case.problem, pose.displacement, label=TRUTH)
    bars = dict.fromkeys([(m, Strain.GREEN) for m in verdict.whole_metrics(case.problem)], math.inf)
    record = {ADAPTIVE: {Strain.GREEN.value: {"ended": ended}}}
    found = ReferenceSet({(TRUTH, Strain.GREEN): truth}, bars, "", provenance=record)
    (pane,) = verdict.judge_panes(verdict.TRUTH, case, [pose], found)
    assert pane.verdict == "inconclusive"
    assert pane.checks[-1] == (
        f"the truth ended before it could decide: {ended}; take a coarser mesh, or build its truth "
        "without this limit: palpate reference build block"
    )


def test_where_a_tool_presses_one_is_told_to_press_less_deep() -> None:
    pressed = ReferenceNotConvergedError(0.83, "a cell would invert", 0.3, is_pressed=True)
    assert "up to 0.830 of the tool's way" in str(pressed)
    assert str(pressed).endswith("; press less deep")
    spent = ReferenceNotConvergedError(0.5, "press less deep, or go on", is_pressed=True)
    assert str(spent).count("press less deep") == 1
    assert str(ReferenceNotConvergedError(0.83, "", 0.3)).endswith("; lower the load")
    live = live_case(case_of("block"), Touch(mass_damping=100.0), (Element.LINEAR,))
    pane = make_panes(live.problem, Surface(live.problem), (Element.LINEAR,))[-1]

    def blow(*_: object) -> None:
        raise BlowUpError("a cell inverted", 3, 0.1, 7, (0.0, 0.0, 0.0), 0.1, None, 1e-4, 1e-3)

    pane._step = blow
    pane.advance(live.metres(live.start), None, 1)
    assert "press less deep, or more slowly; reset" in pane.trouble
    assert "lower the load" not in pane.trouble


def test_why_nothing_was_found_is_in_the_units_of_the_page(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(_: Path) -> None:
        raise ReferenceFailedError("a cell would invert at (0.04, 0.0125, 0.01) m")

    monkeypatch.setattr(verdict, "load_case", fails)
    assert verdict.main(["case.toml", "pose.npz"]) == 3
    assert capsys.readouterr().err.strip() == "a cell would invert at (40, 12.5, 10) mm"
