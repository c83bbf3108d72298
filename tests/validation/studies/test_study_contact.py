"""The study of contact: its scenes, its verdicts both ways, and its page."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.fastsim.contact.static_contact import solve_contact
from palpate.meshes.problem import Material, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.report.study_page import study_page
from palpate.validation.states import Verdict
from palpate.validation.studies import contact
from palpate.validation.studies.closed_forms import contact_radius, hertz_force
from palpate.validation.studies.contact import Outcome, curve_table, present
from palpate.validation.studies.contact.motions import Collision, Fold, Speed
from palpate.validation.studies.contact.scenes import Pair, Scene, compare
from palpate.validation.studies.contact.sphere import (
    DEPTHS,
    RADIUS,
    Level,
    Penalty,
    hertz,
    hertz_level,
    quarter_block,
    sphere_into_block,
)


def coarse_block() -> TetMesh:
    """A quarter block with a seventh of the radius as its finest edge."""
    return quarter_block(0.15 * RADIUS, 0.3 * RADIUS, growth=0.4, width=2.0 * RADIUS)


def good() -> Outcome:
    """What a right simulator would leave."""
    levels = [Level(n, 1000 * n, 1.0 + 0.2 / n, 0.955 * (1.0 + 0.2 / n)) for n in (4, 8, 16)]
    forces = tuple((0.0, 0.0, hertz(depth)) for depth in DEPTHS)
    pairs = [
        Pair("sphere into block", strain, 10, forces, 1e-9, 1e-9, 1e-9, "") for strain in Strain
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
    return level._replace(linear=1.03 * level.linear, green=1.03 * level.green)


def slow(speed: Speed) -> Speed:
    return speed._replace(seconds=(1e-4, 1.3e-4, 1e-4, 2e-4))


def test_a_right_simulator_passes() -> None:
    assert set(verdicts(good())) == {Verdict.PASSED}


@pytest.mark.parametrize(
    ("place", "spoil"),
    [
        (0, lambda o: o._replace(levels=[farther(x) for x in o.levels])),
        (0, lambda o: o._replace(levels=o.levels[::-1])),
        (1, lambda o: o._replace(levels=[*o.levels[:2], o.levels[2]._replace(green=1.0)])),
        (2, lambda o: o._replace(pairs=[o.pairs[0]._replace(force_error=0.02), o.pairs[1]])),
        (3, lambda o: o._replace(pairs=[o.pairs[0], o.pairs[1]._replace(volume_error=np.nan)])),
        (4, lambda o: o._replace(last_depth=(0.12, 0.5, "a limit point"))),
        (5, lambda o: o._replace(penalties=[p._replace(lack=0.01) for p in o.penalties])),
        (6, lambda o: o._replace(collision=o.collision._replace(momentum_error=1e-6))),
        (7, lambda o: o._replace(folded=o.folded._replace(depths=(0.2, 0.3)))),
        (8, lambda o: o._replace(speeds=(slow(o.speeds[0]), o.speeds[1]))),
        (9, lambda o: o._replace(speeds=(o.speeds[0], o.speeds[1]._replace(time_step=1e-4)))),
        (9, lambda o: o._replace(speeds=(o.speeds[0], o.speeds[1]._replace(cells=20_000)))),
    ],
)
def test_each_spoiled_answer_fails_its_own_claim(
    place: int, spoil: Callable[[Outcome], Outcome]
) -> None:
    found = verdicts(spoil(good()))
    assert found[place] is Verdict.FAILED
    assert found.count(Verdict.FAILED) == 1


def test_hertz_is_the_published_formula() -> None:
    # 4/3 * 1000 / (1 - 0.25) * sqrt(0.04) * 0.0001^1.5 = 4/3 * 1333.33 * 0.2 * 1e-6 N
    expected = 4 / 3 * 1000 / 0.75 * 0.2 * 1e-6
    assert hertz_force(1e-4, Material(1000.0, 0.5 - 1e-12), 0.04) == pytest.approx(expected)
    # sqrt(0.04 * 1e-4)
    assert contact_radius(1e-4, 0.04) == pytest.approx(2e-3)


def test_a_coarse_level_is_stiffer_and_green_is_softer() -> None:
    level = hertz_level(3.0, 0.5, lambda _: None)
    assert 1.03 < level.linear < 1.15
    assert 0.93 < level.green / level.linear < 0.97


def test_a_quarter_is_a_quarter_of_the_whole() -> None:
    # The same cells turned about the axis: forces of the quarter's symmetry planes cancel.
    problem = sphere_into_block(coarse_block(), (0.0, 0.1))
    found = solve_contact(problem, strain=Strain.LINEAR)
    assert found.forces[-1, 0, 2] > 0.0
    # Diagonals of the mesh apart, x and y are alike.
    assert found.forces[-1, 0, 0] == pytest.approx(found.forces[-1, 0, 1], rel=1e-6)


@pytest.mark.dolfinx
@pytest.mark.parametrize("strain", list(Strain))
def test_a_coarse_scene_is_the_references(strain: Strain) -> None:
    problem = sphere_into_block(coarse_block(), (0.0, 0.05, 0.1))
    pair = compare(Scene("coarse", problem, 4.0), strain, lambda _: None)
    assert pair.forces[-1][2] > 0.0
    assert max(pair.force_error, pair.displacement_error, pair.volume_error) < 1e-7


def test_a_curve_that_ends_early_has_dashes() -> None:
    outcome = good()
    short = outcome.pairs[1]._replace(forces=outcome.pairs[1].forces[:3])
    rows = curve_table(outcome._replace(pairs=[outcome.pairs[0], short])).texts
    assert rows[0][2:] == ["0.0000", "-", "0.0000", "-"]
    assert rows[1][3] == rows[2][5] == "1.0000"
    assert rows[3][4:] == ["-", "-"]


def test_the_page_stands_alone() -> None:
    outcome = good()
    shown = present(outcome)
    assert len(shown.tables) == 6
    page = study_page("Contact", ["Why."], contact.judge(outcome), shown)
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org", "")
    assert "a limit point" in page
    assert page.count("<svg") == 2
