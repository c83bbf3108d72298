"""Surfaces as scans, segmentations and CAD leave them: 25 ways to damage one, written down first.

Each kind of defect is made at three severities on a built-in shape, from a seed that is its number
in the list. Lengths are fractions of the shape's mean edge where nothing else is said.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.shapes import (
    shape_box,
    shape_cylinder,
    shape_hollow_sphere,
    shape_sphere,
    shape_tube,
)
from palpate.meshes.tri_surface import TriSurface

Rng = np.random.Generator


@dataclass(frozen=True, eq=False)
class Perturbed:
    """A perturbed surface.

    Attributes:
        surface: As it is given to the repair [m].
        sound: The surface before, where there is one; None where the surface is sound as it is,
            or where no other is meant.
        size: Of the defect [m]: how far points were moved, or half the width of a hole.
        smallest_shell: Loose parts that the user has dropped are shorter [m].
    """

    surface: TriSurface
    sound: TriSurface | None = None
    size: float = 0.0
    smallest_shell: float = 0.0


def mean_edge(surface: TriSurface) -> float:
    """[m]."""
    corners = surface.points[surface.facets]
    return float(np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).mean())


def joined(*parts: TriSurface) -> TriSurface:
    """Surfaces beside each other, each with points of its own."""
    starts = np.cumsum([0, *(len(p.points) for p in parts)])
    return TriSurface(
        np.vstack([p.points for p in parts]),
        np.vstack([p.facets + start for p, start in zip(parts, starts[:-1], strict=True)]),
    )


def _moved(body: TriSurface, shift: Points) -> Perturbed:
    size = float(np.linalg.norm(shift, axis=1).max())
    return Perturbed(TriSurface(body.points + shift, body.facets), body, size)


def _near(body: TriSurface, radius: float, rng: Rng) -> tuple[Points, np.ndarray]:  # type: ignore[type-arg]
    centre = body.points[rng.integers(len(body.points))]
    return centre, np.linalg.norm(body.points - centre, axis=1) < radius


def crumpled(body: TriSurface, severity: float, rng: Rng) -> Perturbed:
    """Normal noise around one point."""
    edge = mean_edge(body)
    _, near = _near(body, 3.0 * edge, rng)
    shift = np.zeros_like(body.points)
    shift[near] = severity * edge * rng.standard_normal((int(near.sum()), 3))
    return _moved(body, shift)


def pushed(body: TriSurface, severity: float, rng: Rng, *, inwards: bool) -> Perturbed:
    """A patch pushed along the surface, or pressed into it."""
    edge = mean_edge(body)
    centre, near = _near(body, (2.0 if inwards else 3.0) * edge, rng)
    way = centre - body.points.mean(axis=0)
    if not inwards:
        way = np.cross(way, rng.standard_normal(3))
    way = way / np.linalg.norm(way)
    shift = np.zeros_like(body.points)
    shift[near] = (-severity if inwards else severity) * edge * way
    return _moved(body, shift)


def crossing_walls(body: TriSurface, severity: float) -> Perturbed:
    """A dent in the upper face of a plate that runs through the lower one."""
    top = body.points.max(axis=0)
    middle = np.array([0.5 * top[0], 0.5 * top[1], top[2]])
    deep = np.linalg.norm(body.points - middle, axis=1) < 0.08 * top[0]
    shift = np.zeros_like(body.points)
    shift[deep, 2] = -(1.0 + severity) * top[2]
    return _moved(body, shift)


def crossing_bodies(body: TriSurface, severity: float) -> Perturbed:
    """Two balls beside each other that overlap; what is meant is not known."""
    low, high = body.points.min(axis=0), body.points.max(axis=0)
    radius = 0.5 * (high[0] - low[0])
    apart = np.array([(2.0 - severity) * radius, 0.0, 0.0])
    both = joined(body, TriSurface(body.points + apart, body.facets))
    return Perturbed(both, both, severity * radius)


def noisy(body: TriSurface, severity: float, rng: Rng) -> Perturbed:
    """Normal noise at every point."""
    return _moved(body, severity * mean_edge(body) * rng.standard_normal(body.points.shape))


def _rim_length(facets: np.ndarray) -> int:  # type: ignore[type-arg]
    sides = np.sort(facets[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return int(np.count_nonzero(np.unique(sides, axis=0, return_counts=True)[1] == 1))


def holed(body: TriSurface, edges: float, rng: Rng, *, lobes: int) -> Perturbed:
    """Facets cut away around a point until the rim has so many edges; in lobes, if asked for."""
    centre = body.points[rng.integers(len(body.points))]
    middles = body.points[body.facets].mean(axis=1)
    away = centre - body.points.mean(axis=0)
    away = away / np.linalg.norm(away)
    u = np.cross(away, [1.0, 0.0, 0.0] if abs(away[0]) < 0.9 else [0.0, 1.0, 0.0])
    u /= np.linalg.norm(u)
    v = np.cross(away, u)
    offset = middles - centre
    angle = np.arctan2(offset @ v, offset @ u)
    distance = np.linalg.norm(offset, axis=1) / (
        1.0 + (0.6 * np.cos(lobes * angle) if lobes else 0.0)
    )
    order = np.argsort(distance, kind="stable")
    count = next(n for n in range(4, len(order)) if _rim_length(body.facets[order[:n]]) >= edges)
    half = float(np.linalg.norm(offset[order[:count]], axis=1).max())
    return Perturbed(
        TriSurface(body.points, np.delete(body.facets, order[:count], axis=0)), body, half
    )


def pipe(around: int) -> TriSurface:
    """A pipe with a thick wall, its points in rings: two around its ends, both ends closed."""
    radius, inner, height, rows = 0.02, 0.014, 0.06, max(4, around // 3)
    turn = 2.0 * np.pi * np.arange(around) / around
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    points = [
        np.column_stack([r * ring, np.full(around, height * row / rows)])
        for r in (radius, inner)
        for row in range(rows + 1)
    ]

    def quads(below: int, above: int) -> list[list[int]]:
        k, after = np.arange(around), (np.arange(around) + 1) % around
        a, b, c, d = (
            below * around + k, below * around + after, above * around + after, above * around + k
        )  # fmt: skip
        return [*np.column_stack([a, b, c]).tolist(), *np.column_stack([a, c, d]).tolist()]

    facets = []
    for row in range(rows):
        facets += quads(row, row + 1)
        facets += quads(rows + 1 + row + 1, rows + 1 + row)
    # The ends come last: 2 x around facets each.
    facets += quads(rows, 2 * rows + 1)
    facets += quads(rows + 1, 0)
    return TriSurface(np.vstack(points), np.array(facets))


def open_pipe(around: int, *, ends: int) -> Perturbed:
    """A pipe whose ends have no wall between the outer and the inner mantle."""
    whole = pipe(around)
    facets = whole.facets[: len(whole.facets) - 2 * around * ends]
    return Perturbed(TriSurface(whole.points, facets), whole, 3e-3)


def many_holes(body: TriSurface, count: int, rng: Rng) -> Perturbed:
    """All facets around single points or edges cut away."""
    gone = np.zeros(body.num_facets, dtype=bool)
    touched = np.zeros(len(body.points), dtype=bool)
    made = 0
    for start in rng.permutation(body.num_facets):
        corners = body.facets[start][: rng.integers(1, 4)]
        around = np.isin(body.facets, corners).any(axis=1)
        if touched[body.facets[around]].any():
            continue
        rows = around if rng.random() < 0.5 else np.arange(body.num_facets) == start
        gone |= rows
        touched[body.facets[around]] = True
        made += 1
        if made == count:
            break
    return Perturbed(TriSurface(body.points, body.facets[~gone]), body, 2.0 * mean_edge(body))


def _merged(*parts: TriSurface) -> TriSurface:
    """Points of one place, to a billionth of the box, are one point; of the facets none is lost."""
    both = joined(*parts)
    grid = np.round(both.points / (1e-9 * np.ptp(both.points, axis=0).max()))
    _, first, inverse = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    return TriSurface(both.points[first], inverse.reshape(-1)[both.facets])


def touching_boxes(edges: int) -> Perturbed:
    """Two boxes that share the edges along one side, and nothing else."""
    edge = 4e-3
    one = shape_box((8 * edge, edges * edge, 8 * edge), edge_length=edge)
    other = TriSurface(one.points + np.array([8 * edge, 0.0, 8 * edge]), one.facets)
    return Perturbed(_merged(one, other), joined(one, other), 0.0)


def touching_balls(points: int) -> Perturbed:
    """Balls in a row, each sharing a point with the next."""
    one = shape_sphere(0.02, edge_length=5e-3)
    apart = 2.0 * one.points[0]
    row = [TriSurface(one.points + k * apart, one.facets) for k in range(points + 1)]
    return Perturbed(_merged(*row), joined(*row), 0.0)


def finned(body: TriSurface, facets: int, rng: Rng) -> Perturbed:
    """Strips of facets that stand on three edges of the surface, with free rims."""
    points, rows = list(body.points), body.facets.tolist()
    edge = mean_edge(body)
    for start in rng.choice(body.num_facets, 3, replace=False):
        a, b = (int(v) for v in body.facets[start][:2])
        normal = body.points[a] - body.points.mean(axis=0)
        normal = normal / np.linalg.norm(normal)
        for _ in range(facets):
            points.append(0.5 * (points[a] + points[b]) + 0.8 * edge * normal)
            rows.append([a, b, len(points) - 1])
            a, b = b, len(points) - 1
    return Perturbed(TriSurface(np.array(points), np.array(rows)), body, 0.0)


def doubled(body: TriSurface, part: float, rng: Rng) -> Perturbed:
    """Facets given twice."""
    again = rng.choice(body.num_facets, max(1, round(part * body.num_facets)), replace=False)
    copies = body.facets[again].copy()
    copies[::2] = copies[::2, ::-1]
    rows = rng.permutation(np.vstack([body.facets, copies]))
    return Perturbed(TriSurface(body.points, rows), body, 0.0)


def walled(walls: int) -> Perturbed:
    """Boxes in a row whose common faces were left in, facing both ways."""
    edge = 4e-3
    one = shape_box((6 * edge, 6 * edge, 6 * edge), edge_length=edge)
    row = [
        TriSurface(one.points + np.array([6 * edge * k, 0.0, 0.0]), one.facets)
        for k in range(walls + 1)
    ]
    whole = shape_box(((walls + 1) * 6 * edge, 6 * edge, 6 * edge), edge_length=edge)
    return Perturbed(_merged(*row), whole, 0.0)


def with_crumbs(body: TriSurface, count: int, rng: Rng, *, is_dropped: bool) -> Perturbed:
    """Small balls beside the organ, apart from each other."""
    long = float(np.ptp(body.points, axis=0).max())
    radius = long / 100.0
    crumb = shape_sphere(radius, edge_length=radius)
    high = body.points.max(axis=0)
    positions = rng.permutation(100)[:count]
    shifts = [
        high + radius * np.array([4.0 + 3.0 * (n // 10), 3.0 * (n % 10), 0.0])
        for n in positions.tolist()
    ]
    parts = [TriSurface(crumb.points + shift, crumb.facets) for shift in shifts]
    perturbed = joined(body, *parts)
    if is_dropped:
        return Perturbed(perturbed, body, 0.0, 3.0 * radius)
    return Perturbed(perturbed, perturbed, 0.0)


def turned(body: TriSurface, part: float, rng: Rng) -> Perturbed:
    """Facets that face the wrong way."""
    chosen = rng.choice(body.num_facets, max(1, round(part * body.num_facets)), replace=False)
    facets = body.facets.copy()
    facets[chosen] = facets[chosen][:, ::-1]
    return Perturbed(TriSurface(body.points, facets), body, 0.0)


def polygon_plate(sides: int) -> Perturbed:
    """A plate whose two faces are cut into triangles from one corner, as CAD programs do."""
    turn = 2.0 * np.pi * np.arange(sides) / sides
    ring = 0.05 * np.column_stack([np.cos(turn), np.sin(turn)])
    points = np.vstack([np.column_stack([ring, np.full(sides, z)]) for z in (0.0, 5e-3)])
    k = np.arange(1, sides - 1)
    a, b = np.arange(sides), (np.arange(sides) + 1) % sides
    facets = [
        np.column_stack([np.full(len(k), sides), sides + k, sides + k + 1]),
        np.column_stack([np.zeros(len(k), dtype=int), k + 1, k]),
        np.column_stack([a, b, sides + b]),
        np.column_stack([a, sides + b, sides + a]),
    ]
    return Perturbed(TriSurface(points, np.vstack(facets)))


def torn(body: TriSurface, severity: float, rng: Rng) -> Perturbed:
    """Facets with corners of their own, as STL has them, and none quite in its place."""
    size = severity * mean_edge(body)
    corners = body.points[body.facets].reshape(-1, 3)
    corners = corners + size * rng.uniform(-1.0, 1.0, corners.shape)
    facets = np.arange(len(corners)).reshape(-1, 3)
    return Perturbed(TriSurface(corners, facets), body, np.sqrt(3.0) * size)


def hanging(body: TriSurface, count: int, rng: Rng) -> Perturbed:
    """Edges cut in the middle for one of their two facets, as bodies made of patches have them."""
    points, facets = list(body.points), body.facets.tolist()
    for start in sorted(rng.choice(body.num_facets, count, replace=False).tolist(), reverse=True):
        a, b, c = facets.pop(start)
        points.append(0.5 * (points[a] + points[b]))
        facets += [[a, len(points) - 1, c], [len(points) - 1, b, c]]
    return Perturbed(TriSurface(np.array(points), np.array(facets)), body, 0.0)


def all_at_once(body: TriSurface, count: int, rng: Rng) -> Perturbed:
    """So many crumples, holes and crumbs each, fins and doubled facets."""
    made, size = body, 0.0
    for _ in range(count):
        one = crumpled(made, 0.5, rng)
        made, size = one.surface, max(size, one.size)
    holes = many_holes(made, count, rng)
    size += holes.size
    made = finned(holes.surface, count, rng).surface
    made = doubled(made, 0.02 * count, rng).surface
    last = with_crumbs(made, count, rng, is_dropped=True)
    return Perturbed(last.surface, body, size, last.smallest_shell)


# Of every repair: how far the surface may move, of its mean edge.
DISTANCE = 3.0
# What nothing may take: processor time per 100 000 triangles, and what a small surface may [s].
CPU_PER_100K, CPU_LEAST = 60.0, 2.0
# Of the 75 so many are meshed at least; the others are refused for a stated reason.
FEWEST_MESHED = 55


def kidney() -> TriSurface:
    """Some 1500 facets."""
    return shape_kidney(edge_length=6.5e-3)


def ball() -> TriSurface:
    """Some 1600 facets."""
    return shape_sphere(0.05, edge_length=6.5e-3)


def plate() -> TriSurface:
    """Two facets thick."""
    return shape_box((0.1, 0.1, 0.01), edge_length=5e-3)


def box() -> TriSurface:
    """With sharp edges."""
    return shape_box((0.06, 0.06, 0.06), edge_length=6e-3)


def shell() -> TriSurface:
    """A ball with a cavity."""
    return shape_hollow_sphere(0.05, 0.03, edge_length=7e-3)


class Kind(NamedTuple):
    """A defect: how it is made from a shape, a severity and a random generator."""

    name: str
    unit: str
    severities: tuple[float, float, float]
    make: Callable[[float, np.random.Generator], Perturbed]


KINDS = (
    Kind("crumpled", "edges of random displacement within 3 edges of a point", (0.3, 0.5, 0.7),
         lambda s, rng: crumpled(kidney(), s, rng)),
    Kind("slid", "edges that a patch of 3 edges is pushed along the surface", (1.5, 2.0, 3.0),
         lambda s, rng: pushed(kidney(), s, rng, inwards=False)),
    Kind("pressed", "edges that a patch of 2 edges is pressed in", (1.5, 2.0, 3.0),
         lambda s, rng: pushed(ball(), s, rng, inwards=True)),
    Kind("crossing walls", "plate thicknesses that a dent runs beyond the other face",
         (0.05, 0.15, 0.3), lambda s, _: crossing_walls(plate(), s)),
    Kind("crossing bodies", "radii that two balls run into each other", (0.01, 0.03, 0.06),
         lambda s, _: crossing_bodies(ball(), s)),
    Kind("noise", "edges of normal noise at every point", (0.1, 0.2, 0.3),
         lambda s, rng: noisy(kidney(), s, rng)),
    Kind("round hole", "edges of the hole", (16, 42, 90),
         lambda s, rng: holed(shape_kidney(edge_length=4.5e-3), s, rng, lobes=0)),
    Kind("concave hole", "edges of the hole, of three lobes", (16, 42, 90),
         lambda s, rng: holed(shape_kidney(edge_length=4.5e-3), s, rng, lobes=3)),
    Kind("annular hole", "edges of each of two loops of an open pipe's end", (16, 32, 48),
         lambda s, _: open_pipe(int(s), ends=1)),
    Kind("open pipe", "edges of each of four loops of a pipe open at both ends", (16, 32, 48),
         lambda s, _: open_pipe(int(s), ends=2)),
    Kind("many holes", "holes of 3 to 12 edges", (3, 10, 30),
         lambda s, rng: many_holes(kidney(), int(s), rng)),
    Kind("touching along edges", "edges that two boxes share", (1, 4, 16),
         lambda s, _: touching_boxes(int(s))),
    Kind("touching at points", "points at which balls in a row touch", (1, 2, 4),
         lambda s, _: touching_balls(int(s))),
    Kind("fins", "facets of each of three fins", (1, 6, 24),
         lambda s, rng: finned(kidney(), int(s), rng)),
    Kind("doubled facets", "part of the facets given twice, half of them turned", (0.01, 0.1, 0.5),
         lambda s, rng: doubled(kidney(), s, rng)),
    Kind("inner walls", "walls of equal facets both ways between bodies that touch", (1, 2, 4),
         lambda s, _: walled(int(s))),
    Kind("loose shells", "shells of a fiftieth of the size beside the organ, dropped", (1, 10, 50),
         lambda s, rng: with_crumbs(kidney(), int(s), rng, is_dropped=True)),
    Kind("kept shells", "shells of a fiftieth of the size beside the organ, kept", (1, 10, 50),
         lambda s, rng: with_crumbs(kidney(), int(s), rng, is_dropped=False)),
    Kind("turned facets", "part of the facets turned; 1 is inside out", (0.01, 0.3, 1.0),
         lambda s, rng: turned(shell(), s, rng)),
    Kind("thin pipe", "wall over radius", (0.1, 0.03, 0.01),
         lambda s, _: Perturbed(shape_tube(0.02, 0.02 * (1.0 - s), 0.06, edge_length=4e-3))),
    Kind("thin vessel", "length over diameter, six facets around", (10, 30, 100),
         lambda s, _: Perturbed(shape_cylinder(1e-3, 2e-3 * s, edge_length=1e-3))),
    Kind("coplanar plate", "sides of a polygon, its faces cut from one corner", (32, 128, 512),
         lambda s, _: polygon_plate(int(s))),
    Kind("torn seams", "edges of jitter at every corner of unconnected facets",
         (1e-7, 1e-5, 1e-4), lambda s, rng: torn(kidney(), s, rng)),
    Kind("hanging points", "edges of a box cut on one side only", (1, 10, 50),
         lambda s, rng: hanging(box(), int(s), rng)),
    Kind("all at once", "of each: holes, fins, doubled facets, crumbs, crumples", (1, 2, 4),
         lambda s, rng: all_at_once(kidney(), int(s), rng)),
)  # fmt: skip
