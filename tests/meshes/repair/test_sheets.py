"""Sheets that meet where they must not: fins, walls, bodies that touch; and crumbs."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.exact_repair.patch_repairs import is_clean
from palpate.meshes.repair.sheets import copied_sheets
from palpate.meshes.repair.surface_repair import repair_surface
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.shells import find_shells
from palpate.meshes.surface_checks import merge_equal_points, require_closed
from palpate.meshes.tri_surface import NonManifoldError, TriSurface

EDGE = 0.25
BOX = shape_box((1.0, 1.0, 1.0), edge_length=EDGE)


def beside(shift: tuple[float, float, float], other: TriSurface = BOX) -> TriSurface:
    return TriSurface(
        np.vstack([BOX.points, other.points + np.array(shift)]),
        np.vstack([BOX.facets, other.facets + len(BOX.points)]),
    )


def test_an_open_copy_goes_and_a_sheet_of_its_own_stays() -> None:
    patch = BOX.facets[:20]
    beside_it = TriSurface(BOX.points + 0.01 * EDGE, patch)
    both = TriSurface(
        np.vstack([BOX.points, beside_it.points]),
        np.vstack([BOX.facets, patch + len(BOX.points)]),
    )
    assert np.flatnonzero(copied_sheets(both.points, both.facets)).tolist() == list(
        range(BOX.num_facets, BOX.num_facets + len(patch))
    )
    repaired, report = repair_surface(both)
    assert report.fin_facets == list(range(BOX.num_facets, BOX.num_facets + len(patch)))
    assert repaired.num_facets == BOX.num_facets
    # A fifth of an edge beside, or with a corner elsewhere: no copy.
    for shift in (0.2 * EDGE, 0.0):
        points = both.points.copy()
        points[len(BOX.points) :] += shift
        points[len(BOX.points) + patch[3, 0]] += 0.1 * EDGE * (shift == 0.0)
        assert not copied_sheets(points, both.facets).any()


@pytest.mark.parametrize(("shift", "num_points"), [((1, 1, 0), 5), ((1, 1, 1), 1)])
def test_boxes_that_touch_are_parted_by_a_stated_gap(
    shift: tuple[float, float, float], num_points: int
) -> None:
    touching = beside(shift)
    # As a file has it: the points of one place are one.
    with pytest.raises(NonManifoldError):
        require_closed(merge_equal_points(touching))
    repaired, report = repair_surface(touching, fits=is_clean)
    require_closed(repaired)
    assert is_clean(repaired.points, repaired.facets, np.ones(repaired.num_facets, dtype=bool))
    assert len(find_shells(repaired)) == 2
    assert report.split_points == num_points
    assert 0.0 < report.gap < 0.1 * EDGE
    gap = np.linalg.norm(
        repaired.points[repaired.facets] - touching.points[touching.facets], axis=2
    )
    assert gap.max() == pytest.approx(report.gap, rel=1e-12)
    assert "sheets touched split" in " ".join(report.lines())


# The box next to BOX in x, its facets mirrored: the wall between is the same in both.
NEXT = TriSurface(BOX.points * [-1.0, 1.0, 1.0] + [2.0, 0.0, 0.0], BOX.facets[:, ::-1])


def test_a_body_pinched_along_an_edge_is_parted_by_the_solid() -> None:
    # Three of four boxes around an edge: two touch along it, the third joins them.
    above = TriSurface(NEXT.points * [1.0, -1.0, 1.0] + [0.0, 2.0, 0.0], NEXT.facets[:, ::-1])
    three = TriSurface(
        np.vstack([BOX.points, NEXT.points, above.points]),
        np.vstack([BOX.facets, NEXT.facets + len(BOX.points), above.facets + 2 * len(BOX.points)]),
    )
    repaired, report = repair_surface(three, fits=is_clean)
    require_closed(repaired)
    assert len(find_shells(repaired)) == 1
    assert repaired.volume == pytest.approx(3.0, rel=1e-12)
    assert len(report.fin_facets) == 2 * len(BOX.facets) // 6  # the two walls between


def test_a_body_that_meets_itself_along_an_edge_is_parted_by_the_solid() -> None:
    # Cubes of a grid around a hollow: (1, 0, 0) and (0, 1, 0) meet along an edge alone, and hang
    # together by the cubes above.
    cubes = {(1, 0, 0), (0, 1, 0), (1, 0, 1), (0, 1, 1), (0, 0, 1)}
    body = _walls_of(cubes)
    with pytest.raises(NonManifoldError):
        require_closed(body)
    repaired, report = repair_surface(body, fits=is_clean)
    (shell,) = require_closed(repaired)
    assert is_clean(repaired.points, repaired.facets, np.ones(repaired.num_facets, dtype=bool))
    assert report.split_points >= 1
    assert shell.volume == pytest.approx(5.0, rel=0.05)


def _walls_of(cubes: set[tuple[int, int, int]]) -> TriSurface:
    """The squares between cubes and nothing, each cut in two along the same diagonal."""
    points: dict[tuple[int, int, int], int] = {}
    facets = []
    for cube in sorted(cubes):
        for axis in range(3):
            for side in (0, 1):
                beyond = list(cube)
                beyond[axis] += 2 * side - 1
                if tuple(beyond) in cubes:
                    continue
                ring = []
                for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)):
                    corner = list(cube)
                    corner[axis] += side
                    corner[(axis + 1) % 3] += u
                    corner[(axis + 2) % 3] += v
                    a, b, c = corner
                    ring.append(points.setdefault((a, b, c), len(points)))
                order = ring if side else ring[::-1]
                facets += [[order[0], order[1], order[2]], [order[0], order[2], order[3]]]
    return TriSurface(np.array(list(points), dtype=float), np.array(facets, dtype=np.int32))


def test_boxes_on_each_other_are_one_body_without_the_wall() -> None:
    both = TriSurface(
        np.vstack([BOX.points, NEXT.points]), np.vstack([BOX.facets, NEXT.facets + len(BOX.points)])
    )
    repaired, report = repair_surface(both)
    assert [shell.volume for shell in require_closed(repaired)] == pytest.approx([2.0], rel=1e-12)
    assert "inner walls" in " ".join(report.lines())


def test_fins_and_copies_are_removed_and_what_they_stood_on_stays() -> None:
    tip = len(BOX.points)
    a, b = BOX.facets[0, :2]
    out = BOX.points[a] + [[0.1, 0.1, 0.5], [0.2, 0.3, 0.5]]
    fin = [[a, b, tip], [b, tip + 1, tip]]
    spoiled = TriSurface(
        np.vstack([BOX.points, out]),
        np.vstack([BOX.facets, fin, BOX.facets[3:5], BOX.facets[7:9, ::-1]]),
    )
    repaired, report = repair_surface(spoiled)
    require_closed(repaired)
    assert np.array_equal(repaired.points[repaired.facets], BOX.points[BOX.facets])
    assert report.fin_facets == [BOX.num_facets, BOX.num_facets + 1]
    assert len(report.dropped_facets) == 4


def test_crumbs_are_told_and_dropped_by_choice() -> None:
    crumb = shape_sphere(0.02, edge_length=0.01)
    spoiled = beside((2.0, 0.5, 0.5), crumb)
    kept, reported = repair_surface(spoiled)
    assert kept.num_facets == spoiled.num_facets
    assert reported.small_parts == pytest.approx([0.04], rel=0.01)
    assert "small loose part(s) kept" in " ".join(reported.lines())
    dropped, report = repair_surface(spoiled, smallest_shell=0.1)
    assert dropped.num_facets == BOX.num_facets
    assert report.loose_facets == list(range(BOX.num_facets, spoiled.num_facets))
    # The largest part stays whatever is asked for.
    assert repair_surface(spoiled, smallest_shell=10.0)[0].num_facets == BOX.num_facets


def test_an_edge_across_a_flat_facet_is_flipped() -> None:
    a, b, c = BOX.facets[0]
    other = np.flatnonzero(np.isin(BOX.facets, [a, b]).sum(axis=1) == 2)
    (across,) = (int(f) for f in other if f != 0)
    (d,) = set(BOX.facets[across].tolist()) - {int(a), int(b)}
    new = len(BOX.points)
    middle = 0.5 * (BOX.points[a] + BOX.points[b])
    flat = TriSurface(
        np.vstack([BOX.points, [middle]]),
        np.vstack([np.delete(BOX.facets, 0, axis=0), [[a, new, c], [new, b, c], [a, b, new]]]),
    )
    repaired, report = repair_surface(flat)
    require_closed(repaired)
    assert report.flipped_edges == 1
    assert repaired.volume == pytest.approx(1.0, rel=1e-12)
    assert d < new
