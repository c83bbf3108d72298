"""Closed surfaces of simple bodies, solid and hollow: oriented, reproducible, well-shaped.

Box, sphere, cylinder, thick sphere and its eighth, and tube; `stitch_rings` and
`flip_to_delaunay` triangulate other shapes made of rings.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
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
    """A box from the origin to `size` [m], facets on regular grids with alternating diagonals.

    Edges of the grid have about a wanted length [m], which is rounded to divide each side.

    Args:
        size: Sides along x, y, z [m], each above 0.
        edge_length: Wanted length of edges [m], above 0.

    Returns:
        The closed surface [m], facets counter-clockwise seen from outside.

    Raises:
        InputError: A length that is not finite and above 0.

    >>> import palpate
    >>> round(palpate.box((0.06, 0.02, 0.02), edge_length=0.01).volume * 1e6, 6)  # cm3
    24.0
    """
    require_positive(x=size[0], y=size[1], z=size[2], edge_length=edge_length)
    counts = [max(1, round(length / edge_length)) for length in size]
    point = _Numbering(lambda *at: [s * p / n for s, p, n in zip(size, at, counts, strict=True)])
    facets: list[tuple[int, int, int]] = []

    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for end in (0, counts[axis]):
            for i in range(counts[u]):
                for j in range(counts[v]):
                    corners = []
                    for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1)):
                        at = [0, 0, 0]
                        at[axis], at[u], at[v] = end, i + du, j + dv
                        corners.append(point(*at))
                    a, b, c, d = corners if end else corners[::-1]
                    facets += _halves((a, b, c, d), i + j)
    return TriSurface(np.array(point.positions), np.array(facets))


def shape_beam(length: float, width: float, height: float, *, edge_length: float) -> TriSurface:
    """A box of `length` along x, `width` along y, `height` along z [m], from the origin."""
    return shape_box((length, width, height), edge_length=edge_length)


def shape_sphere(radius: float = 1.0, *, edge_length: float) -> TriSurface:
    """A sphere about the origin: an icosahedron, each side cut in equal parts, pushed out.

    Every point lies on the sphere to rounding. The number of parts is the one whose mean edge
    comes closest to `edge_length` [m].

    Args:
        radius: [m], above 0.
        edge_length: Wanted length of edges [m], above 0.

    Returns:
        The closed surface [m], facets counter-clockwise seen from outside.

    Raises:
        InputError: A length that is not finite and above 0.

    >>> import palpate
    >>> len(palpate.sphere(0.03, edge_length=0.01).points)
    162
    """
    require_positive(radius=radius, edge_length=edge_length)
    # 10 n^2 + 2 points on an area of 4 pi R^2: equilateral triangles of that density.
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
    facets: list[tuple[int, int, int]] = []

    def position(*weights: tuple[int, int]) -> Points:
        total = np.zeros(3)
        for corner, weight in weights:
            total = total + weight * corners[corner]
        return total / math.sqrt(float(total @ total))

    point = _Numbering(position)
    for a, b, c in sides:
        # Points on a common side have no weight at the third corner.
        grid = {
            (i, j): point(*sorted((v, w) for v, w in ((a, parts - i - j), (b, i), (c, j)) if w))
            for i in range(parts + 1)
            for j in range(parts + 1 - i)
        }
        for i in range(parts):
            for j in range(parts - i):
                facets.append((grid[i, j], grid[i + 1, j], grid[i, j + 1]))
                if i + j < parts - 1:
                    facets.append((grid[i + 1, j], grid[i + 1, j + 1], grid[i, j + 1]))
    return TriSurface(radius * np.array(point.positions), np.array(facets))


def shape_cylinder(radius: float, height: float, *, edge_length: float) -> TriSurface:
    """A cylinder about the z axis from z = 0 to `height` [m], caps of concentric rings.

    The points of the mantle lie on it; edges have about a wanted length [m].

    Args:
        radius: [m], above 0.
        height: [m], above 0.
        edge_length: Wanted length of edges [m], above 0.

    Returns:
        The closed surface [m], facets counter-clockwise seen from outside.

    Raises:
        InputError: A length that is not finite and above 0.

    >>> import palpate
    >>> float(palpate.cylinder(0.01, 0.05, edge_length=0.004).points[:, 2].max())
    0.05
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


