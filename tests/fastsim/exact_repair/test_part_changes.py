"""Parts are compared before and after a repair: nothing is lost or changed too much unasked."""

from __future__ import annotations

import re

import numpy as np
import pytest

from palpate.fastsim import _core
from palpate.fastsim.exact_repair.part_changes import (
    ChangedPartError,
    Measure,
    PartChange,
    find_parts,
    measure,
    measure_changes,
    require_within,
    round_up,
    table,
)
from palpate.fastsim.exact_repair.solid_repair import repair_to_solid
from palpate.meshes.repair.choices import RepairChoices
from palpate.meshes.repair.surface_repair import repair_surface
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import TriSurface

BALL = shape_sphere(1.0, edge_length=0.2)
BOX = shape_box((1.0, 1.0, 1.0), edge_length=0.25)


def together(*bodies: TriSurface) -> TriSurface:
    starts = np.cumsum([0, *(len(body.points) for body in bodies)])
    return TriSurface(
        np.vstack([body.points for body in bodies]),
        np.vstack([b.facets + n for b, n in zip(bodies, starts, strict=False)]),
    )


def moved(body: TriSurface, x: float, y: float = 0.0, z: float = 0.0) -> TriSurface:
    return TriSurface(body.points + np.array([x, y, z]), body.facets)


def with_process(*, is_torn: bool) -> tuple[TriSurface, float]:
    """A box with a process of 0.25 x 0.25 x 0.3 on top, and the wall between; with its volume."""
    corners = [[0.25, 0.25], [0.5, 0.25], [0.5, 0.5], [0.25, 0.5]]
    base = [int(np.argmin(np.abs(BOX.points - [x, y, 1.0]).sum(axis=1))) for x, y in corners]
    top = [len(BOX.points) + k for k in range(4)]
    sides = []
    for k in range(4):
        a, b, c, d = base[k], base[(k + 1) % 4], top[(k + 1) % 4], top[k]
        sides += [[a, b, c], [a, c, d]]
    lid = [[top[0], top[1], top[2]], [top[0], top[2], top[3]]]
    points = np.vstack([BOX.points, BOX.points[base] + [0.0, 0.0, 0.3]])
    facets = np.vstack([BOX.facets, sides, lid[: 1 if is_torn else 2]])
    return TriSurface(points, facets), 1.0 + 0.25 * 0.25 * 0.3


@pytest.mark.parametrize("is_torn", [True, False])
def test_a_process_on_a_bone_is_no_fin(is_torn: bool) -> None:
    # A torn process ends free and hangs on edges of three facets, as a fin does; it has 5 % of the
    # area. Its neck's wall goes, and it stays.
    body, volume = with_process(is_torn=is_torn)
    done = repair_to_solid(body)
    (shell,) = require_closed(done.surface)
    assert shell.volume == pytest.approx(volume, rel=1e-12)


def test_a_flap_is_a_fin_however_far_it_stands_off() -> None:
    a, b = (int(np.argmin(np.abs(BOX.points - [x, 0.5, 1.0]).sum(axis=1))) for x in (0.25, 0.5))
    c = len(BOX.points)
    flap = TriSurface(np.vstack([BOX.points, [[0.3, 0.5, 3.0]]]), [*BOX.facets.tolist(), [a, b, c]])
    done = repair_to_solid(flap)
    assert done.lines == ["1 facet(s) of thin fins, inner walls and scraps removed"]
    assert done.surface.volume == pytest.approx(1.0, rel=1e-12)


def test_of_two_sheets_across_one_rim_one_goes() -> None:
    # Both triangulations of a quadrilateral that is not quite flat: edges of three facets.
    points = BOX.points.copy()
    rows = np.flatnonzero((points[BOX.facets][:, :, 2] == 1.0).all(axis=1))
    quad = next(
        [f, g] for f in rows for g in rows if f < g and len(set(BOX.facets[[f, g]].flat)) == 4
    )
    shared = [int(v) for v in set(BOX.facets[quad[0]]) & set(BOX.facets[quad[1]])]
    others = [int(v) for v in set(BOX.facets[quad].flat) - set(shared)]
    points[others[0], 2] += 0.02
    lens = [[others[0], others[1], shared[0]], [others[1], others[0], shared[1]]]
    done = repair_to_solid(TriSurface(points, np.vstack([BOX.facets, lens])))
    (shell,) = require_closed(done.surface)
    assert shell.volume == pytest.approx(1.0, rel=0.01)


