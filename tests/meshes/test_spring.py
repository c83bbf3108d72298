"""Springs over patches as plain data: which facets they hold, with what weight, in other forms."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes import transforms
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import FacetNotOnBoundaryError, InputError
from palpate.meshes.problem import Material, Problem
from palpate.meshes.problem_files import load_problem, save_problem
from palpate.meshes.refinement import refine_problem
from palpate.meshes.spring import AnchorPath, Spring, spring_patch
from palpate.meshes.tet_mesh import TetMesh

PATH = AnchorPath([0.0, 1.0], [[0.0, 0.0, 0.0], [0.0, 0.1, 0.2]])


@pytest.fixture(scope="module")
def mesh() -> TetMesh:
    return brick_box((8, 6, 2), (0.8, 0.6, 0.02))


def area(mesh: TetMesh, values: np.ndarray, facets: np.ndarray) -> float:
    a, b, c = (mesh.points[facets[:, k]] for k in range(3))
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return float(areas @ values.mean(axis=1))


def test_the_other_side_of_a_thin_wall_is_not_held(mesh: TetMesh) -> None:
    patch = spring_patch(mesh, (0.4, 0.3, 0.02), 0.15)
    heights = mesh.points[patch][:, :, 2]
    assert len(patch) >= 8
    assert (heights == 0.02).all()
    near_edge = spring_patch(mesh, (0.75, 0.3, 0.02), 0.15)
    assert (mesh.points[near_edge][:, :, 2] == 0.0).any()  # round the edge it hangs together


def test_every_facet_that_has_a_weight_is_held(mesh: TetMesh) -> None:
    center, radius = (0.43, 0.31, 0.02), 0.17
    spring = Spring.on(mesh, center, radius, 40.0, PATH)
    on_top = side(mesh, 2, 0.02)
    has_weight = (spring.weights(mesh.points[on_top]) > 0.0).any(axis=1)
    fixed = {tuple(row) for row in np.sort(spring.facets, axis=1).tolist()}
    assert {tuple(row) for row in np.sort(on_top[has_weight], axis=1).tolist()} <= fixed
    for _ in range(2):
        assert area(mesh, spring.densities(mesh.points), spring.facets) == pytest.approx(40.0)
        problem = refine_problem(Problem(mesh, Material(1e4, 0.3), (), (), springs=(spring,)))
        (spring,), mesh = problem.springs, problem.mesh
        again = Spring.on(mesh, center, radius, 40.0, PATH)
        mine, other = (s.densities(mesh.points)[s.weights(mesh.points[s.facets]) > 0] for s in
                       (spring, again))  # fmt: skip
        assert np.sort(mine) == pytest.approx(np.sort(other))


def test_in_other_forms(mesh: TetMesh, tmp_path: Path) -> None:
    spring = Spring.on(mesh, (0.4, 0.3, 0.02), 0.15, 40.0, PATH)
    problem = Problem(mesh, Material(1e4, 0.3), (), (), springs=(spring,))
    matrix = transforms.rotation((1.0, 2.0, 3.0), 40.0)
    turned = transforms.turn(problem, matrix)[0]
    mirrored = transforms.turn(problem, np.diag([1.0, -1.0, 1.0]))[0]
    renumbered = transforms.renumber(problem)[0]
    scaled = transforms.change_units(problem, 1000.0)[0]
    whole = spring.densities(mesh.points)
    for other in (turned, mirrored, renumbered):
        (one,) = other.springs
        assert np.sort(one.densities(other.mesh.points).ravel()) == pytest.approx(
            np.sort(whole.ravel())
        )
    assert turned.springs[0].path.end == pytest.approx(matrix @ PATH.end)
    assert scaled.springs[0].stiffness == pytest.approx(0.04)  # N/mm
    assert scaled.springs[0].path.end == pytest.approx([0.0, 100.0, 200.0])
    save_problem(tmp_path / "p.npz", problem)
    (read,) = load_problem(tmp_path / "p.npz").springs
    assert np.array_equal(read.facets, spring.facets)
    assert (read.center, read.radius, read.stiffness) == (spring.center, 0.15, 40.0)
    assert np.array_equal(read.path.displacements, PATH.displacements)


@pytest.mark.parametrize(
    ("center", "radius", "stiffness", "says"),
    [
        ((0.4, 0.3, 0.5), 0.1, 1.0, "the surface is 0.48 m away"),
        ((0.43, 0.31, 0.02), 0.01, 1.0, "no point of the surface lies so near"),
        ((0.4, 0.3, 0.02), 0.0, 1.0, "radius = 0"),
        ((0.4, 0.3, 0.02), 0.1, -1.0, "stiffness = -1"),
        ((0.4, np.nan, 0.02), 0.1, 1.0, "needs finite numbers"),
    ],
)
def test_what_is_refused(
    mesh: TetMesh, center: tuple[float, float, float], radius: float, stiffness: float, says: str
) -> None:
    with pytest.raises(InputError, match=says):
        Spring.on(mesh, center, radius, stiffness, PATH)


def test_paths_and_facets_that_are_refused(mesh: TetMesh) -> None:
    with pytest.raises(InputError, match="times must increase"):
        AnchorPath([0.0, 0.0], np.zeros((2, 3)))
    with pytest.raises(InputError, match=r"displacements need shape \(1, 3\)"):
        AnchorPath([0.0], np.zeros((2, 3)))
    spring = Spring.on(mesh, (0.4, 0.3, 0.02), 0.15, 40.0, PATH)
    inner = dataclasses.replace(spring, facets=mesh.cells[:1, :3])
    fixed = np.unique(side(mesh, 0, 0.0)).astype(np.int32)
    with pytest.raises((FacetNotOnBoundaryError, InputError)):
        Problem(mesh, Material(1e4, 0.3), (Support(fixed),), (), springs=(inner,))
    with pytest.raises(InputError, match="between 0 and 1"):
        dataclasses.replace(spring, amplitude=TabularAmplitude((0.0,), (2.0,)))
