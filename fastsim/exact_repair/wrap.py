"""A new closed surface around facets of any kind: soup, open sheets, crossing parts, inner walls.

Inside are points with a winding number of at least a half (Jacobson, Kavan, Sorkine-Hornung
2013, "Robust inside-outside segmentation using generalized winding numbers"): crossing parts are
united, inner parts are absorbed, and holes are bridged where the winding number falls through
a half. The surface between is made on a grid, and given better triangles within the distance.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.exact_repair.part_changes import round_up
from palpate.fastsim.grading.size_fields import grid_of_sizes
from palpate.fastsim.mesher import TimeLimitError
from palpate.fastsim.surface_remesher import two_way_distance
from palpate.meshes.arrays import Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.percent import Percent
from palpate.meshes.repair.patches import loose_facets
from palpate.meshes.shapes import require_positive
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import EmptySurfaceError, SurfaceError, TriSurface
from palpate.meshes.triangles import facet_normals

# The grid's cubes and the moves for better triangles, of the distance: a cube's diagonal is 1.7
# edges, and where both are spent at a sharp edge the distance is not.
_SPACING, _MOVES = 0.8, 0.2
# Edges of the new facets, of the spacing; and how often all of them are worked on.
_EDGE, _PASSES = 1.4, 3
# Each takes some 2 kB and 0.2 ms until the new facets are made: 2 GB and some minutes.
_MOST_CUBES = 1_000_000
# Cubes that a surface passes, of its area projected along the axes over a cube's side squared.
_CUBES_PER_SIDE = 1.3
# Parts shorter than this, of the spacing, are left over by the grid and are no part of the body.
_SHORTEST = 3.0
# Spacing of a first wrap, over that of the second.
_COARSER = 4.0


class WrapError(InputError):
    """No closed surface within the distance; `.distance` is the one requested [m]."""

    def __init__(self, message: str, distance: float) -> None:
        self.distance = distance
        super().__init__(message)


@dataclass(frozen=True)
class WrapReport:
    """How near the new surface is to the given one, by upper bounds of distances.

    Attributes:
        num_facets: Number of facets of the new surface.
        distance: The distance requested [m].
        from_given: Largest distance of the new surface from the given one, but over holes [m].
        bridging: Fraction of the new facets that bridge holes: further away than requested.
        bridge_distance: Largest distance of those [m].
        lost: Fraction of the given facets further away: inner walls, fins, thin sheets.
        lost_distance: Largest distance of those [m].
        is_inward: Whether the given facets face inwards, and were taken the other way round.
    """

    num_facets: int
    distance: float
    from_given: float
    bridging: float
    bridge_distance: float
    lost: float
    lost_distance: float
    is_inward: bool = False

    def line(self) -> str:
        """Report in one line."""
        within = round_up(self.from_given)
        said = [f"wrapped by {self.num_facets} new facets within {within:.3g} m"]
        if self.is_inward:
            said.insert(0, "the facets face inwards and were taken the other way round")
        if self.bridging:
            said.append(
                f"{100 * self.bridging:.2g} % of them bridge holes, up to "
                f"{round_up(self.bridge_distance):.3g} m away"
            )
        if self.lost:
            said.append(
                f"{100 * self.lost:.2g} % of the given facets (inner or thin ones) are up to "
                f"{round_up(self.lost_distance):.3g} m from the new"
            )
        return "; ".join(said)


def wrap_surface(
    surface: TriSurface,
    *,
    distance: float,
    time_limit: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> tuple[TriSurface, WrapReport]:
    """Make a closed surface near the outside of facets of any kind.

    Args:
        surface: Facets that mostly face one way, out or in [m]; nothing else is required of them.
            Of the two ways the one that encloses more is taken.
        distance: How far the new surface may be from the given one, > 0 [m]; details smaller than
            it may be lost. Over holes it is further away, which is reported.
        time_limit: Seconds after which there is an error, > 0; None is no limit.
        progress: Called with the part that is done, in per cent, after two seconds.

    Returns:
        The new surface, closed, outward and without crossings, and how near it is.

    Raises:
        EmptySurfaceError: No facets.
        WrapError: The facets enclose nothing, or the distance asks for too many cubes; before any
            is made, with the distance that would do, but where it is for what bridges holes; or
            the coordinates are too large for facets of such a size.
        TimeLimitError: The time was up.
    """
    if not 0.0 < distance < math.inf:
        raise InputError(f"wrap distance {distance:g} m: needs a finite value above 0")
    # Those with an area.
    longest = np.ptp(surface.points[surface.facets], axis=1).max(axis=1, initial=0.0)
    double_area = 2.0 * np.linalg.norm(surface.area_vectors, axis=1)
    facets = surface.facets[double_area > np.finfo(float).eps * longest**2]
    if not len(facets):
        raise EmptySurfaceError("the surface has no facets with an area; there is nothing to wrap")
    used, facets = np.unique(facets, return_inverse=True)
    facets = facets.reshape(-1, 3).astype(np.int32)
    # About a local origin, where lengths are not lost beside a far-off one.
    origin = surface.points[used].mean(axis=0)
    points = np.ascontiguousarray(surface.points[used] - origin)
    spacing = _SPACING * distance
    watch = _Watch(time_limit, progress)
    cubes = _count_cubes(points, facets, distance)
    watch.num_cubes = cubes / _COARSER**2
    # A coarse one says which way the facets face; where both are thinner than that, the fine one.
    coarse = [_grid(points, way, _COARSER * spacing, watch) for way in (facets, facets[:, ::-1])]
    watch.stage, watch.num_cubes = "wrapping the surface", cubes
    is_inward = coarse[1].volume > coarse[0].volume
    way = facets[:, ::-1] if is_inward else facets
    grid = _grid(points, way, spacing, watch)
    if not grid.num_facets:
        way, is_inward = way[:, ::-1], not is_inward
        grid = _grid(points, way, spacing, watch)
    if not grid.num_facets:
        raise WrapError(
            f"the facets enclose nothing that is thicker than {spacing:.3g} m: thinner than the "
            "distance, or facing both ways; take less, or turn them round",
            distance,
        )
    watch.require_time("making better facets of the wrap")
    new = _better(grid, _MOVES * distance, _EDGE * spacing, watch.percent)
    watch.require_time("measuring the wrap")
    report = _measure(points, facets, new, distance, is_inward=is_inward)
    moved = TriSurface(new.points + origin, new.facets)
    # Where it lies: a far-off origin may round small facets flat.
    try:
        require_closed(moved)
        is_sound = not len(_core.find_self_intersections(moved.points, moved.facets, 1))
    except SurfaceError:
        is_sound = False
    if not is_sound:
        raise WrapError(
            f"coordinates of {np.abs(moved.points).max():.3g} m leave facets of a wrap within "
            f"{distance:.3g} m no digits; move the surface near the origin",
            distance,
        )
    return moved, report


class _Watch:
    """Says how far a wrap is; raises TimeLimitError when the time is up."""

    # The stage at hand, and about how many cubes it takes.
    stage = "looking which way the facets face"
    num_cubes = 1.0

    def __init__(self, time_limit: float | None, progress: Callable[[str], None] | None) -> None:
        if time_limit is not None:
            require_positive(time_limit=time_limit)
        self._time_limit, self.percent = time_limit, Percent(progress)
        self._began = time.monotonic()

    def require_time(self, stage: str) -> None:
        if self._time_limit is not None and time.monotonic() - self._began > self._time_limit:
            raise TimeLimitError(self._time_limit, stage)

    def __call__(self, cubes: int) -> None:
        self.require_time("wrapping the surface")
        # What is tiny beside the cubes takes 0 of them in floating-point numbers.
        self.percent(self.stage, cubes / max(self.num_cubes, 1.0))


def _grid(points: Points, facets: Indices, spacing: float, watch: _Watch) -> TriSurface:
    """The wrap on a grid, without parts shorter than three cubes; empty where it has no other."""
    made = _core.wrap_surface(points, np.ascontiguousarray(facets), spacing, _MOST_CUBES, watch)
    if made.is_too_fine:
        distance = spacing / _SPACING
        raise WrapError(
            f"a wrap within {distance:.3g} m takes more than {_MOST_CUBES} cubes once its holes "
            f"are bridged, or its parts lie too far from each other; try {2.0 * distance:.3g} m",
            distance,
        )
    rows = made.facets
    if len(rows):
        rows = rows[~loose_facets(made.points, rows, _SHORTEST * spacing)]
    used, rows = np.unique(rows, return_inverse=True)
    grid = TriSurface(made.points[used], rows.reshape(-1, 3).astype(np.int32))
    # `loose_facets` leaves the largest part however short it is.
    is_short = not len(rows) or np.ptp(grid.points, axis=0).max() < _SHORTEST * spacing
    return TriSurface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32)) if is_short else grid


def _count_cubes(points: Points, facets: Indices, distance: float) -> float:
    """About how many cubes a wrap takes; refuses too many."""
    projected = 0.5 * float(np.abs(facet_normals(points[facets])).sum())
    sides = projected / (_SPACING * distance) / (_SPACING * distance)
    cubes = _CUBES_PER_SIDE * sides
    if not cubes <= _MOST_CUBES:
        enough = round_up(1.001 * distance * math.sqrt(cubes / _MOST_CUBES))
        raise WrapError(
            f"a wrap within {distance:.3g} m takes about {cubes:.2g} cubes, more than "
            f"{_MOST_CUBES}; {enough:.3g} m would do",
            distance,
        )
    return cubes


def _better(surface: TriSurface, moves: float, edge: float, percent: Percent) -> TriSurface:
    """Better triangles within a small distance; the grid's own where there are none."""
    require_closed(surface)
    sizes = grid_of_sizes(surface.points, edge, None)
    # Each step is bounded more tightly: what the grid has cut off at edges counts both ways.
    given = surface.points, surface.facets
    for count, part in enumerate((0.5, 0.25), start=1):
        tell = partial(percent, f"making better facets of the wrap, try {count}")
        made = _core.remesh_surface(*given, sizes, part * moves, _PASSES, tell)
        crossings = _core.find_self_intersections(made.points, made.facets, 1)
        apart = two_way_distance(made.points, made.facets, given, 1e-3 * moves)
        if apart <= moves and not len(crossings):
            new = TriSurface(made.points, made.facets)
            require_closed(new)
            return new
    return surface


def _measure(
    points: Points, facets: Indices, new: TriSurface, distance: float, *, is_inward: bool
) -> WrapReport:
    """Upper bounds of the distances."""
    accuracy = 1e-3 * distance
    far = _core.SurfaceDistance(points, facets).farthest(new.points, new.facets, accuracy)
    is_bridge = far > distance
    made = _core.SurfaceDistance(np.ascontiguousarray(new.points), new.facets)
    lost = made.farthest(points, facets, accuracy)
    is_lost = lost > distance
    return WrapReport(
        new.num_facets,
        distance,
        float(far[~is_bridge].max(initial=0.0)),
        float(is_bridge.mean()),
        float(far[is_bridge].max(initial=0.0)),
        float(is_lost.mean()),
        float(lost[is_lost].max(initial=0.0)),
        is_inward,
    )
