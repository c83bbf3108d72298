"""Triangles of a boundary: their areas, and which of them are among others."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.validation.exchange.nodal_arrays import are_among, area_vectors, facet_areas

POINTS = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 1.0]])


def test_areas_and_outward_vectors():
    facets = np.array([[0, 1, 2], [0, 2, 1], [0, 3, 1]])
    # Half of 3 times 4 along z and against it; half of 1 times 3 along y.
    assert area_vectors(POINTS, facets).tolist() == [[0, 0, 6], [0, 0, -6], [0, 1.5, 0]]
    assert facet_areas(POINTS, facets) == pytest.approx([6.0, 6.0, 1.5])


def test_facets_are_found_by_their_corners_in_any_order():
    facets = np.array([[5, 1, 3], [0, 9, 7], [9, 2, 4]])
    others = np.array([[4, 9, 2], [3, 5, 1], [9, 1, 7]])
    assert are_among(facets, others).tolist() == [True, False, True]
    assert are_among(others, facets).tolist() == [True, True, False]
