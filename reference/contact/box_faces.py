"""By which face a place came into a box: the one it has to leave by.

The nearest face is the wrong one beside an edge: a node under the bottom, nearer to a side than it
is deep, would be pushed out of that side. A node enters by the face it was outside of, and of
several by the one whose plane it crossed last; one that has touched a face keeps to it until it is
clear of the box.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points

Mask = NDArray[np.bool_]
# Of the smallest half width.
_TOUCHING = 1e-6


def entered_faces(
    local: Points, half_widths: Points, came_from: Points | None
) -> tuple[Indices, Points]:
    """The face by which each place, if it is inside, came in on the straight way.

    Args:
        local: In the box's frame [m], shape (n, 3).
        half_widths: [m], shape (3,).
        came_from: Where each was before, in the frame of then [m], shape (n, 3); without it, and
            for a place that was inside, the nearest face.

    Returns:
        Axis of the face's normal, shape (n,), and its side of the box, -1 or 1, shape (n,).
    """
    rows = np.arange(len(local))
    axes = np.argmax(np.abs(local) - half_widths, axis=1)
    sides = _signs(local)[rows, axes]
    if came_from is None:
        return axes, sides
    slack = touching_distance(half_widths)
    beyond, before = np.abs(came_from) - half_widths, _signs(came_from)
    way = np.abs(came_from) - before * local
    # A place that is still outside by an axis has crossed no plane of it.
    crossed = (beyond > slack) & (way >= beyond - slack)
    parts = np.where(crossed, beyond / np.where(crossed, way, 1.0), -1.0)
    last, known = np.argmax(parts, axis=1), crossed.any(axis=1)
    return np.where(known, last, axes), np.where(known, before[rows, last], sides)


def seen_at(local: Points, half_widths: Points, came_from: Points | None) -> Points:
    """Where the next way into the box begins [m], shape (n, 3), in its frame.

    A place that is clear of the box is its own. One that touches it, or is inside, counts as
    straight in front of the face by which it came.

    Args:
        local: In the box's frame [m], shape (n, 3).
        half_widths: [m], shape (3,).
        came_from: As for `entered_faces`.
    """
    axes, sides = entered_faces(local, half_widths, came_from)
    touching = (np.abs(local) - half_widths).max(axis=1) <= touching_distance(half_widths)
    return np.where(touching[:, None], _in_front_of(axes, sides, local, half_widths), local)


class HeldFaces:
    """The faces of a box that nodes are held against while an equilibrium is sought.

    A node straight in front of a face is held against the whole plane of it: where the face ended,
    forces would jump, and a node at its edge come and go without end. One that an equilibrium
    holds beyond the edge has slid off, and is let go to the face round that edge.

    Args:
        half_widths: Of the box [m], shape (3,).

    Attributes:
        came_from: See `entered_faces`; None before anything was seen.
    """

    def __init__(self, half_widths: tuple[float, float, float]) -> None:
        self._half_widths = np.asarray(half_widths)
        self.came_from: Points | None = None
        self._kept: Points | None = None
        self._has_slid: Mask = np.zeros(0, dtype=np.bool_)

    def keep(self, local: Points) -> None:
        """Go on from an equilibrium that has the nodes at these places, shape (n, 3)."""
        self._kept = seen_at(local, self._half_widths, self.came_from)
        self.go_back()

    def go_back(self) -> None:
        """To the last equilibrium that was kept."""
        self.came_from = self._kept
        self._has_slid = np.zeros(0 if self._kept is None else len(self._kept), dtype=np.bool_)

    def planes(self, local: Points) -> tuple[Mask, Points, Points]:
        """The planes that nodes are held against, from places [m], shape (n, 3).

        Returns:
            Whether a node is held against one, shape (n,), its distance from that [m], shape (n,),
            and the plane's normal out of the box, in its frame, shape (n, 3).
        """
        is_held, axes, sides = self._held()
        normals = np.zeros_like(local)
        normals[np.arange(len(local)), axes] = sides
        return is_held, (normals * local).sum(axis=1) - self._half_widths[axes], normals

    def let_go(self, local: Points, pressed: Mask) -> tuple[Mask, bool]:
        """Let go of the pressed nodes that have slid off the face they are held against.

        Returns:
            Which, shape (n,), and whether one of them had slid off another already.
        """
        assert self.came_from is not None
        is_held, axes, _ = self._held()
        beyond = np.abs(local) - self._half_widths
        beyond[np.arange(len(axes)), axes] = -np.inf
        off = is_held & pressed & (beyond.max(axis=1) > touching_distance(self._half_widths))
        round_it = np.argmax(beyond, axis=1)
        sides = _signs(local)[np.arange(len(axes)), round_it]
        moved = _in_front_of(round_it, sides, local, self._half_widths)
        self.came_from = np.where(off[:, None], moved, self.came_from)
        again = bool((off & self._has_slid).any())
        self._has_slid = self._has_slid | off
        return off, again

    def _held(self) -> tuple[Mask, Indices, Points]:
        assert self.came_from is not None
        beyond = np.abs(self.came_from) - self._half_widths
        axes = np.argmax(beyond, axis=1)
        count = (beyond > touching_distance(self._half_widths)).sum(axis=1)
        return count == 1, axes, _signs(self.came_from)[np.arange(len(axes)), axes]


def touching_distance(half_widths: Points) -> float:
    """Nearer than this a place is still at the face, or the edge, that it touches [m]."""
    return _TOUCHING * float(half_widths.min())


def _signs(values: Points) -> Points:
    signs: Points = np.where(values < 0.0, -1.0, 1.0)
    return signs


def _in_front_of(axes: Indices, sides: Points, local: Points, half_widths: Points) -> Points:
    moved: Points = np.clip(local, -half_widths, half_widths)
    moved[np.arange(len(local)), axes] = 2.0 * sides * half_widths[axes]
    return moved
