"""Grading by distance and by size field."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.fastsim.grading.size_fields import (
    TooManyCellsError,
    distance_to_ball,
    distance_to_facets,
    distance_to_points,
    grow_with_distance,
    mean_edges,
    refine_to_size,
)
from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.errors import InputError
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.tri_surface import TriSurface

BOX = mesh_surface(shape_box(edge_length=0.5))


def test_no_edge_is_longer_than_asked_and_far_ones_are_not_needlessly_short() -> None:
    size = grow_with_distance(distance_to_points([0.5, 0.5, 1.0]), smallest=0.03, growth=0.5)
    graded = GradedMesh(BOX)
    refine_to_size(graded, size)
    middle = graded.points[graded.cells].mean(axis=1)
    edges = mean_edges(graded.points, graded.cells)
    assert np.all(edges <= size(middle))
    # A cell is bisected when its edges were too long, or a neighbour's were: two generations
    # (a factor of 2^(2/3)) below what is asked for, and the shapes' own scatter.
    typical = np.median(edges / size(middle))
    assert 0.4 < typical <= 1.0


def test_distances_are_those_of_brute_force() -> None:
    rng = np.random.default_rng(0)
    positions = rng.uniform(-1.0, 2.0, (40, 3))
    ball = shape_sphere(1.0, edge_length=0.4)
    # Dense samples of each facet bound its distance from above, within their spacing.
    share = rng.dirichlet([1, 1, 1], 400)
    samples = np.einsum("sk,fkx->fsx", share, ball.points[ball.facets]).reshape(-1, 3)
    brute = np.min(np.linalg.norm(positions[:, None] - samples[None], axis=2), axis=1)
    exact = distance_to_facets(ball)(positions)
    assert np.all(exact <= brute + 1e-15)
    assert np.all(exact > brute - 0.05)
    assert distance_to_facets(ball)(ball.points) == pytest.approx(0.0, abs=1e-15)
    assert distance_to_ball([0, 0, 0], 1.0)(positions) == pytest.approx(
        np.maximum(np.linalg.norm(positions, axis=1) - 1.0, 0.0)
    )


def test_refusals() -> None:
    graded = GradedMesh(BOX)
    with pytest.raises(InputError, match="no facets"):
        distance_to_facets(TriSurface(BOX.points, np.zeros((0, 3), dtype=int)))
    near = distance_to_points([0, 0, 0])
    for smallest, growth, largest in ((0.0, 1.0, 1.0), (0.1, -1.0, 1.0), (0.1, 1.0, 0.05)):
        with pytest.raises(InputError):
            grow_with_distance(near, smallest=smallest, growth=growth, largest=largest)
    with pytest.raises(TooManyCellsError) as caught:
        refine_to_size(graded, lambda p: np.full(len(p), 0.01), max_cells=5000)
    # A round cuts more than was marked, for conformity: up to eight of every cell marked.
    assert 2500 < caught.value.num_cells <= 8 * 5000
    for bad in (lambda p: np.zeros(len(p)), lambda p: np.full(len(p), np.nan), lambda p: p):
        with pytest.raises(InputError, match="size field"):
            refine_to_size(GradedMesh(BOX), bad)
