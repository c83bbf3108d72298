"""Surfaces for the tests of the mesher: rough, thin, coarse, twisted and holed, drawn at random.

A family makes a shape of a random generator; the few draws that are no valid surface are skipped.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.fastsim import _core
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import SurfaceError, TriSurface

Array = NDArray[np.float64]
Maker = Callable[[np.random.Generator], TriSurface]


def grid_surface(points: Array, turn: int = 0) -> TriSurface:
    """A torus of points in a grid (around, across, 3), closed both ways; `turn` joins it askew."""
    around, across = points.shape[:2]
    number = np.arange(around * across).reshape(around, across)
    ahead = np.vstack([number[1:], np.roll(number[:1], turn, axis=1)])
    a, b = number.ravel(), ahead.ravel()
    c, d = np.roll(ahead, -1, axis=1).ravel(), np.roll(number, -1, axis=1).ravel()
    facets = np.vstack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return outward(points.reshape(-1, 3), facets)


def outward(points: Array, facets: NDArray[np.integer]) -> TriSurface:
    surface = TriSurface(np.ascontiguousarray(points), np.ascontiguousarray(facets, dtype=np.int32))
    if surface.volume < 0.0:
        return TriSurface(surface.points, np.ascontiguousarray(surface.facets[:, ::-1]))
    return surface


def tube(path: Array, radius: float, across: int) -> TriSurface:
    """A closed tube about a closed path (n, 3), with a frame carried along it."""
    tangent = np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.cross(tangent[0], [0.3, -0.5, 0.8])
    rings = []
    angle = 2 * np.pi * np.arange(across) / across
    for at, along in zip(path, tangent, strict=True):
        normal = normal - along * (normal @ along)
        normal /= np.linalg.norm(normal)
        side = np.cross(along, normal)
        rings.append(
            at + radius * (np.cos(angle)[:, None] * normal + np.sin(angle)[:, None] * side)
        )
    # The frame comes back turned: join the ends with the shift that fits best.
    shifts = [np.linalg.norm(np.roll(rings[0], s, axis=0) - rings[-1]) for s in range(across)]
    return grid_surface(np.array(rings), int(np.argmin(shifts)))


def torus(rng: np.random.Generator) -> TriSurface:
    around, across = int(rng.integers(3, 13)), int(rng.integers(3, 8))
    t = 2 * np.pi * np.arange(around) / around
    path = np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    shape = tube(path, float(rng.uniform(0.1, 0.45)), across)
    return TriSurface(shape.points * rng.uniform([1, 1, 1], [6, 1, 3]), shape.facets)


def knot(rng: np.random.Generator) -> TriSurface:
    p, q = [(2, 3), (3, 2), (2, 5), (3, 4), (1, 4)][rng.integers(5)]
    t = 2 * np.pi * np.arange(int(rng.integers(24, 60))) / 60 * 1.0
    t = np.linspace(0, 2 * np.pi, len(t), endpoint=False)
    width = 2 + np.cos(q * t)
    path = np.stack([width * np.cos(p * t), width * np.sin(p * t), np.sin(q * t)], axis=1)
    return tube(path, float(rng.uniform(0.05, 0.3)), int(rng.integers(3, 6)))


def rough_ball(rng: np.random.Generator) -> TriSurface:
    ball = shape_sphere(1.0, edge_length=float(rng.choice([1.1, 0.6, 0.4, 0.3])))
    radius = 1.0 + float(rng.choice([0.2, 0.5, 0.8, 0.95])) * rng.uniform(-1, 1, len(ball.points))
    return TriSurface(ball.points * radius[:, None], ball.facets)


def flat_ball(rng: np.random.Generator) -> TriSurface:
    """Rough, and thin: the aspect of its triangles goes to 20."""
    ball = shape_sphere(1.0, edge_length=float(rng.choice([0.6, 0.4, 0.3])))
    radius = 1.0 + 0.3 * rng.uniform(-1, 1, len(ball.points))
    thin = np.array([1.0, rng.uniform(0.05, 1.0), rng.uniform(0.03, 0.1)])
    return TriSurface(ball.points * radius[:, None] * thin, ball.facets)


def spiked_ball(rng: np.random.Generator) -> TriSurface:
    """Some points pulled deep towards the other side, some far out."""
    ball = shape_sphere(1.0, edge_length=float(rng.choice([0.5, 0.3])))
    radius = np.ones(len(ball.points))
    radius[rng.choice(len(radius), 4)] = rng.uniform(0.02, 0.3, 4)
    radius[rng.choice(len(radius), 3)] = rng.uniform(2, 6, 3)
    points = ball.points * radius[:, None] + 0.0
    points[0] *= -0.5 if rng.random() < 0.5 else 1.0
    return TriSurface(points, ball.facets)


def extruded(rng: np.random.Generator) -> TriSurface:
    """A prism over a star or a comb, twisted: with three sides Schoenhardt's prism."""
    kind = rng.integers(3)
    if kind == 0:
        n = int(rng.integers(3, 5))
        angle = 2 * np.pi * np.arange(n) / n
        outline = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        twist, steps = float(rng.uniform(0.2, 1.0)), 1
    elif kind == 1:
        n = 2 * int(rng.integers(3, 9))
        angle = 2 * np.pi * np.arange(n) / n
        reach = np.where(np.arange(n) % 2, rng.uniform(0.2, 0.8), 1.0)
        outline = reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        twist, steps = float(rng.uniform(0.0, 0.6)), int(rng.integers(1, 4))
    else:
        teeth, gap = int(rng.integers(2, 8)), float(rng.uniform(0.02, 0.5))
        rows = []
        for k in range(teeth):
            rows += [(k, 0.3), (k, 2.0), (k + 1 - gap, 2.0), (k + 1 - gap, 0.3)]
        outline = np.array([(0.0, 0.0), *rows[1:-1], (teeth - gap, 0.0)])[::-1]
        twist, steps = float(rng.choice([0.0, 0.05])), int(rng.integers(1, 4))
    height = float(rng.choice([0.1, 1.0, 3.0]))
    n = len(outline)
    levels = []
    for k in range(steps + 1):
        s, c = np.sin(twist * k / steps), np.cos(twist * k / steps)
        levels.append(
            np.column_stack([outline @ [[c, s], [-s, c]], np.full(n, height * k / steps)])
        )
    facets = []
    for k in range(steps):
        for i in range(n):
            a, b = k * n + i, k * n + (i + 1) % n
            facets += [(a, b, a + n), (b, b + n, a + n)]
    cap = ear_clipped(outline)
    facets += [(a, c, b) for a, b, c in cap]
    facets += [(a + steps * n, b + steps * n, c + steps * n) for a, b, c in cap]
    points = np.vstack(levels)
    if rng.random() < 0.5:
        points = points @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return outward(points, np.array(facets))


