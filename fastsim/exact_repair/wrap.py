"""A new closed surface around facets of any kind: soup, open sheets, crossing parts, inner walls.

Inside are points with a winding number of at least a half (Jacobson, Kavan, Sorkine-Hornung
2013, "Robust inside-outside segmentation using generalized winding numbers"): crossing parts are
united, inner parts are absorbed, and holes are bridged where the winding number falls through
a half. The surface between is made on a grid, and given better triangles within the distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.grading.size_fields import grid_of_sizes
from palpate.fastsim.surface_remesher import facet_distances
from palpate.meshes.arrays import Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.repair.patches import loose_facets
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import EmptySurfaceError, TriSurface
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
# Parts shorter than this, of the spacing, are crumbs of the grid.
_CRUMB = 3.0


class WrapError(InputError):
    """No closed surface within the distance; `.distance` is the one requested [m]."""

    def __init__(self, message: str, distance: float) -> None:
        self.distance = distance
        super().__init__(message)


@dataclass(frozen=True)
class WrapReport:
    """How near the new surface is to the given one, over corners, middles of edges and centres.

    Attributes:
        num_facets: Number of facets of the new surface.
        distance: The distance requested [m].
        from_given: Largest distance of the new surface from the given one, but over holes [m].
        bridging: Fraction of the new facets that bridge holes: further away than requested.
        bridge_distance: Largest distance of those [m].
        lost: Fraction of the given facets further away: inner walls, fins, thin sheets.
        lost_distance: Largest distance of those [m].
    """

    num_facets: int
    distance: float
    from_given: float
    bridging: float
    bridge_distance: float
    lost: float
    lost_distance: float

    def line(self) -> str:
        """Report in one line."""
        said = [f"wrapped by {self.num_facets} new facets within {self.from_given:.3g} m"]
        if self.bridging:
            said.append(
                f"{100 * self.bridging:.2g} % of them bridge holes, up to "
                f"{self.bridge_distance:.3g} m away"
            )
        if self.lost:
            said.append(
                f"{100 * self.lost:.2g} % of the given facets (inner or thin ones) are up to "
                f"{self.lost_distance:.3g} m from the new"
            )
        return "; ".join(said)


def wrap_surface(surface: TriSurface, *, distance: float) -> tuple[TriSurface, WrapReport]:
    """Make a closed surface near the outside of facets of any kind.

    Args:
        surface: Facets that mostly face outwards [m]; nothing else is required of them.
        distance: How far the new surface may be from the given one, > 0 [m]; details smaller than
            it may be lost. Over holes it is further away, which is reported.

    Returns:
        The new surface, closed, outward and without crossings, and how near it is.

    Raises:
        EmptySurfaceError: No facets.
        WrapError: The facets enclose nothing, or the distance asks for too many cubes; before any
            is made, with the distance that would do, but where it is for what bridges holes.
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
    _refuse_too_many_cubes(points, facets, distance)
    made = _core.wrap_surface(points, facets, spacing, _MOST_CUBES)
    if made.is_too_fine:
        raise WrapError(
            f"a wrap within {distance:.3g} m takes more than {_MOST_CUBES} cubes once its holes "
            f"are bridged, or its parts lie too far from each other; try {2.0 * distance:.3g} m",
            distance,
        )
    positions, rows = made.points, made.facets
    crumbs = (
        loose_facets(positions, rows, _CRUMB * spacing) if len(rows) else np.zeros(0, dtype=bool)
    )
    rows = rows[~crumbs]
    if not len(rows):
        raise WrapError(
            f"the facets enclose nothing that is thicker than {spacing:.3g} m: thinner than the "
            "distance, turned inwards, or facing both ways; take less, or turn them round",
            distance,
        )
    used, rows = np.unique(rows, return_inverse=True)
    grid = TriSurface(positions[used], rows.reshape(-1, 3).astype(np.int32))
    new = _better(grid, _MOVES * distance, _EDGE * spacing)
    report = _measure(points, facets, new, distance)
    return TriSurface(new.points + origin, new.facets), report


def _refuse_too_many_cubes(points: Points, facets: Indices, distance: float) -> None:
    projected = 0.5 * float(np.abs(facet_normals(points[facets])).sum())
    sides = projected / (_SPACING * distance) / (_SPACING * distance)
    cubes = _CUBES_PER_SIDE * sides
    if not cubes <= _MOST_CUBES:
        # A little more, since it is printed with three digits.
        enough = 1.01 * distance * math.sqrt(cubes / _MOST_CUBES)
        raise WrapError(
            f"a wrap within {distance:.3g} m takes about {cubes:.2g} cubes, more than "
            f"{_MOST_CUBES}; {enough:.3g} m would do",
            distance,
        )


def _better(surface: TriSurface, moves: float, edge: float) -> TriSurface:
    """Better triangles within a small distance; the grid's own where there are none."""
    require_closed(surface)
    sizes = grid_of_sizes(surface.points, edge, None)
    # Each step is bounded more tightly: what the grid has cut off at edges counts both ways.
    for part in (0.5, 0.25):
        made = _core.remesh_surface(surface.points, surface.facets, sizes, part * moves, _PASSES)
        crossings = _core.find_self_intersections(made.points, made.facets, 1)
        if made.distance <= moves and not len(crossings):
            new = TriSurface(made.points, made.facets)
            require_closed(new)
            return new
    return surface


def _measure(points: Points, facets: Indices, new: TriSurface, distance: float) -> WrapReport:
    far = facet_distances(new.points, new.facets, _core.SurfaceDistance(points, facets))
    is_bridge = far > distance
    made = _core.SurfaceDistance(np.ascontiguousarray(new.points), new.facets)
    lost = facet_distances(points, facets, made)
    is_lost = lost > distance
    return WrapReport(
        new.num_facets,
        distance,
        float(far[~is_bridge].max(initial=0.0)),
        float(is_bridge.mean()),
        float(far[is_bridge].max(initial=0.0)),
        float(is_lost.mean()),
        float(lost[is_lost].max(initial=0.0)),
    )
