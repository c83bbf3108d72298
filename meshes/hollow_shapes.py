"""Closed surfaces of hollow bodies: a thick sphere, an eighth of one, a tube."""

from __future__ import annotations

import math

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError
from palpate.meshes.shapes import require_positive, shape_sphere
from palpate.meshes.tri_surface import TriSurface

Quad = tuple[int, int, int, int]


def shape_hollow_sphere(radius: float, inner_radius: float, *, edge_length: float) -> TriSurface:
    """A thick sphere about the origin: two spheres, the inner one turned inside out.

    Args:
        radius: Outer [m].
        inner_radius: [m], below `radius`.
        edge_length: Wanted mean edge length of both [m].

    Raises:
        InputError: A length that is not above 0, or no wall.
    """
    _require_wall(radius, inner_radius, edge_length)
    outer = shape_sphere(radius, edge_length=edge_length)
    inner = shape_sphere(inner_radius, edge_length=edge_length)
    facets = np.vstack([outer.facets, inner.facets[:, ::-1] + len(outer.points)])
    return TriSurface(np.vstack([outer.points, inner.points]), facets)


def shape_hollow_octant(radius: float, inner_radius: float, *, edge_length: float) -> TriSurface:
    """The eighth of a thick sphere with x, y, z >= 0, its flat faces on the planes x, y, z = 0.

    With these faces sliding it is the whole sphere under any load of that symmetry.

    Args:
        radius: Outer [m].
        inner_radius: [m], below `radius`.
        edge_length: Wanted edge length [m]: the mean on the outer sphere, and across the wall.

    Raises:
        InputError: A length that is not above 0, or no wall.
    """
    _require_wall(radius, inner_radius, edge_length)
    # n^2 triangles share pi R^2 / 2: equilateral ones of that density.
    n = max(1, round(radius * math.sqrt(2.0 * math.pi / math.sqrt(3.0)) / edge_length))
    layers = max(1, round((radius - inner_radius) / edge_length))
    index: dict[tuple[int, int, int], int] = {}
    points: list[Points] = []

    def point(i: int, j: int, layer: int) -> int:
        key = (i, j, layer)
        if key not in index:
            index[key] = len(points)
            direction = np.array([n - i - j, i, j]) / math.hypot(n - i - j, i, j)
            part = layer / layers
            points.append(((1.0 - part) * inner_radius + part * radius) * direction)
        return index[key]

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
    return TriSurface(np.array(points), np.array(facets))


def shape_tube(
    radius: float, inner_radius: float, height: float, *, edge_length: float
) -> TriSurface:
    """A tube about the z axis from z = 0 to `height`.

    Args:
        radius: Outer [m]; the points of the mantle lie on it.
        inner_radius: [m], below `radius`.
        height: [m].
        edge_length: Wanted edge length on the outer mantle, and across the wall [m].

    Raises:
        InputError: A length that is not above 0, or no wall.
    """
    _require_wall(radius, inner_radius, edge_length)
    require_positive(height=height)
    around = max(6, round(2.0 * math.pi * radius / edge_length))
    rows, layers = (max(1, round(x / edge_length)) for x in (height, radius - inner_radius))
    index: dict[tuple[int, int, int], int] = {}
    points: list[Points] = []

    def point(k: int, layer: int, row: int) -> int:
        key = (k % around, layer, row)
        if key not in index:
            index[key] = len(points)
            angle, part = 2.0 * math.pi * key[0] / around, layer / layers
            r = (1.0 - part) * inner_radius + part * radius
            place = (r * math.cos(angle), r * math.sin(angle), height * row / rows)
            points.append(np.array(place))
        return index[key]

    facets: list[tuple[int, int, int]] = []
    for k in range(around):
        for row in range(rows):
            for layer, (a, b) in ((layers, (k, k + 1)), (0, (k + 1, k))):
                quad = (
                    point(a, layer, row),
                    point(b, layer, row),
                    point(b, layer, row + 1),
                    point(a, layer, row + 1),
                )
                facets += _halves(quad, k + row)
        for layer in range(layers):
            for row, (a, b) in ((rows, (k, k + 1)), (0, (k + 1, k))):
                quad = (
                    point(a, layer + 1, row),
                    point(b, layer + 1, row),
                    point(b, layer, row),
                    point(a, layer, row),
                )
                facets += _halves(quad, k + layer)
    return TriSurface(np.array(points), np.array(facets))


def _halves(quad: Quad, number: int) -> list[tuple[int, int, int]]:
    """A quadrilateral in two, along one diagonal or the other in turn."""
    a, b, c, d = quad
    return [(a, b, c), (a, c, d)] if number % 2 else [(a, b, d), (b, c, d)]


def _require_wall(radius: float, inner_radius: float, edge_length: float) -> None:
    require_positive(radius=radius, inner_radius=inner_radius, edge_length=edge_length)
    if not inner_radius < radius:
        raise InputError(
            f"inner_radius = {inner_radius:g}: needs less than the radius, {radius:g}; there is "
            "no wall"
        )
