"""Which nodal forces are taken for tractions, and what that may cost."""

import numpy as np

from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.validation.importing import nodal_forces
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