def ear_clipped(outline: Array) -> list[tuple[int, int, int]]:
    """Triangles of a counter-clockwise polygon."""

    def area(a: int, b: int, c: int) -> float:
        p, q, r = outline[a], outline[b], outline[c]
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    left = list(range(len(outline)))
    if sum(area(0, i, i + 1) for i in range(1, len(outline) - 1)) < 0:
        left.reverse()
    was_clockwise = left[0] != 0
    triangles = []
    while len(left) > 3:
        for k in range(len(left)):
            a, b, c = left[k - 1], left[k], left[(k + 1) % len(left)]
            others = [d for d in left if d not in (a, b, c)]
            if area(a, b, c) > 0 and not any(
                area(a, b, d) >= 0 and area(b, c, d) >= 0 and area(c, a, d) >= 0 for d in others
            ):
                triangles.append((a, b, c))
                left.pop(k)
                break
        else:
            raise SurfaceError("no ear")
    triangles.append((left[0], left[1], left[2]))
    return [(a, c, b) if was_clockwise else (a, b, c) for a, b, c in triangles]


def polycube(rng: np.random.Generator) -> TriSurface:
    """Cubes of a grid joined at random: any genus, coplanar facets, edges of every angle."""
    size = int(rng.integers(2, 5))
    filled = rng.random((size, size, size)) < rng.choice([0.5, 0.7, 0.85])
    return cubes(filled, rng, float(rng.choice([0.0, 0.0, 0.1, 0.2])))


def holed_plate(rng: np.random.Generator) -> TriSurface:
    """Genus 0 to 5: a plate with holes, thin."""
    holes = int(rng.integers(0, 6))
    filled = np.ones((2 * holes + 1, 3, 1), dtype=bool)
    filled[1::2, 1, 0] = False
    shape = cubes(filled, rng, float(rng.choice([0.0, 0.15])))
    return TriSurface(shape.points * [1.0, 1.0, rng.choice([1.0, 0.1, 0.05])], shape.facets)


def cubes(filled: NDArray[np.bool_], rng: np.random.Generator, ragged: float) -> TriSurface:
    full = np.pad(filled, 1)
    quads = []
    for axis in range(3):
        step = np.eye(3, dtype=int)[axis]
        u, v = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
        for at in np.argwhere(full):
            for way in (0, 1):
                if full[tuple(at + (2 * way - 1) * step)]:
                    continue
                corner = at + way * step
                quad = [corner, corner + u, corner + u + v, corner + v]
                quads.append(quad if way else quad[::-1])
    positions, number = np.unique(np.array(quads).reshape(-1, 3), axis=0, return_inverse=True)
    facets = []
    for a, b, c, d in number.reshape(-1, 4):
        facets += [(a, b, c), (a, c, d)] if rng.random() < 0.5 else [(a, b, d), (b, c, d)]
    points = positions + ragged * rng.uniform(-1, 1, positions.shape)
    return outward(points, np.array(facets))


