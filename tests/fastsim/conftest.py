"""Small meshes and problems for the tests of the simulator."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.meshes.bricks import brick_box
from palpate.meshes.tet_mesh import TetMesh

BoxMaker = Callable[..., TetMesh]


@pytest.fixture(scope="session")
def make_box() -> BoxMaker:
    return brick_box


@pytest.fixture(scope="session")
def ragged_box() -> TetMesh:
    return brick_box((4, 3, 3), (1.6, 1.0, 1.2), ragged=0.2)


@pytest.fixture(scope="session")
def single_cell() -> TetMesh:
    points = np.array([[0.1, 0.0, 0.0], [1.2, 0.1, -0.1], [0.2, 0.9, 0.1], [0.0, 0.2, 1.1]])
    return TetMesh(points, np.array([[0, 1, 2, 3]]))
