"""Better triangles on a surface, within a stated distance of it: the mesher's free boundary.

Poor triangles (marching cubes, decimation) limit the quality of every mesh with them. Where
the surface may move a little, this gives it others: splits, collapses, flips and moves after
Botsch and Kobbelt (2004), each refused where the surface would leave the distance. Sharp edges
are preserved, and so is the enclosed volume, as far as the distance allows (`keep_volume`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.exact_repair.part_changes import round_up
from palpate.fastsim.grading.size_fields import SizeField, grid_of_sizes
from palpate.meshes.arrays import Floats, Indices, Integers, Points
from palpate.meshes.errors import MeshError
from palpate.meshes.percent import Percent
from palpate.meshes.shapes import require_positive
from palpate.meshes.shells import Shell, ShellKind
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import SelfIntersectionError, TriSurface
from palpate.meshes.triangles import facet_normals, side_lengths

# Where the two-way distance comes out too large, or sheets meet, a tighter bound is tried on
# each step.
_PARTS = (1.0, 0.5, 0.25, 0.125)
_PASSES = 8
_MOST_PAIRS = 10
# Accuracy of distances beside a hundredth of themselves, over the distance that is allowed.
_ACCURACY = 1e-3


class RemeshError(MeshError):
    """No other triangles within the distance; `.distance` is the best reached [m], if any."""

    def __init__(self, message: str, distance: float | None) -> None:
        self.distance = distance
        super().__init__(message)


@dataclass(frozen=True)
class RemeshReport:
    """Changes of a surface by remeshing.

    Attributes:
        distance: Largest distance of either surface from the other [m], an upper bound, about a
            hundredth above it.
        volume_change: Enclosed volume over the given one, minus 1; not 0 to rounding where the
            distance did not allow to move further.
        splits, collapses, flips, moves: Numbers of these steps.
        smallest_angle_before, smallest_angle_after: Of all facets [degrees].
    """

    distance: float
    volume_change: float
    splits: int
    collapses: int
    flips: int
    moves: int
    smallest_angle_before: float
    smallest_angle_after: float

    def line(self) -> str:
        """Report in one line."""
        return (
            f"boundary re-triangulated within {round_up(self.distance):.3g} m (volume "
            f"{100 * self.volume_change:+.2g} %, smallest facet angle "
            f"{self.smallest_angle_before:.0f} to {self.smallest_angle_after:.0f} degrees)"
        )


def remesh_surface(
    surface: TriSurface,
    *,
    distance: float,
    edge_length: float | None = None,
    size_field: SizeField | None = None,
    progress: Callable[[str], None] | None = None,
) -> tuple[TriSurface, RemeshReport]:
    """Give a closed surface better triangles.

    Args:
        surface: Closed, outward, without self-intersection [m].
        distance: How far the two surfaces may be apart, > 0 [m].
        edge_length: Wanted edge length [m]; None takes the surface's mean. Details that need
            shorter edges to stay within the distance keep them. With a size field, the largest.
        size_field: Shorter edges here and there; see `grading.size_fields`.
        progress: Called with the part that is done, in per cent, after two seconds.

    Returns:
        The new surface, closed and without self-intersection, and what was done.

    Raises:
        SurfaceError: The given surface does not bound a solid, or intersects itself.
        RemeshError: No way was found to stay within the distance.
    """
    require_solid(surface)
    used, facets = compact_facets(surface)
    # About a local origin, where lengths are not lost beside a far-off one.
    origin = surface.points[used].mean(axis=0)
    points = np.ascontiguousarray(surface.points[used] - origin)
    size = mean_edge_length(points, facets) if edge_length is None else edge_length
    require_positive(edge_length=size, distance=distance)
    require_no_self_intersection(points, facets, most=_MOST_PAIRS)
    local = None if size_field is None else lambda positions: size_field(positions + origin)
    sizes = grid_of_sizes(points, size, local)
    best: float | None = None
    percent = Percent(progress)
    for count, part in enumerate(_PARTS, start=1):
        tell = partial(percent, f"better facets on the boundary, try {count}")
        made = _core.remesh_surface(points, facets, sizes, part * distance, _PASSES, tell)
        moved, new_facets = made.points, made.facets
        apart = two_way_distance(moved, new_facets, (points, facets), _ACCURACY * distance)
        best = apart if best is None else min(best, apart)
        if apart > distance or len(_core.find_self_intersections(moved, new_facets, 1)):
            continue
        kept = keep_volume(moved, new_facets, (points, facets), distance=distance, reached=apart)
        moved = kept.points
        new = TriSurface(moved + origin, new_facets)
        require_solid(new)
        return new, RemeshReport(
            kept.distance,
            new.volume / surface.volume - 1.0,
            made.splits,
            made.collapses,
            made.flips,
            made.moves,
            smallest_angle_before=_smallest_angle(points[facets]),
            smallest_angle_after=_smallest_angle(moved[new_facets]),
        )
    raise RemeshError(
        f"no better triangles within {distance:.3g} m of the surface (reached {best:.3g} m, or "
        "sheets met); allow a larger distance, or keep the boundary",
        best,
    )


def _smallest_angle(corners: Points) -> float:
    """Smallest angle of facets with these corners, shape (num_facets, 3, 3) [degrees]."""
    u, v = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    across = np.linalg.norm(np.cross(u, v), axis=2)
    angles = np.arctan2(across, np.einsum("ijk,ijk->ij", u, v))
    return float(np.degrees(angles.min(initial=np.inf)))


# A remeshed surface moved a little, so that it encloses the volume of the given one.
#
# Points of new triangles lie on the given surface, so that these cut chords: where it is convex
# they lose volume, 0.1 to 0.3 % of an organ, and 10 % of a vessel with few triangles around. Each
# point moves along its normal by what the given surface stands off the triangles around it, times
# one factor, the same for all, for which the volume is the given one. Points on sharp edges stay.


# A point whose facets face further apart than this from its normal lies on a sharp edge.
_SHARP_COSINE = np.cos(np.radians(35.0))
# Largest factor: 0.75 is a paraboloid's over its middle.
_LARGEST_FACTOR = 3.0
_ROUNDS = 3
_TRIES = 8
_STEPS = 20
# Tolerance of the volume; the next round corrects the remaining difference.
_CLOSE = 1e-12


@dataclass(frozen=True, eq=False)
class ConservedVolume:
    """Points moved to preserve the volume [m], and the surfaces' largest distance then [m].

    `part` of the missing volume was restored, 0 to 1; below 1 the distance was the limit.
    """

    points: Points
    distance: float
    part: float


def keep_volume(
    points: Points,
    facets: Indices,
    given: tuple[Points, Indices],
    *,
    distance: float,
    reached: float,
) -> ConservedVolume:
    """Move points [m] so that the volume is that of the given surface, within a distance [m] of it.

    `given` are points and facets of the given surface, `reached` the distance before the move [m].
    """
    searched = _core.SurfaceDistance(*given)
    wanted = _volume(*given)
    missing = wanted - _volume(points, facets)
    if abs(missing) <= _CLOSE * abs(wanted):
        return ConservedVolume(points, reached, 1.0)
    kept = ConservedVolume(points, reached, 0.0)
    for _ in range(_ROUNDS):
        moves = _moves(kept.points, facets, searched)
        # As much of it as the distance allows, point by point.
        for _ in range(_TRIES):
            factor = _factor(kept.points, facets, moves, wanted)
            moved = np.ascontiguousarray(kept.points + factor * moves)
            apart = two_way_distance(moved, facets, given, _ACCURACY * distance)
            if apart <= distance and not len(_core.find_self_intersections(moved, facets, 1)):
                part = 1.0 - (wanted - _volume(moved, facets)) / missing
                if part > kept.part:
                    kept = ConservedVolume(moved, apart, min(part, 1.0))
                break
            far = _farthest(searched, moved, facets, distance, _ACCURACY * distance) > distance
            moves[np.unique(facets[far]) if far.any() else slice(None)] *= 0.5
        if abs(wanted - _volume(kept.points, facets)) <= _CLOSE * abs(wanted):
            return ConservedVolume(kept.points, kept.distance, 1.0)
    return kept


def _moves(points: Points, facets: Indices, searched: _core.SurfaceDistance) -> Points:
    """Displacement of each point for a factor of 1 [m]."""
    corners = points[facets]
    areas = facet_normals(corners)
    sizes = np.linalg.norm(areas, axis=1)
    normals = areas / np.maximum(sizes, np.finfo(float).tiny)[:, None]
    centres = corners.mean(axis=1)
    # How far the given surface stands off, outwards positive: the way that comes nearer to it.
    off = searched.distances(np.ascontiguousarray(centres))
    out = searched.distances(np.ascontiguousarray(centres + off[:, None] * normals))
    back = searched.distances(np.ascontiguousarray(centres - off[:, None] * normals))
    off = np.where(out <= back, off, -off)
    weight, amount = np.zeros(len(points)), np.zeros(len(points))
    directions = np.zeros_like(points)
    for k in range(3):
        np.add.at(weight, facets[:, k], sizes)
        np.add.at(amount, facets[:, k], sizes * off)
        np.add.at(directions, facets[:, k], areas)
    length = np.linalg.norm(directions, axis=1)
    directions /= np.maximum(length, np.finfo(float).tiny)[:, None]
    facing = np.ones(len(points))
    for k in range(3):
        cosine = np.einsum("ij,ij->i", normals, directions[facets[:, k]])
        np.minimum.at(facing, facets[:, k], cosine)
    amount = np.where(facing > _SHARP_COSINE, amount / np.maximum(weight, 1e-300), 0.0)
    return amount[:, None] * directions


def _factor(points: Points, facets: Indices, moves: Points, wanted: float) -> float:
    """The factor by which the volume is as wanted, or as near to it as the largest one gets."""
    low, high = 0.0, 1.0
    gap = wanted - _volume(points, facets)

    def is_beyond(factor: float) -> bool:
        return (wanted - _volume(points + factor * moves, facets)) * gap <= 0.0

    while not is_beyond(high):
        high *= 1.5
        if high > _LARGEST_FACTOR:
            after = _volume(points + _LARGEST_FACTOR * moves, facets)
            return _LARGEST_FACTOR if abs(wanted - after) < abs(gap) else 0.0
    # Regula falsi by halves: the volume is a cubic of the factor.
    for _ in range(3 * _STEPS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if is_beyond(middle) else (middle, high)
    return high


def two_way_distance(
    points: Points, facets: Indices, given: tuple[Points, Indices], accuracy: float
) -> float:
    """Largest distance of either surface from the other [m], an upper bound.

    Above it by at most `accuracy` [m] and a hundredth.
    """
    made = np.ascontiguousarray(points), facets
    found = []
    for one, other in ((made, given), (given, made)):
        tree = _core.SurfaceDistance(*other)
        corners = one[0][one[1]]
        middles = (corners + corners[:, [1, 2, 0]]).reshape(-1, 3) / 2.0
        samples = np.vstack([corners.reshape(-1, 3), middles, corners.mean(axis=1)])
        seen = float(tree.distances(samples).max(initial=0.0))
        level = 1.01 * seen + accuracy
        found.append(float(_farthest(tree, *one, level, accuracy).max(initial=0.0)))
    return max(found)


def _farthest(
    other: _core.SurfaceDistance, points: Points, facets: Indices, level: float, accuracy: float
) -> Floats:
    """Upper bounds of each facet's distance from another surface [m]; accurate above a level."""
    far = other.farthest(points, facets, max(0.3 * level, accuracy))
    above = far > level
    if above.any():
        far[above] = other.farthest(points, np.ascontiguousarray(facets[above]), accuracy)
    return far


