"""A tree of boxes over cells or facets, searched for many places at once.

Items are sorted along a space-filling curve (Morton 1966), and neighbours are joined two by two:
a complete binary tree that does not suffer from items of very different sizes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points

Rows = NDArray[np.int64]
Distance = Callable[[Rows, Rows], Points]
# Places that go down the tree together: bounds the memory.
_CHUNK = 2048
_BITS = 20


class BoxTree:
    """Boxes of items: which of them hold a place, and which item is nearest to it.

    Args:
        low: Smallest corner of each item's box [m], (num_items, 3), finite; one item or more.
        high: Largest corner, likewise.
        inner: A place of each item itself [m], (num_items, 3); needed for `nearest` alone.
    """

    def __init__(self, low: Points, high: Points, inner: Points | None = None) -> None:
        self._largest = float(max(np.abs(low).max(), np.abs(high).max()))
        order = _along_curve(0.5 * (low + high))
        count, self._depth = len(low), max(len(low) - 1, 0).bit_length()
        leaves = 2**self._depth
        self._items = np.full(leaves, -1)
        self._items[:count] = order
        # Node k has the children 2k and 2k + 1; the root is 1, an empty box holds nothing.
        self._low = np.full((2 * leaves, 3), np.inf)
        self._high = np.full((2 * leaves, 3), -np.inf)
        self._inner = np.full((2 * leaves, 3), np.inf)
        self._low[leaves : leaves + count] = low[order]
        self._high[leaves : leaves + count] = high[order]
        if inner is not None:
            self._inner[leaves : leaves + count] = inner[order]
        for level in range(self._depth - 1, -1, -1):
            nodes = np.arange(2**level, 2 ** (level + 1))
            left, right = 2 * nodes, 2 * nodes + 1
            self._low[nodes] = np.minimum(self._low[left], self._low[right])
            self._high[nodes] = np.maximum(self._high[left], self._high[right])
            self._inner[nodes] = self._inner[left]

    def holding(self, places: Points) -> tuple[Rows, Rows]:
        """Every place with every item whose box holds it: two arrays of the same length."""
        found = [(np.zeros(0, dtype=np.int64),) * 2]
        for rows in _in_chunks(len(places)):
            who, nodes = self._descend(places[rows])
            found.append((rows[who], self._items[nodes - len(self._items)]))
        return np.concatenate([w for w, _ in found]), np.concatenate([i for _, i in found])

    def nearest(self, places: Points, distance: Distance, within: Points | None = None) -> Rows:
        """The item nearest to each place, (num_places,); of equals the first.

        Args:
            places: [m], (num_places, 3), finite.
            distance: Of places from items [m], both given by number, (n,) each.
            within: No farther than this is an item known to be [m], (num_places,): where that is
                near, much less has to be looked at.
        """
        nearest = np.empty(len(places), dtype=np.int64)
        for rows in _in_chunks(len(places)):
            some = places[rows]
            known = np.full(len(some), np.inf) if within is None else within[rows]
            who, nodes = self._descend(some, known)
            items = self._items[nodes - len(self._items)]
            # The likeliest first: most others are then too far by their boxes.
            order = np.lexsort([_length(some[who] - self._inner[nodes]), who])
            likely = order[_starts(who)]
            bound = distance(rows, items[likely])
            kept = self._apart(some[who], nodes) <= bound[who] + self._rounding(some)
            who, items = who[kept], items[kept]
            apart = distance(rows[who], items)
            order = np.lexsort([items, apart, who])
            nearest[rows] = items[order[_starts(who)]]
        return nearest

    def _descend(self, places: Points, known: Points | None = None) -> tuple[Rows, Rows]:
        """Places, in order, with the leaves that hold them; that may be nearest where told how far.

        `known` is how far the nearest is at most [m], (num_places,).
        """
        who, nodes = np.arange(len(places)), np.ones(len(places), dtype=np.int64)
        for level in range(self._depth + 1):
            if level:
                who, nodes = np.repeat(who, 2), np.repeat(2 * nodes, 2)
                nodes[1::2] += 1
            bound = np.zeros(len(places))
            if known is not None:
                to_inner = _length(places[who] - self._inner[nodes])
                nearest = np.minimum(np.minimum.reduceat(to_inner, _starts(who)), known)
                bound = nearest + self._rounding(places)
            kept = self._apart(places[who], nodes) <= bound[who]
            who, nodes = who[kept], nodes[kept]
        return who, nodes

    def _rounding(self, places: Points) -> float:
        """What a distance may be off: an item's inner place may lie a hair outside of its box."""
        return 64.0 * float(np.finfo(float).eps) * max(self._largest, float(np.abs(places).max()))

    def _apart(self, places: Points, nodes: Rows) -> Points:
        """Distance from each place to its box, infinite for an empty one."""
        outside = np.maximum(self._low[nodes] - places, places - self._high[nodes])
        return _length(np.maximum(outside, 0.0))


def _in_chunks(count: int) -> list[Rows]:
    return [np.arange(start, min(start + _CHUNK, count)) for start in range(0, count, _CHUNK)]


def _starts(who: Rows) -> Rows:
    """Where each run of equal numbers begins."""
    return np.flatnonzero(np.concatenate([[True], who[1:] != who[:-1]]))


def _length(vectors: Points) -> Points:
    length: Points = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return length


def _along_curve(places: Points) -> Rows:
    """Order along a Morton curve: the bits of three whole numbers, one after the other."""
    size = float(np.ptp(places, axis=0).max()) or 1.0
    steps = ((places - places.min(axis=0)) / size * (2**_BITS - 1)).astype(np.int64)
    code = np.zeros(len(steps), dtype=np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            code |= ((steps[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")
