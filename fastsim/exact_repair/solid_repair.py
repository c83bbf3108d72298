"""Repair of a surface until it bounds a solid: all repairs in their order, each reported."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.exact_repair.part_changes import (
    EDGES,
    ChangedPartError,
    PartChange,
    distances_apart,
    measure,
    measure_changes,
    require_within,
    round_up,
)
from palpate.fastsim.exact_repair.patch_repairs import (
    MOST_PAIRS,
    Attempt,
    Surroundings,
    all_crossings,
    crossings_of,
    facets_near,
    filled_anew,
    is_clean,
    pulled_apart,
    pushed_back,
    smoothed,
)
from palpate.fastsim.exact_repair.union import (
    INSTALL,
    United,
    bodies_that_meet,
    is_available,
    unite,
)
from palpate.meshes.arrays import Indices, Points
from palpate.meshes.percent import Percent
from palpate.meshes.repair.choices import FUSES, LIMIT, RepairChoices
from palpate.meshes.repair.patches import grow
from palpate.meshes.repair.surface_repair import RepairReport, repair_surface
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.tri_surface import OpenSurfaceError, SurfaceError, TriSurface
from palpate.meshes.triangles import connected_parts, facet_parts, side_lengths


@dataclass(frozen=True, eq=False)
class RepairedSolid:
    """A surface, a line for each repair, its parts before and after, and facets of its caps.

    "cap 1" closes the longest loop.
    """

    surface: TriSurface
    lines: list[str] = field(default_factory=list)
    caps: dict[str, list[int]] = field(default_factory=dict)
    changes: list[PartChange] = field(default_factory=list)


def repair_to_solid(
    surface: TriSurface,
    choices: RepairChoices | None = None,
    progress: Callable[[str], None] | None = None,
) -> RepairedSolid:
    """Make a surface [m] bound a solid without crossings, within what was chosen.

    `progress` is called with the part that is done, in per cent, after two seconds.

    Raises:
        ChangedPartError: A part would be lost, fused, or changed by more than was chosen.
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
    first = None
    # Who lets parts be fused wants bodies that run into each other united, not pulled apart.
    united = unite(repaired) if choices.limit >= FUSES else None
    for start in (united, None) if united is not None else (None,):
        try:
            return _finished(surface, report, repaired, start, choices, progress)
        except SurfaceError as error:
            first = first or error
    assert first is not None
    if choices.limit < FUSES:
        _suggest_union(first, surface, report, repaired)
    raise first


def _finished(
    surface: TriSurface,
    report: RepairReport,
    repaired: TriSurface,
    united: United | None,
    choices: RepairChoices,
    progress: Callable[[str], None] | None,
) -> RepairedSolid:
    """Untangle what has been repaired, or united besides, and require it to be within limits."""
    lines = report.lines()
    start = repaired if united is None else united.surface
    solid, done, number = untangle(start, Percent(progress))
    if united is not None:
        lines.append(united.line())
        number = np.append(united.number, -1)[number]
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
    changes = measure_changes(surface, report, repaired, solid, number)
    try:
        require_within(changes, choices)
    except ChangedPartError as error:
        error.done = lines
        raise
    return RepairedSolid(solid, lines, caps, changes)


def _suggest_union(
    error: SurfaceError, surface: TriSurface, report: RepairReport, repaired: TriSurface
) -> None:
    """Say what would unite bodies that run into each other, where some do."""
    if np.all(bodies_that_meet(repaired) < 0):
        return
    united = unite(repaired)
    if united is None:
        if is_available():
            return
        said = f"{INSTALL}, then a repair limit of {FUSES:g} %"
    else:
        said = f"a repair limit of {FUSES:g} %"
        try:
            _finished(surface, report, repaired, united, RepairChoices(limit=FUSES), None)
        except ChangedPartError as beyond:
            # A stated distance is for all parts, also for those with longer edges.
            reach = max(one.distance for one in beyond.all_changes)
            said += f" and a repair distance of {round_up(reach):.4g} m"
        except SurfaceError:
            return
    said += " unites bodies that run into each other"
    error.hint = f"{error.hint}; {said}" if error.hint else said
    error.args = (f"{error}; {said}",)


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
# Each region where facets cross is a patch by itself. Of four ways the one that moves the surface
# least is taken: the patch and some rings around it are bent like a thin plate; what pierces a
# facet is pushed back through it; the patch's points are pulled along their normals; or its facets
# are removed and the holes filled anew (Attene 2010, "A lightweight approach to repairing digitized
# polygon meshes", does the last). What is left behind
# has no crossing by the exact test.


