"""Statics beside the edges of a box: each vertex is held against one face until it slides off.

Inside a box the nearest face may be a side that a vertex under the bottom never came by. So a
vertex that stands before one face is held against that face's plane, beyond its edges too, while an
equilibrium is sought: the force has no jump at the edge, and Newton's method no vertices that come
and go. Where an equilibrium presses a vertex beyond an edge, it is given to the face round that
edge, and the equilibrium sought again. One that came in over an edge belongs to the face whose
plane it crossed last.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.contact.tool_contact import Gaps
from palpate.meshes.arrays import Points

# Of the smallest half width: what is nearer than this is at the face, or at the edge.
_AT = 1e-6


class BoxFaces:
    """Which face of one box each vertex stands before.

    Faces are outward normals in the box's frame; zero is none, over an edge or a corner.

    Args:
        half_widths: Of the box [m].
    """

    def __init__(self, half_widths: tuple[float, float, float]) -> None:
        self._half_widths = np.array(half_widths)
        self._at = _AT * float(self._half_widths.min())
        self._begin = self._faces = self._kept = np.zeros((0, 3))
        self._has_moved = np.zeros(0, dtype=np.bool_)

    def keep(self, places: Points, pose: NDArray[np.void]) -> None:
        """Go on from where an equilibrium has the vertices [m], shape (n, 3)."""
        own = _in_frame(places, pose)
        heights = np.abs(own) - self._half_widths
        above = (heights > self._at).sum(axis=1)
        at_box = self._by_way(own) if len(self._faces) else self._nearest(own)
        faces = np.where((above == 1)[:, None], self._nearest(own), 0.0)
        self._faces = self._kept = np.where((above == 0)[:, None], at_box, faces)
        self._begin = own
        self._has_moved = np.zeros(len(own), dtype=np.bool_)

    def go_back(self) -> None:
        """To the faces of the last equilibrium."""
        self._faces = self._kept
        self._has_moved = np.zeros(len(self._kept), dtype=np.bool_)

    def from_faces(self, gaps: Gaps, places: Points, pose: NDArray[np.void]) -> Gaps:
        """Gaps from each vertex's own face, where it has one or is inside the box."""
        if not len(self._faces):
            return gaps
        own = _in_frame(places, pose)
        inside = (np.abs(own) <= self._half_widths + self._at).all(axis=1)
        faces = self._by_way(own)
        is_held = (self._faces != 0.0).any(axis=1) | inside
        distances = (faces * own).sum(axis=1) - np.abs(faces) @ self._half_widths
        normals = faces @ pose["rotation"].T
        return Gaps(
            np.where(is_held, distances, gaps.distances),
            np.where(is_held[:, None], normals, gaps.normals),
            np.where(is_held, 0.0, gaps.curvatures),
            np.where(is_held[:, None], 0.0, gaps.axes),
        )

    def move_round(
        self, places: Points, pose: NDArray[np.void], is_pressed: NDArray[np.bool_]
    ) -> tuple[NDArray[np.bool_], bool]:
        """Give what is pressed beyond an edge of its face to the face round that edge.

        Returns:
            Which vertices, shape (n,), and whether one of them was given on before.
        """
        own = _in_frame(places, pose)
        beside = np.where(self._faces != 0.0, 0.0, np.abs(own) - self._half_widths)
        held = (self._faces != 0.0).any(axis=1)
        moves = held & is_pressed & (beside.max(axis=1) > self._at)
        round_it = _unit(np.argmax(beside, axis=1)) * np.where(own < 0.0, -1.0, 1.0)
        self._faces = np.where(moves[:, None], round_it, self._faces)
        is_again = bool((moves & self._has_moved).any())
        self._has_moved = self._has_moved | moves
        return moves, is_again

    def came_over_edge(self, is_pressed: NDArray[np.bool_]) -> bool:
        """Whether what is pressed stood before no face: by which it came, only short ways tell."""
        return bool((is_pressed & ~(self._kept != 0.0).any(axis=1)).any())

    def _by_way(self, own: Points) -> Points:
        """Own face; of one that has none, the plane it crossed last on the way to a place."""
        signs = np.where(self._begin < 0.0, -1.0, 1.0)
        first, last = (signs * x - self._half_widths for x in (self._begin, own))
        crosses = (first > self._at) & (last <= self._at)
        fractions = np.where(crosses, first / np.where(crosses, first - last, 1.0), -1.0)
        entered = _unit(np.argmax(fractions, axis=1)) * signs
        entered = np.where(crosses.any(axis=1)[:, None], entered, self._nearest(own))
        known = (self._faces != 0.0).any(axis=1)
        found: Points = np.where(known[:, None], self._faces, entered)
        return found

    def _nearest(self, own: Points) -> Points:
        nearest = np.argmax(np.abs(own) - self._half_widths, axis=1)
        found: Points = _unit(nearest) * np.where(own < 0.0, -1.0, 1.0)
        return found


def _in_frame(places: Points, pose: NDArray[np.void]) -> Points:
    own: Points = (places - pose["position"]) @ pose["rotation"]
    return own


def _unit(axes: NDArray[np.intp]) -> Points:
    units: Points = np.eye(3)[axes]
    return units
