"""Meshes that follow the true surface: their points lie on it, their volumes near the body's."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.refinement import refine_uniformly
from palpate.meshes.shapes import shape_cylinder, shape_hollow_octant, shape_sphere, shape_tube
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.true_surfaces import (
    CurvedPart,
    offset_boundary,
    refine_along,
    spherical_parts,
    upright_parts,
)


def test_a_sphere_is_followed() -> None:
    mesh = mesh_surface(shape_sphere(2.0, edge_length=1.3))
    fine = refine_along(mesh, spherical_parts(mesh, [2.0]))
    lengths = np.linalg.norm(fine.points[np.unique(fine.boundary_facets)], axis=1)
    assert lengths == pytest.approx(2.0, rel=1e-12)
    true = 4.0 / 3.0 * math.pi * 8.0
    assert refine_uniformly(mesh).volume == pytest.approx(mesh.volume)
    # Chords are of second order: about a quarter of the gap is left.
    assert 0.2 < (true - fine.volume) / (true - mesh.volume) < 0.3
    assert np.array_equal(fine.points[: mesh.num_points], mesh.points)


def test_the_caps_of_a_cylinder_stay_flat() -> None:
    mesh = mesh_surface(shape_cylinder(1.0, 3.0, edge_length=0.8))
    fine = refine_along(mesh, upright_parts(mesh, [1.0]))
    n = max(6, round(2.0 * math.pi / 0.8))
    # Regular polygons of n and of 2 n sides, where the rows are not turned: caps are exact.
    caps = fine.points[np.isclose(fine.points[:, 2], 0.0, atol=1e-9)]
    rim = np.hypot(caps[:, 0], caps[:, 1]) > 0.99
    assert rim.sum() == 2 * n
    assert np.hypot(*caps[rim, :2].T) == pytest.approx(1.0, rel=1e-12)
    true = 3.0 * math.pi
    assert 0.15 < (true - fine.volume) / (true - mesh.volume) < 0.35


def test_inside_and_outside_of_a_tube_and_an_octant_go_to_their_own_radius() -> None:
    tube = mesh_surface(shape_tube(2.0, 1.0, 1.5, edge_length=0.7))
    parts = upright_parts(tube, [2.0, 1.0])
    fine = refine_along(tube, parts)
    radii = np.hypot(*fine.points[np.unique(fine.boundary_facets), :2].T)
    is_near = [np.isclose(radii, r, rtol=1e-12).sum() for r in (2.0, 1.0)]
    assert min(is_near) > 20
    octant = mesh_surface(shape_hollow_octant(2.0, 1.0, edge_length=0.7))
    fine = refine_along(octant, spherical_parts(octant, [2.0, 1.0]))
    # Faces on the planes of symmetry stay there.
    assert fine.points.min() == pytest.approx(0.0, abs=1e-12)
    true = 4.0 / 3.0 * math.pi * 7.0 / 8.0
    assert abs(true - fine.volume) < 0.4 * abs(true - octant.volume)


def test_groups_are_carried() -> None:
    mesh = mesh_surface(shape_cylinder(1.0, 2.0, edge_length=0.9))
    cap = mesh.boundary_facets[(mesh.points[mesh.boundary_facets][..., 2] < 1e-9).all(axis=1)]
    named = TetMesh(mesh.points, mesh.cells, {"cap": cap})
    fine = refine_along(named, upright_parts(named, [1.0]))
    assert set(fine.facet_groups) == {"cap"}
    assert len(fine.facet_groups["cap"]) == 4 * len(cap)


def test_a_mesh_that_cannot_follow_is_refused() -> None:
    box = brick_box((1, 1, 1), (1.0, 1.0, 1.0))
    swapped = CurvedPart(box.boundary_facets, lambda x: -x)
    with pytest.raises(InputError, match="too coarse for its true surface"):
        refine_along(box, [swapped])


def test_a_boundary_moves_out_and_in() -> None:
    mesh = mesh_surface(shape_sphere(1.0, edge_length=0.5))
    for distance in (0.05, -0.05):
        moved = offset_boundary(mesh, distance)
        ratio = moved.volume / mesh.volume
        assert ratio == pytest.approx((1.0 + distance) ** 3, rel=0.01)
    with pytest.raises(InputError, match="turned inside out"):
        offset_boundary(mesh, -5.0)