def test_a_part_that_is_lost_is_refused_with_its_place() -> None:
    both = together(BALL, moved(BOX, 5.0))
    repaired, report = repair_surface(both)
    rows = np.arange(BALL.num_facets)
    new = TriSurface(repaired.points, repaired.facets[rows])
    changes = measure_changes(both, report, repaired, new, rows)
    assert [one.is_lost for one in changes] == [False, True]
    with pytest.raises(ChangedPartError, match=r"part 2, 192 facet\(s\) around .* would be lost"):
        require_within(changes, RepairChoices(distance=100.0))
    assert changes[1].position[0] > 4.5
    require_within(changes, RepairChoices(distance=100.0, limit=100.0))


def test_parts_that_are_fused_are_refused() -> None:
    cube = shape_box((1.0, 1.0, 1.0), edge_length=1.0)
    both = together(cube, moved(cube, 1.5))
    repaired, report = repair_surface(both)
    x = repaired.points[repaired.facets][:, :, 0]
    facing = ((x == 1.0) | (x == 1.5)).all(axis=1) & (np.ptp(x, axis=1) == 0.0)
    rows = np.flatnonzero(~facing)
    ring = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    at = [
        [int(np.argmin(np.abs(repaired.points - [x, y, z]).sum(axis=1))) for y, z in ring]
        for x in (1.0, 1.5)
    ]
    bridge = []
    for k in range(4):
        a, b, c, d = at[0][k], at[0][k - 1], at[1][k - 1], at[1][k]
        bridge += [[a, b, c], [a, c, d]]
    new = TriSurface(repaired.points, np.vstack([repaired.facets[rows], bridge]))
    number = np.concatenate([rows, np.full(8, -1)])
    (change,) = measure_changes(both, report, repaired, new, number)
    assert change.is_fused
    assert change.parts == (1, 2)
    with pytest.raises(ChangedPartError, match=r"part 1 and 2, .* would be fused"):
        require_within([change], RepairChoices(distance=100.0, limit=99.0))


def test_a_stray_body_within_another_becomes_no_cavity_unasked() -> None:
    small = TriSurface(0.1 * BOX.points, BOX.facets)
    both = together(BALL, small)
    with pytest.raises(ChangedPartError, match="would become a cavity") as caught:
        repair_to_solid(both)
    assert "a repair limit of 100 % would allow it" in str(caught.value)
    allowed = repair_to_solid(both, RepairChoices(limit=100.0)).surface
    assert allowed.volume == pytest.approx(BALL.volume - small.volume, rel=1e-12)
    dropped = repair_to_solid(both, RepairChoices(smallest_shell=0.2))
    assert dropped.surface.volume == pytest.approx(BALL.volume, rel=1e-12)


def test_parts_that_touch_at_an_edge_are_parts() -> None:
    shifted = moved(BOX, 1.0, 1.0)
    both = together(BOX, shifted)
    _, report = repair_surface(both)
    assert report.merged is not None
    part, is_closed = find_parts(report.merged.facets)
    assert is_closed.tolist() == [True, True]
    assert np.array_equal(part, np.repeat([0, 1], BOX.num_facets))


def test_what_touches_is_opened_by_the_least_gap_that_makes_a_solid() -> None:
    for shift in ((1.0, 1.0, 0.0), (1.0, 1.0, 1.0)):
        done = repair_to_solid(together(BOX, moved(BOX, *shift)))
        assert len(require_closed(done.surface)) == 2
        # 0.002 of the shortest edge there; 0.05 is what was opened before. Its distance is a bound.
        found = max(one.distance for one in done.changes)
        assert 0.0 < found <= 0.002 * 0.25 * 1.01 + 1e-3 * 0.3


def test_a_small_part_far_away_changes_nothing_of_what_is_merged() -> None:
    small = TriSurface(1e-2 * BOX.points + [1e6, 0.0, 0.0], BOX.facets)
    repaired, report = repair_surface(together(BALL, small))
    assert report.merged_points == 0
    assert repaired.num_facets == BALL.num_facets + BOX.num_facets


