"""The frontier's claims go red on what would contradict them, and the figure says who is who."""

from __future__ import annotations

from palpate.validation.peers import frontier
from palpate.validation.peers.frontier import Row, Runs, draw, judge
from palpate.validation.references.field_truth import FieldTruth, time_fastsim
from palpate.validation.states import Verdict

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