# Number of further attempts at patches that cross others again after their repair.
_MOST_ROUNDS = 6
# Number of rings of facets around crossing ones that belong to a patch.
_RINGS_AROUND = 12
# Largest fraction of the surface's facets in a patch: beyond that it is the organ itself.
_LARGEST_PART = 0.3
# How far facets are pulled at most, over the mean edge of those that cross.
_FARTHEST = 2.0
# A way that costs less than this of what is allowed needs no comparison.
_GOOD_ENOUGH = 0.2
# Facets looked at in all attempts; some 10 s.
_MOST_WORK = 400_000


class EntangledError(SurfaceError):
    """Crossings that could not be repaired; `.facets` holds them."""

    def __init__(self, facets: list[int], position: Points, why: str) -> None:
        at = ", ".join(f"{x:.6g}" for x in position)
        first = ", ".join(map(str, facets[:5]))
        super().__init__(
            f"the surface intersects itself and could not be repaired ({why}), at {len(facets)} "
            f"facet(s), first {first}, around ({at}) m",
            facets,
            detail="; repair it by hand, or wrap it anew",
        )


@dataclass(frozen=True)
class UntangleReport:
    """What `untangle` has done.

    Attributes:
        num_pairs: Pairs of facets that crossed.
        num_regions: Number of regions where they did.
        replaced_facets: Facets that were moved or replaced, by their number before.
        euler_change: Change of Euler's characteristic: 2 for each bridge cut or shell made.
    """

    num_pairs: int = 0
    num_regions: int = 0
    replaced_facets: tuple[int, ...] = ()
    euler_change: int = 0

    def line(self) -> str:
        """Report in one line."""
        bridges = self.euler_change // 2
        cut = f"; {bridges} handle(s) or bridge(s) between sheets cut" if bridges else ""
        return (
            f"{self.num_pairs} pair(s) of facets that cut each other in {self.num_regions} "
            f"region(s) repaired: {len(self.replaced_facets)} facet(s) moved or replaced{cut}"
        )


def untangle(
    surface: TriSurface, percent: Percent | None = None
) -> tuple[TriSurface, UntangleReport, NDArray[np.int64]]:
    """Repair a closed, consistently oriented surface where it cuts itself.

    Returns a surface without crossings, what was done, and of each facet its number before, or -1
    of a new one, shape (num_facets,). How far it has moved is for the caller to measure.

    Raises:
        EntangledError: No way was found.
    """
    points, facets = surface.points, surface.facets
    # Numbers that stay with facets; new ones count on.
    number = np.arange(len(facets))
    num_given = fresh = len(facets)
    pairs = all_crossings(points, facets)
    report = UntangleReport(len(pairs), len(_clusters(facets, pairs)))
    work = 0

    def give_up(rows: NDArray[np.int64], why: str) -> EntangledError:
        known = number[rows][number[rows] < num_given].tolist()
        return EntangledError(known, points[facets[rows]].mean(axis=(0, 1)), why)

    if len(pairs) >= MOST_PAIRS:
        raise give_up(np.unique(pairs), f"{len(pairs)} pairs of facets or more")
    for count in range(1, _MOST_ROUNDS + 1):
        if not len(pairs):
            break
        places = [number[rows] for rows in _clusters(facets, pairs)]
        for place, guilty in enumerate(places):
            if percent is not None:
                stage = f"repairing {len(places)} place(s) where facets cross, round {count}"
                percent(stage, place / len(places))
            rows = np.flatnonzero(np.isin(number, guilty))
            # A patch beside it may have replaced or repaired these facets meanwhile.
            if len(rows) < len(guilty) or not len(crossings_of(points, facets, rows)):
                continue
            if work > _MOST_WORK:
                raise give_up(rows, "too many places, or too large ones")
            chosen, looked_at = _least_moved(points, facets, rows)
            work += looked_at
            if chosen is None:
                raise give_up(rows, "no way leaves it without crossings")
            count = len(chosen.facets) - len(chosen.kept)
            points, facets = chosen.points, chosen.facets
            number = np.concatenate([number[chosen.kept], np.arange(fresh, fresh + count)])
            fresh += count
        pairs = all_crossings(points, facets)
    if len(pairs):
        raise give_up(np.unique(pairs), f"not in {_MOST_ROUNDS} rounds")
    if not report.num_pairs:
        return surface, report, number
    moved = np.ones(num_given, dtype=bool)
    stays = number < num_given
    moved[number[stays]] = np.any(
        points[facets[stays]] != surface.points[surface.facets[number[stays]]], axis=(1, 2)
    )
    done = UntangleReport(
        report.num_pairs,
        report.num_regions,
        tuple(np.flatnonzero(moved).tolist()),
        _euler(facets) - _euler(surface.facets),
    )
    return TriSurface(points, facets), done, np.where(stays, number, -1)


