"""What a repair has done to each part of a surface, and which of it is more than was allowed.

A part is what hangs together by edges of two facets; open patches that meet at other edges belong
together. Distances are upper bounds, of both surfaces from each other, measured on what differs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.fastsim import _core
from palpate.meshes.arrays import Floats, Indices, Integers, Mask, Points
from palpate.meshes.repair.choices import FUSES, RepairChoices
from palpate.meshes.repair.surface_repair import RepairReport
from palpate.meshes.tri_surface import SurfaceError, TriSurface
from palpate.meshes.triangles import (
    connected_parts,
    edge_uses,
    facet_areas,
    facet_parts,
    parts_by_plain_edges,
    side_lengths,
)

# Default distance by which a part may move, over its mean edge.
EDGES = 0.5
# Accuracy of distances, over the mean edge, beside a hundredth of themselves.
_ACCURACY = 1e-3
# Rows of the table at most: the parts that changed most.
_MOST_ROWS = 20


@dataclass(frozen=True)
class Measure:
    """Facets, volume [m3], area [m2], shells and handles of a part; handles None where open."""

    facets: int
    volume: float
    area: float
    shells: int
    genus: int | None


@dataclass(frozen=True)
class PartChange:
    """A part before and after a repair.

    Attributes:
        parts: Its number, by the first facet; several where open parts are joined, or bodies fused.
        before, after: Its measures; the volume is that of the closed part both times.
        distance: Largest distance of either surface from the other [m], an upper bound; caps, and
            what was removed as thin or by choice, aside.
        mean_edge: Of the given part [m].
        position: Its middle, or where it moved most [m].
        is_fused: Whether bodies that were closed each are one now.
        is_turned: Whether a body has become a cavity.
    """

    parts: tuple[int, ...]
    before: Measure
    after: Measure
    distance: float
    mean_edge: float
    position: tuple[float, float, float]
    is_fused: bool
    is_turned: bool

    @property
    def volume_change(self) -> float:
        """Change of the volume over the volume before, in per cent."""
        change = abs(abs(self.after.volume) - abs(self.before.volume))
        if change == 0.0:
            return 0.0
        # Of nothing, everything is new.
        return 100.0 * change / (abs(self.before.volume) or change)

    @property
    def is_lost(self) -> bool:
        """Whether nothing is left of it."""
        return self.after.facets == 0

    @property
    def needed_limit(self) -> float:
        """Smallest limit that allows it, in per cent; 100 where it is lost, fused or a cavity."""
        is_other = self.is_lost or self.is_fused or self.is_turned
        return max(FUSES, self.volume_change) if is_other else self.volume_change


class ChangedPartError(SurfaceError):
    """A repair that changes parts by more than was allowed.

    `.changes` holds those parts, `.all_changes` the others too.
    """

    def __init__(self, changes: Sequence[PartChange], choices: RepairChoices) -> None:
        beyond = [one for one in changes if not is_within(one, choices)]
        self.changes, self.all_changes = beyond, list(changes)
        worst = max(beyond, key=lambda one: (one.needed_limit, one.distance))
        at = ", ".join(f"{x:.6g}" for x in worst.position)
        name = " and ".join(map(str, worst.parts[:4]))
        if worst.is_lost:
            what = "would be lost"
        elif worst.is_fused:
            what = "would be fused"
        elif worst.is_turned:
            what = "lies within another and would become a cavity"
        else:
            what = (
                f"would change by {round_up(worst.volume_change):.3g} % of its volume and by up to "
                f"{round_up(worst.distance):.3g} m"
            )
        ways = []
        limit = max(one.needed_limit for one in changes)
        if limit > choices.limit:
            ways.append(f"a repair limit of {round_up(limit):.4g} %")
        if any(one.distance > allowed(one, choices) for one in beyond):
            # A stated distance is for all parts, also for those with longer edges.
            reach = max(one.distance for one in changes)
            ways.append(f"a repair distance of {round_up(reach):.4g} m")
        super().__init__(
            f"the repair goes too far in {len(beyond)} part(s): part {name}, "
            f"{worst.before.facets} facet(s) around ({at}) m, {what}"
        )
        self.hint = f"{' and '.join(ways)} would allow it"
        self.args = (f"{self.summary}; {self.hint}",)


def round_up(value: float) -> float:
    """The next larger number of three digits, so that it suffices when it is typed."""
    if not 0.0 < value < math.inf or float(f"{value:.3g}") == value:
        return value
    digit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{(math.floor(value / digit) + 1) * digit:.3g}")


def allowed(change: PartChange, choices: RepairChoices) -> float:
    """How far a part may move [m]."""
    return EDGES * change.mean_edge if choices.distance is None else choices.distance


def is_within(change: PartChange, choices: RepairChoices) -> bool:
    """Whether a change is allowed."""
    return change.needed_limit <= choices.limit and change.distance <= allowed(change, choices)


def require_within(changes: Sequence[PartChange], choices: RepairChoices) -> None:
    """Refuse changes beyond what was allowed.

    Raises:
        ChangedPartError: With the worst part, its place, and the options that would allow it.
    """
    if not all(is_within(one, choices) for one in changes):
        raise ChangedPartError(changes, choices)


def measure_changes(
    given: TriSurface,
    report: RepairReport,
    repaired: TriSurface,
    new: TriSurface,
    number: Integers,
) -> list[PartChange]:
    """Measure what became of each part of a surface.

    Args:
        given: The surface before.
        report: What `repair_surface` did to it.
        repaired: What that made of it: the holes of open parts are closed by its caps.
        new: The surface after, closed.
        number: Facet of `repaired` of each facet of `new`, or -1, shape (num_new,).
    """
    merged = report.merged
    assert merged is not None
    is_turned = np.isin(report.merged_sources, report.turned_facets)
    old = merged.facets.copy()
    old[is_turned] = old[is_turned][:, ::-1]
    part, is_closed = find_parts(old)
    num_parts = len(is_closed)
    of_given = np.full(given.num_facets, -1)
    of_given[report.merged_sources] = part
    gone = np.zeros(given.num_facets, dtype=bool)
    gone[[*report.fin_facets, *report.loose_facets, *report.dropped_facets]] = True
    stays = ~gone[report.merged_sources]
    # What hangs together: parts, shells of the repaired surface, and those of the new one.
    shell, last = facet_parts(repaired.facets), facet_parts(new.facets)
    num_shells, num_last = int(shell.max(initial=-1)) + 1, int(last.max(initial=-1)) + 1
    known, known_new = report.sources >= 0, number >= 0
    first = np.column_stack([of_given[report.sources[known]], num_parts + shell[known]])
    second = num_parts + np.column_stack([shell[number[known_new]], num_shells + last[known_new]])
    group = connected_parts(
        num_parts + num_shells + num_last,
        np.vstack([first, second]),
    )
    of_part, of_shell, of_last = np.split(group, [num_parts, num_parts + num_shells])
    source = np.append(report.sources, -1)[number]
    ends = np.unique(np.column_stack([of_given[source], last])[source >= 0], axis=0)
    num_closed = np.bincount(ends[:, 1], is_closed[ends[:, 0]], minlength=num_last)
    is_cap = np.append(~known, False)[number]
    edge = float(side_lengths(given.points[given.facets]).mean())
    far, back = distances_apart(given, new, _ACCURACY * edge, ~gone, is_cap)
    changes = []
    for some in np.unique(of_part[part[stays]]):
        rows = stays & (of_part[part] == some)
        mine = ~gone & (of_given >= 0) & (of_part[of_given] == some)
        after = of_last[last] == some
        inside = measure(repaired.points, repaired.facets[of_shell[shell] == some])
        moved = np.concatenate([far[mine], back[after]])
        places = np.vstack([given.points[given.facets[mine]], new.points[new.facets[after]]])
        # Where it moved most, or its middle.
        where = places[[np.argmax(moved)]] if moved.max(initial=0.0) > 0.0 else places
        changes.append(
            PartChange(
                tuple((np.flatnonzero(of_part == some) + 1).tolist()),
                replace(measure(merged.points, old[rows]), volume=inside.volume),
                measure(new.points, new.facets[after]),
                float(moved.max(initial=0.0)),
                float(side_lengths(merged.points[old[rows]]).mean()),
                tuple(where.mean(axis=(0, 1)).tolist()),
                bool((num_closed[of_last == some] > 1).any()),
                bool(inside.volume < 0.0 and is_turned[rows].mean() > 0.5),
            )
        )
    return changes


def find_parts(facets: Indices) -> tuple[Integers, Mask]:
    """Part of each facet, and whether each part is closed by itself; see the module."""
    uses = edge_uses(facets)
    patch = parts_by_plain_edges(uses)
    sign = np.where(uses.directed[:, 0] < uses.directed[:, 1], 1, -1)
    keys, row = np.unique(
        patch[uses.owner] * np.int64(len(uses.counts)) + uses.edge, return_inverse=True
    )
    is_open = np.zeros(int(patch.max(initial=-1)) + 1, dtype=bool)
    balance = np.bincount(row.reshape(-1), sign)
    of_key = keys // len(uses.counts)
    is_open[of_key[balance != 0.0]] = True
    own = is_open[patch[uses.owner]]
    order = uses.by_edge[own[uses.by_edge]]
    same = uses.edge[order][1:] == uses.edge[order][:-1]
    owners = patch[uses.owner[order]]
    part = connected_parts(len(is_open), np.column_stack([owners[:-1], owners[1:]])[same])
    is_closed = np.ones(int(part.max(initial=-1)) + 1, dtype=bool)
    is_closed[part[is_open]] = False
    return part[patch], is_closed


def measure(points: Points, facets: Indices) -> Measure:
    """Measures of some facets; rims are closed by fans around their middles for the volume."""
    if not len(facets):
        return Measure(0, 0.0, 0.0, 0, None)
    corners = points[facets]
    origin = corners.mean(axis=(0, 1))
    local = points - origin
    a, b, c = (local[facets[:, k]] for k in range(3))
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0
    uses = edge_uses(facets)
    sign = np.where(uses.directed[:, 0] < uses.directed[:, 1], 1.0, -1.0)
    balance = np.bincount(uses.edge, sign)
    rim = np.flatnonzero(balance != 0.0)
    if len(rim):
        used, ends = np.unique(uses.edges[rim], return_inverse=True)
        ends = ends.reshape(-1, 2)
        loop = connected_parts(len(used), ends)
        middle = np.zeros((int(loop.max()) + 1, 3))
        np.add.at(middle, loop, local[used])
        middle /= np.bincount(loop)[:, None]
        start, end = local[uses.edges[rim, 0]], local[uses.edges[rim, 1]]
        # The fan runs along each edge the other way.
        cones = np.einsum("ij,ij->i", middle[loop[ends[:, 0]]], np.cross(end, start))
        volume += float((balance[rim] * cones).sum()) / 6.0
    shells = int(facet_parts(facets, uses).max()) + 1
    genus = None
    if np.all(uses.counts == 2):
        genus = shells - (len(np.unique(facets)) - len(facets) // 2) // 2
    return Measure(len(facets), volume, float(facet_areas(corners).sum()), shells, genus)


def distances_apart(
    given: TriSurface, new: TriSurface, accuracy: float, counts: Mask, is_cap: Mask
) -> tuple[Floats, Floats]:
    """Largest distance of each facet of either surface from the other [m], upper bounds.

    0 for facets that both have, given ones that do not count, and caps.
    """
    old, made = _corners(given), _corners(new)
    _, inverse = np.unique(np.vstack([old, made]), axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    there = counts & ~np.isin(inverse[: len(old)], inverse[len(old) :])
    back = ~np.isin(inverse[len(old) :], inverse[: len(old)])
    back &= ~is_cap
    found = []
    for one, other, rows in ((given, new, there), (new, given, back)):
        far = np.zeros(one.num_facets)
        if rows.any() and other.num_facets:
            tree = _core.SurfaceDistance(other.points, other.facets)
            some = np.ascontiguousarray(one.facets[rows])
            far[rows] = tree.farthest(one.points, some, accuracy)
        found.append(far)
    return found[0], found[1]


def _corners(surface: TriSurface) -> Points:
    """Corners of facets in ascending order of their positions, (num_facets, 9)."""
    positions, number = np.unique(surface.points + 0.0, axis=0, return_inverse=True)
    rows: Points = positions[np.sort(number.reshape(-1)[surface.facets], axis=1)].reshape(-1, 9)
    return rows


def table(changes: Sequence[PartChange], unit: str, scale: float) -> list[str]:
    """The parts before and after, those that changed most first; `scale` is metres per unit."""

    def number(value: float, power: int) -> str:
        return f"{value / scale**power:.4g}"

    rows = [
        [
            "part", "facets", f"volume [{unit}3]", f"area [{unit}2]", f"moved [{unit}]", "parts",
            "handles",
        ]
    ]  # fmt: skip
    ranked = sorted(changes, key=lambda one: (-one.needed_limit, -one.distance, one.parts))
    changed = [one for one in ranked if one.needed_limit > 1e-9 or one.distance > 0.0]
    for one in changed[:_MOST_ROWS]:
        x, y = one.before, one.after
        genus = ["open" if g is None else str(g) for g in (x.genus, y.genus)]
        rows.append(
            [
                "+".join(map(str, one.parts[:3])) + ("+..." if len(one.parts) > 3 else ""),
                f"{x.facets} > {y.facets}",
                f"{number(x.volume, 3)} > {number(y.volume, 3)}",
                f"{number(x.area, 2)} > {number(y.area, 2)}",
                number(round_up(one.distance), 1),
                f"{x.shells} > {y.shells}",
                " > ".join(genus),
            ]
        )
    if len(rows) == 1:
        return []
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(c.ljust(w) for c, w in zip(r, widths, strict=True)).rstrip() for r in rows]
    left = len(changes) - len(rows) + 1
    return [*lines, f"{left} other part(s) unchanged or less changed"] if left else lines
