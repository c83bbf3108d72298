"""Shells, the closed parts of a surface, and their nesting: outer walls, cavities, inner bodies."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from palpate.meshes.arrays import Floats, Integers, Points
from palpate.meshes.tri_surface import OrientationError, TriSurface
from palpate.meshes.triangles import EdgeUses, facet_parts

# Facets times points per block: limits the memory of the solid angles to some 50 MB.
_BLOCK = 500_000


class ShellKind(StrEnum):
    """What a shell bounds: the outside, a cavity, or a body within a cavity."""

    OUTSIDE = "outside"
    CAVITY = "cavity"
    BODY_WITHIN_A_CAVITY = "body within a cavity"


@dataclass(frozen=True, eq=False)
class Shell:
    """One closed, connected part of a surface.

    Attributes:
        facets: Numbers of its facets in the surface.
        volume: Enclosed volume [m3]; < 0 if its facets point inwards.
        around: Numbers of the shells in which it lies.
        kind: By nesting: with an even number of shells around it, it is an outer wall.
    """

    facets: Integers
    volume: float
    around: tuple[int, ...]
    kind: ShellKind


def find_shells(surface: TriSurface, uses: EdgeUses | None = None) -> list[Shell]:
    """Divide a closed surface into shells and find which lies in which.

    Whether a shell lies in another is read from the other's winding number about one of its
    points (Van Oosterom, Strackee 1983): a whole number for shells that do not touch or cross,
    which is not checked here. `uses` is the table of the surface's edges, if known.
    """
    part = facet_parts(surface.facets, uses)
    members = [np.flatnonzero(part == k) for k in range(int(part.max(initial=-1)) + 1)]
    if len(members) == 1:
        return [Shell(members[0], surface.volume, (), ShellKind.OUTSIDE)]
    parts = [TriSurface(surface.points, surface.facets[rows]) for rows in members]
    corners = [surface.points[p.facets].reshape(-1, 3) for p in parts]
    low = np.array([c.min(axis=0) for c in corners]).reshape(-1, 3)
    high = np.array([c.max(axis=0) for c in corners]).reshape(-1, 3)
    probe = np.array([c[0] for c in corners]).reshape(-1, 3)
    around: list[list[int]] = [[] for _ in parts]
    for outer, wall in enumerate(parts):
        within = ((low >= low[outer]) & (high <= high[outer])).all(axis=1)
        within[outer] = False
        chosen = np.flatnonzero(within)
        turns = winding_numbers(wall, probe[chosen])
        for inner in chosen[np.abs(turns) > 0.5]:
            around[inner].append(outer)
    shells = []
    for rows, wall, outside in zip(members, parts, around, strict=True):
        kind = ShellKind.CAVITY if len(outside) % 2 else ShellKind.OUTSIDE
        if kind is ShellKind.OUTSIDE and outside:
            kind = ShellKind.BODY_WITHIN_A_CAVITY
        shells.append(Shell(rows, wall.volume, tuple(outside), kind))
    return shells


def require_nested(surface: TriSurface, uses: EdgeUses | None = None) -> list[Shell]:
    """The shells; refused where one faces the wrong way: outer walls out, cavities to the hollow.

    Raises:
        OrientationError: A shell's facets face the wrong way for where it lies.
    """
    shells = find_shells(surface, uses)
    for number, shell in enumerate(shells):
        is_cavity = shell.kind is ShellKind.CAVITY
        if shell.volume * (-1.0 if is_cavity else 1.0) > 0.0:
            continue
        which = (
            "the surface" if len(shells) == 1 else f"shell {number} ({len(shell.facets)} facets)"
        )
        if is_cavity:
            why = (
                f"lies in {len(shell.around)} other(s), which makes it a cavity, and its facets "
                "point into the solid around it"
            )
        else:
            why = "encloses a negative volume: its facets point inwards"
        raise OrientationError(
            f"{which} {why}",
            shell.facets.tolist(),
            detail="; swap two points of each of its facets",
        )
    return shells


def turn_bodies(surface: TriSurface) -> tuple[TriSurface, int]:
    """Reverse each outer wall whose facets point inwards, with all the shells within it.

    No point moves, and which side is solid is unambiguous; `require_nested` checks whether the
    shells within then face the right way. Returns the surface, and how many facets were reversed.
    """
    shells = find_shells(surface)
    turned = np.zeros(surface.num_facets, dtype=bool)
    for shell in shells:
        outermost = next((shells[k] for k in shell.around if not shells[k].around), shell)
        turned[shell.facets] = outermost.volume < 0.0
    facets = np.where(turned[:, None], surface.facets[:, ::-1], surface.facets)
    return TriSurface(surface.points, facets), int(np.count_nonzero(turned))


def winding_numbers(surface: TriSurface, positions: Points) -> Floats:
    """How often an oriented surface winds around positions [m] off it: its solid angle / 4 pi.

    Closed parts give whole numbers, +1 inside an outward shell; shape (num_places,).
    """
    winding = np.zeros(len(positions))
    step = max(1, _BLOCK // max(1, len(positions)))
    for start in range(0, surface.num_facets, step):
        corners = surface.points[surface.facets[start : start + step]]
        a, b, c = (corners[None, :, k] - positions[:, None] for k in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
        triple = np.einsum("ijk,ijk->ij", a, np.cross(b, c))
        flat = (
            la * lb * lc
            + np.einsum("ijk,ijk->ij", a, b) * lc
            + np.einsum("ijk,ijk->ij", b, c) * la
            + np.einsum("ijk,ijk->ij", c, a) * lb
        )
        # Outward facets seen from inside turn clockwise, hence a positive triple product.
        winding += np.arctan2(triple, flat).sum(axis=1) / (2.0 * np.pi)
    return winding
