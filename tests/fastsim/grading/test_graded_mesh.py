"""Local refinement: conforming, of bounded shapes, undone exactly, with all groups carried."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.errors import InputError
from palpate.meshes.quality import measure_quality
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh, signed_volumes

BALL = mesh_surface(shape_sphere(1.0, edge_length=0.7))
BOX = mesh_surface(shape_box(edge_length=0.5))


def require_conforming(graded: GradedMesh, given: TetMesh) -> None:
    """Every facet has two cells or lies in the boundary, and the boundary has the given area.

    A hanging point would leave facets with one cell inside, and their area would be too much.
    """
    mesh = graded.mesh
    facets = np.sort(mesh.cells[:, CELL_FACETS].reshape(-1, 3), axis=1)
    counts = np.unique(facets, axis=0, return_counts=True)[1]
    assert counts.max() <= 2
    assert mesh.volume == pytest.approx(given.volume, rel=1e-12)
    assert mesh.surface_area == pytest.approx(given.surface_area, rel=1e-12)
    assert mesh.surface().volume == pytest.approx(given.volume, rel=1e-12)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_random_marks_conform(seed: int, rounds: int) -> None:
    rng = np.random.default_rng(seed)
    graded = GradedMesh(BALL)
    for _ in range(rounds):
        graded.refine(rng.random(len(graded.cells)) < rng.choice([0.01, 0.1, 0.6]))
        require_conforming(graded, BALL)


def test_the_same_marks_give_the_same_mesh() -> None:
    def once() -> GradedMesh:
        rng = np.random.default_rng(5)
        graded = GradedMesh(BALL)
        for _ in range(6):
            graded.refine(rng.random(len(graded.cells)) < 0.2)
        return graded

    one, two = once(), once()
    assert np.array_equal(one.points, two.points)
    assert np.array_equal(one.cells, two.cells)


def shapes_of(points: np.ndarray, cells: np.ndarray) -> set[tuple[float, ...]]:  # type: ignore[type-arg]
    """Similarity classes, mirror images together: squared edges over volume^(2/3), rounded."""
    corners = points[cells]
    squared = ((corners[:, :, None] - corners[:, None]) ** 2).sum(axis=-1)
    squared /= np.abs(signed_volumes(points, cells))[:, None, None] ** (2.0 / 3.0)
    rows, columns = np.triu_indices(4, 1)
    names = np.stack(
        [
            np.round(squared[:, order][:, :, order][:, rows, columns], 6)
            for order in map(list, itertools.permutations(range(4)))
        ],
        axis=1,
    )
    return {min(map(tuple, row)) for row in np.unique(names, axis=0).tolist()}


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.long
def test_a_cells_descendants_have_at_most_72_shapes(seed: int) -> None:
    # Arnold, Mukherjee, Pouly 2000: finitely many; 72 for any marking of the first cell.
    points = np.random.default_rng(seed).random((4, 3))
    cells = np.array([[0, 1, 2, 3]], dtype=np.int32)
    if signed_volumes(points, cells)[0] < 0.0:
        cells = np.array([[0, 1, 3, 2]], dtype=np.int32)
    graded = GradedMesh(TetMesh(points, cells))
    seen: set[tuple[float, ...]] = set()
    new: list[int] = []
    for _ in range(13):
        graded.refine(np.ones(len(graded.cells), dtype=bool))
        found = shapes_of(graded.points, graded.cells)
        new.append(len(found - seen))
        seen |= found
    assert len(seen) <= 72
    # Three generations without a new shape: the classes are closed under bisection.
    assert new[-3:] == [0, 0, 0]


def test_deep_refinement_keeps_the_quality() -> None:
    graded = GradedMesh(BOX)
    for k in range(18):
        middle = graded.points[graded.cells].mean(axis=1)
        graded.refine(np.linalg.norm(middle - [0.3, 0.2, 1.0], axis=1) < 0.6 * 0.75**k)
    require_conforming(graded, BOX)
    # The worst of the shapes of this mesh's cells, found by three uniform rounds and more.
    uniform = GradedMesh(BOX)
    for _ in range(6):
        uniform.refine(np.ones(len(uniform.cells), dtype=bool))
    worst = measure_quality(uniform.mesh).smallest_dihedral_deg
    assert measure_quality(graded.mesh).smallest_dihedral_deg >= worst - 1e-6
    assert graded.generation.max() > 15


def test_groups_are_carried() -> None:
    boundary = BOX.boundary_facets
    on_top = (BOX.points[boundary][:, :, 2] == 1.0).all(axis=1)
    inside = BOX.cells[:1, [0, 1, 2]]
    bottom = np.flatnonzero(BOX.points[:, 2] == 0.0)
    mesh = TetMesh(
        BOX.points,
        BOX.cells,
        {"top": boundary[on_top], "seam": inside},
        {"bottom": bottom},
    )
    graded = GradedMesh(mesh)
    rng = np.random.default_rng(2)
    for _ in range(5):
        graded.refine(rng.random(len(graded.cells)) < 0.4)
    now = graded.mesh
    corners = now.points[now.facet_groups["top"]]
    assert (corners[:, :, 2] == 1.0).all()
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert 0.5 * areas[:, 2].sum() == pytest.approx(1.0, rel=1e-13)  # outward, and all of it
    at_bottom = np.flatnonzero(now.points[:, 2] == 0.0)
    assert np.array_equal(now.point_groups["bottom"], at_bottom)
    seam = now.points[now.facet_groups["seam"]]
    whole = mesh.points[inside[0]]
    area = np.linalg.norm(np.cross(whole[1] - whole[0], whole[2] - whole[0]))
    parts = np.linalg.norm(np.cross(seam[:, 1] - seam[:, 0], seam[:, 2] - seam[:, 0]), axis=1)
    assert parts.sum() == pytest.approx(area, rel=1e-12)


def test_refusals() -> None:
    graded = GradedMesh(BOX)
    for bad in (np.ones(3, dtype=bool), np.ones(len(graded.cells)), [0, 1]):
        with pytest.raises(InputError, match="marks"):
            graded.refine(bad)
    interior = next(
        row
        for row in BOX.cells[:, CELL_FACETS].reshape(-1, 3).tolist()
        if sorted(row) not in np.sort(BOX.boundary_facets, axis=1).tolist()
    )
    with pytest.raises(InputError, match="neither on the boundary"):
        graded.carry_facets([interior])
