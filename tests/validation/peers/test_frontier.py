"""The frontier's claims go red on what would contradict them, and the figure says who is who."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from palpate.meshes.problem import TimeSpan
from palpate.validation.peers import frontier, frontier_cases
from palpate.validation.peers.frontier import Runs, draw, judge, present, times_ours
from palpate.validation.peers.frontier_cases import PRESS, STRIP, Row, run_case
from palpate.validation.peers.registry import Peer
from palpate.validation.references.field_truth import FieldTruth, time_fastsim
from palpate.validation.report.plots import COLOURS
from palpate.validation.states import Verdict, in_silence

ROWS = [
    Row("fastsim", "1", frontier.STVK, "m", 24, 0.001, 0.7, 0.0),
    Row("fastsim", "1", frontier.STVK, "m", 192, 0.003, 0.4, 0.0),
    Row("Other", "2", frontier.STVK, "m", 24, 0.1, 0.7, 1e-7),
    Row("Third", "3", "neo-Hookean", "m", 24, 0.1, 0.69, 0.03),
]


def verdicts(rows: list[Row]) -> list[Verdict]:
    return [finding.verdict for finding in judge(Runs(rows, (), 0.01))]


def test_what_agrees_and_converges_passes() -> None:
    finer = ROWS[2]._replace(num_cells=192, error=0.4)
    assert set(verdicts([*ROWS, finer])) == {Verdict.PASSED}


def test_a_stranger_of_the_same_law_and_a_coarser_winner_fail() -> None:
    far = [*ROWS[:2], ROWS[2]._replace(same_mesh=1e-3)]
    assert Verdict.FAILED in verdicts(far)
    growing = [ROWS[0], ROWS[1]._replace(error=0.8)]
    assert Verdict.FAILED in verdicts(growing)


def test_one_mesh_shows_no_convergence() -> None:
    alone = Row("Alone", "1", frontier.STVK, "m", 24, 0.1, 0.7, 1e-7)
    (finding,) = (f for f in judge(Runs([*ROWS[:2], alone], (), 0.01)) if "Alone" in f.claim)
    assert finding.verdict is Verdict.INCONCLUSIVE
    assert "no convergence" in finding.found


def test_the_figure_names_tools_versions_and_the_other_law() -> None:
    svg = draw(Runs(ROWS, (), 0.01)).svg
    for word in ("fastsim 1", "Other 2", "Third 3, neo-Hookean"):
        assert word in svg


def test_the_problems_share_one_body_and_one_load() -> None:
    coarse, fine = frontier.make_problem(1), frontier.make_problem(3)
    assert abs(coarse.mesh.volume - fine.mesh.volume) < 1e-15
    assert fine.mesh.num_cells == 27 * coarse.mesh.num_cells


def test_the_condensed_model_stands_apart_as_linear_strain() -> None:
    problem = frontier.make_problem(1)
    seconds, green = time_fastsim(problem)
    rows = frontier.time_condensed(problem, green, FieldTruth(problem, green))
    anew, ready = rows
    assert {row.law for row in rows} == {frontier.LINEAR}
    assert anew.error == ready.error > 0.01
    assert ready.seconds < seconds


def on(body: str, row: Row, **more: object) -> Row:
    return row._replace(body=body, same_mesh=None, **more)


def test_meshes_of_each_body_are_judged_and_other_settings_are_not() -> None:
    swings = [on(STRIP, ROWS[0]), on(STRIP, ROWS[1]), on(STRIP, ROWS[0], setting="substeps 2")]
    found = judge(Runs([*ROWS[:2], *swings], (), 0.01))
    assert [f.claim for f in found if "strip" in f.claim] == [
        "strip, fastsim: a finer mesh is nearer to the reference"
    ]
    assert {f.verdict for f in found} == {Verdict.PASSED}
    away = [on(STRIP, ROWS[0]), on(STRIP, ROWS[1], error=0.8)]
    assert Verdict.FAILED in verdicts([*ROWS[:2], *away])


def test_times_are_over_those_of_fastsim_on_the_same_mesh_of_the_same_body() -> None:
    rows = [*ROWS, on(PRESS, ROWS[2])]
    assert times_ours(ROWS[2], rows) == pytest.approx(100.0)
    assert times_ours(rows[-1], rows) is None
    (table,) = present(Runs(rows, (), 0.01)).tables.values()
    assert [row[8] for row in table.rows] == [
        *(1.0, 1.0, pytest.approx(100.0), pytest.approx(100.0), None)
    ]


def test_the_figure_has_a_panel_for_each_body_and_names_its_floors() -> None:
    rows = [*ROWS, *(on(STRIP, row) for row in ROWS), on(STRIP, ROWS[2], setting="substeps 2")]
    floors = {"bar": {0.01: "a halved mesh", 0.02: "the measured bar"}, STRIP: {0.003: "its bar"}}
    svg = draw(Runs(rows, (), 0.01, floors)).svg
    for words in ("bent by a quarter", "a strip that swings", *floors["bar"].values(), "its bar"):
        assert words in svg
    assert "a ball pressed" not in svg
    # Each tool has its colour in both panels, and one entry in the legend.
    for number, words in enumerate(("fastsim 1", "Other 2", "Third 3, neo-Hookean")):
        assert svg.count(f">{words}<") == 1
        assert len(re.findall(f"stroke: {COLOURS[number]}", svg)) > 2


def test_a_motion_is_as_far_off_as_at_its_worst_time() -> None:
    problem = frontier.make_problem(1)
    _, u = time_fastsim(problem)
    truth = FieldTruth(problem, np.array([0.0 * u, 2.0 * u, u]))
    # Off by u at the end, over 2 u.
    motion = np.array([0.0 * u, 1.9 * u, 0.0 * u])
    assert truth.error_of(problem.mesh, motion) == pytest.approx(0.5)
    assert truth.error_of(problem.mesh, motion[:2]) == float("inf")


def test_the_press_is_solved_by_both_elements_against_the_stored_truth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(frontier_cases._EDGES, PRESS, (20.0, 10.0))
    monkeypatch.setattr(frontier_cases, "read_peers", tuple)
    left: list[str] = []
    rows, bar = run_case(PRESS, in_silence, left.append)
    assert [row.tool for row in rows] == ["fastsim"] * 2 + ["fastsim, smoothed"] * 2
    assert 0.0 < bar < 0.01 < rows[3].error < rows[1].error < rows[0].error
    assert {row.body for row in rows} == {PRESS}
    assert all(row.seconds > 0.0 for row in rows)
    assert left == []


def test_steps_and_iterations_are_asked_for_by_the_words_of_the_adapter(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def peer(name: str, varies: str) -> Peer:
        return Peer(name=name, title=name, command=f"{name} {{case}} {{result}}", varies=varies)

    presses = peer("presses", "").model_copy(update={"takes_tools": True})
    peers = (peer("steps", "substeps"), peer("sweeps", "iterations"), peer("still", ""), presses)
    monkeypatch.setattr(frontier_cases, "read_peers", lambda: peers)
    problem = replace(frontier.make_problem(1), time=TimeSpan(1.0))
    finer = replace(frontier.make_problem(2), time=TimeSpan(1.0))
    pressed = [(words, one, command) for words, one, command, _ in
               frontier_cases._asked(PRESS, [problem, finer], in_silence)]  # fmt: skip
    plain = "presses {case} {result}"
    assert pressed == [("", problem, plain), ("", finer, plain)]
    asked = list(frontier_cases._asked(STRIP, [problem, finer], in_silence))
    plain = "steps {case} {result}"
    assert [(words, command) for words, _, command, _ in asked[:4]] == [
        ("", plain), ("", plain),
        ("substeps 2", f"{plain} substeps=2"), ("substeps 4", f"{plain} substeps=4"),
    ]  # fmt: skip
    steps = [given.time.time_step for _, given, _, _ in asked if given.time is not None]
    assert steps == [None] * 4 + [2.5e-3] * 3 + [5e-3, 2.5e-3, 1.25e-3]
    assert asked[4][2] == "sweeps {case} {result} iterations=3"
    assert len(asked) == 10


def test_the_scatter_of_the_measured_bar_is_over_the_way_of_its_tip() -> None:
    """0.5 mm of 27 mm."""
    assert frontier_cases.measured_scatter() == pytest.approx(0.504 / 27.27, rel=1e-3)
