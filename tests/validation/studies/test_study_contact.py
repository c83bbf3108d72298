"""The study of contact: its scenes, its verdicts both ways, and its page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.fastsim.contact.static_contact import solve_contact
from palpate.meshes.problem import Material, Strain
from palpate.validation.report.study_page import write_study_page
from palpate.validation.states import Verdict
from palpate.validation.studies import contact, contact_page
from palpate.validation.studies import contact_scenes as scenes
from palpate.validation.studies.contact_bodies import Collision, Fold
from palpate.validation.studies.contact_hertz import (
    RADIUS,
    Zone,
    hertz_force,
    quarter_block,
    sphere_into_block,
)
from palpate.validation.studies.contact_runs import Level, Outcome, Penalty, hertz_level
from palpate.validation.studies.contact_speed import Speed


def good() -> Outcome:
    """What a right simulator would leave."""
    levels = [Level(n, 1000 * n, 1.0 + 0.2 / n, 0.955 * (1.0 + 0.2 / n)) for n in (4, 8, 16)]
    depths = np.array(scenes.DEPTHS) * RADIUS
    forces = tuple((0.0, 0.0, float(f)) for f in hertz_force(depths))
    pairs = [
        scenes.Pair("sphere into block", strain, 10, scenes.DEPTHS, forces, 1e-9, 1e-9, 1e-9, "")
        for strain in Strain
    ]
    penalties = [Penalty(n, 10.0 * n, 0.1 / n, 1e-6) for n in (3.0, 10.0, 30.0)]
    speeds = (
        Speed(20_000, 3e-4, (1e-4, 1.1e-4, 1.1e-4, 2e-4)),
        Speed(35_000, 2.5e-4, (2e-4, 2e-4, 2e-4, 4e-4)),
    )
    collision = Collision(1e-15, 1e-15, 1e-3, (0.95, 0.05))
    fold = Fold(2.0, (1e6, 4e6), (0.2, 0.05))
    return Outcome(levels, pairs, (0.2, 0.5, "a limit point"), penalties, speeds, collision, fold)


def verdicts(outcome: Outcome) -> list[Verdict]:
    return [finding.verdict for finding in contact.judge(outcome)]


def farther(level: Level) -> Level:
    return replace(level, linear=1.03 * level.linear, green=1.03 * level.green)


def slow(speed: Speed) -> Speed:
    return replace(speed, seconds=(1e-4, 1.3e-4, 1e-4, 2e-4))


def test_a_right_simulator_passes() -> None:
    assert set(verdicts(good())) == {Verdict.PASSED}


@pytest.mark.parametrize(
    ("place", "spoil"),
    [
        (0, lambda o: replace(o, levels=[farther(x) for x in o.levels])),
        (0, lambda o: replace(o, levels=o.levels[::-1])),
        (1, lambda o: replace(o, levels=[*o.levels[:2], replace(o.levels[2], green=1.0)])),
        (2, lambda o: replace(o, pairs=[replace(o.pairs[0], force_error=0.02), o.pairs[1]])),
        (3, lambda o: replace(o, pairs=[o.pairs[0], replace(o.pairs[1], volume_error=np.nan)])),
        (4, lambda o: replace(o, last_depth=(0.12, 0.5, "a limit point"))),
        (5, lambda o: replace(o, penalties=[replace(p, lack=0.01) for p in o.penalties])),
        (6, lambda o: replace(o, collision=replace(o.collision, momentum_error=1e-6))),
        (7, lambda o: replace(o, fold=replace(o.fold, depths=(0.2, 0.3)))),
        (8, lambda o: replace(o, speeds=(slow(o.speeds[0]), o.speeds[1]))),
        (9, lambda o: replace(o, speeds=(o.speeds[0], replace(o.speeds[1], time_step=1e-4)))),
        (9, lambda o: replace(o, speeds=(o.speeds[0], replace(o.speeds[1], cells=20_000)))),
    ],
)
def test_each_spoiled_answer_fails_its_own_claim(place: int, spoil) -> None:  # type: ignore[no-untyped-def]
    found = verdicts(spoil(good()))
    assert found[place] is Verdict.FAILED
    assert found.count(Verdict.FAILED) == 1


def test_hertz_is_the_published_formula() -> None:
    # 4/3 * 1000 / (1 - 0.25) * sqrt(0.04) * 0.0001^1.5 = 4/3 * 1333.33 * 0.2 * 1e-6 N
    expected = 4 / 3 * 1000 / 0.75 * 0.2 * 1e-6
    assert hertz_force(np.array(1e-4), Material(1000.0, 0.5 - 1e-12), 0.04) == pytest.approx(
        expected
    )


def test_a_coarse_level_is_stiffer_and_green_is_softer() -> None:
    level = hertz_level(3.0, 0.5, lambda _: None)
    assert 1.03 < level.linear < 1.15
    assert 0.93 < level.green / level.linear < 0.97


def test_a_quarter_is_a_quarter_of_the_whole() -> None:
    # The same cells turned about the axis: forces of the quarter's symmetry planes cancel.
    mesh = quarter_block(2.0 * RADIUS, Zone(0.15 * RADIUS, 0.3 * RADIUS, 0.4))
    problem = sphere_into_block(mesh, np.array([0.0, 0.1 * RADIUS]))
    found = solve_contact(problem, strain=Strain.LINEAR)
    assert found.forces[-1, 0, 2] > 0.0
    # Diagonals of the mesh apart, x and y are alike.
    assert found.forces[-1, 0, 0] == pytest.approx(found.forces[-1, 0, 1], rel=1e-6)


@pytest.mark.dolfinx
@pytest.mark.parametrize("strain", list(Strain))
def test_a_coarse_scene_is_the_references(strain: Strain) -> None:
    mesh = quarter_block(2.0 * RADIUS, Zone(0.15 * RADIUS, 0.3 * RADIUS, 0.4))
    problem = sphere_into_block(mesh, RADIUS * np.array([0.0, 0.05, 0.1]))
    pair = scenes.compare(scenes.Scene("coarse", problem, 4.0), strain, lambda _: None)
    assert pair.forces[-1][2] > 0.0
    assert max(pair.force_error, pair.displacement_error, pair.volume_error) < 1e-7


def test_the_page_stands_alone(tmp_path: Path) -> None:
    outcome = good()
    write_study_page(
        tmp_path / "report.html",
        title="Contact",
        about=["Why."],
        findings=contact.judge(outcome),
        figures=contact_page.draw(outcome, contact.HERTZ_LIMIT),
        tables=[
            contact_page.level_table(outcome),
            contact_page.curve_table(outcome),
            contact_page.pair_table(outcome),
            contact_page.penalty_table(outcome),
            contact_page.speed_table(outcome),
            contact_page.bodies_table(outcome),
        ],
    )
    page = (tmp_path / "report.html").read_text("utf-8")
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org", "")
    assert "a limit point" in page
    assert page.count("<svg") == 2