def stitch_rings(lower: NDArray[np.int64], upper: NDArray[np.int64]) -> list[list[int]]:
    """Triangulate the band between two closed rings of points that start at the same angle.

    Both rings are evenly spaced and run counter-clockwise seen from above; the facets face
    outwards of the band. A ring of one point makes a fan. Both rings are followed at once, each
    time closing the shorter diagonal.
    """
    low, up = len(lower), len(upper)
    facets: list[list[int]] = []
    i = j = 0
    while i < (low if low > 1 else 0) or j < (up if up > 1 else 0):
        next_low, next_up = (i + 1) / low, (j + 1) / up
        advance_low = low > 1 and i < low and (up == 1 or j >= up or next_low <= next_up)
        if advance_low:
            facets.append([int(lower[i % low]), int(lower[(i + 1) % low]), int(upper[j % up])])
            i += 1
        else:
            facets.append([int(lower[i % low]), int(upper[(j + 1) % up]), int(upper[j % up])])
            j += 1
    return facets


def flip_to_delaunay(
    points: Points, facets: Indices, max_passes: int = 20, patches: Indices | None = None
) -> Indices:
    """Flip edges whose two opposite angles sum to more than pi, until none is left.

    Raises the smallest angles; the surface stays closed, and no edge is made twice.

    Args:
        points: Shape (num_points, 3).
        facets: Shape (num_facets, 3).
        max_passes: Most passes over all edges.
        patches: Number of each facet's patch, shape (num_facets,): edges between patches stay, and
            patches may meet at an edge. All are one closed surface where not given.

    Returns:
        The facets in their order, shape (num_facets, 3).
    """
    triangles = facets.astype(np.int64).copy()
    patch = np.zeros(len(facets), dtype=np.int64) if patches is None else patches
    for _ in range(max_passes):
        directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        owner = np.repeat(patch, 3)
        number_of = {
            (int(p), int(a), int(b)): k
            for k, (p, (a, b)) in enumerate(zip(owner, directed, strict=True))
        }
        there = {(int(a), int(b)) for a, b in np.sort(directed, axis=1)}
        cosines = _corner_cosines(points, triangles)
        touched = np.zeros(len(triangles), dtype=bool)
        flipped = 0
        for (p, a, b), k in number_of.items():
            opposite = number_of.get((p, b, a))
            if a > b or opposite is None:
                continue
            (s, side), (t, other) = divmod(k, 3), divmod(opposite, 3)
            if touched[s] or touched[t]:
                continue
            # Opposite angles alpha + beta > pi  <=>  cos alpha + cos beta < 0.
            if cosines[s, (side + 2) % 3] + cosines[t, (other + 2) % 3] >= -1e-12:
                continue
            c = int(triangles[s, (side + 2) % 3])
            d = int(triangles[t, (other + 2) % 3])
            if (min(c, d), max(c, d)) in there:
                continue
            triangles[s] = (c, a, d)
            triangles[t] = (d, b, c)
            there.add((min(c, d), max(c, d)))
            touched[s] = touched[t] = True
            flipped += 1
        if flipped == 0:
            break
    return triangles.astype(np.int32)


def _corner_cosines(points: Points, facets: NDArray[np.int64]) -> Floats:
    """Cosine of the angle at each corner, shape (num_facets, 3)."""
    corners = points[facets]
    to_next = corners[:, [1, 2, 0]] - corners
    to_last = corners[:, [2, 0, 1]] - corners
    dots = np.einsum("ijk,ijk->ij", to_next, to_last)
    cosines: Floats = dots / (
        np.linalg.norm(to_next, axis=2) * np.linalg.norm(to_last, axis=2) + np.finfo(float).tiny
    )
    return cosines


Quad = tuple[int, int, int, int]


def shape_hollow_sphere(radius: float, inner_radius: float, *, edge_length: float) -> TriSurface:
    """A thick sphere about the origin, of radii [m]: two spheres, the inner one turned inside out.

    The wanted mean edge length [m] is that of both.

    Raises:
        InputError: A length that is not above 0, or no wall.
    """
    _require_wall(radius, inner_radius, edge_length)
    outer = shape_sphere(radius, edge_length=edge_length)
    inner = shape_sphere(inner_radius, edge_length=edge_length)
    facets = np.vstack([outer.facets, inner.facets[:, ::-1] + len(outer.points)])
    return TriSurface(np.vstack([outer.points, inner.points]), facets)


