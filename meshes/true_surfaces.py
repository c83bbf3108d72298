"""Meshes of curved bodies cut finer, with the points of their boundary on the true surface.

A mesh's own facets are chords: refined by `refine_uniformly` it stays the same polyhedron. Here the
new points follow the surface that was meant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError, InvertedCellError
from palpate.meshes.refinement import refine_uniformly
from palpate.meshes.tet_mesh import TetMesh

Projection = Callable[[Points], Points]
# Of the size of a body: a facet lies in a plane x, y or z = 0 within it.
_FLAT = 1e-9
# Of the length of a facet's normal along z: a mantle's has none, a cap's is all of it.
_UPRIGHT = 0.5


@dataclass(frozen=True, eq=False)
class CurvedPart:
    """Facets of a mesh's boundary, and the place on the true surface for any place near them."""

    facets: Indices
    project: Projection


def spherical_parts(mesh: TetMesh, radii: Sequence[float]) -> list[CurvedPart]:
    """Parts of spheres about the origin; facets in a plane x, y or z = 0 are flat.

    Args:
        mesh: Of a sphere, a thick one, or an eighth of it.
        radii: Of its spheres [m]; each facet belongs to the nearest.
    """
    corners = mesh.points[mesh.boundary_facets]
    size = float(np.ptp(mesh.points, axis=0).max())
    is_flat = (np.abs(corners) <= _FLAT * size).all(axis=1).any(axis=1)
    lengths = np.linalg.norm(corners, axis=2).mean(axis=1)

    def onto(radius: float) -> Projection:
        return lambda x: x * (radius / np.linalg.norm(x, axis=1, keepdims=True))

    return _nearest(mesh, radii, lengths, ~is_flat, onto)


def upright_parts(mesh: TetMesh, radii: Sequence[float]) -> list[CurvedPart]:
    """Mantles about the z axis; caps are flat.

    Args:
        mesh: Of a cylinder or a tube.
        radii: Of its mantles [m]; each facet belongs to the nearest.
    """
    corners = mesh.points[mesh.boundary_facets]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    is_mantle = np.abs(normals[:, 2]) < _UPRIGHT * np.linalg.norm(normals, axis=1)
    lengths = np.linalg.norm(corners[..., :2], axis=2).mean(axis=1)

    def onto(radius: float) -> Projection:
        def project(x: Points) -> Points:
            out = x.copy()
            out[:, :2] *= radius / np.linalg.norm(x[:, :2], axis=1, keepdims=True)
            return out

        return project

    return _nearest(mesh, radii, lengths, is_mantle, onto)


def _nearest(
    mesh: TetMesh,
    radii: Sequence[float],
    lengths: Floats,
    is_curved: np.ndarray[tuple[int], np.dtype[np.bool_]],
    onto: Callable[[float], Projection],
) -> list[CurvedPart]:
    nearest = np.abs(lengths[:, None] - np.array(radii)).argmin(axis=1)
    facets = mesh.boundary_facets
    return [
        CurvedPart(facets[is_curved & (nearest == k)], onto(radius))
        for k, radius in enumerate(radii)
    ]


def refine_along(mesh: TetMesh, parts: Sequence[CurvedPart]) -> TetMesh:
    """Cut each cell into eight, and put the points of the curved parts on the true surface.

    Args:
        mesh: Whose points come first and stay where they are, if they are on it.
        parts: Its curved parts.

    Returns:
        A mesh with the points and cells of `refine_uniformly`, the boundary's points moved.

    Raises:
        InputError: A cell would be turned inside out: the mesh is too coarse for its surface.
    """
    names = [f"curved part {k}" for k in range(len(parts))]
    groups = {**mesh.facet_groups, **dict(zip(names, (p.facets for p in parts), strict=True))}
    fine = refine_uniformly(TetMesh(mesh.points, mesh.cells, groups, mesh.point_groups))
    points = fine.points.copy()
    for name, part in zip(names, parts, strict=True):
        chosen = np.unique(fine.facet_groups[name])
        if len(chosen):
            points[chosen] = part.project(points[chosen])
    kept = {name: rows for name, rows in fine.facet_groups.items() if name not in names}
    return _moved(fine, points, kept)


def offset_boundary(mesh: TetMesh, distance: float) -> TetMesh:
    """Move each point of the boundary along the mean of its facets' normals.

    Args:
        mesh: Any.
        distance: Outwards [m]; below 0 inwards.

    Raises:
        InputError: A cell would be turned inside out.
    """
    facets = mesh.boundary_facets
    corners = mesh.points[facets]
    vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(mesh.points)
    np.add.at(normals, facets, vectors[:, None, :])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    moved = mesh.points + distance * normals / np.where(lengths > 0.0, lengths, 1.0)
    return _moved(mesh, moved, dict(mesh.facet_groups))


def _moved(mesh: TetMesh, points: Points, groups: dict[str, Indices]) -> TetMesh:
    try:
        return TetMesh(points, mesh.cells, groups, mesh.point_groups)
    except InvertedCellError as error:
        raise InputError(
            "the mesh is too coarse for its true surface: moved there, cells would be turned "
            f"inside out ({error}); mesh the body finer"
        ) from error