def _least_moved(
    points: Points, facets: Indices, rows: NDArray[np.int64]
) -> tuple[Attempt | None, int]:
    """The way that changes the surface least, and how many facets were looked at."""
    is_cross = np.zeros(len(facets), dtype=bool)
    is_cross[rows] = True
    most = _FARTHEST * float(side_lengths(points[facets[rows]]).mean())
    around = grow(facets, is_cross, _RINGS_AROUND)
    # All that a patch may come to: the work is in proportion to it, not to the organ.
    around[facets_near(points, facets, points[facets[around]].reshape(-1, 3), most)] = True
    local = np.flatnonzero(around)
    used, some = np.unique(facets[local], return_inverse=True)
    some = some.reshape(-1, 3).astype(np.int32)
    is_fixed = np.zeros(len(points), dtype=bool)
    is_fixed[facets[~around]] = True
    part = Surroundings(points[used], some, is_fixed[used], _LARGEST_PART * len(facets))
    chosen = np.flatnonzero(is_cross[local])
    ways: tuple[Callable[[], Attempt | None], ...] = (
        lambda: smoothed(part, chosen),
        lambda: pushed_back(part, chosen, most=most),
        lambda: pulled_apart(part, chosen, outwards=False, most=most, with_islands=False),
        lambda: pulled_apart(part, chosen, outwards=True, most=most, with_islands=False),
        lambda: pulled_apart(part, chosen, outwards=False, most=most),
        lambda: pulled_apart(part, chosen, outwards=True, most=most),
        lambda: filled_anew(part, chosen),
    )
    best, least = None, np.inf
    work = 0
    for way in ways:
        work += len(local)
        attempt = way()
        if attempt is None:
            continue
        cost = _cost(part, attempt)
        if cost < least:
            best, least = attempt, cost
        if least <= _GOOD_ENOUGH:
            break
    if best is None:
        return None, work
    moved = np.vstack([points, best.points[len(used) :]])
    moved[used] = best.points[: len(used)]
    back = np.concatenate([used, np.arange(len(points), len(moved))])
    gone = np.setdiff1d(local, local[best.kept])
    kept = np.setdiff1d(np.arange(len(facets)), gone)
    new = back[best.facets[len(best.kept) :]]
    return Attempt(moved, np.vstack([facets[kept], new]).astype(np.int32), kept), work


def _cost(part: Surroundings, attempt: Attempt) -> float:
    """The largest change of a patch's surroundings over what a repair may do, see `RepairChoices`.

    The larger of the distance of both surfaces over half a mean edge, and of each shell's change of
    volume over its limit.
    """
    before = TriSurface(part.points, part.facets)
    after = TriSurface(attempt.points, attempt.facets)
    edge = EDGES * float(side_lengths(part.points[part.facets]).mean())
    all_of, no_cap = np.ones(len(part.facets), bool), np.zeros(len(attempt.facets), bool)
    far = distances_apart(before, after, 0.01 * edge, all_of, no_cap)
    cost = max(far[0].max(initial=0.0), far[1].max(initial=0.0)) / edge
    shell, new = facet_parts(part.facets), facet_parts(attempt.facets)
    of_new = np.full(int(new.max(initial=-1)) + 1, -1)
    of_new[new[: len(attempt.kept)]] = shell[attempt.kept]
    for number in np.unique(shell):
        was = measure(part.points, part.facets[shell == number]).volume
        now = measure(attempt.points, attempt.facets[of_new[new] == number]).volume
        cost = max(cost, 100.0 * abs(now - was) / (LIMIT * abs(was) + np.finfo(float).tiny))
    return float(cost)


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
