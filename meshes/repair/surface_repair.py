"""Safe repairs of a surface; every change is reported."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from palpate.meshes.arrays import Indices, Integers, Mask
from palpate.meshes.repair.choices import LARGEST_HOLE
from palpate.meshes.repair.hole_filling import close_holes
from palpate.meshes.repair.patches import (
    SMALL,
    Fits,
    edges_of,
    loose_facets,
    orient_parts,
    part_sizes,
)
from palpate.meshes.repair.seams import cut_at_hanging_points, flip_flat_facets, rim_pairs
from palpate.meshes.repair.sheets import copied_sheets, double_walls, fins_of, split_touching
from palpate.meshes.shells import ShellKind, find_shells
from palpate.meshes.surface_checks import NEAR, find_near_duplicates
from palpate.meshes.tri_surface import (
    DegenerateFacetError,
    NonManifoldError,
    TriSurface,
)
from palpate.meshes.triangles import connected_parts, edge_uses


def _no_facets() -> Integers:
    return np.zeros(0, dtype=np.int64)


@dataclass
class RepairReport:
    """What a repair has done; all zero or empty where there was nothing to do.

    Attributes:
        merged_points: Points merged into a near one.
        cut_edges: Open edges cut at points of other open edges that lie on them.
        dropped_facets: Facets, by their number before, that merging made flat, or copies.
        fin_facets: Facets, by their number before, of fins, of walls between bodies that
            touch, of open sheets that copy another, and of parts too small to close.
        loose_facets: Facets, by their number before, of parts dropped by choice.
        flipped_edges: Edges across facets without area, flipped.
        split_points: Points at which sheets touched, each now a point of its own for each sheet.
        gap: Largest movement of the split points [m].
        turned_facets: Facets, by their number before, whose orientation was changed.
        filled_holes: Points of the loops that were closed, numbered as after.
        caps: Facets of the caps that close them, numbered as after, in the same order.
        open_holes: Points of the loops that were left open, numbered as after.
        small_parts: Longest sides of the boxes of small parts that remain [m].
        unused_points: Points, by their number before, that no facet used.
        merged: The surface with its points merged and edges cut, before all else.
        merged_sources: Number before of each facet of it.
        sources: Number before of each facet of the result; -1 in caps.
    """

    merged_points: int = 0
    cut_edges: int = 0
    dropped_facets: list[int] = field(default_factory=list)
    fin_facets: list[int] = field(default_factory=list)
    loose_facets: list[int] = field(default_factory=list)
    flipped_edges: int = 0
    split_points: int = 0
    gap: float = 0.0
    turned_facets: list[int] = field(default_factory=list)
    filled_holes: list[list[int]] = field(default_factory=list)
    caps: list[list[int]] = field(default_factory=list)
    open_holes: list[list[int]] = field(default_factory=list)
    small_parts: list[float] = field(default_factory=list)
    unused_points: list[int] = field(default_factory=list)
    merged: TriSurface | None = field(default=None, compare=False)
    merged_sources: Integers = field(default_factory=_no_facets, compare=False)
    sources: Integers = field(default_factory=_no_facets, compare=False)

    def lines(self) -> list[str]:
        """One line of text for each kind of change."""
        edges = [len(loop) for loop in self.filled_holes]
        left = [len(loop) for loop in self.open_holes]
        said = (
            (len(self.unused_points), "point(s) without a facet left out"),
            (self.merged_points, "point(s) merged into a near one"),
            (self.cut_edges, "open edge(s) cut at points that lie on them"),
            (len(self.dropped_facets), "flat or repeated facet(s) dropped"),
            (len(self.fin_facets), "facet(s) of thin fins, inner walls and scraps removed"),
            (len(self.loose_facets), "facet(s) of small loose parts dropped"),
            (self.flipped_edges, "edge(s) across flat facets flipped"),
            (
                self.split_points,
                f"point(s) where sheets touched split, moved by at most {self.gap:.3g} m",
            ),
            (len(self.turned_facets), "facet(s) turned round"),
            (
                len(edges),
                f"hole(s) closed by {sum(map(len, self.caps))} facet(s), of {_few(edges)} edges",
            ),
            (
                len(left),
                f"hole(s) left open, of {_few(left)} edges: longer than the largest hole to close, "
                "or no cap fits",
            ),
            (
                len(self.small_parts),
                "small loose part(s) kept, the largest "
                f"{max(self.small_parts, default=0.0):.3g} m long",
            ),
        )
        return [f"{count} {what}" for count, what in said if count]


def _few(numbers: list[int]) -> str:
    shown = ", ".join(map(str, sorted(numbers, reverse=True)[:5]))
    return shown if len(numbers) <= 5 else f"{shown}, ..."


def repair_surface(
    surface: TriSurface,
    *,
    near: float | None = None,
    largest_hole: int = LARGEST_HOLE,
    smallest_shell: float = 0.0,
    fits: Fits | None = None,
) -> tuple[TriSurface, RepairReport]:
    """Merge points, join seams, cut fins, separate sheets, turn facets, close holes, and report it.

    Whether the result bounds a solid is checked by `require_closed`. Parts are dropped only by
    choice; self-intersections are repaired by `palpate.fastsim.exact_repair`.

    Args:
        surface: Any surface.
        near: Points within this distance are merged [m]; None takes 1e-6 of the longest side of
            each part's box. Along open edges it is a hundredth of the shortest edge as well.
        largest_hole: See `RepairChoices`.
        smallest_shell: See `RepairChoices`.
        fits: Whether points and facets have no crossing at the marked facets; chooses caps and
            gaps. None takes the first of them unchecked.

    Raises:
        DegenerateFacetError: Merging within `near` would make a whole part flat.
        NonManifoldError: More than two facets at an edge, and no rule says which belong together.
        OrientationError: A one-sided part (a Moebius band) has no outside.
    """
    report = RepairReport()
    used = np.unique(surface.facets)
    report.unused_points = np.setdiff1d(np.arange(len(surface.points)), used).tolist()
    points = surface.points
    facets, kept, is_wall = _merge_points(surface, near, report)
    reach = NEAR * float(part_sizes(points, facets)[1].max()) if near is None else near
    facets, cut, report.cut_edges = cut_at_hanging_points(points, facets, reach)
    kept, is_wall = kept[cut], is_wall[cut]
    report.merged, report.merged_sources = TriSurface(points, facets), kept
    is_double = double_walls(points, facets)
    is_double |= copied_sheets(points, facets)
    report.fin_facets = kept[is_double].tolist()
    facets, kept, is_wall = facets[~is_double], kept[~is_double], is_wall[~is_double]
    is_fin = fins_of(points, facets, is_wall)
    report.fin_facets = np.union1d(report.fin_facets, kept[is_fin]).astype(int).tolist()
    facets, kept = facets[~is_fin], kept[~is_fin]
    is_loose = loose_facets(points, facets, smallest_shell)
    report.loose_facets = np.unique(kept[is_loose]).tolist()
    facets, kept = facets[~is_loose], kept[~is_loose]
    facets, turned = orient_parts(facets)
    points, facets, report.split_points, report.gap = split_touching(points, facets, fits)
    uses = edge_uses(facets)
    if np.any(uses.counts > 2):
        guilty = np.unique(uses.owner[uses.crowd > 2]).tolist()
        crowded = [(int(a), int(b)) for a, b in uses.edges[uses.counts > 2]]
        error = NonManifoldError(guilty, edges=crowded)
        error.surface, error.done = TriSurface(points, facets), report.lines()
        raise error
    facets, report.flipped_edges = flip_flat_facets(points, facets)
    closed = close_holes(points, facets, largest_hole=largest_hole, fits=fits)
    if np.all(edge_uses(closed.facets).counts == 2):
        # Caps close fans around points where other sheets go on.
        closed.points, closed.facets, count, gap = split_touching(
            closed.points, closed.facets, fits
        )
        report.split_points, report.gap = report.split_points + count, max(report.gap, gap)
    sizes = part_sizes(closed.points, closed.facets)[1]
    report.small_parts = sizes[sizes < SMALL * sizes.max(initial=0.0)].tolist()
    facets, shells_turned = _orient_shells(TriSurface(closed.points, closed.facets))
    flips = shells_turned.copy()
    flips[: len(kept)] ^= turned
    report.turned_facets = np.unique(kept[flips[: len(kept)]]).tolist()
    report.caps = closed.caps
    report.sources = np.concatenate([kept, np.full(len(facets) - len(kept), -1)])
    # Points in the order of their first appearance; the loops in those numbers.
    corners = facets.reshape(-1)
    found, first = np.unique(corners, return_index=True)
    order = found[np.argsort(first)]
    number = np.full(len(closed.points), -1)
    number[order] = np.arange(len(order))
    report.filled_holes = [number[loop].tolist() for loop in closed.filled]
    report.open_holes = [number[loop].tolist() for loop in closed.left_open]
    return TriSurface(closed.points[order], number[facets].astype(np.int32)), report


def _near_pairs(surface: TriSurface, near: float | None) -> Integers:
    """Pairs of points to merge, shape (num_pairs, 2); distances are of the part, not of the box."""
    points = surface.points
    if near is not None or not surface.num_facets:
        return find_near_duplicates(points, near)
    same = find_near_duplicates(points, 0.0)
    part = connected_parts(len(points), np.vstack([same, edges_of(surface.facets)]))
    low, high = np.full((2, part.max() + 1, 3), np.inf)
    np.minimum.at(low, part, points)
    np.minimum.at(high, part, -points)
    size = (-high - low).max(axis=1)
    pairs = find_near_duplicates(points, NEAR * float(size.max()))
    apart = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    near_enough: Integers = pairs[apart <= NEAR * size[part[pairs]].min(axis=1)]
    return near_enough


def _merge_points(
    surface: TriSurface, near: float | None, report: RepairReport
) -> tuple[Indices, Integers, Mask]:
    """Facets on merged points without flat ones and copies, their numbers before, and walls.

    A wall is a facet that is given twice, facing both ways.
    """
    pairs = _near_pairs(surface, near)
    target = connected_parts(len(surface.points), pairs)
    first = np.unique(target, return_index=True)[1]
    merged = first[target][surface.facets]
    is_whole = (merged != np.roll(merged, 1, axis=1)).all(axis=1)
    seams = rim_pairs(surface.points, merged[is_whole].astype(np.int32))
    if len(seams):
        target = connected_parts(len(surface.points), np.vstack([pairs, seams]))
        first = np.unique(target, return_index=True)[1]
    used = np.unique(surface.facets)
    report.merged_points = len(used) - len(np.unique(target[used]))
    facets = first[target][surface.facets].astype(np.int32)
    a, b, c = facets.T
    is_flat = (a == b) | (b == c) | (c == a)
    if is_flat.all() and len(facets):
        raise DegenerateFacetError(np.flatnonzero(is_flat).tolist())
    key = np.sort(facets, axis=1)
    # The first of equal facets stays.
    stays = np.zeros(len(facets), dtype=bool)
    _, first_of, same = np.unique(key, axis=0, return_index=True, return_inverse=True)
    stays[first_of] = True
    stays &= ~is_flat
    report.dropped_facets = np.flatnonzero(~stays).tolist()
    rank = np.argsort(facets, axis=1)
    is_even = (rank[:, 1] - rank[:, 0]) % 3 == 1
    both = np.bincount(same.reshape(-1), is_even) * np.bincount(same.reshape(-1), ~is_even) > 0
    return facets[stays], np.flatnonzero(stays), both[same.reshape(-1)][stays]


def _orient_shells(surface: TriSurface) -> tuple[Indices, Mask]:
    """Turn closed shells to face as their nesting requires; open parts stay."""
    facets = surface.facets.copy()
    is_turned = np.zeros(len(facets), dtype=bool)
    if np.any(edge_uses(facets).counts != 2):
        return facets, is_turned
    for shell in find_shells(surface):
        if (shell.volume < 0.0) != (shell.kind is ShellKind.CAVITY):
            facets[shell.facets] = facets[shell.facets][:, ::-1]
            is_turned[shell.facets] = True
    return facets, is_turned