def test_the_distance_is_an_upper_bound_where_samples_see_nothing() -> None:
    # A flat facet, and a square with a pit: corners, middles of sides and centre meet at 0.
    pit = np.array([0.37, 0.21, -0.5])
    ring = [[0.32, 0.16, 0.0], [0.42, 0.16, 0.0], [0.42, 0.26, 0.0], [0.32, 0.26, 0.0]]
    rim = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]
    facets = [[4, 5, 8], [5, 6, 8], [6, 7, 8], [7, 4, 8]]
    for k in range(4):
        n = (k + 1) % 4
        facets += [[k, n, 4 + n], [k, 4 + n, 4 + k]]
    tree = _core.SurfaceDistance(np.array([*rim, *ring, pit]), np.array(facets, dtype=np.int32))
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    middles = 0.5 * (corners + corners[[1, 2, 0]])
    samples = np.vstack([corners, middles, corners.mean(axis=0)])
    assert tree.distances(samples).max() < 1e-12
    (found,) = tree.farthest(corners, np.array([[0, 1, 2]], dtype=np.int32), 1e-4)
    weights = np.random.default_rng(1).dirichlet([1.0, 1.0, 1.0], 200_000)
    dense = tree.distances(weights @ corners).max()
    assert dense > 0.04
    # A hundredth of itself and the accuracy above, and what samples 0.003 apart miss of it.
    assert dense <= found <= 1.01 * dense + 1e-4 + 0.003


def test_distances_of_random_facets_are_bounds() -> None:
    rng = np.random.default_rng(7)
    tree = _core.SurfaceDistance(BALL.points, BALL.facets)
    points = rng.uniform(-1.5, 1.5, (60, 3))
    facets = np.arange(60, dtype=np.int32).reshape(-1, 3)
    found = tree.farthest(points, facets, 1e-3)
    weights = rng.dirichlet([1.0, 1.0, 1.0], 5_000)
    dense = np.array([tree.distances(weights @ points[f]).max() for f in facets])
    assert np.all(found >= dense)
    # A hundredth and the accuracy above, and what samples a tenth apart miss.
    assert np.all(found <= 1.01 * dense + 1e-3 + 0.03)


def test_numbers_are_rounded_up() -> None:
    for value in (0.0149, 1.2701, 9.995, 1.0, 100.0, 0.000123456):
        assert value <= round_up(value) <= 1.011 * value
        assert float(f"{round_up(value):.3g}") == round_up(value)


def test_the_suggested_distance_is_for_all_parts() -> None:
    # Half a mean edge allows the coarse part 0.5, and the fine one 0.05.
    body = Measure(100, 1.0, 6.0, 1, 0)
    coarse, fine = (
        PartChange((k,), body, body, distance, edge, (0.0, 0.0, 0.0), False, False)
        for k, distance, edge in ((1, 0.4, 1.0), (2, 0.06, 0.1))
    )
    with pytest.raises(ChangedPartError, match=r"1 part\(s\): part 2, .*; a repair .* of 0.4 m"):
        require_within([coarse, fine], RepairChoices())
    require_within([coarse, fine], RepairChoices(distance=0.4))


def test_measures_are_those_of_the_body() -> None:
    one = measure(BOX.points, BOX.facets)
    assert (one.facets, one.shells, one.genus) == (BOX.num_facets, 1, 0)
    assert one.volume == pytest.approx(1.0, rel=1e-12)
    assert one.area == pytest.approx(6.0, rel=1e-12)
    # Without its lid the box is closed by a flat fan again.
    lid = (BOX.points[BOX.facets][:, :, 2] == 1.0).all(axis=1)
    torn = measure(BOX.points, BOX.facets[~lid])
    assert torn.genus is None
    assert torn.volume == pytest.approx(1.0, rel=1e-12)


def test_the_table_says_each_part_in_the_files_unit() -> None:
    ball = TriSurface(1e-3 * BALL.points, BALL.facets)
    lobes = together(ball, moved(ball, 1.97e-3))
    done = repair_to_solid(lobes, RepairChoices(limit=50.0, distance=1e-4))
    lines = table(done.changes, "mm", 1e-3)
    assert re.split(r"  +", lines[0]) == [
        "part", "facets", "volume [mm3]", "area [mm2]", "moved [mm]", "parts", "handles",
    ]  # fmt: skip
    assert len(lines) == 3
    for line, change in zip(sorted(lines[1:]), done.changes, strict=True):
        cells = re.split(r"  +", line)
        assert cells[0] == str(change.parts[0])
        assert cells[1] == f"{BALL.num_facets} > {change.after.facets}"
        before, after = map(float, cells[2].split(" > "))
        assert before == pytest.approx(BALL.volume, rel=1e-3)
        assert after == pytest.approx(1e9 * change.after.volume, rel=1e-3)
        assert float(cells[4]) >= 1e3 * change.distance
        assert cells[5:] == ["1 > 1", "0 > 0"]
