"""Boxes and facets found by the tree are those that brute force finds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.meshes.shapes import shape_sphere
from palpate.validation.exchange.point_location import BoxTree, nearest_on_surface


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(0, 20))
def test_every_box_that_holds_a_place_is_found(seed: int, num_boxes: int, num_places: int) -> None:
    rng = np.random.default_rng(seed)
    low = rng.uniform(-1.0, 1.0, (num_boxes, 3))
    # Sizes of all orders, some boxes flat.
    high = low + 10.0 ** rng.uniform(-4.0, 0.5, (num_boxes, 1)) * rng.integers(0, 2, (num_boxes, 3))
    places = np.concatenate([rng.uniform(-1.0, 1.0, (num_places, 3)), low])
    who, items = BoxTree(low, high).holding(places)
    holds = ((places[:, None] >= low) & (places[:, None] <= high)).all(axis=2)
    # A hair of rounding may add a box that touches, and loses none.
    assert set(zip(*np.nonzero(holds), strict=True)) <= set(zip(who, items, strict=True))
    assert len(who) <= holds.sum() + 2


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.floats(0.01, 100.0))
def test_the_nearest_facet_is_that_of_brute_force(seed: int, count: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(3 * count, 3))
    points[2::3] = points[::3] + size * rng.normal(size=(count, 3))
    facets = np.arange(3 * count).reshape(-1, 3)
    # Middles lie in their facets: distance 0, with a box that rounding may leave them outside of.
    places = np.concatenate([points[facets].mean(axis=1), 10.0 * rng.normal(size=(20, 3))])
    found = nearest_on_surface(places, points, facets)
    alone = np.array([nearest_on_surface(places, points, f[None]).distances for f in facets])
    largest = np.abs(points).max() + np.abs(places).max()
    np.testing.assert_allclose(found.distances, alone.min(axis=0), rtol=1e-9, atol=1e-14 * largest)
    at = np.einsum("pa,pai->pi", found.weights, points[facets[found.facets]])
    apart = np.linalg.norm(at - places, axis=1)
    np.testing.assert_allclose(apart, found.distances, rtol=1e-9, atol=1e-13 * largest)
    assert found.weights.min() >= 0.0


@pytest.mark.parametrize("thickness", [0.0, 1e-9])
def test_middles_of_flat_facets_are_on_them(thickness: float) -> None:
    # A plane at a height that no number holds exactly: the mean of three of it may differ.
    sphere = shape_sphere(1.0, edge_length=0.3)
    points = sphere.points * [1.0, 1.0, thickness] + [0.1, 0.7, 1.0 / 3.0]
    middles = points[sphere.facets].mean(axis=1)
    found = nearest_on_surface(middles, points, sphere.facets)
    assert found.distances.max() <= 1e-15
