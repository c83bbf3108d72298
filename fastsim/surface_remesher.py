"""Better triangles on a surface, within a stated distance of it: the mesher's free boundary.

Poor triangles (marching cubes, decimation) bound the quality of every mesh that keeps them. Where
the surface may move a little, this gives it others: splits, collapses, flips and moves after
Botsch and Kobbelt (2004), each refused where the surface would leave the distance. Sharp edges
are kept, and so is the enclosed volume, as far as the distance allows (kept_volume).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.grading.sampled_sizes import grid_of_sizes
from palpate.fastsim.grading.size_fields import SizeField
from palpate.fastsim.kept_volume import keep_volume
from palpate.fastsim.surface_arrays import (
    compact_facets,
    mean_edge_length,
    require_no_self_intersection,
)
from palpate.meshes.arrays import Points
from palpate.meshes.errors import MeshError
from palpate.meshes.shapes import require_positive
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import TriSurface

# Where the two-way distance comes out too large, or sheets meet, a tighter bound is tried on
# each step.
_PARTS = (1.0, 0.5, 0.25, 0.125)
_PASSES = 8
_MOST_PAIRS = 10


class RemeshError(MeshError):
    """No other triangles within the distance; `.distance` is the best reached [m], if any."""

    def __init__(self, message: str, distance: float | None) -> None:
        self.distance = distance
        super().__init__(message)


@dataclass(frozen=True)
class RemeshReport:
    """What was done.

    Attributes:
        distance: Largest distance of either surface from the other, measured at points, middles
            of edges and centres of facets [m].
        volume_change: Enclosed volume over the given one, minus 1; not 0 to rounding where the
            distance did not allow to move further.
        splits, collapses, flips, moves: Steps taken.
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
        """What was done, in one line for people."""
        return (
            f"boundary re-triangulated within {self.distance:.3g} m (volume "
            f"{100 * self.volume_change:+.2g} %, smallest facet angle "
            f"{self.smallest_angle_before:.0f} to {self.smallest_angle_after:.0f} degrees)"
        )


def remesh_surface(
    surface: TriSurface,
    *,
    distance: float,
    edge_length: float | None = None,
    size_field: SizeField | None = None,
) -> tuple[TriSurface, RemeshReport]:
    """Give a closed surface better triangles.

    Args:
        surface: Closed, outward, without self-intersection [m].
        distance: How far the two surfaces may be apart, > 0 [m].
        edge_length: Wanted edge length [m]; None takes the surface's mean. Details that need
            shorter edges to stay within the distance keep them. With a size field, the largest.
        size_field: Shorter edges here and there; see `grading.size_fields`.

    Returns:
        The new surface, closed and without self-intersection, and what was done.

    Raises:
        SurfaceError: The given surface does not bound a solid, or intersects itself.
        RemeshError: No way was found to stay within the distance.
    """
    require_closed(surface)
    used, facets = compact_facets(surface)
    # About a local origin, where lengths are not lost beside a far-off one.
    origin = surface.points[used].mean(axis=0)
    points = np.ascontiguousarray(surface.points[used] - origin)
    size = mean_edge_length(points, facets) if edge_length is None else edge_length
    require_positive(edge_length=size, distance=distance)
    require_no_self_intersection(points, facets, most=_MOST_PAIRS)
    local = None if size_field is None else lambda places: size_field(places + origin)
    sizes = grid_of_sizes(points, size, local)
    best: float | None = None
    for part in _PARTS:
        made = _core.remesh_surface(points, facets, sizes, part * distance, _PASSES)
        best = made.distance if best is None else min(best, made.distance)
        moved, new_facets = made.points, made.facets
        if made.distance > distance or len(_core.find_self_intersections(moved, new_facets, 1)):
            continue
        kept = keep_volume(
            moved, new_facets, (points, facets), distance=distance, reached=made.distance
        )
        moved = kept.points
        new = TriSurface(moved + origin, new_facets)
        require_closed(new)
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
    """Of all facets, given by their corners, shape (num_facets, 3, 3) [degrees]."""
    smallest = np.inf
    for k in range(3):
        u = corners[:, (k + 1) % 3] - corners[:, k]
        v = corners[:, (k + 2) % 3] - corners[:, k]
        across = np.linalg.norm(np.cross(u, v), axis=1)
        smallest = min(
            smallest, float(np.arctan2(across, np.einsum("ij,ij->i", u, v)).min(initial=np.inf))
        )
    return float(np.degrees(smallest))