def flipped_ball(rng: np.random.Generator) -> TriSurface:
    """Edges of a ball flipped at random: long triangles, edges far from Delaunay's."""
    if rng.random() < 0.5:
        shape = shape_box((1.0, 0.7, 0.4), edge_length=float(rng.choice([0.35, 0.2])))
    else:
        shape = shape_sphere(1.0, edge_length=float(rng.choice([0.6, 0.4])))
    facets = [list(map(int, f)) for f in shape.facets]
    for _ in range(int(rng.choice([0.5, 1.0, 2.0]) * len(facets))):
        owner = {(f[k], f[(k + 1) % 3]): (i, k) for i, f in enumerate(facets) for k in range(3)}
        a, b = list(owner)[rng.integers(len(owner))]
        (i, k), (j, m) = owner[a, b], owner[b, a]
        c, d = facets[i][(k + 2) % 3], facets[j][(m + 2) % 3]
        if (c, d) in owner or (d, c) in owner:
            continue
        normals = []
        for x, y, z in ((a, d, c), (d, b, c), (a, b, c), (b, a, d)):
            p, q, r = shape.points[[x, y, z]]
            normals.append(np.cross(q - p, r - p))
        unit = [n / max(float(np.linalg.norm(n)), 1e-30) for n in normals]
        if (
            min(float(np.linalg.norm(n)) for n in normals) < 0.02
            or min(u @ w for u in unit for w in unit) < 0.5
        ):
            continue
        facets[i], facets[j] = [a, d, c], [d, b, c]
    return TriSurface(shape.points, np.array(facets, dtype=np.int32))


def nested(rng: np.random.Generator) -> TriSurface:
    """Shells within shells: a body, a cavity in it, a body in that; and one beside."""
    parts = []
    radius, way = 1.0, 1
    for _ in range(int(rng.integers(2, 5))):
        ball = shape_sphere(1.0, edge_length=float(rng.choice([1.1, 0.6, 0.4])))
        parts.append((ball.points * radius, ball.facets[:, ::way]))
        radius *= float(rng.uniform(0.4, 0.75))
        way = -way
    ball = shape_sphere(0.5, edge_length=0.4)
    parts.append((ball.points + np.array([rng.choice([1.53, 2.0]), 0.0, 0.0]), ball.facets))
    starts = np.cumsum([0, *(len(p) for p, _ in parts)])
    return TriSurface(
        np.vstack([p for p, _ in parts]) @ np.linalg.qr(rng.normal(size=(3, 3)))[0],
        np.vstack([f + s for (_, f), s in zip(parts, starts, strict=False)]).astype(np.int32),
    )


def notched_box(rng: np.random.Generator) -> TriSurface:
    """Chazelle's polyhedron: wedges cut from top and bottom almost meet on a saddle."""
    n, gap = int(rng.integers(2, 6)), float(rng.choice([0.3, 0.1, 0.02]))
    grid = 4 * n + 1
    x = np.linspace(-1.0, 1.0, grid)
    tops, bottoms = [], []
    for i in range(grid):
        for j in range(grid):
            saddle = 1.5 * x[i] * x[j]
            # Blades along x cut from above, blades along y from below, in alternate lines.
            tops.append((x[i], x[j], saddle + gap if j % 4 == 2 else 3.0))
            bottoms.append((x[i], x[j], saddle if i % 4 == 2 else -3.0))
    number = np.arange(grid * grid).reshape(grid, grid)
    a, b = number[:-1, :-1].ravel(), number[1:, :-1].ravel()
    c, d = number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    top = np.vstack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    rim = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
    turn, below = np.roll(rim, -1), grid * grid
    sides = np.vstack(
        [
            np.stack([rim + below, turn + below, turn], axis=1),
            np.stack([rim + below, turn, rim], axis=1),
        ]
    )
    facets = np.vstack([top, top[:, ::-1] + below, sides])
    return outward(np.array(tops + bottoms), facets)


FAMILIES: dict[str, Maker] = {
    f.__name__: f
    for f in (
        torus, knot, rough_ball, flat_ball, spiked_ball, extruded, polycube, holed_plate,
        flipped_ball, nested, notched_box,
    )
}  # fmt: skip


def draw(family: str, seed: int) -> TriSurface | None:
    """Shape number `seed` of a family; None where that is no valid surface."""
    rng = np.random.default_rng([seed, len(family)])
    try:
        surface = FAMILIES[family](rng)
        require_closed(surface)
    except SurfaceError:
        return None
    if len(_core.find_self_intersections(surface.points, surface.facets, 1)):
        return None
    return surface


@pytest.fixture(name="outward")
def outward_fixture() -> Callable[[Array, NDArray[np.integer]], TriSurface]:
    return outward


@pytest.fixture(name="draw")
def draw_fixture() -> Callable[[str, int], TriSurface | None]:
    return draw


@pytest.fixture(params=FAMILIES)
def family(request: pytest.FixtureRequest) -> str:
    """The name of each family in turn; a test may name its own."""
    return str(request.param)
