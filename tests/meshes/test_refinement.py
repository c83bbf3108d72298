"""Uniform refinement: the same body, eight times the cells, everything carried."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce, PointForce, Support, Traction
from palpate.meshes.problem import Material, Problem
from palpate.meshes.quality import dihedral_angles, edge_length_deviation, mean_ratio
from palpate.meshes.refinement import refine_problem, refine_uniformly
from palpate.meshes.tet_mesh import TetMesh

CUBE = TetMesh(
    np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)]),
    # Kuhn's six cells around the diagonal 0-7.
    np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]]),
)


def test_volume_area_and_old_points_are_kept() -> None:
    fine = refine_uniformly(CUBE)
    assert fine.num_cells == 8 * CUBE.num_cells
    assert np.array_equal(fine.points[: CUBE.num_points], CUBE.points)
    assert fine.volume == pytest.approx(CUBE.volume, rel=1e-14)
    assert fine.surface_area == pytest.approx(CUBE.surface_area, rel=1e-14)
    assert len(fine.boundary_facets) == 4 * len(CUBE.boundary_facets)


def test_quality_stays_bounded_over_three_levels() -> None:
    mesh = CUBE
    worst = []
    for _ in range(3):
        mesh = refine_uniformly(mesh)
        worst.append(mean_ratio(mesh.points, mesh.cells).min())
    # The first cut makes one more class of shapes, the later ones none (Bey 1995: at most three).
    assert worst[2] == pytest.approx(worst[1], rel=1e-12)
    assert min(worst) > 0.9 * (1 - 1e-12) * mean_ratio(CUBE.points, CUBE.cells).min()


def test_supports_and_loads_cover_the_same_area() -> None:
    floor = CUBE.boundary_facets[(CUBE.points[CUBE.boundary_facets, 2] == 0.0).all(axis=1)]
    top = CUBE.boundary_facets[(CUBE.points[CUBE.boundary_facets, 2] == 1.0).all(axis=1)]
    problem = Problem(
        CUBE,
        Material(1.0, 0.3),
        (Support(np.unique(floor).astype(np.int32), floor),),
        (
            Traction(top, (0.0, 0.0, 2.0)),
            BodyForce((0.0, 0.0, -1.0)),
            PointForce(np.array([7], dtype=np.int32), np.array([[1.0, 0.0, 0.0]])),
        ),
    )
    fine = refine_problem(problem)
    support, traction = fine.supports[0], fine.loads[0]
    assert isinstance(traction, Traction)
    for facets, height in ((support.facets, 0.0), (traction.facets, 1.0)):
        assert len(facets) == 8
        corners = fine.mesh.points[facets]
        assert (corners[:, :, 2] == height).all()
        normals = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        np.testing.assert_allclose(normals.sum(axis=0), [0, 0, 2 * height - 1], atol=1e-15)
    assert set(support.points) == set(np.flatnonzero(fine.mesh.points[:, 2] == 0.0))
    assert fine.loads[1:] == problem.loads[1:]


def test_quality_measures_of_a_regular_and_a_right_angled_cell() -> None:
    regular = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    cell = np.array([[0, 1, 2, 3]], dtype=np.int32)
    flipped = np.array([[1, 0, 2, 3]], dtype=np.int32)
    angles = dihedral_angles(regular, cell if _volume(regular, cell) > 0 else flipped)
    np.testing.assert_allclose(angles, np.arccos(1.0 / 3.0), rtol=1e-14)
    assert abs(mean_ratio(regular, cell)[0]) == pytest.approx(1.0, rel=1e-14)
    assert mean_ratio(regular, cell)[0] == -mean_ratio(regular, flipped)[0]
    assert edge_length_deviation(regular, cell)[0] == pytest.approx(0.0, abs=1e-15)
    right = np.vstack([np.zeros(3), np.eye(3)])
    # Three right angles at the corner, arccos(1/sqrt 3) at the slanted facet.
    expected = sorted([np.pi / 2] * 3 + [np.arccos(1 / np.sqrt(3))] * 3)
    np.testing.assert_allclose(sorted(dihedral_angles(right, cell)[0]), expected, rtol=1e-14)


def _volume(points: np.ndarray, cells: np.ndarray) -> float:  # type: ignore[type-arg]
    from palpate.meshes.tet_mesh import signed_volumes

    return float(signed_volumes(points, cells)[0])
