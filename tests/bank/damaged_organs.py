"""Fourteen kinds of damage that surfaces of organs come with, done to any sound surface by a seed.

Unlike `perturbed_surfaces`, each goes with every surface, so that real ones can be damaged too.
Lengths are in mean edges of the surface.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from perturbed_surfaces import (
    Perturbed,
    Rng,
    crumpled,
    doubled,
    finned,
    hanging,
    holed,
    joined,
    many_holes,
    mean_edge,
    pushed,
    torn,
    turned,
    with_crumbs,
)

from palpate.meshes.tri_surface import TriSurface

# Bodies of this many edges in a direction overlap by a part of them.
_SHALLOW, _DEEP = 0.3, 3.0


def overlapping(body: TriSurface, depth: float, rng: Rng) -> Perturbed:
    """The body and a copy of it beside it, which run into each other by so many edges."""
    way = rng.standard_normal(3)
    way /= np.linalg.norm(way)
    edge = mean_edge(body)
    # Where they first touch: along the way, of all lines beside one another.
    across = np.linalg.svd(way[None])[2][1:]
    cells = np.round(body.points @ across.T / edge).astype(np.int64)
    _, cell = np.unique(cells, axis=0, return_inverse=True)
    height = body.points @ way
    high, low = np.full((2, cell.max() + 1), -np.inf)
    np.maximum.at(high, cell.reshape(-1), height)
    np.maximum.at(low, cell.reshape(-1), -height)
    apart = float((high + low).max()) - depth * edge
    both = joined(body, TriSurface(body.points + apart * way, body.facets))
    return Perturbed(both, both, depth * edge)


def second_sheet(body: TriSurface, rng: Rng) -> Perturbed:
    """A patch that is there twice, the copy a hundredth of an edge beside it and open."""
    edge = mean_edge(body)
    middles = body.points[body.facets].mean(axis=1)
    near = np.linalg.norm(middles - middles[rng.integers(len(middles))], axis=1) < 4.0 * edge
    away = 0.01 * edge * rng.standard_normal(3)
    both = joined(body, TriSurface(body.points + away, body.facets[near]))
    return Perturbed(both, body, 0.03 * edge)


def self_crossing(body: TriSurface, rng: Rng) -> Perturbed:
    """A thin wall pushed through: points near one move across to the other side of the body."""
    edge = mean_edge(body)
    middles = body.points[body.facets].mean(axis=1)
    normals = np.cross(
        body.points[body.facets[:, 1]] - body.points[body.facets[:, 0]],
        body.points[body.facets[:, 2]] - body.points[body.facets[:, 0]],
    )
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # The thinnest place among some: how far it is straight down to the other side.
    best = (np.inf, 0)
    for row in rng.choice(len(middles), min(40, len(middles)), replace=False):
        offset = middles - middles[row]
        down = -offset @ normals[row]
        beside = np.linalg.norm(offset + down[:, None] * normals[row], axis=1)
        under = (beside < edge) & (down > 2.0 * edge) & (normals @ normals[row] < -0.5)
        if under.any():
            best = min(best, (float(down[under].min()), int(row)))
    thick, row = best
    shift = np.zeros_like(body.points)
    near = np.linalg.norm(body.points - middles[row], axis=1) < 1.2 * edge
    depth = (thick if np.isfinite(thick) else 0.0) + 0.3 * edge
    shift[near] = -depth * normals[row]
    return Perturbed(TriSurface(body.points + shift, body.facets), body, depth)


DEFECTS: dict[str, Callable[[TriSurface, Rng], Perturbed]] = {
    "holes of 3 to 12 edges": lambda body, rng: many_holes(body, 5, rng),
    "hole of 30 edges": lambda body, rng: holed(body, 30, rng, lobes=0),
    "flipped facets": lambda body, rng: turned(body, 0.2, rng),
    "facets given twice": lambda body, rng: doubled(body, 0.1, rng),
    "sheet a hundredth of an edge beside": second_sheet,
    "bodies overlapping by 0.3 edges": lambda body, rng: overlapping(body, _SHALLOW, rng),
    "bodies overlapping by 3 edges": lambda body, rng: overlapping(body, _DEEP, rng),
    "wall pushed through another": self_crossing,
    "crumpled patch": lambda body, rng: crumpled(body, 0.4, rng),
    "patch pushed over its neighbours": lambda body, rng: pushed(body, 1.5, rng, inwards=False),
    "fins": lambda body, rng: finned(body, 4, rng),
    "tiny loose parts": lambda body, rng: with_crumbs(body, 10, rng, is_dropped=True),
    "T-junctions": lambda body, rng: hanging(body, 10, rng),
    "facets torn apart": lambda body, rng: torn(body, 1e-5, rng),
}
