"""Closed, oriented, deterministic surfaces of simple bodies, made of well-shaped triangles."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.rings import stitch_rings
from palpate.meshes.tri_surface import TriSurface

GOLDEN_RATIO = (1.0 + math.sqrt(5.0)) / 2.0


def require_positive(**lengths: float) -> None:
    """Refuse a length that is not finite and above zero."""
    for name, value in lengths.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{name} = {value:g}: needs a finite length above 0")


def shape_box(
    size: tuple[float, float, float] = (1.0, 1.0, 1.0), *, edge_length: float
) -> TriSurface:
    """A box from the origin to `size`, facets on regular grids with alternating diagonals.

    Args:
        size: Lengths along x, y, z [m], each > 0.
        edge_length: Wanted length of the grid's edges [m], > 0; rounded to divide each side.
    """
    require_positive(x=size[0], y=size[1], z=size[2], edge_length=edge_length)
    counts = [max(1, round(length / edge_length)) for length in size]
    index: dict[tuple[int, int, int], int] = {}
    points: list[tuple[float, ...]] = []
    facets: list[tuple[int, int, int]] = []

    def point(place: tuple[int, int, int]) -> int:
        if place not in index:
            index[place] = len(points)
            points.append(tuple(s * p / n for s, p, n in zip(size, place, counts, strict=True)))
        return index[place]

    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for end in (0, counts[axis]):
            for i in range(counts[u]):
                for j in range(counts[v]):
                    corners = []
                    for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1)):
                        place = [0, 0, 0]
                        place[axis], place[u], place[v] = end, i + du, j + dv
                        corners.append(point((place[0], place[1], place[2])))
                    if end == 0:
                        corners = corners[::-1]
                    a, b, c, d = corners
                    facets += [(a, b, c), (a, c, d)] if (i + j) % 2 else [(a, b, d), (b, c, d)]
    return TriSurface(np.array(points), np.array(facets))


def shape_beam(length: float, width: float, height: float, *, edge_length: float) -> TriSurface:
    """A box of `length` along x, `width` along y, `height` along z [m], from the origin."""
    return shape_box((length, width, height), edge_length=edge_length)


def shape_sphere(radius: float = 1.0, *, edge_length: float) -> TriSurface:
    """A sphere about the origin: an icosahedron, each side cut in equal parts, pushed out.

    Every point lies on the sphere to rounding. The number of parts is the one whose mean edge
    comes closest to `edge_length`.

    Args:
        radius: [m], > 0.
        edge_length: Wanted mean edge length [m], > 0.
    """
    require_positive(radius=radius, edge_length=edge_length)
    # 10 n^2 + 2 points share 4 pi R^2: equilateral triangles of that density.
    parts = max(1, round(radius * math.sqrt(4.0 * math.pi / (math.sqrt(3.0) * 5.0)) / edge_length))
    t = GOLDEN_RATIO
    corners = np.array(
        [
            [-1, t, 0], [1, t, 0], [-1, -t, 0], [1, -t, 0], [0, -1, t], [0, 1, t],
            [0, -1, -t], [0, 1, -t], [t, 0, -1], [t, 0, 1], [-t, 0, -1], [-t, 0, 1],
        ]
    )  # fmt: skip
    sides = [
        (0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4),
        (11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8),
        (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1),
    ]  # fmt: skip
    index: dict[tuple[tuple[int, int], ...], int] = {}
    points: list[Points] = []
    facets: list[tuple[int, int, int]] = []

    def point(weights: dict[int, int]) -> int:
        key = tuple(sorted((corner, w) for corner, w in weights.items() if w))
        if key not in index:
            index[key] = len(points)
            place = np.zeros(3)
            for corner, weight in key:
                place = place + weight * corners[corner]
            points.append(place / math.sqrt(float(place @ place)))
        return index[key]

    for a, b, c in sides:
        grid = {
            (i, j): point({a: parts - i - j, b: i, c: j})
            for i in range(parts + 1)
            for j in range(parts + 1 - i)
        }
        for i in range(parts):
            for j in range(parts - i):
                facets.append((grid[i, j], grid[i + 1, j], grid[i, j + 1]))
                if i + j < parts - 1:
                    facets.append((grid[i + 1, j], grid[i + 1, j + 1], grid[i, j + 1]))
    return TriSurface(radius * np.array(points), np.array(facets))


def shape_cylinder(radius: float, height: float, *, edge_length: float) -> TriSurface:
    """A cylinder about the z axis from z = 0 to `height`, caps of concentric rings.

    Args:
        radius: [m], > 0; the points of the mantle lie on it.
        height: [m], > 0.
        edge_length: Wanted edge length [m], > 0.
    """
    require_positive(radius=radius, height=height, edge_length=edge_length)
    around = max(6, round(2.0 * math.pi * radius / edge_length))
    # Equilateral rows are sqrt(3)/2 apart.
    rows = max(1, round(height / (edge_length * math.sqrt(3.0) / 2.0)))
    rings = max(1, round(radius / edge_length))
    points: list[Points] = []
    facets: list[list[int]] = []

    def ring(count: int, r: float, z: float, shift: float = 0.0) -> NDArray[np.int64]:
        start = sum(len(p) for p in points)
        angle = 2.0 * np.pi * (np.arange(count) + shift) / count
        points.append(np.column_stack([r * np.cos(angle), r * np.sin(angle), np.full(count, z)]))
        return np.arange(start, start + count)

    mantle = [ring(around, radius, height * k / rows, 0.5 * (k % 2)) for k in range(rows + 1)]
    for below, above, k in zip(mantle[:-1], mantle[1:], range(rows), strict=True):
        facets += stitch_rings(below, np.roll(above, 0 if k % 2 == 0 else -1))
    for cap, z in ((mantle[0], 0.0), (mantle[-1], height)):
        outer = cap
        shift = 0.5 * (rows % 2) if z else 0.0
        for k in range(rings - 1, -1, -1):
            count = 1 if k == 0 else max(5, round(around * k / rings))
            r = radius * k / rings
            inner = ring(count, r, z, shift * count / around if count > 1 else 0.0)
            band = stitch_rings(outer, inner)
            facets += band if z else [[a, c, b] for a, b, c in band]
            outer = inner
    return TriSurface(np.vstack(points), np.array(facets))
