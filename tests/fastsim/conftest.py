"""Small meshes and problems for the tests of the simulator."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.meshes.tet_mesh import TetMesh, signed_volumes

BoxMaker = Callable[..., TetMesh]


def _box(
    divisions: tuple[int, int, int] = (3, 2, 2),
    size: tuple[float, float, float] = (1.5, 1.0, 1.0),
    *,
    ragged: float = 0.0,
    seed: int = 0,
) -> TetMesh:
    """A box of bricks, six tetrahedra each; interior points moved by `ragged` brick sizes."""
    nx, ny, nz = divisions
    grid = [np.linspace(0.0, s, n + 1) for s, n in zip(size, divisions, strict=True)]
    points = np.stack(np.meshgrid(*grid, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(nx + 1, ny + 1, nz + 1)
    corner = number[:-1, :-1, :-1].ravel()
    along = np.array([(ny + 1) * (nz + 1), nz + 1, 1])
    cells = []
    for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        path = np.concatenate([[0], np.cumsum(along[list(order)])])
        cells.append(corner[:, None] + path)
    all_cells = np.concatenate(cells).astype(np.int32)
    flipped = signed_volumes(points, all_cells) < 0.0
    all_cells[flipped] = all_cells[flipped][:, [0, 1, 3, 2]]
    inside = np.all((points > 1e-12) & (points < np.array(size) - 1e-12), axis=1)
    brick = np.array(size) / np.array(divisions)
    rng = np.random.default_rng(seed)
    points[inside] += ragged * brick * rng.uniform(-1.0, 1.0, (int(inside.sum()), 3))
    return TetMesh(points, all_cells)


@pytest.fixture(scope="session")
def make_box() -> BoxMaker:
    return _box


@pytest.fixture(scope="session")
def ragged_box() -> TetMesh:
    return _box((4, 3, 3), (1.6, 1.0, 1.2), ragged=0.2)


@pytest.fixture(scope="session")
def single_cell() -> TetMesh:
    points = np.array([[0.1, 0.0, 0.0], [1.2, 0.1, -0.1], [0.2, 0.9, 0.1], [0.0, 0.2, 1.1]])
    return TetMesh(points, np.array([[0, 1, 2, 3]]))
