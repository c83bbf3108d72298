"""Repair of a surface until it bounds a solid: all repairs in their order, each reported."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.exact_repair.patch_repairs import (
    Attempt,
    Surroundings,
    all_crossings,
    crossings_of,
    distance_apart,
    facets_near,
    filled_anew,
    is_clean,
    pulled_apart,
    smoothed,
)
from palpate.fastsim.surface_remesher import mean_edge_length
from palpate.meshes.arrays import Indices, Points
from palpate.meshes.repair.choices import RepairChoices
from palpate.meshes.repair.patches import grow
from palpate.meshes.repair.surface_repair import RepairReport, repair_surface
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import OpenSurfaceError, SurfaceError, TriSurface
from palpate.meshes.triangles import connected_parts

# Default distance by which the surface may move, over its mean edge: the detail it resolves.
_EDGES = 2.0


@dataclass(frozen=True, eq=False)
class RepairedSolid:
    """A surface, a line for each repair, and facets of its caps, "cap 1" on the longest loop."""

    surface: TriSurface
    lines: list[str] = field(default_factory=list)
    caps: dict[str, list[int]] = field(default_factory=dict)


def repair_to_solid(surface: TriSurface, choices: RepairChoices | None = None) -> RepairedSolid:
    """Make a surface [m] bound a solid without crossings, as far as that can be done.

    Raises:
        SurfaceError: What cannot be repaired, with the facets at fault.
    """
    choices = choices or RepairChoices()
    repaired, report = repair_surface(
        surface,
        largest_hole=choices.largest_hole,
        smallest_shell=choices.smallest_shell,
        fits=is_clean,
    )
    _require_solid(repaired, report)
    distance = choices.distance
    if distance is None:
        distance = _EDGES * mean_edge_length(repaired.points, repaired.facets)
    solid, done, number = untangle(repaired, distance=distance)
    lines = report.lines()
    if done.num_pairs:
        lines.append(done.line())
    caps = {}
    for count, rows in enumerate(report.caps, start=1):
        left = np.flatnonzero(np.isin(number, rows))
        if len(left):
            caps[f"cap {count}"] = left.tolist()
    if caps:
        names = "cap 1" if len(caps) == 1 else f"cap 1 to cap {len(report.caps)}"
        lines.append(f"facet group(s) {names}: what closes holes, on the longest loop first")
    return RepairedSolid(solid, lines, caps)


def _require_solid(surface: TriSurface, report: RepairReport) -> None:
    """Refuse a surface that is still open or wrong; state what was done and what might help."""
    try:
        require_closed(surface)
    except SurfaceError as error:
        said = "; ".join(report.lines())
        hint = ""
        if isinstance(error, OpenSurfaceError) and report.open_holes:
            longest = max(map(len, report.open_holes))
            hint = f"allow holes of {longest} edges if these are to be closed"
        error.done, error.hint = report.lines(), hint
        text = f"{error}; {hint}" if hint else str(error)
        error.args = (f"{said}; {text}" if said else text,)
        raise


# Self-intersecting surfaces: folds are smoothed, sheets pulled apart, patches made anew.
#
# Each region where facets cross is a patch by itself. Of three ways the one that moves the surface
# least is taken: the patch and some rings around it are bent like a thin plate; its points are
# pulled along their normals; or its facets are removed and the holes filled anew (Attene 2010, "A
# lightweight approach to repairing digitized polygon meshes", does the last). What is left behind
# has no crossing by the exact test.


# Number of further attempts at patches that cross others again after their repair.
_MOST_ROUNDS = 6
# Number of rings of facets around crossing ones that belong to a patch.
_RINGS_AROUND = 12
# Largest fraction of the surface's facets in a patch: beyond that it is the organ itself.
_LARGEST_PART = 0.3
# A repair that moves the surface by less than this fraction of the limit needs no comparison.
_GOOD_ENOUGH = 0.1


class EntangledError(SurfaceError):
    """Crossings that could not be repaired within the distance; `.facets` holds them.

    `.needed` is the distance that would have done, where one was found [m].
    """

    def __init__(self, facets: list[int], position: Points, distance: float, needed: float) -> None:
        at = ", ".join(f"{x:.6g}" for x in position)
        hint = (
            f"moving it by {needed:.3g} m would: allow a larger distance"
            if np.isfinite(needed)
            else "repair it by hand, or wrap it anew"
        )
        first = ", ".join(map(str, facets[:5]))
        what = (
            "the surface intersects itself and could not be repaired within "
            f"{distance:.3g} m, at {len(facets)} facet(s)"
        )
        super().__init__(f"{what}, first {first}, around ({at}) m; {hint}", facets)
        self.needed, self.hint, self.summary = needed, hint, f"{what} around ({at}) m"


@dataclass(frozen=True)
class UntangleReport:
    """Changes of a surface by `untangle`.

    Attributes:
        num_pairs: Pairs of facets that crossed.
        num_regions: Number of regions where they did.
        replaced_facets: Facets that were moved or replaced, by their number before.
        distance: Largest distance of either surface from the other, over corners, middles of
            edges and centres of what was changed [m].
        euler_change: Change of Euler's characteristic: 2 for each bridge cut or shell made.
    """

    num_pairs: int = 0
    num_regions: int = 0
    replaced_facets: tuple[int, ...] = ()
    distance: float = 0.0
    euler_change: int = 0

    def line(self) -> str:
        """Report in one line."""
        bridges = self.euler_change // 2
        cut = f"; {bridges} handle(s) or bridge(s) between sheets cut" if bridges else ""
        return (
            f"{self.num_pairs} pair(s) of facets that cut each other in {self.num_regions} "
            f"region(s) repaired: {len(self.replaced_facets)} facet(s) moved or replaced, by at "
            f"most {self.distance:.3g} m{cut}"
        )


def untangle(
    surface: TriSurface, *, distance: float
) -> tuple[TriSurface, UntangleReport, NDArray[np.int64]]:
    """Repair a closed, consistently oriented surface where it cuts itself.

    Returns a surface without crossings, at most `distance` [m] from the given one, what was done,
    and of each facet its number before, or -1 of a new one, shape (num_facets,).

    Raises:
        EntangledError: Not within the distance.
    """
    points, facets = surface.points, surface.facets
    # Numbers that stay with facets; new ones count on.
    number = np.arange(len(facets))
    num_given = fresh = len(facets)
    pairs = all_crossings(points, facets)
    report = UntangleReport(len(pairs), len(_clusters(facets, pairs)))
    for _ in range(_MOST_ROUNDS):
        if not len(pairs):
            break
        for guilty in [number[rows] for rows in _clusters(facets, pairs)]:
            rows = np.flatnonzero(np.isin(number, guilty))
            # A patch beside it may have replaced or repaired these facets meanwhile.
            if len(rows) < len(guilty) or not len(crossings_of(points, facets, rows)):
                continue
            chosen = _least_moved(points, facets, rows, distance)
            if isinstance(chosen, float):
                known = guilty[guilty < num_given].tolist()
                position = points[facets[rows]].mean(axis=(0, 1))
                raise EntangledError(known, position, distance, chosen)
            count = len(chosen.facets) - len(chosen.kept)
            points, facets = chosen.points, chosen.facets
            number = np.concatenate([number[chosen.kept], np.arange(fresh, fresh + count)])
            fresh += count
        pairs = all_crossings(points, facets)
    if len(pairs):
        rows = np.unique(pairs)
        known = number[rows][number[rows] < num_given].tolist()
        raise EntangledError(known, points[facets[rows]].mean(axis=(0, 1)), distance, np.inf)
    if not report.num_pairs:
        return surface, report, number
    apart = distance_apart(surface.points, surface.facets, points, facets)
    moved = np.ones(num_given, dtype=bool)
    stays = number < num_given
    moved[number[stays]] = np.any(
        points[facets[stays]] != surface.points[surface.facets[number[stays]]], axis=(1, 2)
    )
    replaced = np.flatnonzero(moved)
    if apart > distance:
        position = surface.points[surface.facets[replaced]].mean(axis=(0, 1))
        raise EntangledError(replaced.tolist(), position, distance, apart)
    done = UntangleReport(
        report.num_pairs,
        report.num_regions,
        tuple(replaced.tolist()),
        apart,
        _euler(facets) - _euler(surface.facets),
    )
    return TriSurface(points, facets), done, np.where(stays, number, -1)


def _least_moved(
    points: Points, facets: Indices, rows: NDArray[np.int64], distance: float
) -> Attempt | float:
    """The way that moves the surface least; the distance needed [m] where that is too far."""
    is_cross = np.zeros(len(facets), dtype=bool)
    is_cross[rows] = True
    around = grow(facets, is_cross, _RINGS_AROUND)
    # All that a patch may come to: the work is in proportion to it, not to the organ.
    around[facets_near(points, facets, points[facets[around]].reshape(-1, 3), distance)] = True
    local = np.flatnonzero(around)
    used, some = np.unique(facets[local], return_inverse=True)
    some = some.reshape(-1, 3).astype(np.int32)
    is_fixed = np.zeros(len(points), dtype=bool)
    is_fixed[facets[~around]] = True
    part = Surroundings(points[used], some, is_fixed[used], _LARGEST_PART * len(facets))
    chosen = np.flatnonzero(is_cross[local])
    ways: tuple[Callable[[], Attempt | None], ...] = (
        lambda: smoothed(part, chosen),
        lambda: pulled_apart(part, chosen, outwards=False, most=distance),
        lambda: pulled_apart(part, chosen, outwards=True, most=distance),
        lambda: filled_anew(part, chosen),
    )
    best, least = None, np.inf
    for way in ways:
        attempt = way()
        if attempt is None:
            continue
        apart = distance_apart(part.points, part.facets, attempt.points, attempt.facets)
        if apart < least:
            best, least = attempt, apart
        if least <= _GOOD_ENOUGH * distance:
            break
    if best is None or least > distance:
        return float(least)
    moved = np.vstack([points, best.points[len(used) :]])
    moved[used] = best.points[: len(used)]
    back = np.concatenate([used, np.arange(len(points), len(moved))])
    gone = np.setdiff1d(local, local[best.kept])
    kept = np.setdiff1d(np.arange(len(facets)), gone)
    new = back[best.facets[len(best.kept) :]]
    return Attempt(moved, np.vstack([facets[kept], new]).astype(np.int32), kept)


def _clusters(facets: Indices, pairs: NDArray[np.int32]) -> list[NDArray[np.int64]]:
    """Facets that cross each other or share a point with others that do, in connected groups."""
    if not len(pairs):
        return []
    rows = np.unique(pairs)
    used, corner = np.unique(facets[rows], return_inverse=True)
    corner = corner.reshape(-1, 3) + len(rows)
    own = np.repeat(np.arange(len(rows)), 3)
    links = np.vstack([np.searchsorted(rows, pairs), np.column_stack([own, corner.reshape(-1)])])
    part = connected_parts(len(rows) + len(used), links)[: len(rows)]
    return [rows[part == k].astype(np.int64) for k in np.unique(part)]


def _euler(facets: Indices) -> int:
    """Euler's characteristic of a closed surface: 2 for each shell, less 2 for each handle."""
    return len(np.unique(facets)) - len(facets) // 2
