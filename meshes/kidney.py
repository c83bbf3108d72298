"""The kidney: a smooth bean with a hilum, scaled to an exact volume."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.shapes import flip_to_delaunay, require_positive, stitch_rings
from palpate.meshes.tri_surface import TriSurface

# Table I of Yan, Gu et al. 2007: 332 889 mm3.
KIDNEY_VOLUME = 332889e-9


def shape_kidney(*, edge_length: float, volume: float = KIDNEY_VOLUME) -> TriSurface:
    """A kidney-shaped closed surface of exactly the given volume.

    The long axis is z (upper pole at +z, a little fuller), the hilum faces -x, y is the
    thickness; the poles lean towards the hilum. No mirror symmetry, so that a mirrored
    solution shows. About 143 x 77 x 61 mm at the default volume (a large kidney: the volume is
    the paper's); area about 26 400 mm2.

    Args:
        edge_length: Wanted edge length [m], > 0 and at most a fifth of the length of the body.
        volume: Enclosed volume of the triangulated surface [m3], > 0; met by uniform scaling to
            1e-14 relative.

    Returns:
        A closed, outward surface; smallest angle about 35 degrees for edges of 10 mm or less.

    Raises:
        InputError: A length that is not above 0, or too coarse to show the shape.
    """
    require_positive(edge_length=edge_length, volume=volume)
    unit = (volume / KIDNEY_VOLUME) ** (1.0 / 3.0) * 1e-3  # metres per modelling millimetre
    spacing = edge_length / unit
    if spacing > 25.0:
        raise InputError(
            f"edge_length = {edge_length:g} m is too coarse for a kidney of {volume:g} m3; "
            f"use at most {25.0 * unit:.3g} m"
        )
    directions, facets = _rings_on_sphere(spacing)
    directions, facets = _relax(directions, facets)
    points = _kidney_points(directions)
    for _ in range(3):  # the last passes only remove rounding
        points = points - points.mean(axis=0)
        points = points * (volume / TriSurface(points, facets).volume) ** (1.0 / 3.0)
    return TriSurface(points, facets)


def _kidney_points(directions: Points) -> Points:
    """Map unit vectors to the kidney's surface, in modelling millimetres."""
    x, y, z = directions.T
    fuller_above = 1.0 + 0.07 * z
    hilum = 18.9 * np.exp(-((z / 0.34) ** 2) - (y / 0.62) ** 2) * np.clip(-x, 0.0, None) ** 2
    px = 39.0 * fuller_above * x - 16.4 * z**2 + hilum
    py = 30.2 * fuller_above * y + 3.8 * z + 2.5 * z**2
    pz = 71.7 * z
    return np.column_stack([px, py, pz])


def _rings_on_sphere(spacing: float) -> tuple[Points, Indices]:
    """Rings of points along the long axis; their number of points follows the mapped length."""
    fine = np.linspace(0.0, np.pi, 721)
    around = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
    grid = np.stack(
        [_kidney_points(_direction(fine, np.full_like(fine, angle))) for angle in around]
    )
    meridian = np.linalg.norm(np.diff(grid, axis=1), axis=2).mean(axis=0)
    along = np.concatenate([[0.0], np.cumsum(meridian)])
    rows = max(4, round(along[-1] / (spacing * math.sqrt(3.0) / 2.0)))
    polar = np.interp(np.linspace(0.0, along[-1], rows + 1), along, fine)
    directions: list[Points] = []
    facets: list[list[int]] = []
    previous: NDArray[np.int64] | None = None
    start = 0
    for k, angle in enumerate(polar):
        ends = k in (0, rows)
        ring = _kidney_points(_direction(np.full_like(around, angle), around))
        length = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum()
        count = 1 if ends else max(5, round(length / spacing))
        turn = 2.0 * np.pi * (np.arange(count) + 0.5 * (k % 2)) / count
        directions.append(_direction(np.full(count, angle), turn))
        indices = np.arange(start, start + count)
        start += count
        if previous is not None:
            # Rings run downwards from the upper pole, so the new one is the lower.
            facets += stitch_rings(indices, previous)
        previous = indices
    return np.vstack(directions), np.array(facets, dtype=np.int32)


def _direction(polar: Floats, around: Floats) -> Points:
    return np.column_stack(
        [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)]
    )


def _relax(directions: Points, facets: Indices, passes: int = 60) -> tuple[Points, Indices]:
    """Even out the triangles: move each point along the surface towards its neighbours' centre.

    The step is taken in the tangent plane of the sphere by least squares on the map's
    derivative, so every point stays on the surface; edges are flipped to Delaunay in between.
    """
    for step in range(passes):
        points = _kidney_points(directions)
        if step % 10 == 0:
            facets = flip_to_delaunay(points, facets)
        first, second = facets[:, [0, 1, 2]].reshape(-1), facets[:, [1, 2, 0]].reshape(-1)
        total, count = np.zeros_like(points), np.zeros(len(points))
        np.add.at(total, first, points[second])
        np.add.at(count, first, 1.0)
        wanted = 0.5 * (total / count[:, None] - points)
        # An orthonormal pair of tangents for each direction.
        pole = np.where(np.abs(directions[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
        t1 = np.cross(directions, pole)
        t1 /= np.linalg.norm(t1, axis=1, keepdims=True)
        t2 = np.cross(directions, t1)
        h = 1e-6
        d1 = (_kidney_points(directions + h * t1) - _kidney_points(directions - h * t1)) / (2 * h)
        d2 = (_kidney_points(directions + h * t2) - _kidney_points(directions - h * t2)) / (2 * h)
        a11, a12, a22 = (np.einsum("ij,ij->i", p, q) for p, q in ((d1, d1), (d1, d2), (d2, d2)))
        b1, b2 = np.einsum("ij,ij->i", d1, wanted), np.einsum("ij,ij->i", d2, wanted)
        determinant = a11 * a22 - a12**2
        s1 = (a22 * b1 - a12 * b2) / determinant
        s2 = (a11 * b2 - a12 * b1) / determinant
        directions = directions + s1[:, None] * t1 + s2[:, None] * t2
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return directions, flip_to_delaunay(_kidney_points(directions), facets)
