"""What is spoiled, and how badly: the numbers were written down before any result was seen.

Each kind of defect is made at three severities on a built-in shape, from a seed that is its place
in the list. Lengths are parts of the shape's mean edge where nothing else is said.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.meshes.hollow_shapes import shape_hollow_sphere, shape_tube
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.shapes import shape_box, shape_cylinder, shape_sphere
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.studies.organs import spoiling
from palpate.validation.studies.organs.spoiling import Spoiled

# Of every repair: how far the surface may move, of its mean edge.
DISTANCE = 3.0
# What nothing may take: processor time per 100 000 triangles, and what a small surface may [s].
CPU_PER_100K, CPU_LEAST = 60.0, 2.0
# Of the whole: so many versions at least, of which so many are meshed at least.
FEWEST, FEWEST_MESHED = 60, 55


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
    make: Callable[[float, np.random.Generator], Spoiled]


KINDS = (
    Kind("crumpled", "edges of random displacement within 3 edges of a point", (0.3, 0.5, 0.7),
         lambda s, rng: spoiling.crumpled(kidney(), s, rng)),
    Kind("slid", "edges that a patch of 3 edges is pushed along the surface", (1.5, 2.0, 3.0),
         lambda s, rng: spoiling.pushed(kidney(), s, rng, inwards=False)),
    Kind("pressed", "edges that a patch of 2 edges is pressed in", (1.5, 2.0, 3.0),
         lambda s, rng: spoiling.pushed(ball(), s, rng, inwards=True)),
    Kind("crossing walls", "plate thicknesses that a dent runs beyond the other face",
         (0.05, 0.15, 0.3), lambda s, _: spoiling.crossing_walls(plate(), s)),
    Kind("crossing bodies", "radii that two balls run into each other", (0.01, 0.03, 0.06),
         lambda s, _: spoiling.crossing_bodies(ball(), s)),
    Kind("noise", "edges of normal noise at every point", (0.1, 0.2, 0.3),
         lambda s, rng: spoiling.noisy(kidney(), s, rng)),
    Kind("round hole", "edges of the hole", (16, 42, 90),
         lambda s, rng: spoiling.holed(shape_kidney(edge_length=4.5e-3), s, rng, lobes=0)),
    Kind("concave hole", "edges of the hole, of three lobes", (16, 42, 90),
         lambda s, rng: spoiling.holed(shape_kidney(edge_length=4.5e-3), s, rng, lobes=3)),
    Kind("annular hole", "edges of each of two loops of an open pipe's end", (16, 32, 48),
         lambda s, _: spoiling.open_pipe(int(s), ends=1)),
    Kind("open pipe", "edges of each of four loops of a pipe open at both ends", (16, 32, 48),
         lambda s, _: spoiling.open_pipe(int(s), ends=2)),
    Kind("many holes", "holes of 3 to 12 edges", (3, 10, 30),
         lambda s, rng: spoiling.many_holes(kidney(), int(s), rng)),
    Kind("touching along edges", "edges that two boxes share", (1, 4, 16),
         lambda s, _: spoiling.touching_boxes(int(s))),
    Kind("touching at points", "points at which balls in a row touch", (1, 2, 4),
         lambda s, _: spoiling.touching_balls(int(s))),
    Kind("fins", "facets of each of three fins", (1, 6, 24),
         lambda s, rng: spoiling.finned(kidney(), int(s), rng)),
    Kind("doubled facets", "part of the facets given twice, half of them turned", (0.01, 0.1, 0.5),
         lambda s, rng: spoiling.doubled(kidney(), s, rng)),
    Kind("inner walls", "walls of equal facets both ways between bodies that touch", (1, 2, 4),
         lambda s, _: spoiling.walled(int(s))),
    Kind("loose shells", "shells of a fiftieth of the size beside the organ, dropped", (1, 10, 50),
         lambda s, rng: spoiling.with_crumbs(kidney(), int(s), rng, is_dropped=True)),
    Kind("kept shells", "shells of a fiftieth of the size beside the organ, kept", (1, 10, 50),
         lambda s, rng: spoiling.with_crumbs(kidney(), int(s), rng, is_dropped=False)),
    Kind("turned facets", "part of the facets turned; 1 is inside out", (0.01, 0.3, 1.0),
         lambda s, rng: spoiling.turned(shell(), s, rng)),
    Kind("thin pipe", "wall over radius", (0.1, 0.03, 0.01),
         lambda s, _: Spoiled(shape_tube(0.02, 0.02 * (1.0 - s), 0.06, edge_length=4e-3))),
    Kind("thin vessel", "length over diameter, six facets around", (10, 30, 100),
         lambda s, _: Spoiled(shape_cylinder(1e-3, 2e-3 * s, edge_length=1e-3))),
    Kind("coplanar plate", "sides of a polygon, its faces cut from one corner", (32, 128, 512),
         lambda s, _: spoiling.polygon_plate(int(s))),
    Kind("torn seams", "edges of jitter at every corner of unconnected facets",
         (1e-7, 1e-5, 1e-4), lambda s, rng: spoiling.torn(kidney(), s, rng)),
    Kind("hanging points", "edges of a box cut on one side only", (1, 10, 50),
         lambda s, rng: spoiling.hanging(box(), int(s), rng)),
    Kind("all at once", "of each: holes, fins, doubled facets, crumbs, crumples", (1, 2, 4),
         lambda s, rng: spoiling.all_at_once(kidney(), int(s), rng)),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Version:
    """One spoiled surface by its name."""

    name: str
    kind: str
    severity: float
    spoiled: Spoiled


def versions(kinds: tuple[str, ...] | None = None) -> Iterator[Version]:
    """Spoiled versions in the order of the list; of some kinds only, if these are named."""
    for number, kind in enumerate(KINDS):
        for step, severity in enumerate(kind.severities):
            if kinds is None or kind.name in kinds:
                rng = np.random.default_rng([number, step])
                name = f"{kind.name} {severity:g}"
                yield Version(name, kind.name, severity, kind.make(severity, rng))
