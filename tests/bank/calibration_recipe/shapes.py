"""Meshes of the problems: boxes of bricks, bent, cut out or squashed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material
from palpate.meshes.tet_mesh import TetMesh

BAR_THICKNESS = 0.125
# Of the arch, inside and outside, and how far round it goes.
_INNER, _OUTER, _ANGLE = 0.6, 1.0, 0.75 * np.pi


def _part_of(mesh: TetMesh, is_kept: Callable[[Points], NDArray[np.bool_]]) -> TetMesh:
    """Cells whose centres are kept."""
    cells = mesh.cells[is_kept(mesh.points[mesh.cells].mean(axis=1))]
    used, numbers = np.unique(cells, return_inverse=True)
    return TetMesh(mesh.points[used], numbers.reshape(cells.shape).astype(np.int32))


def _arch() -> TetMesh:
    """Three quarters of half a ring, of flat facets; it begins on top, at x = 0."""
    box = brick_box((6, 2, 2), (1.0, 1.0, 0.4))
    s, r, z = box.points.T
    radius, angle = _INNER + (_OUTER - _INNER) * r, _ANGLE * s
    points = np.column_stack([radius * np.sin(angle), 0.4 - z, radius * np.cos(angle)])
    return TetMesh(points, box.cells)


def _elbow(ragged: float = 0.15) -> TetMesh:
    """An L: its inner edge, along y, is re-entrant; ragged, the faces beside it are uneven."""
    return _part_of(
        brick_box((4, 2, 4), (1.0, 0.5, 1.0), ragged=ragged),
        lambda c: (c[:, 0] < 0.5) | (c[:, 2] < 0.5),
    )


def _notched() -> TetMesh:
    """A bar with a square notch half-way, on top."""
    return _part_of(
        brick_box((5, 2, 3), (1.25, 0.5, 0.75)),
        lambda c: (abs(c[:, 0] - 0.625) > 0.125) | (c[:, 2] < 0.5),
    )


def _sliver() -> TetMesh:
    """Flat cells: eight times as long as high, and ragged."""
    return brick_box((3, 3, 6), (1.0, 1.0, 0.25), ragged=0.3)


_SHAPES: dict[str, Callable[[], TetMesh]] = {
    "box": lambda: brick_box((3, 2, 2), (1.0, 0.7, 0.6), ragged=0.2),
    "cube": lambda: brick_box((3, 3, 3), (1.0, 1.0, 1.0), ragged=0.25),
    "thin": lambda: brick_box((5, 4, 1), (1.0, 0.8, 0.1)),
    "bar": lambda: brick_box((8, 1, 1), (1.0, BAR_THICKNESS, BAR_THICKNESS)),
    "sliver": _sliver,
    "elbow": _elbow,
    "bracket": lambda: _elbow(0.0),
    "notched": _notched,
    "arch": _arch,
}


def shape_mesh(name: str) -> TetMesh:
    """A mesh by its name, 48 to 324 cells, about 1 m large."""
    return _SHAPES[name]()


def confined_modulus(material: Material) -> float:
    """Return lmbda + 2 mu [Pa]."""
    E, nu = material.youngs_modulus, material.poissons_ratio
    return E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))


def planes(mesh: TetMesh) -> list[tuple[Floats, Indices]]:
    """Boundary facets by their outward unit normal: pairs of a normal and facets, (n, 3)."""
    corners = mesh.points[mesh.boundary_facets]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    keys, which = np.unique(np.round(normals, 9), axis=0, return_inverse=True)
    return [
        (normals[which.ravel() == k][0], mesh.boundary_facets[which.ravel() == k])
        for k in range(len(keys))
    ]