def shape_hollow_octant(radius: float, inner_radius: float, *, edge_length: float) -> TriSurface:
    """The eighth of a thick sphere, of radii [m], with x, y, z >= 0, flat on x, y, z = 0.

    With supports that let the flat faces slide it stands for the whole sphere under symmetric
    loads. The wanted edge length [m] is the mean on the outer sphere, and that across the wall.

    Raises:
        InputError: A length that is not above 0, or no wall.
    """
    _require_wall(radius, inner_radius, edge_length)
    # n^2 triangles on an area of pi R^2 / 2: equilateral triangles of that density.
    n = max(1, round(radius * math.sqrt(2.0 * math.pi / math.sqrt(3.0)) / edge_length))
    layers = max(1, round((radius - inner_radius) / edge_length))

    def position(i: int, j: int, layer: int) -> Points:
        direction = np.array([n - i - j, i, j]) / math.hypot(n - i - j, i, j)
        part = layer / layers
        return ((1.0 - part) * inner_radius + part * radius) * direction

    point = _Numbering(position)
    facets: list[tuple[int, int, int]] = []
    for i in range(n):
        for j in range(n - i):
            corners = [[(i, j), (i + 1, j), (i, j + 1)]]
            if i + j < n - 1:
                corners.append([(i + 1, j), (i + 1, j + 1), (i, j + 1)])
            for (a, b), (c, d), (e, f) in corners:
                facets.append((point(a, b, layers), point(c, d, layers), point(e, f, layers)))
                facets.append((point(a, b, 0), point(e, f, 0), point(c, d, 0)))
    for k in range(n):
        for layer in range(layers):
            for (a, b), (c, d) in (
                ((k, 0), (k + 1, 0)),  # z = 0
                ((0, k + 1), (0, k)),  # y = 0
                ((n - k, k), (n - k - 1, k + 1)),  # x = 0
            ):
                low, high = layer, layer + 1
                quad = point(a, b, low), point(c, d, low), point(c, d, high), point(a, b, high)
                facets += _halves(quad, k + layer)
    return TriSurface(np.array(point.positions), np.array(facets))


def shape_tube(
    radius: float, inner_radius: float, height: float, *, edge_length: float
) -> TriSurface:
    """A tube about the z axis from z = 0 to `height`, of radii [m]; the mantle's points lie on it.

    The wanted edge length [m] is that on the outer mantle, and across the wall.

    Raises:
        InputError: A length that is not above 0, or no wall.
    """
    _require_wall(radius, inner_radius, edge_length)
    require_positive(height=height)
    around = max(6, round(2.0 * math.pi * radius / edge_length))
    rows, layers = (max(1, round(x / edge_length)) for x in (height, radius - inner_radius))

    def position(k: int, layer: int, row: int) -> list[float]:
        angle, part = 2.0 * math.pi * k / around, layer / layers
        r = (1.0 - part) * inner_radius + part * radius
        return [r * math.cos(angle), r * math.sin(angle), height * row / rows]

    point = _Numbering(position)
    facets: list[tuple[int, int, int]] = []

    def add_quad(a: int, b: int, low: tuple[int, int], high: tuple[int, int], number: int) -> None:
        """Two triangles between the angles a and b, from one layer and row to another."""
        a, b = a % around, b % around
        quad = point(a, *low), point(b, *low), point(b, *high), point(a, *high)
        facets.extend(_halves(quad, number))

    for k in range(around):
        for row in range(rows):
            for layer, (a, b) in ((layers, (k, k + 1)), (0, (k + 1, k))):
                add_quad(a, b, (layer, row), (layer, row + 1), k + row)
        for layer in range(layers):
            for row, (a, b) in ((rows, (k, k + 1)), (0, (k + 1, k))):
                add_quad(a, b, (layer + 1, row), (layer, row), k + layer)
    return TriSurface(np.array(point.positions), np.array(facets))


class _Numbering:
    """Numbers points in the order in which they are first named, each once, found by `position`."""

    def __init__(self, position: Callable[..., Points | list[float]]) -> None:
        self._position = position
        self._numbers: dict[tuple[Any, ...], int] = {}
        self.positions: list[Points | list[float]] = []

    def __call__(self, *key: Any) -> int:
        if key not in self._numbers:
            self._numbers[key] = len(self.positions)
            self.positions.append(self._position(*key))
        return self._numbers[key]


def _halves(quad: Quad, number: int) -> list[tuple[int, int, int]]:
    """The two triangles of a quadrilateral, cut along one diagonal or the other in turn."""
    a, b, c, d = quad
    return [(a, b, c), (a, c, d)] if number % 2 else [(a, b, d), (b, c, d)]


def _require_wall(radius: float, inner_radius: float, edge_length: float) -> None:
    require_positive(radius=radius, inner_radius=inner_radius, edge_length=edge_length)
    if not inner_radius < radius:
        raise InputError(
            f"inner_radius = {inner_radius:g}: needs less than the radius, {radius:g}; there is "
            "no wall"
        )
