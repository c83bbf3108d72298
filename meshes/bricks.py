"""A box of bricks, each cut into six tetrahedra: bodies for tests, studies and benchmarks."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from palpate.meshes.arrays import Indices
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.tet_mesh import TetMesh, signed_volumes

_CORNER_PATHS = ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0))


def brick_box(
    divisions: tuple[int, int, int],
    size: tuple[float, float, float],
    *,
    ragged: float = 0.0,
) -> TetMesh:
    """A box of bricks of edge lengths [m] along x, y, z, six tetrahedra each.

    `ragged` moves interior points by up to so many brick sizes, 0 to 0.3, the same on every call.
    """
    axes = [np.linspace(0.0, s, n + 1) for s, n in zip(size, divisions, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    counts = tuple(n + 1 for n in divisions)
    first = np.arange(len(points)).reshape(counts)[:-1, :-1, :-1].ravel()
    along = np.array([counts[1] * counts[2], counts[2], 1])
    cells = np.concatenate(
        [
            first[:, None] + np.concatenate([[0], np.cumsum(along[list(path)])])
            for path in _CORNER_PATHS
        ]
    ).astype(np.int32)
    flipped = signed_volumes(points, cells) < 0.0
    cells[flipped] = cells[flipped][:, [0, 1, 3, 2]]
    inside = np.all((points > 1e-12) & (points < np.array(size) - 1e-12), axis=1)
    brick = np.array(size) / np.array(divisions)
    shift = np.random.default_rng(0).uniform(-1.0, 1.0, (int(inside.sum()), 3))
    points[inside] += ragged * brick * shift
    return TetMesh(points, cells)


def side(mesh: TetMesh, axis: int, position: float) -> Indices:
    """Boundary facets whose corners all lie at a coordinate `position` [m] of an axis, (n, 3)."""
    facets = mesh.boundary_facets
    distance = np.abs(mesh.points[facets][:, :, axis] - position)
    found: Indices = facets[(distance <= 1e-9 * np.ptp(mesh.points[:, axis])).all(axis=1)]
    return found


def support_of(
    facets: Indices,
    components: tuple[bool, bool, bool] = (True, True, True),
    displacement: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Support:
    """Support of facets with their corners, at a given displacement [m]."""
    return Support(np.unique(facets).astype(np.int32), facets, components, displacement)


def rollers(mesh: TetMesh, positions: Iterable[tuple[int, float]]) -> tuple[Support, ...]:
    """Sides (axis, position [m]) that may slide in their own plane only."""
    return tuple(
        support_of(side(mesh, axis, position), (axis == 0, axis == 1, axis == 2))
        for axis, position in positions
    )
