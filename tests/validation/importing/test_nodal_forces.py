"""Which nodal forces are taken for tractions, and what that may cost."""

from types import SimpleNamespace

import numpy as np

from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.validation.importing import nodal_forces
from palpate.validation.importing.case_files import _volumes_of_nodes
from palpate.validation.importing.nodal_forces import fit_tractions


def without_middles(facets):
    return np.full_like(facets, -1)


def test_a_traction_of_its_own_on_every_face_of_a_box_is_found():
    surface = shape_box((1.0, 2.0, 3.0), edge_length=0.6)
    points, facets = surface.points, np.asarray(surface.facets, dtype=np.int64)
    a, b, c = points[facets].transpose(1, 0, 2)
    vectors = 0.5 * np.cross(b - a, c - a)
    forces = np.zeros_like(points)
    for corner in facets.T:
        np.add.at(forces, corner, -2.0 * vectors / 3.0)
    found, left = fit_tractions(points, facets, without_middles(facets), forces)
    assert len(found) == 6
    assert not left.any()
    for traction in found:
        p, q, r = points[traction.facets[0]]
        normal = np.cross(q - p, r - p)
        normal /= np.linalg.norm(normal)
        assert np.abs(traction.values - -2.0 * normal).max() <= 1e-9


def test_forces_all_over_a_curved_surface_stay_forces_on_points(monkeypatch):
    surface = shape_sphere(1.0, edge_length=0.15)
    points, facets = surface.points, np.asarray(surface.facets, dtype=np.int64)
    forces = np.random.default_rng(0).normal(size=points.shape)
    widths = []
    solve = np.linalg.lstsq

    def counted(matrix, *rest, **more):
        widths.append(matrix.shape[1])
        return solve(matrix, *rest, **more)

    monkeypatch.setattr(nodal_forces.np.linalg, "lstsq", counted)
    found, left = fit_tractions(points, facets, without_middles(facets), forces)
    assert found == []
    assert np.array_equal(left, forces)
    # A plane for each facet would be thousands of columns.
    assert len(facets) > 1000
    assert max(widths) == 4


def test_shape_functions_of_a_quadratic_cell_weigh_its_middles_alone_and_its_corners_against():
    """Of a tetrahedron of volume V: -V / 20 at corners, V / 5 at middles; V / 4 without middles."""
    corners = np.vstack([np.zeros(3), np.eye(3)])
    pairs = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
    nodes = np.vstack([corners, [corners[list(pair)].mean(axis=0) for pair in pairs]])
    cells, middles = np.array([[0, 1, 2, 3]]), np.arange(4, 10)[None]
    for is_quadratic, expected in ((True, [-0.05] * 4 + [0.2] * 6), (False, [0.25] * 4 + [0] * 6)):
        model = SimpleNamespace(
            nodes=nodes, corners=cells, middles=middles, is_quadratic=np.array([is_quadratic])
        )
        assert np.abs(_volumes_of_nodes(model) - np.array(expected) / 6.0).max() <= 1e-16
