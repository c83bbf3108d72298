"""Quality of tetrahedra: dihedral angles, mean ratio, spread of edge lengths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.tet_mesh import CELL_FACETS, EDGES, TetMesh, signed_volumes
from palpate.meshes.triangles import facet_normals

# The two facets that meet at each edge lie opposite the two other corners.
_OPPOSITE = np.array([[2, 3], [1, 3], [1, 2], [0, 3], [0, 2], [0, 1]])


def dihedral_angles(points: Points, cells: Indices) -> Floats:
    """Angle between the two facets at each of the six edges [rad], shape (num_cells, 6).

    A regular tetrahedron has arccos(1/3) = 70.53 degrees everywhere.
    """
    corners = points[cells]
    normals = facet_normals(corners[:, CELL_FACETS])
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    pair = normals[:, _OPPOSITE]
    cosine = -np.einsum("ijk,ijk->ij", pair[:, :, 0], pair[:, :, 1])
    angles: Floats = np.arccos(np.clip(cosine, -1.0, 1.0))
    return angles


def edge_lengths(points: Points, cells: Indices) -> Floats:
    """Lengths of the six edges of each cell [m], shape (num_cells, 6)."""
    ends = points[cells[:, EDGES]]
    lengths: Floats = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    return lengths


def mean_ratio(points: Points, cells: Indices) -> Floats:
    """12 (3 V)^(2/3) / sum of squared edge lengths [-]: 1 regular, 0 flat, < 0 inverted.

    Liu and Joe 1994, eq. (4.1). Shape (num_cells,).
    """
    volumes = signed_volumes(points, cells)
    squared = (edge_lengths(points, cells) ** 2).sum(axis=1)
    ratio: Floats = np.sign(volumes) * 12.0 * np.cbrt(3.0 * np.abs(volumes)) ** 2 / squared
    return ratio


def edge_length_deviation(points: Points, cells: Indices) -> Floats:
    """Standard deviation of a cell's edge lengths over their mean [-], shape (num_cells,).

    The paper's measure of a sliver (section II, step 5). A flat square of four points scores
    only 0.19, so it is read together with the dihedral angle.
    """
    lengths = edge_lengths(points, cells)
    deviation: Floats = lengths.std(axis=1) / lengths.mean(axis=1)
    return deviation


@dataclass(frozen=True)
class MeshQuality:
    """Quality of a mesh in a few numbers; angles in degrees."""

    num_points: int
    num_cells: int
    smallest_dihedral_deg: float
    first_percentile_dihedral_deg: float
    largest_dihedral_deg: float
    smallest_mean_ratio: float
    largest_edge_length_deviation: float
    shortest_edge: float
    longest_edge: float


def measure_quality(mesh: TetMesh) -> MeshQuality:
    """Measure all of a mesh; the percentile is of each cell's smallest dihedral angle."""
    angles = np.degrees(dihedral_angles(mesh.points, mesh.cells))
    lengths = edge_lengths(mesh.points, mesh.cells)
    smallest = angles.min(axis=1)
    return MeshQuality(
        num_points=mesh.num_points,
        num_cells=mesh.num_cells,
        smallest_dihedral_deg=float(smallest.min()),
        first_percentile_dihedral_deg=float(np.percentile(smallest, 1.0)),
        largest_dihedral_deg=float(angles.max()),
        smallest_mean_ratio=float(mean_ratio(mesh.points, mesh.cells).min()),
        largest_edge_length_deviation=float(edge_length_deviation(mesh.points, mesh.cells).max()),
        shortest_edge=float(lengths.min()),
        longest_edge=float(lengths.max()),
    )
