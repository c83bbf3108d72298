"""Repairs bring back a sound surface from a spoiled one, and say what they did."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.meshes.repair.surface_repair import RepairReport, repair_surface
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.surface_checks import find_near_duplicates, require_closed
from palpate.meshes.tri_surface import (
    DegenerateFacetError,
    OpenSurfaceError,
    OrientationError,
    TriSurface,
)

# Around the box in the plane x = 0.5, in (y, z).
_AROUND = ((0, 0), (0.5, 0), (1, 0), (1, 0.5), (1, 1), (0.5, 1), (0, 1), (0, 0.5))
BALL = shape_sphere(1.0, edge_length=0.3)


def test_a_sound_surface_is_left_as_it_is() -> None:
    repaired, report = repair_surface(BALL)
    assert report == RepairReport()
    assert report.lines() == []
    # Points may be renumbered by first appearance; places and facets are the same.
    assert np.array_equal(repaired.points[repaired.facets], BALL.points[BALL.facets])


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_soup_with_noise_turned_facets_and_holes_is_repaired(seed: int) -> None:
    rng = np.random.default_rng(seed)
    noise = rng.uniform(-1e-8, 1e-8, (3 * BALL.num_facets, 3))
    facets = np.arange(3 * BALL.num_facets).reshape(-1, 3)
    turned = rng.random(BALL.num_facets) < 0.3
    facets[turned] = facets[turned][:, ::-1]
    hole = int(rng.integers(BALL.num_facets))
    soup = TriSurface(
        BALL.points[BALL.facets].reshape(-1, 3) + noise, np.delete(facets, hole, axis=0)
    )
    with pytest.raises(OpenSurfaceError):
        require_closed(soup)
    repaired, report = repair_surface(soup)
    require_closed(repaired)
    assert len(repaired.points) == len(BALL.points)
    assert repaired.volume == pytest.approx(BALL.volume, rel=1e-7)
    assert len(report.filled_holes) == 1
    assert report.open_holes == []
    corners = {tuple(np.round(p, 6) + 0.0) for p in repaired.points[report.filled_holes[0]]}
    assert corners == {tuple(np.round(p, 6) + 0.0) for p in BALL.points[BALL.facets[hole]]}
    kept_turned = set(np.flatnonzero(np.delete(turned, hole)).tolist())
    assert set(report.turned_facets) == kept_turned
    assert report.merged_points == 3 * (BALL.num_facets - 1) - len(BALL.points)


def test_a_hole_of_several_facets_is_closed_and_a_large_one_is_left_and_told() -> None:
    apex = np.flatnonzero((BALL.facets == 0).any(axis=1))
    torn = TriSurface(BALL.points, np.delete(BALL.facets, apex, axis=0))
    repaired, report = repair_surface(torn)
    require_closed(repaired)
    assert len(report.filled_holes[0]) == len(apex)
    assert report.unused_points == [0]
    left, reported = repair_surface(torn, largest_hole=len(apex) - 1)
    assert len(reported.open_holes) == 1
    assert left.num_facets == torn.num_facets
    assert "left open" in " ".join(reported.lines())
    with pytest.raises(OpenSurfaceError):
        require_closed(left)


def test_shells_are_turned_by_their_nesting() -> None:
    small = shape_box((0.2, 0.2, 0.2), edge_length=0.1)
    both = TriSurface(
        np.vstack([BALL.points, small.points]),
        np.vstack([BALL.facets[:, ::-1], small.facets + len(BALL.points)]),
    )
    repaired, report = repair_surface(both)
    require_closed(repaired)
    assert repaired.volume == pytest.approx(BALL.volume - small.volume, rel=1e-12)
    assert len(report.turned_facets) == both.num_facets


def test_a_wall_within_goes_and_what_cannot_be_repaired_safely_is_refused() -> None:
    box = shape_box((1.0, 1.0, 1.0), edge_length=0.5)
    at = [int(np.argmin(np.abs(box.points - [0.5, y, z]).sum(axis=1))) for y, z in _AROUND]
    centre = len(box.points)
    walled = TriSurface(
        np.vstack([box.points, [[0.5, 0.5, 0.5]]]),
        np.vstack([box.facets, [[at[k], at[(k + 1) % 8], centre] for k in range(8)]]),
    )
    # A wall across the box, given once: three facets at its edges. The solid is that without it.
    repaired, report = repair_surface(walled)
    require_closed(repaired)
    assert report.fin_facets == list(range(box.num_facets, walled.num_facets))
    assert repaired.volume == pytest.approx(box.volume, rel=1e-12)
    with pytest.raises(DegenerateFacetError):
        repair_surface(BALL, near=10.0)
    k = np.arange(6)
    angle = 2 * np.pi * k / 6
    up, out = np.sin(angle / 2), 1 + 0.3 * np.cos(angle / 2)
    rim = [
        np.column_stack(
            [(1 + s * (out - 1)) * np.cos(angle), (1 + s * (out - 1)) * np.sin(angle), 0.3 * s * up]
        )
        for s in (1, -1)
    ]
    quads = [
        (i, (i + 1) % 6 + (6 if i == 5 else 0), 6 + i, (6 + i + 1) if i < 5 else 0)
        for i in range(6)
    ]
    band = TriSurface(
        np.vstack(rim), np.array([t for a, b, c, d in quads for t in ((a, b, c), (b, d, c))])
    )
    with pytest.raises(OrientationError, match="one-sided"):
        repair_surface(band)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 0.3))
def test_near_duplicates_are_those_of_all_pairs(seed: int, distance: float) -> None:
    points = np.random.default_rng(seed).random((25, 3))
    gap = np.linalg.norm(points[:, None] - points[None], axis=2)
    expected = np.argwhere(np.triu(gap <= distance, 1))
    assert np.array_equal(find_near_duplicates(points, distance), expected)
