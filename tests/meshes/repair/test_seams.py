"""Seams that do not quite meet, and walls between bodies that are cut into other facets."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from palpate.meshes.repair.surface_repair import repair_surface
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.surface_checks import merge_equal_points, require_closed
from palpate.meshes.tri_surface import NonManifoldError, TriSurface

BOX = shape_box((1.0, 1.0, 1.0), edge_length=0.25)
BALL = shape_sphere(1.0, edge_length=0.3)


def halves(shift: float) -> TriSurface:
    """Two bodies of points of their own, the second one moved a little."""
    middle = BALL.points[BALL.facets].mean(axis=1)[:, 2] > 0.0
    return TriSurface(
        np.vstack([BALL.points, BALL.points + np.array([shift, 0.0, 0.0])]),
        np.vstack([BALL.facets[middle], BALL.facets[~middle] + len(BALL.points)]),
    )


def test_rims_a_little_apart_are_welded_and_others_are_not() -> None:
    repaired, report = repair_surface(halves(1e-4))
    require_closed(repaired)
    assert repaired.num_facets == BALL.num_facets
    assert report.merged_points > 0
    assert repaired.volume == pytest.approx(BALL.volume, rel=1e-3)
    far, report = repair_surface(halves(0.1))
    assert report.merged_points == 0
    assert far.num_facets > BALL.num_facets


def test_points_of_a_closed_surface_are_not_welded() -> None:
    # Two points nearer than a hundredth of the edges of others, and no rim.
    points = BALL.points.copy()
    a, b = BALL.facets[0][:2]
    points[a] = points[b] + 1e-3 * (points[a] - points[b])
    close = TriSurface(points, BALL.facets)
    repaired, report = repair_surface(close)
    assert report.merged_points == 0
    assert repaired.num_facets == BALL.num_facets


def test_an_edge_is_cut_at_all_points_that_lie_on_it() -> None:
    a, b, c = BOX.facets[0]
    parts = np.array([0.2, 0.5, 0.9])[:, None]
    new = (1.0 - parts) * BOX.points[a] + parts * BOX.points[b]
    n = len(BOX.points)
    chain = [a, n, n + 1, n + 2, b]
    rows = [[u, v, c] for u, v in itertools.pairwise(chain)]
    hanging = TriSurface(np.vstack([BOX.points, new]), np.vstack([BOX.facets[1:], rows]))
    repaired, report = repair_surface(hanging)
    require_closed(repaired)
    assert report.cut_edges == 1
    assert report.filled_holes == []
    assert repaired.volume == pytest.approx(1.0, rel=1e-14)
    assert report.lines() == ["1 open edge(s) cut at points that lie on them"]


def test_a_wall_between_boxes_goes_though_its_sides_have_other_facets() -> None:
    # The diagonals of a box's opposite faces cross each other.
    both = TriSurface(
        np.vstack([BOX.points, BOX.points + np.array([1.0, 0.0, 0.0])]),
        np.vstack([BOX.facets, BOX.facets + len(BOX.points)]),
    )
    with pytest.raises(NonManifoldError):
        require_closed(merge_equal_points(both))
    repaired, report = repair_surface(both)
    require_closed(repaired)
    assert repaired.volume == pytest.approx(2.0, rel=1e-14)
    assert len(report.fin_facets) == 4 * 4 * 2 * 2
