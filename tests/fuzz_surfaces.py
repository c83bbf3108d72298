"""Mutated surfaces thrown at repair and mesher: a mesh or a typed refusal, never anything else.

    python tests/fuzz_surfaces.py --seconds 60 [--seed N] [--once]

Not collected by pytest; `tests/fastsim/test_fuzz.py` runs it for some seconds, `make fuzz` for a
minute under the address and undefined-behaviour sanitizers. A surface that
takes more of the processor than the limit ends the process, with the seed to repeat it.
"""

from __future__ import annotations

import argparse
import faulthandler
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable

import numpy as np

from palpate.fastsim.exact_repair.patch_repairs import all_crossings
from palpate.fastsim.exact_repair.solid_repair import repair_to_solid
from palpate.fastsim.exact_repair.wrap import wrap_surface
from palpate.fastsim.mesher import BoundaryRecoveryError, mesh_surface
from palpate.fastsim.surface_remesher import remesh_surface
from palpate.meshes.errors import InputError
from palpate.meshes.repair.choices import RepairChoices
from palpate.meshes.repair.surface_repair import repair_surface
from palpate.meshes.shapes import shape_box, shape_cylinder, shape_sphere
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface

Rng = np.random.Generator
Arrays = tuple[np.ndarray, np.ndarray]  # type: ignore[type-arg]

# [s] of the processor, for on a busy machine the clock says nothing of the surface: a single one of
# at most some hundred facets; the slowest seen took a second.
LIMIT = 60.0


def torus(rng: Rng) -> Arrays:
    """A ring with few, elongated facets."""
    n, m = rng.integers(3, 12), rng.integers(3, 8)
    u, v = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    a, b = 2 * np.pi * u.ravel() / n, 2 * np.pi * v.ravel() / m
    r = rng.uniform(0.1, 0.9)
    points = np.column_stack(
        [(1 + r * np.cos(b)) * np.cos(a), (1 + r * np.cos(b)) * np.sin(a), r * np.sin(b)]
    )

    def at(i: np.ndarray, j: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
        return (i % n * m + j % m).ravel()

    p, q, s, t = at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)
    return points, np.vstack([np.column_stack([p, q, s]), np.column_stack([p, s, t])])


def base(rng: Rng) -> Arrays:
    """A sound surface to perturb."""
    kind = rng.integers(4)
    if kind == 0:
        return torus(rng)
    if kind == 1:
        body = shape_sphere(1.0, edge_length=rng.uniform(0.4, 1.5))
    elif kind == 2:
        body = shape_cylinder(0.5, 2.0, edge_length=rng.uniform(0.3, 0.8))
    else:
        body = shape_box(tuple(rng.uniform(0.05, 2.0, 3)), edge_length=rng.uniform(0.4, 1.0))
    return body.points.copy(), body.facets.copy()


def noise(rng: Rng, points: np.ndarray, facets: np.ndarray) -> Arrays:  # type: ignore[type-arg]
    return points + 10.0 ** rng.uniform(-17, -0.5) * rng.standard_normal(points.shape), facets


def move_a_point(rng: Rng, points: np.ndarray, facets: np.ndarray) -> Arrays:  # type: ignore[type-arg]
    """Onto another point, an edge, a plane of facets, or anywhere."""
    points = points.copy()
    which, (a, b, c) = rng.integers(len(points)), points[facets[rng.integers(len(facets))]]
    share = rng.dirichlet([1, 1, 1]) * np.array([1, rng.integers(2), rng.integers(2)])
    points[which] = (share[0] * a + share[1] * b + share[2] * c) / share.sum()
    return points, facets


def extreme_coordinate(rng: Rng, points: np.ndarray, facets: np.ndarray) -> Arrays:  # type: ignore[type-arg]
    points = points.copy()
    values = [np.nan, np.inf, 1e308, -1e308, 5e-324, 1e-200, 1e15, 0.0]
    points[rng.integers(len(points)), rng.integers(3)] = rng.choice(values)
    return points, facets


def stretch(rng: Rng, points: np.ndarray, facets: np.ndarray) -> Arrays:  # type: ignore[type-arg]
    scale = np.ones(3)
    scale[rng.integers(3)] = 10.0 ** rng.uniform(-12, 3)
    return points * scale * 10.0 ** rng.uniform(-9, 9) + rng.choice([0.0, 1e3]), facets


def drop_facets(rng: Rng, points: np.ndarray, facets: np.ndarray) -> Arrays:  # type: ignore[type-arg]
    return points, np.delete(facets, rng.integers(len(facets), size=rng.integers(1, 4)), axis=0)


def repeat_a_facet(rng: Rng, points: np.ndarray, facets: np.ndarray) -> Arrays:  # type: ignore[type-arg]
    row = facets[rng.integers(len(facets))]
    return points, np.vstack([facets, row[:: rng.choice([1, -1])]])


def turn_facets(rng: Rng, points: np.ndarray, facets: np.ndarray) -> Arrays:  # type: ignore[type-arg]
    turned = rng.random(len(facets)) < rng.choice([0.02, 0.5, 1.0])
    facets = facets.copy()
    facets[turned] = facets[turned][:, ::-1]
    return points, facets


