"""Each way in which a surface can fail to bound a solid is named, with the guilty facets."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.meshes import arrays
from palpate.meshes.arrays import equal_points
from palpate.meshes.errors import IndexRangeError, NonFiniteError
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.surface_checks import (
    _surely_apart,
    find_near_duplicates,
    merge_equal_points,
    merge_of,
    require_closed,
)
from palpate.meshes.tri_surface import (
    DegenerateFacetError,
    DuplicateFacetError,
    EmptySurfaceError,
    NonManifoldError,
    OpenSurfaceError,
    OrientationError,
    TriSurface,
)

BOX = shape_box(edge_length=0.5)


def with_facets(facets: np.ndarray) -> TriSurface:  # type: ignore[type-arg]
    return TriSurface(BOX.points, facets)


def test_a_closed_box_is_accepted_and_changes_with_order_do_not_matter() -> None:
    require_closed(BOX)
    rng = np.random.default_rng(1)
    rows = rng.permutation(len(BOX.facets))
    require_closed(with_facets(np.roll(BOX.facets[rows], 1, axis=1)))


def test_empty() -> None:
    with pytest.raises(EmptySurfaceError):
        require_closed(with_facets(np.zeros((0, 3), dtype=int)))


def test_a_hole_lists_its_edges_and_facets() -> None:
    with pytest.raises(OpenSurfaceError) as caught:
        require_closed(with_facets(np.delete(BOX.facets, 5, axis=0)))
    assert {frozenset(e) for e in caught.value.edges} == {
        frozenset(map(int, BOX.facets[5, [i, j]])) for i, j in ((0, 1), (1, 2), (2, 0))
    }
    assert len(caught.value.facets) == 3


@settings(max_examples=25, deadline=None)
@given(st.integers(0, len(BOX.facets) - 1))
def test_a_flipped_facet_is_found_with_its_neighbours(which: int) -> None:
    facets = BOX.facets.copy()
    facets[which] = facets[which][::-1]
    with pytest.raises(OrientationError) as caught:
        require_closed(with_facets(facets))
    assert which in caught.value.facets
    assert len(caught.value.facets) == 4


def test_a_surface_turned_inside_out() -> None:
    with pytest.raises(OrientationError, match="inwards"):
        require_closed(with_facets(BOX.facets[:, ::-1]))


def test_a_facet_given_twice() -> None:
    with pytest.raises(DuplicateFacetError) as caught:
        require_closed(with_facets(np.vstack([BOX.facets, BOX.facets[3]])))
    assert caught.value.facets == [3, len(BOX.facets)]


def test_a_flat_facet() -> None:
    points = np.vstack([BOX.points, BOX.points[BOX.facets[0, :2]].mean(axis=0)])
    facets = np.vstack([BOX.facets, [*BOX.facets[0, :2], len(BOX.points)]])
    with pytest.raises(DegenerateFacetError) as caught:
        require_closed(TriSurface(points, facets))
    assert caught.value.facets == [len(BOX.facets)]


def test_two_boxes_that_share_an_edge_and_two_that_share_a_point() -> None:
    cube = shape_box(edge_length=1.0)
    for shift, kind in (([1.0, 1.0, 0.0], "edges"), ([1.0, 1.0, 1.0], "vertices")):
        both = TriSurface(
            np.vstack([cube.points, cube.points + shift]),
            np.vstack([cube.facets, cube.facets + len(cube.points)]),
        )
        with pytest.raises(NonManifoldError) as caught:
            require_closed(merge_equal_points(both))
        assert len(getattr(caught.value, kind)) == 1
        assert caught.value.facets


def test_nan_and_index_out_of_range_name_the_rows() -> None:
    points = BOX.points.copy()
    points[7, 1] = np.nan
    with pytest.raises(NonFiniteError) as caught:
        TriSurface(points, BOX.facets)
    assert caught.value.points == [7]
    facets = BOX.facets.copy()
    facets[2, 0] = len(BOX.points)
    with pytest.raises(IndexRangeError) as out:
        with_facets(facets)
    assert out.value.rows == [2]


def test_soup_is_merged_and_unused_points_are_dropped() -> None:
    sphere = shape_sphere(edge_length=0.5)
    soup = TriSurface(
        np.vstack([sphere.points[sphere.facets].reshape(-1, 3), [[9.0, 9.0, 9.0]]]),
        np.arange(3 * len(sphere.facets)).reshape(-1, 3),
    )
    with pytest.raises(OpenSurfaceError):
        require_closed(soup)
    merged, first = merge_of(soup)
    require_closed(merged)
    np.testing.assert_array_equal(soup.points[first], merged.points)
    # The first of the equal ones each: no earlier point of the soup is equal to one of them.
    earliest = [int((soup.points == point).all(axis=1).argmax()) for point in merged.points]
    np.testing.assert_array_equal(first, earliest)
    assert len(merged.points) == len(sphere.points)
    assert merged.volume == pytest.approx(sphere.volume, rel=1e-14)


@pytest.mark.parametrize("scale", [1e-300, 1e-160, 1.0, 1e200, 1e300])
def test_near_points_are_found_at_every_scale(scale: float) -> None:
    points = np.random.default_rng(0).uniform(size=(200, 3))
    points = np.vstack([points, points[:5] + 1e-8])
    pairs = find_near_duplicates(scale * points)
    np.testing.assert_array_equal(pairs, np.column_stack([np.arange(5), np.arange(200, 205)]))


def test_the_quick_look_never_misses_a_near_pair_and_passes_a_fine_surface() -> None:
    rng = np.random.default_rng(3)
    reach = 1e-6
    for _ in range(200):
        points = rng.uniform(size=(40, 3))
        # As far apart as they may be, across any borders of cells, along axes too.
        way = rng.standard_normal(3) * rng.integers(0, 2, 3)
        length = np.linalg.norm(way)
        other = points[0] + (reach / length * way if length else 0.0)
        assert not _surely_apart(np.vstack([points, other]), reach)
    assert _surely_apart(shape_sphere(edge_length=0.05).points, reach)


def test_equal_points_are_found_by_keys_and_where_keys_fail_by_sorting(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(5)
    points = rng.integers(-2, 3, size=(300, 3)) * 0.25
    points[points == 0.0] *= rng.choice([-1.0, 1.0], size=int((points == 0.0).sum()))
    known: dict[tuple[float, ...], int] = {}
    first = [k for k, row in enumerate(points.tolist()) if known.setdefault(tuple(row), k) == k]
    sets = [first.index(known[tuple(row)]) for row in points.tolist()]
    for _ in range(2):
        found, of = equal_points(points)
        assert found.tolist() == first
        assert of.tolist() == sets
        # Keys that are all alike.
        monkeypatch.setattr(arrays, "row_keys", lambda rows: np.zeros(len(rows), np.uint64))
