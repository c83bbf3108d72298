"""Surfaces made to cut themselves by seeded recipes come back without a crossing."""

from __future__ import annotations

import re

import numpy as np
import pytest

from palpate.fastsim.exact_repair.part_changes import ChangedPartError, distances_apart
from palpate.fastsim.exact_repair.patch_repairs import Surroundings, all_crossings, pushed_back
from palpate.fastsim.exact_repair.solid_repair import EntangledError, repair_to_solid, untangle
from palpate.fastsim.mesher import mesh_surface
from palpate.fastsim.surface_remesher import mean_edge_length
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.repair.choices import RepairChoices
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import SelfIntersectionError, TriSurface

KIDNEY = shape_kidney(edge_length=8e-3)
PLATE = shape_box((1.0, 1.0, 0.1), edge_length=0.05)


def spoil(body: TriSurface, kind: str, seed: int) -> TriSurface:
    """Push the points within some edges of one at random: crumpled, slid along, or pressed in."""
    rng = np.random.default_rng(seed)
    edge = mean_edge_length(body.points, body.facets)
    centre = body.points[rng.integers(len(body.points))]
    near = np.linalg.norm(body.points - centre, axis=1) < rng.uniform(1.5, 4.0) * edge
    points = body.points.copy()
    if kind == "crumpled":
        points[near] += rng.uniform(0.3, 0.7) * edge * rng.standard_normal((near.sum(), 3))
    else:
        away = centre - body.points.mean(axis=0)
        away /= np.linalg.norm(away)
        along = np.cross(away, rng.standard_normal(3))
        along /= np.linalg.norm(along)
        push = rng.uniform(1.5, 3.0) * edge * (along if kind == "slid" else -away)
        points[near] += push
    return TriSurface(points, body.facets)


def require_solid(given: TriSurface, distance: float) -> tuple[TriSurface, int]:
    """Repaired within the distance, checked by the exact test."""
    pairs = len(all_crossings(given.points, given.facets))
    repaired, report, number = untangle(given)
    require_closed(repaired)
    assert len(all_crossings(repaired.points, repaired.facets)) == 0
    assert report.num_pairs == pairs
    everything = np.ones(given.num_facets, dtype=bool)
    no_cap = np.zeros(repaired.num_facets, dtype=bool)
    far = distances_apart(given, repaired, 1e-3 * distance, everything, no_cap)
    assert max(far[0].max(), far[1].max()) <= distance
    stays = number >= 0
    untouched = np.setdiff1d(number[stays], report.replaced_facets)
    same = np.isin(number, untouched)
    assert np.array_equal(
        repaired.points[repaired.facets[same]], given.points[given.facets[number[same]]]
    )
    return repaired, pairs


@pytest.mark.parametrize(
    ("kind", "seed"),
    [("crumpled", 4), ("crumpled", 7), ("slid", 0), ("slid", 7), ("pressed", 1), ("pressed", 4)],
)
def test_a_spoiled_organ_is_repaired_and_meshed(kind: str, seed: int) -> None:
    given = spoil(KIDNEY, kind, seed)
    distance = 3.0 * mean_edge_length(KIDNEY.points, KIDNEY.facets)
    repaired, pairs = require_solid(given, distance)
    assert pairs > 0
    with pytest.raises(SelfIntersectionError):
        mesh_surface(given)
    assert mesh_surface(repaired).volume == pytest.approx(repaired.volume, rel=1e-12)


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["crumpled", "slid", "pressed"])
@pytest.mark.parametrize("body", [KIDNEY, PLATE, shape_sphere(1.0, edge_length=0.1)])
def test_many_spoiled_surfaces_are_repaired_or_refused(body: TriSurface, kind: str) -> None:
    distance = 3.0 * mean_edge_length(body.points, body.facets)
    refused = []
    for seed in range(40):
        given = spoil(body, kind, seed)
        try:
            require_solid(given, distance)
        except EntangledError as error:
            refused.append(error)
    assert all(error.facets for error in refused)
    # With three edges of distance allowed, at most one surface in twenty is refused.
    assert len(refused) <= 2


def test_lobes_that_run_into_each_other_are_pulled_apart_inwards() -> None:
    ball = shape_sphere(1.0, edge_length=0.2)
    both = TriSurface(
        np.vstack([ball.points, ball.points + np.array([1.97, 0.0, 0.0])]),
        np.vstack([ball.facets, ball.facets + len(ball.points)]),
    )
    repaired, pairs = require_solid(both, 0.1)
    assert pairs > 0
    assert repaired.volume < both.volume


def test_walls_that_run_through_each_other_are_pulled_apart_outwards() -> None:
    given = PLATE.points.copy()
    deep = np.linalg.norm(given - [0.5, 0.5, 0.1], axis=1) < 0.08
    given[deep, 2] -= 0.11
    repaired, pairs = require_solid(TriSurface(given, PLATE.facets), 0.1)
    assert pairs > 0
    assert repaired.volume > TriSurface(given, PLATE.facets).volume


def test_what_pierces_a_wall_is_pushed_back_and_the_wall_the_other_way() -> None:
    given = PLATE.points.copy()
    deep = np.linalg.norm(given - [0.5, 0.5, 0.1], axis=1) < 0.08
    given[deep, 2] -= 0.11
    body = TriSurface(given, PLATE.facets)
    # It is 0.01 through the wall: 0.005 for each of the two is the least that parts them.
    whole = Surroundings(given, PLATE.facets, np.zeros(len(given), bool), len(PLATE.facets))
    rows = np.unique(all_crossings(given, PLATE.facets)).astype(np.int64)
    made = pushed_back(whole, rows, most=0.01)
    assert made is not None
    assert not len(all_crossings(made.points, made.facets))
    shift = made.points - given
    assert shift[deep, 2].min() > 0.0
    assert shift[given[:, 2] == 0.0, 2].min() < 0.0
    assert pushed_back(whole, rows, most=0.004) is None
    # Within half an edge, as it is allowed by default.
    assert repair_to_solid(body).changes[0].distance <= 0.5 * mean_edge_length(given, PLATE.facets)


@pytest.mark.parametrize(("kind", "seed"), [("crumpled", 4), ("slid", 7), ("pressed", 1)])
def test_beyond_what_is_allowed_it_is_refused_and_what_is_suggested_does(
    kind: str, seed: int
) -> None:
    given = spoil(KIDNEY, kind, seed)
    with pytest.raises(ChangedPartError, match="would allow it") as caught:
        repair_to_solid(given, RepairChoices(distance=1e-5, limit=0.0))
    limit = re.search(r"limit of ([\d.e-]+) %", str(caught.value))
    distance = re.search(r"distance of ([\d.e-]+) m", str(caught.value))
    assert limit is not None
    assert distance is not None
    done = repair_to_solid(given, RepairChoices(distance=float(distance[1]), limit=float(limit[1])))
    require_closed(done.surface)
    # Its digits say more than is needed, but not a per cent more.
    with pytest.raises(ChangedPartError):
        repair_to_solid(given, RepairChoices(distance=0.98 * float(distance[1]), limit=100.0))


def test_what_was_done_is_said() -> None:
    given = spoil(KIDNEY, "crumpled", 4)
    done = repair_to_solid(given, RepairChoices(distance=0.03, limit=100.0))
    (line,) = done.lines
    assert "cut each other in 1 region" in line
    sound = repair_to_solid(KIDNEY)
    assert sound.lines == []
    assert [one.volume_change for one in sound.changes] == [0.0]