def change_an_index(rng: Rng, points: np.ndarray, facets: np.ndarray) -> Arrays:  # type: ignore[type-arg]
    facets = facets.copy()
    facets[rng.integers(len(facets)), rng.integers(3)] = rng.integers(-1, len(points) + 1)
    return points, facets


def split_a_facet(rng: Rng, points: np.ndarray, facets: np.ndarray) -> Arrays:  # type: ignore[type-arg]
    """A new point in a facet, near a corner at times: slivers of facets."""
    row = rng.integers(len(facets))
    a, b, c = facets[row]
    share = rng.dirichlet([10.0 ** rng.uniform(-2, 1)] * 3)
    new = len(points)
    points = np.vstack([points, share @ points[[a, b, c]]])
    return points, np.vstack(
        [np.delete(facets, row, axis=0), [[a, b, new], [b, c, new], [c, a, new]]]
    )


def add_a_shell(rng: Rng, points: np.ndarray, facets: np.ndarray) -> Arrays:  # type: ignore[type-arg]
    """Within, beside, across or touching; facing either way."""
    more, rows = base(rng)
    more = more * 10.0 ** rng.uniform(-2, 0.5) + rng.choice([0.0, 0.5, 1.0, 2.0], 3)
    return np.vstack([points, more]), np.vstack(
        [facets, rows[:, :: rng.choice([1, -1])] + len(points)]
    )


MUTATIONS: list[Callable[[Rng, np.ndarray, np.ndarray], Arrays]] = [  # type: ignore[type-arg]
    noise, move_a_point, extreme_coordinate, stretch, drop_facets, repeat_a_facet, turn_facets,
    change_an_index, split_a_facet, add_a_shell,
]  # fmt: skip


def try_one(seed: int, *, repairs: bool = True) -> str:
    """What became of a surface: the kind of refusal, or "meshed"; a wrong mesh is an error.

    Args:
        seed: Of everything that is drawn.
        repairs: Whether some surfaces are repaired or wrapped first. It has draws of its own, so
            that a seed without it stays the surface that it is.
    """
    rng, ways = np.random.default_rng(seed), np.random.default_rng((seed, 1))
    points, facets = base(rng)
    for k in rng.integers(len(MUTATIONS), size=rng.integers(0, 4)):
        points, facets = MUTATIONS[k](rng, points, facets)
    try:
        surface = TriSurface(points, facets)
        if rng.random() < 0.3:
            surface, _ = repair_surface(surface)
        if repairs and ways.random() < 0.4:
            surface = _repaired(ways, surface)
        if rng.random() < 0.1:
            size = np.ptp(surface.points, axis=0).max()
            surface, _ = remesh_surface(surface, distance=size * 10.0 ** rng.uniform(-4, -1))
        corners = surface.points[surface.facets]
        mean = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).mean()
        mesh = mesh_surface(surface, edge_length=mean * 2.0 ** rng.uniform(-1, 2))
    except BoundaryRecoveryError:
        return "not recovered"
    except InputError as error:
        return type(error).__name__
    require_right(surface, mesh)
    return "meshed"


def _repaired(rng: Rng, surface: TriSurface) -> TriSurface:
    """All that can be repaired, or made anew; checked by the exact test."""
    size = float(np.ptp(surface.points, axis=0).max())
    wraps = rng.random() < 0.5
    if not wraps:
        hole = int(10.0 ** rng.uniform(0, 3))
        repaired = repair_to_solid(surface, RepairChoices(largest_hole=hole)).surface
    else:
        distance = size * 10.0 ** rng.uniform(-1.2, 0.0)
        if not 0.0 < distance < np.inf:
            return surface
        repaired = wrap_surface(surface, distance=distance)[0]
    crossings = all_crossings(repaired.points, repaired.facets)
    if len(crossings):
        raise AssertionError(
            f"{len(crossings)} pair(s) cross after {'wrapping' if wraps else 'repair'}"
        )
    return repaired


def require_right(surface: TriSurface, mesh: TetMesh) -> None:
    """The mesh fills the surface; TetMesh has refused inverted cells."""
    size = np.ptp(surface.points, axis=0).max()
    # Each volume is good to some roundings of the coordinates' size times the area.
    reach = max(size, np.abs(surface.points).max())
    tolerance = 1e3 * np.finfo(float).eps * reach * surface.area
    if abs(mesh.volume - surface.volume) > tolerance:
        raise AssertionError(f"volume {mesh.volume!r} is not the surface's {surface.volume!r}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--once", action="store_true", help="only this seed")
    chosen = parser.parse_args()
    ends: Counter[str] = Counter()
    seed, finish = chosen.seed, time.monotonic() + chosen.seconds
    np.seterr(all="ignore")
    try:
        while time.monotonic() < finish or seed == chosen.seed:
            # A crash or a hang ends the process: the last line names the seed.
            print(f"\rseed {seed} ", end="", file=sys.stderr, flush=True)
            signal.setitimer(signal.ITIMER_PROF, LIMIT)
            ends[try_one(seed)] += 1
            if chosen.once:
                break
            seed += 1
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        print(f"\n{sum(ends.values())} surfaces: ", dict(ends.most_common()), file=sys.stderr)
    return 0


if __name__ == "__main__":
    faulthandler.enable()
    # Within the core as well: the traceback, then the end of the process.
    faulthandler.register(signal.SIGPROF, chain=True)
    sys.exit(main())
