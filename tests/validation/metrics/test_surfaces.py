"""Distances of surfaces against closed forms and brute force."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.shapes import shape_sphere
from palpate.validation.exchange.point_location import nearest_on_surface
from palpate.validation.metrics import make_state, measure
from palpate.validation.metrics.comparison import surface_distances

CORNER = np.vstack([np.zeros(3), np.eye(3)])
TRIANGLE = (np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]], dtype=np.int32))


@pytest.mark.parametrize(
    ("place", "distance"),
    [
        ([0.2, 0.2, 0.7], 0.7),  # above the inside
        ([-3.0, -4.0, 0.0], 5.0),  # beyond a corner
        ([0.5, -2.0, 0.0], 2.0),  # beyond an edge
        ([1.0, 1.0, 0.0], np.sqrt(0.5)),  # beyond the slanted edge
        ([0.25, 0.25, 0.0], 0.0),
    ],
)
def test_distance_to_one_triangle(place: list[float], distance: float) -> None:
    found = nearest_on_surface(np.array([place]), *TRIANGLE).distances
    assert found[0] == pytest.approx(distance, abs=1e-12)


def test_concentric_spheres_are_apart_by_the_difference_of_radii() -> None:
    sphere = shape_sphere(1.0, edge_length=0.2)
    hausdorff, mean = surface_distances(
        sphere.points, sphere.facets, 1.1 * sphere.points, sphere.facets
    )
    # Facets cut inside the sphere by at most edge^2 / (8 R) = 0.005 (edges up to 0.25).
    assert hausdorff == pytest.approx(0.1, abs=0.01)
    assert mean == pytest.approx(0.1, abs=0.01)


def test_the_search_finds_what_brute_force_finds() -> None:
    rng = np.random.default_rng(2)
    sphere = shape_sphere(1.0, edge_length=0.4)
    points = sphere.points + 5.0
    places = rng.uniform(3.5, 6.5, (300, 3))
    found = nearest_on_surface(places, points, sphere.facets).distances
    one_by_one = [
        nearest_on_surface(places, points, facet[None]).distances for facet in sphere.facets
    ]
    np.testing.assert_allclose(found, np.min(one_by_one, axis=0), rtol=1e-12)


@pytest.mark.parametrize("size", [1e-9, 0.05, 2.0])
def test_what_is_known_of_one_body_in_two_states_changes_no_distance(size: float) -> None:
    sphere = shape_sphere(1.0, edge_length=0.3)
    random = np.random.default_rng(4)
    moved = sphere.points + size * random.standard_normal(sphere.points.shape)
    known = surface_distances(sphere.points, sphere.facets, moved, sphere.facets)
    # Facets that are not the very same say nothing of which place belongs to which.
    assert known == surface_distances(sphere.points, sphere.facets, moved, sphere.facets.copy())


def test_a_shifted_box_is_off_by_the_shift_and_sliding_is_seen_at_the_ends_only() -> None:
    mesh = brick_box((4, 2, 2), (2.0, 1.0, 1.0))
    problem = Problem(mesh, Material(1.0, 0.3), (), ())

    def shifted(x: float) -> object:
        u = np.tile([x, 0.0, 0.0], (mesh.num_points, 1))
        return make_state(mesh, u, label="x", simulator="x", strain=Strain.GREEN)

    candidate, reference = shifted(0.11), shifted(0.10)
    hausdorff = measure("surface_hausdorff", problem, candidate, reference)  # type: ignore[arg-type]
    assert hausdorff.value == pytest.approx(0.1, rel=1e-9)  # 0.01 of a largest displacement of 0.1
    mean = measure("surface_mean_distance", problem, candidate, reference)  # type: ignore[arg-type]
    # The two ends, 2 of 10 areas, are 0.01 off; of the sides only what sticks out.
    assert 0.02 < mean.value < 0.03
