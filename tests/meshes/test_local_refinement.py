"""Local refinement: the same body, no hanging points, bounded shapes, everything carried."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import PointForce, Pressure, Support, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Inclusion, Material, Problem
from palpate.meshes.quality import mean_ratio
from palpate.meshes.refinement import refine_cells, refine_uniformly
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import TetMesh, signed_volumes

KUHN = TetMesh(
    np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)]),
    # Kuhn's six cells around the diagonal 0-7.
    np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]]),
)
CUBE = refine_uniformly(refine_uniformly(KUHN))
RNG = np.random.default_rng(1)
# The same cells with points moved about, so that no two edges are of one length.
LOPSIDED = TetMesh(CUBE.points + 0.04 * RNG.standard_normal(CUBE.points.shape), CUBE.cells)


def face(mesh: TetMesh, axis: int, value: float) -> np.ndarray:  # type: ignore[type-arg]
    return mesh.boundary_facets[(CUBE.points[mesh.boundary_facets, axis] == value).all(axis=1)]


def make_problem(mesh: TetMesh) -> Problem:
    floor, top, side = face(mesh, 2, 0.0), face(mesh, 2, 1.0), face(mesh, 0, 1.0)
    low = np.flatnonzero(CUBE.points[mesh.cells].mean(axis=1)[:, 1] < 0.5).astype(np.int32)
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


@pytest.mark.parametrize("mesh", [CUBE, LOPSIDED], ids=["cube", "lopsided"])
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
    problem = make_problem(CUBE)
    refined = refine_cells(problem, np.zeros(CUBE.num_cells, dtype=bool))
    assert np.array_equal(refined.problem.mesh.cells, CUBE.cells)
    assert np.array_equal(refined.given_cell, np.arange(CUBE.num_cells))


def test_all_marked_is_eight_for_each() -> None:
    refined = refine_cells(make_problem(CUBE), np.ones(CUBE.num_cells, dtype=bool))
    assert refined.problem.mesh.num_cells == 8 * CUBE.num_cells


def test_marks_of_another_shape_are_refused() -> None:
    with pytest.raises(InputError, match="marks need shape"):
        refine_cells(make_problem(CUBE), np.zeros(3, dtype=bool))