def _volume(points: Points, facets: Indices) -> float:
    a, b, c = (points[facets[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def compact_facets(surface: TriSurface) -> tuple[Integers, Indices]:
    """Points that facets use, ascending, and the facets numbered by them, shape (num_facets, 3)."""
    used = surface.used_points
    if len(used) == len(surface.points):
        return used, surface.facets
    renumber = np.full(len(surface.points), -1, dtype=np.int32)
    renumber[used] = np.arange(len(used), dtype=np.int32)
    return used, np.ascontiguousarray(renumber[surface.facets])


def mean_edge_length(points: Points, facets: Indices) -> float:
    """Mean over the facets' sides [m]; each edge of a closed surface counts twice."""
    return float(side_lengths(points[facets]).mean())


def require_solid(surface: TriSurface) -> list[Shell]:
    """As `surface_checks.require_closed`, of which a plain shell is spared the work."""
    if _core.is_plain_shell(surface.points, surface.facets):
        return [Shell(np.arange(surface.num_facets), surface.volume, (), ShellKind.OUTSIDE)]
    return require_closed(surface)


def require_no_self_intersection(points: Points, facets: Indices, *, most: int) -> None:
    """Refuse facets that meet anywhere but at shared corners and edges, by exact tests.

    Raises:
        SelfIntersectionError: With the pairs of facets, `most` of them at most: a surface on itself
            has millions.
    """
    pairs = _core.find_self_intersections(points, facets, most)
    if len(pairs):
        raise SelfIntersectionError([(a, b) for a, b in pairs.tolist()])
