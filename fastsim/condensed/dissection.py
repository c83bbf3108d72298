"""Nested dissection: in which order points are eliminated, and how large every front is.

George 1973, "Nested dissection of a regular finite element mesh": halves that do not touch are
eliminated first, then the points between them. Halves are told by coordinates, what touches by the
matrix' own graph, so that the wider graph of the smoothed element needs nothing more. With the
multifrontal method (Duff and Reid 1983) all arithmetic is in dense fronts, one for each node of
the tree. Points that are kept are never eliminated: they are on the border of the last fronts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points

_LEAF = 48  # points that are not halved any more
_REAL = 8  # bytes


@dataclass(frozen=True, eq=False)
class Graph:
    """Which points share entries of a matrix of 3 x 3 blocks, in compressed rows.

    Attributes:
        row_start: Where each row begins, shape (num_points + 1,).
        columns: Ascending in each row.
    """

    row_start: NDArray[np.int64]
    columns: Indices

    def entries_of(self, rows: Indices) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Positions of all entries of some rows, and to which of `rows` each belongs."""
        begin, end = self.row_start[rows], self.row_start[rows + 1]
        counts = end - begin
        owner = np.repeat(np.arange(len(rows)), counts)
        first = np.repeat(begin - np.concatenate([[0], np.cumsum(counts)[:-1]]), counts)
        return first + np.arange(len(owner)), owner

    def neighbours(self, rows: Indices) -> Indices:
        """All points that share an entry with some of these, themselves included, ascending."""
        found: Indices = np.unique(self.columns[self.entries_of(rows)[0]])
        return found


@dataclass(frozen=True, eq=False)
class Node:
    """One front: points eliminated together, and the later ones that they act on.

    Attributes:
        own: Points eliminated here.
        border: Points eliminated later, or kept, ascending.
        children: Numbers of the nodes before it that add to its front.
    """

    own: Indices
    border: Indices
    children: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Dissection:
    """Nodes in the order of their elimination.

    Attributes:
        nodes: Children before parents.
        kept: Points that stay, in the order in which they were given.
    """

    nodes: tuple[Node, ...]
    kept: Indices

    @property
    def operations(self) -> float:
        """Floating-point operations of elimination and of inverting what is kept."""
        sizes = ((3.0 * len(n.own), 3.0 * len(n.border)) for n in self.nodes)
        work = sum(2.0 / 3.0 * a**3 + 2.0 * a**2 * b + 2.0 * a * b**2 for a, b in sizes)
        return float(work + 4.0 / 3.0 * (3.0 * len(self.kept)) ** 3)

    @property
    def factor_bytes(self) -> int:
        """Of what tells the eliminated points from those that are kept."""
        return sum(_REAL * 9 * len(n.own) * len(n.border) for n in self.nodes)

    @property
    def peak_bytes(self) -> int:
        """Most that is held at a time while eliminating and inverting, factors apart."""
        waiting: dict[int, int] = {}
        used = dense = _REAL * 9 * len(self.kept) ** 2
        is_child = {k for node in self.nodes for k in node.children}
        peak = dense
        for number, node in enumerate(self.nodes):
            a, b = len(node.own), len(node.border)
            used += (update := _REAL * 9 * b * b if number in is_child else 0)
            # The front, what solving makes of it, and one child's part of the update.
            child = max((waiting[k] for k in node.children), default=0)
            peak = max(peak, used + child + _REAL * 9 * (2 * a * a + 3 * a * b))
            used -= sum(waiting.pop(k) for k in node.children)
            waiting[number] = update
        # Inverting by halves holds two quarters besides; putting them away, a half.
        return max(peak, dense + dense // 2)


def dissect(points: Points, graph: Graph, eliminated: Indices, kept: Indices) -> Dissection:
    """Order points for elimination.

    Args:
        points: Places [m], shape (num_points, 3).
        graph: Of the matrix.
        eliminated: Points to eliminate.
        kept: Points that stay; none of `eliminated`.
    """
    nodes: list[Node] = []
    # 0 for what takes no part, 1 to be eliminated, 2 kept.
    state = np.zeros(len(points), dtype=np.int8)
    state[eliminated], state[kept] = 1, 2
    for part in _parts(graph, state):
        _dissect(points, graph, part, state, nodes)
    return Dissection(tuple(nodes), kept)


def _parts(graph: Graph, state: NDArray[np.int8]) -> Iterator[Indices]:
    """Points that hang together without those that are kept."""
    left = state == 1
    while left.any():
        seen = np.zeros_like(left)
        frontier = np.flatnonzero(left)[:1].astype(np.int32)
        while len(frontier):
            seen[frontier] = True
            near = graph.neighbours(frontier)
            frontier = near[left[near] & ~seen[near]]
        yield np.flatnonzero(seen).astype(np.int32)
        left &= ~seen


def _dissect(
    points: Points, graph: Graph, part: Indices, state: NDArray[np.int8], nodes: list[Node]
) -> int:
    """Append the nodes of a part, the last of which is its root; return its number."""
    children: list[int] = []
    own = part
    if len(part) > _LEAF:
        lower, upper, own = _halves(points, graph, part)
        children = [_dissect(points, graph, h, state, nodes) for h in (lower, upper) if len(h)]
    near = [graph.neighbours(own)] if len(own) else []
    border = np.unique(np.concatenate([*near, *(nodes[k].border for k in children)]))
    state[own] = 0
    border = border[state[border] > 0].astype(np.int32)
    nodes.append(Node(own, border, tuple(children)))
    return len(nodes) - 1


def _halves(points: Points, graph: Graph, part: Indices) -> tuple[Indices, Indices, Indices]:
    """Two halves that do not touch, and the points between them."""
    along = points[part][:, int(np.argmax(np.ptp(points[part], axis=0)))]
    order = np.argsort(along, kind="stable")
    side = np.zeros(len(points), dtype=np.int8)
    halves = part[order[: len(part) // 2]], part[order[len(part) // 2 :]]
    side[halves[0]], side[halves[1]] = 1, 2
    between = []
    for number, half in enumerate(halves):
        entries, owner = graph.entries_of(half)
        touches = side[graph.columns[entries]] == 2 - number
        between.append(np.unique(owner[touches]))
    k = int(len(between[1]) < len(between[0]))
    separator = halves[k][between[k]]
    rest = np.delete(halves[k], between[k])
    lower, upper = (rest, halves[1]) if k == 0 else (halves[0], rest)
    return lower, upper, separator
