"""Repairs of a surface that are safe, each of them reported: nothing is dropped in silence."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices
from palpate.meshes.errors import DegenerateFacetError, NonManifoldError, OrientationError
from palpate.meshes.facet_topology import connected_parts, edge_uses
from palpate.meshes.hole_filling import fill_loop, find_hole_loops
from palpate.meshes.near_duplicates import find_near_duplicates
from palpate.meshes.shells import ShellKind, find_shells
from palpate.meshes.surface_checks import merge_equal_points
from palpate.meshes.tri_surface import TriSurface

# A hole with more edges is more likely a missing part than a missing facet.
SMALL_HOLE = 12


@dataclass
class RepairReport:
    """What was done; all zero or empty where there was nothing to do.

    Attributes:
        merged_points: Points merged into a near one.
        dropped_facets: Facets, by their number before, that the merging made flat, or copies.
        turned_facets: Facets, by their number before, whose orientation was changed.
        filled_holes: Points of the loops that were closed, numbered as after.
        open_holes: Points of the loops that were left open, numbered as after.
        unused_points: Points, by their number before, that no facet used.
    """

    merged_points: int = 0
    dropped_facets: list[int] = field(default_factory=list)
    turned_facets: list[int] = field(default_factory=list)
    filled_holes: list[list[int]] = field(default_factory=list)
    open_holes: list[list[int]] = field(default_factory=list)
    unused_points: list[int] = field(default_factory=list)

    def lines(self) -> list[str]:
        """One line for each kind of change, for people."""
        holes = sum(len(loop) - 2 for loop in self.filled_holes)
        said = (
            (self.unused_points, f"{len(self.unused_points)} point(s) without a facet left out"),
            (self.merged_points, f"{self.merged_points} point(s) merged into a near one"),
            (self.dropped_facets, f"{len(self.dropped_facets)} flat or repeated facet(s) dropped"),
            (self.turned_facets, f"{len(self.turned_facets)} facet(s) turned round"),
            (self.filled_holes, f"{len(self.filled_holes)} hole(s) closed by {holes} facet(s)"),
            (
                self.open_holes,
                f"{len(self.open_holes)} hole(s) left open: {[len(h) for h in self.open_holes]} "
                f"edges, or loops that touch (holes of up to {SMALL_HOLE} edges are closed)",
            ),
        )
        return [line for what, line in said if what]


def repair_surface(
    surface: TriSurface, *, near: float | None = None, largest_hole: int = SMALL_HOLE
) -> tuple[TriSurface, RepairReport]:
    """Merge near points, orient facets and shells, close small holes; say what was done.

    Whether the result bounds a solid is for `require_closed` to say. Parts are never dropped;
    self-intersections are not mended.

    Args:
        surface: Any surface.
        near: Points within this distance are merged [m]; None takes 1e-6 of the longest side of
            the bounding box.
        largest_hole: Most edges of a hole that is closed.

    Raises:
        DegenerateFacetError: Merging within `near` would make a whole part flat.
        NonManifoldError: More than two facets at an edge; which belong together is not known.
        OrientationError: A one-sided part (a Moebius band) has no outside.
    """
    report = RepairReport()
    used = np.unique(surface.facets)
    report.unused_points = np.setdiff1d(np.arange(len(surface.points)), used).tolist()
    facets, kept = _merge_points(surface, near, report)
    facets, turned = _orient_parts(facets)
    facets = _close_holes(surface, facets, largest_hole, report)
    facets, shells_turned = _orient_shells(TriSurface(surface.points, facets))
    flips = shells_turned.copy()
    flips[: len(kept)] ^= turned
    report.turned_facets = kept[flips[: len(kept)]].tolist()
    compact = merge_equal_points(TriSurface(surface.points, facets))
    # merge_equal_points numbers points by first appearance: say the loops in those numbers.
    number = {}
    for old, new in zip(
        facets.reshape(-1).tolist(), compact.facets.reshape(-1).tolist(), strict=True
    ):
        number[old] = new
    for loops in (report.filled_holes, report.open_holes):
        loops[:] = [[number[v] for v in loop] for loop in loops]
    return compact, report


def _merge_points(
    surface: TriSurface, near: float | None, report: RepairReport
) -> tuple[Indices, NDArray[np.int64]]:
    """Facets on merged points without flat ones and copies, and their numbers before."""
    pairs = find_near_duplicates(surface.points, near)
    target = connected_parts(len(surface.points), pairs)
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
    stays[np.unique(key, axis=0, return_index=True)[1]] = True
    stays &= ~is_flat
    report.dropped_facets = np.flatnonzero(~stays).tolist()
    return facets[stays], np.flatnonzero(stays)


def _orient_parts(facets: Indices) -> tuple[Indices, NDArray[np.bool_]]:
    """Turn facets so that neighbours agree; the first facet of each part stays as it is."""
    uses = edge_uses(facets)
    if np.any(uses.counts > 2):
        guilty = np.unique(uses.owner[uses.counts[uses.edge] > 2])
        edges = uses.edges[uses.counts > 2]
        raise NonManifoldError(guilty.tolist(), edges=[(int(a), int(b)) for a, b in edges])
    order = np.argsort(uses.edge, kind="stable")
    same = uses.edge[order][1:] == uses.edge[order][:-1]
    first, second = order[:-1][same], order[1:][same]
    disagree = uses.directed[first, 0] == uses.directed[second, 0]
    beside: list[list[tuple[int, bool]]] = [[] for _ in facets]
    for f, g, d in zip(
        uses.owner[first].tolist(), uses.owner[second].tolist(), disagree.tolist(), strict=True
    ):
        beside[f].append((g, d))
        beside[g].append((f, d))
    turned = np.full(len(facets), -1)
    for start in range(len(facets)):
        if turned[start] >= 0:
            continue
        turned[start] = 0
        queue = deque([start])
        while queue:
            f = queue.popleft()
            for g, d in beside[f]:
                wanted = turned[f] ^ d
                if turned[g] < 0:
                    turned[g] = wanted
                    queue.append(g)
                elif turned[g] != wanted:
                    raise OrientationError(
                        f"the part of the surface around facets {f} and {g} is one-sided: no way "
                        "to turn its facets makes neighbours agree; separate it there",
                        [f, g],
                    )
    is_turned = turned == 1
    out = facets.copy()
    out[is_turned] = out[is_turned][:, ::-1]
    return out, is_turned


def _close_holes(
    surface: TriSurface, facets: Indices, largest_hole: int, report: RepairReport
) -> Indices:
    loops, tangled = find_hole_loops(facets)
    if tangled:
        report.open_holes.append(tangled)
    taken = set(map(tuple, edge_uses(facets).edges.tolist()))
    new = []
    for loop in loops:
        filling = fill_loop(surface.points, loop, taken) if len(loop) <= largest_hole else None
        if filling is None:
            report.open_holes.append(loop)
            continue
        taken.update(map(tuple, edge_uses(filling).edges.tolist()))
        report.filled_holes.append(loop)
        new.append(filling)
    return np.vstack([facets, *new]).astype(np.int32)


def _orient_shells(surface: TriSurface) -> tuple[Indices, NDArray[np.bool_]]:
    """Turn closed shells to face as their nesting asks; open parts stay."""
    facets = surface.facets.copy()
    is_turned = np.zeros(len(facets), dtype=bool)
    if np.any(edge_uses(facets).counts != 2):
        return facets, is_turned
    for shell in find_shells(surface):
        if (shell.volume < 0.0) != (shell.kind is ShellKind.CAVITY):
            facets[shell.facets] = facets[shell.facets][:, ::-1]
            is_turned[shell.facets] = True
    return facets, is_turned
