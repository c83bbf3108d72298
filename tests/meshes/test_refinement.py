"""Uniform and local refinement: the same body, no hanging points, bounded shapes."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Support, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Inclusion, Material, Problem
from palpate.meshes.quality import dihedral_angles, edge_length_deviation, mean_ratio
from palpate.meshes.refinement import refine_cells, refine_problem, refine_uniformly
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import TetMesh, signed_volumes

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
    angles = dihedral_angles(regular, cell if signed_volumes(regular, cell)[0] > 0 else flipped)
    np.testing.assert_allclose(angles, np.arccos(1.0 / 3.0), rtol=1e-14)
    assert abs(mean_ratio(regular, cell)[0]) == pytest.approx(1.0, rel=1e-14)
    assert mean_ratio(regular, cell)[0] == -mean_ratio(regular, flipped)[0]
    assert edge_length_deviation(regular, cell)[0] == pytest.approx(0.0, abs=1e-15)
    right = np.vstack([np.zeros(3), np.eye(3)])
    # Three right angles at the corner, arccos(1/sqrt 3) at the slanted facet.
    expected = sorted([np.pi / 2] * 3 + [np.arccos(1 / np.sqrt(3))] * 3)
    np.testing.assert_allclose(sorted(dihedral_angles(right, cell)[0]), expected, rtol=1e-14)


GRID = refine_uniformly(refine_uniformly(CUBE))
RNG = np.random.default_rng(1)
# The same cells with points moved about, so that no two edges are of one length.
LOPSIDED = TetMesh(GRID.points + 0.04 * RNG.standard_normal(GRID.points.shape), GRID.cells)


def face(mesh: TetMesh, axis: int, value: float) -> np.ndarray:  # type: ignore[type-arg]
    return mesh.boundary_facets[(GRID.points[mesh.boundary_facets, axis] == value).all(axis=1)]


def make_problem(mesh: TetMesh) -> Problem:
    floor, top, side = face(mesh, 2, 0.0), face(mesh, 2, 1.0), face(mesh, 0, 1.0)
    low = np.flatnonzero(GRID.points[mesh.cells].mean(axis=1)[:, 1] < 0.5).astype(np.int32)
    tool = RigidTool(SphereShape(0.2), ToolPath([0.0], [[0.5, 0.5, 1.3]]), contact_facets=top)
    return Problem(
        TetMesh(mesh.points, mesh.cells, {"side": side}, {"corner": np.unique(side)}),
        Material(1.0, 0.3),
        (Support(np.unique(floor), floor),),
        (
            Traction(top, (0.0, 0.0, 2.0)),
            Pressure(side, 3.0),
            PointForce(np.array([7]), np.array([[1.0, 0.0, 0.0]])),
        ),
        tools=(tool,),
        inclusions=(Inclusion(low, Material(5.0, 0.3)),),
    )


def area_vectors(mesh: TetMesh, facets: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    a, b, c = np.moveaxis(mesh.points[facets], 1, 0)
    return 0.5 * np.cross(b - a, c - a)


@pytest.mark.parametrize("mesh", [GRID, LOPSIDED], ids=["cube", "lopsided"])
def test_the_same_body_with_everything_that_hangs_on_it(mesh: TetMesh) -> None:
    problem = make_problem(mesh)
    for level in range(4):
        centres = problem.mesh.points[problem.mesh.cells].mean(axis=1)
        marked = np.linalg.norm(centres - [1.0, 0.4, 0.0], axis=1) < 0.5 * 0.6**level
        assert marked.any()
        refined = refine_cells(problem, marked)
        fine, before = refined.problem, problem
        children = np.bincount(refined.given_cell, minlength=before.mesh.num_cells)
        # At least in eight where marked: all six edges are cut.
        assert (children[marked] == 8).all()
        assert children.max() == 8
        np.testing.assert_allclose(
            np.bincount(refined.given_cell, signed_volumes(fine.mesh.points, fine.mesh.cells)),
            signed_volumes(before.mesh.points, before.mesh.cells),
            rtol=1e-12,
        )
        assert np.array_equal(fine.mesh.points[: before.mesh.num_points], before.mesh.points)
        # A hanging point would leave facets inside with one cell only.
        assert fine.mesh.surface_area == pytest.approx(before.mesh.surface_area, rel=1e-12)
        pairs = [
            (before.supports[0].facets, fine.supports[0].facets),
            (before.loads[0].facets, fine.loads[0].facets),  # type: ignore[union-attr]
            (before.loads[1].facets, fine.loads[1].facets),  # type: ignore[union-attr]
            (before.tools[0].contact_facets, fine.tools[0].contact_facets),
            (before.mesh.facet_groups["side"], fine.mesh.facet_groups["side"]),
        ]
        boundary = {tuple(row) for row in np.sort(fine.mesh.boundary_facets, axis=1).tolist()}
        for old, new in pairs:
            assert {tuple(row) for row in np.sort(new, axis=1).tolist()} <= boundary
            vectors = [area_vectors(p.mesh, f) for p, f in ((before, old), (fine, new))]
            np.testing.assert_allclose(vectors[1].sum(axis=0), vectors[0].sum(axis=0), atol=1e-13)
            sums = [np.linalg.norm(v, axis=1).sum() for v in vectors]
            assert sums[1] == pytest.approx(sums[0], rel=1e-12)
        assert set(fine.supports[0].points) == set(fine.supports[0].facets.ravel())
        sizes = [
            signed_volumes(p.mesh.points, p.mesh.cells)[p.inclusions[0].cells].sum()
            for p in (before, fine)
        ]
        assert sizes[1] == pytest.approx(sizes[0], rel=1e-12)
        assert fine.loads[2] is before.loads[2]
        assert set(fine.mesh.point_groups["corner"]) >= set(np.unique(pairs[-1][1]))
        problem = fine


def test_shapes_stay_bounded_towards_an_edge() -> None:
    problem = Problem(LOPSIDED, Material(1.0, 0.3), (), ())
    worst = [float(mean_ratio(LOPSIDED.points, LOPSIDED.cells).min())]
    counts = []
    for level in range(8):
        corners = problem.mesh.points[problem.mesh.cells]
        marked = np.linalg.norm(corners[:, :, :2], axis=2).min(axis=1) < 0.3 * 0.5**level
        problem = refine_cells(problem, marked).problem
        worst.append(float(mean_ratio(problem.mesh.points, problem.mesh.cells).min()))
        counts.append(problem.mesh.num_cells)
    assert min(worst) > 0.25 * worst[0]
    assert min(worst[-3:]) == pytest.approx(min(worst), rel=0.2)
    # Graded: each level adds cells along one edge only, twice as many as the one before.
    assert counts[-1] - counts[-2] < 2.5 * (counts[-2] - counts[-3])


def test_nothing_marked_is_nothing_changed() -> None:
    problem = make_problem(GRID)
    refined = refine_cells(problem, np.zeros(GRID.num_cells, dtype=bool))
    assert np.array_equal(refined.problem.mesh.cells, GRID.cells)
    assert np.array_equal(refined.given_cell, np.arange(GRID.num_cells))


def test_all_marked_is_eight_for_each() -> None:
    refined = refine_cells(make_problem(GRID), np.ones(GRID.num_cells, dtype=bool))
    assert refined.problem.mesh.num_cells == 8 * GRID.num_cells


def test_marks_of_another_shape_are_refused() -> None:
    with pytest.raises(InputError, match="marks need shape"):
        refine_cells(make_problem(GRID), np.zeros(3, dtype=bool))
