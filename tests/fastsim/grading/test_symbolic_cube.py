"""Names of cells: children, parents and neighbours from names alone, and the meshes they make."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.fastsim.grading.size_fields import TooManyCellsError
from palpate.fastsim.grading.symbolic_cube import SymbolicCube
from palpate.meshes.errors import InputError
from palpate.meshes.tet_mesh import signed_volumes


def as_sets(corners: np.ndarray) -> set[frozenset[tuple[float, ...]]]:  # type: ignore[type-arg]
    return {frozenset(map(tuple, cell)) for cell in corners.tolist()}


def refined(seed: int, rounds: int) -> SymbolicCube:
    rng = np.random.default_rng(seed)
    cube = SymbolicCube()
    for _ in range(rounds):
        position = rng.random(3)
        middle = cube.corners.mean(axis=1)
        cube.refine(np.linalg.norm(middle - position, axis=1) < 0.4)
    return cube


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 20))
def test_the_same_cells_as_by_bisection_of_marked_tetrahedra(seed: int, rounds: int) -> None:
    rng = np.random.default_rng(seed)
    cube = SymbolicCube()
    graded = GradedMesh(cube.mesh)
    for _ in range(rounds):
        position = rng.random(3)
        cube.refine(np.linalg.norm(cube.corners.mean(axis=1) - position, axis=1) < 0.35)
        middle = graded.points[graded.cells].mean(axis=1)
        graded.refine(np.linalg.norm(middle - position, axis=1) < 0.35)
    assert as_sets(cube.corners) == as_sets(graded.points[graded.cells])


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 25))
def test_neighbours_from_names_share_a_facet_and_exist(seed: int, rounds: int) -> None:
    cube = refined(seed, rounds)
    names = cube.names
    codes = {name.code() for name in names}
    assert len(codes) == len(names)
    for name in names[:: max(1, len(names) // 300)]:
        corners = list(map(tuple, name.corners()))
        for k in range(4):
            other = name.neighbour(k)
            shared = set(corners) & set(map(tuple, other.corners()))
            assert shared == set(corners) - {corners[k]}
            assert other.code() != name.code()
            outside = any(
                len({c[axis] for c in shared}) == 1 and next(iter(shared))[axis] in (0, 2**16)
                for axis in range(3)
            )
            assert other.is_inside() != outside
            if other.is_inside():
                # There itself, or a generation behind, or ahead.
                kin = [other.code(), *(c.code() for c in other.children())]
                if other.generation > 0:
                    kin.append(other.parent().code())
                assert codes & set(kin)
                back = [other.neighbour(j).code() for j in range(4)]
                assert name.code() in back


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_child_knows_its_parent(seed: int) -> None:
    for name in refined(seed, 12).names:
        for child in name.children():
            assert child.parent().code() == name.code()
        first, second = name.children()
        assert len(set(map(tuple, first.corners())) & set(map(tuple, second.corners()))) == 3


def test_three_generations_cut_the_cube_in_eight_alike() -> None:
    cube = SymbolicCube()
    for _ in range(6):
        cube.refine(np.ones(cube.num_cells, dtype=bool))
    assert cube.num_cells == 6 * 8**2
    corners = cube.corners
    cells = np.arange(4 * len(corners), dtype=np.int32).reshape(-1, 4)
    volumes = np.abs(signed_volumes(corners.reshape(-1, 3), cells))
    assert np.all(volumes == 1.0 / (6 * 64))
    lengths = np.linalg.norm(corners[:, :, None] - corners[:, None], axis=-1)
    assert lengths.max() == pytest.approx(np.sqrt(3.0) / 4.0, rel=1e-14)


@pytest.mark.slow
def test_cells_grow_as_the_square_when_graded_to_a_surface() -> None:
    """Section V: O(n^3) cells become O(n^2); the exponents of the last three of n = 8 to 128."""

    def to_face(positions):  # type: ignore[no-untyped-def]
        return positions[:, 2]

    def to_boundary(positions):  # type: ignore[no-untyped-def]
        return np.minimum(positions, 1.0 - positions).min(axis=1)

    n = np.array([8, 16, 32, 64, 128])
    for distance in (to_face, to_boundary):
        counts = []
        for k in n:
            cube = SymbolicCube()
            # Kuhn's cells on cubes of side 1/n have a mean edge of 1.2624 / n.
            cube.refine_to_size(
                lambda positions, k=k, distance=distance: np.maximum(
                    1.27 / k, 2.0 * distance(positions)
                )
            )
            counts.append(cube.num_cells)
        exponent = np.polyfit(np.log(n[-3:]), np.log(counts[-3:]), 1)[0]
        assert abs(exponent - 2.0) < 0.1, counts


def test_refusals() -> None:
    cube = SymbolicCube()
    with pytest.raises(InputError, match="marks"):
        cube.refine(np.ones(5, dtype=bool))
    with pytest.raises(TooManyCellsError):
        cube.refine_to_size(lambda positions: np.full(len(positions), 0.01), max_cells=1000)

    def shrink_one_cell() -> None:
        for _ in range(50):
            generation = np.array([name.generation for name in cube.names])
            deepest = np.flatnonzero(generation == generation.max())[:1]
            cube.refine(np.isin(np.arange(cube.num_cells), deepest))

    with pytest.raises(InputError, match="names"):
        shrink_one_cell()
