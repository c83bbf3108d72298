"""Refined meshes of curved bodies, with the points of their boundary on the true surface.

The facets of a mesh are chords: refined by `refine_uniformly` it stays the same polyhedron. Here
the new points lie on the exact surface.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Mask, Points
from palpate.meshes.errors import InputError, InvertedCellError
from palpate.meshes.refinement import refine_uniformly
from palpate.meshes.tet_mesh import EDGES, TetMesh
from palpate.meshes.triangles import facet_normals, unit_normals_at_points

Projection = Callable[[Points], Points]
# A facet lies in a plane x, y or z = 0 within this fraction of the size of the body.
_FLAT = 1e-9
# Fraction of a facet's normal along z below which it is of a mantle (0); a cap has 1.
_UPRIGHT = 0.5
# Sweeps of `_followed`: only cells near the boundary would invert, so few sweeps suffice.
_SWEEPS = 50


@dataclass(frozen=True, eq=False)
class CurvedPart:
    """Facets of a mesh's boundary, and the map of points near them onto the true surface."""

    facets: Indices
    project: Projection


def spherical_parts(mesh: TetMesh, radii: Sequence[float]) -> list[CurvedPart]:
    """Parts on spheres of given radii [m] about the origin; facets in x, y or z = 0 are flat.

    Each curved facet belongs to the nearest radius.
    """
    corners = mesh.points[mesh.boundary_facets]
    size = float(np.ptp(mesh.points, axis=0).max())
    is_flat = (np.abs(corners) <= _FLAT * size).all(axis=1).any(axis=1)
    lengths = np.linalg.norm(corners, axis=2).mean(axis=1)

    def onto(radius: float) -> Projection:
        return lambda x: x * (radius / np.linalg.norm(x, axis=1, keepdims=True))

    return _nearest(mesh, radii, lengths, ~is_flat, onto)


def upright_parts(mesh: TetMesh, radii: Sequence[float]) -> list[CurvedPart]:
    """Parts on cylinders of given radii [m] about the z axis; caps are flat.

    Each facet of a mantle belongs to the nearest radius.
    """
    corners = mesh.points[mesh.boundary_facets]
    normals = facet_normals(corners)
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
    """Cut each cell into eight as `refine_uniformly`, curved parts' points on the true surface.

    The mesh's own points come first, and do not move if they are on the true surface.

    Raises:
        InputError: A cell would be turned inside out: the mesh is too coarse for its surface.
    """
    names = [f"curved part {k}" for k in range(len(parts))]
    groups = {**mesh.facet_groups, **dict(zip(names, (p.facets for p in parts), strict=True))}
    fine = refine_uniformly(TetMesh(mesh.points, mesh.cells, groups, mesh.point_groups))
    points = fine.points.copy()
    is_placed = np.zeros(fine.num_points, dtype=np.bool_)
    for name, part in zip(names, parts, strict=True):
        chosen = np.unique(fine.facet_groups[name])
        if len(chosen):
            points[chosen] = part.project(points[chosen])
            is_placed[chosen] = True
    kept = {name: rows for name, rows in fine.facet_groups.items() if name not in names}
    return _moved(fine, points, kept, is_placed)


def offset_boundary(mesh: TetMesh, distance: float) -> TetMesh:
    """Move each boundary point by a distance [m], > 0 outwards, along its facets' mean normal.

    Raises:
        InputError: A cell would be turned inside out.
    """
    moved = mesh.points + distance * unit_normals_at_points(mesh.points, mesh.boundary_facets)
    return _moved(mesh, moved, dict(mesh.facet_groups), np.ones(mesh.num_points, dtype=np.bool_))


def _moved(mesh: TetMesh, points: Points, groups: dict[str, Indices], is_placed: Mask) -> TetMesh:
    """A mesh with its points at wanted positions [m]; others follow only where cells would invert.

    `is_placed` is whether a boundary point has its final position, shape (num_points,).
    """
    try:
        return TetMesh(points, mesh.cells, groups, mesh.point_groups)
    except InvertedCellError:
        pass
    try:
        followed = _followed(mesh, points, is_placed)
        return TetMesh(followed, mesh.cells, groups, mesh.point_groups)
    except InvertedCellError as error:
        raise InputError(
            "the mesh is too coarse for its true surface: moved there, cells would be turned "
            f"inside out ({error}); mesh the body finer"
        ) from error


def _followed(mesh: TetMesh, points: Points, is_placed: Mask) -> Points:
    """Inner points, and points of flat faces, moved repeatedly by the mean of their neighbours.

    Neighbours are weighted by one over the square of the distance, so that a point in a thin wall
    follows both sides. Points of a flat face follow neighbours in it, so that it stays flat;
    creases between faces stay.
    """
    moved = points - mesh.points
    facets = mesh.boundary_facets
    on_surface = np.zeros(mesh.num_points, dtype=np.bool_)
    on_surface[facets] = True
    is_sliding = _are_flat(mesh) & ~is_placed & on_surface
    sides = np.vstack([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]])
    inside = np.unique(np.sort(mesh.cells[:, EDGES].reshape(-1, 2), axis=1), axis=0)
    inside = np.vstack([inside, inside[:, ::-1]])
    pairs = np.vstack([sides[is_sliding[sides[:, 0]]], inside[~on_surface[inside[:, 0]]]])
    lengths = np.linalg.norm(mesh.points[pairs[:, 0]] - mesh.points[pairs[:, 1]], axis=1)
    weights = lengths**-2.0
    whole = np.bincount(pairs[:, 0], weights, mesh.num_points)
    is_free = whole > 0.0
    for _ in range(_SWEEPS):
        total = np.zeros_like(moved)
        np.add.at(total, pairs[:, 0], weights[:, None] * moved[pairs[:, 1]])
        moved[is_free] = total[is_free] / whole[is_free, None]
    return mesh.points + moved


def _are_flat(mesh: TetMesh) -> Mask:
    """Whether the boundary facets around each point lie in one plane, shape (num_points,)."""
    normals = facet_normals(mesh.points[mesh.boundary_facets])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sums = np.zeros_like(mesh.points)
    np.add.at(sums, mesh.boundary_facets, normals[:, None, :])
    count = np.bincount(mesh.boundary_facets.ravel(), minlength=mesh.num_points)
    flat: Mask = np.linalg.norm(sums, axis=1) >= (1.0 - _FLAT) * count
    return flat
