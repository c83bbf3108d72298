"""Static condensation: a stiffness matrix reduced to its retained points, by nested dissection.

With K cut into eliminated (e) and retained (k) points, u_e = y - X u_k and

    S = K_kk - K_ke K_ee^-1 K_ek,      S u_k = f_k - K_ke K_ee^-1 f_e

(Bro-Nielsen and Cotin 1996, "Real-time volumetric deformable models for surgery simulation using
finite elements and condensation", eq. 12 ff.; Guyan 1965). Elimination runs over the fronts of a
nested dissection; the dense work is LAPACK's, by NumPy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points

_ROWS = 768  # of an update made at a time, so that it is never there twice
_SMALL = 192  # a matrix that is inverted in one piece


@dataclass(frozen=True, eq=False)
class Condensed:
    """A matrix condensed to the retained points.

    Attributes:
        stiffness: S, shape (3 num_kept, 3 num_kept).
        loads: f_k - K_ke K_ee^-1 f_e for each right-hand side, (3 num_kept, num_columns).
        dissection: Nodes to whose fronts `couplings` and `offsets` belong.
        couplings: X of each front, shape (3 num_own, 3 num_border); empty if not stored.
        offsets: y of each front, shape (3 num_own, num_columns).
    """

    stiffness: Floats
    loads: Floats
    dissection: Dissection
    couplings: list[Floats]
    offsets: list[Floats]

    def extend(self, kept: Floats, num_points: int, offsets: Floats | None = None) -> Floats:
        """Displacements of all points, (3 num_points, n), from retained ones, (3 num_kept, n).

        `offsets` are factors of the right-hand sides, (num_columns, n); None is zero. The result
        is 0 at points neither eliminated nor retained.
        """
        found = np.zeros((3 * num_points, kept.shape[1]))
        found[components_of(self.dissection.kept)] = kept
        fronts = zip(self.dissection.nodes, self.couplings, self.offsets, strict=True)
        for node, coupling, offset in reversed(list(fronts)):
            own = -coupling @ found[components_of(node.border)]
            if offsets is not None:
                own += offset @ offsets
            found[components_of(node.own)] = own
        return found


def components_of(points: Indices | NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of the three components of each point, shape (3 n,)."""
    return (3 * points[:, None] + np.arange(3)).reshape(-1)


def condense_matrix(
    graph: Graph,
    blocks: Floats,
    loads: Floats,
    dissection: Dissection,
    *,
    keeps_couplings: bool,
    progress: Callable[[str], None] | None = None,
) -> Condensed:
    """Eliminate all points that are not retained, in the order of a dissection.

    Of a symmetric, positive definite matrix of 3 x 3 blocks, (num_entries, 3, 3), with a graph, and
    right-hand sides, (3 num_points, num_columns). Couplings are what `Condensed.extend` needs.

    Raises:
        numpy.linalg.LinAlgError: A front that is singular.
    """
    kept = dissection.kept
    num_points = len(graph.row_start) - 1
    position = np.full(num_points, -1, dtype=np.int64)
    position[kept] = np.arange(len(kept))
    entries, owner = graph.entries_of(kept)
    columns = position[graph.columns[entries]]
    stiffness = np.zeros((3 * len(kept), 3 * len(kept)))
    inside = columns >= 0
    _blocks_of(stiffness)[owner[inside], columns[inside]] = blocks[entries[inside]]
    left = loads.copy()
    updates: dict[int, Floats] = {}
    couplings, offsets = [], []
    is_child = {k for node in dissection.nodes for k in node.children}
    at_kept = position.copy()
    position[:] = -1
    for number, node in enumerate(dissection.nodes):
        a, b = len(node.own), len(node.border)
        position[node.own], position[node.border] = np.arange(a), a + np.arange(b)
        front, beside = np.zeros((3 * a, 3 * a)), np.zeros((3 * a, 3 * b))
        entries, owner = graph.entries_of(node.own)
        columns = position[graph.columns[entries]]
        for target, first, end in ((front, 0, a), (beside, a, a + b)):
            inside = (columns >= first) & (columns < end)
            _blocks_of(target)[owner[inside], columns[inside] - first] = blocks[entries[inside]]
        # The last fronts add to the retained matrix at once: their updates are the largest.
        is_last = number not in is_child
        update = stiffness if is_last else np.zeros((3 * b, 3 * b))
        rows = components_of(at_kept[node.border] if is_last else np.arange(b))
        for child in node.children:
            added = updates.pop(child)
            at = components_of(position[dissection.nodes[child].border])
            mine = at < 3 * a
            inner, outer = np.flatnonzero(mine), np.flatnonzero(~mine)
            front[np.ix_(at[inner], at[inner])] += added[np.ix_(inner, inner)]
            beside[np.ix_(at[inner], at[outer] - 3 * a)] += added[np.ix_(inner, outer)]
            to = rows[at[outer] - 3 * a]
            for some in _pieces(len(outer)):
                update[np.ix_(to[some], to)] += added[np.ix_(outer[some], outer)]
        own, border = components_of(node.own), components_of(node.border)
        solved = np.linalg.solve(front, np.hstack([beside, left[own]]))
        coupling, offset = solved[:, : 3 * b].copy(), solved[:, 3 * b :].copy()
        del solved
        for some in _pieces(3 * b):
            update[np.ix_(rows[some], rows)] -= coupling[:, some].T @ beside
        left[border] -= beside.T @ offset
        if not is_last:
            updates[number] = update
        if keeps_couplings:
            couplings.append(coupling)
            offsets.append(offset)
        position[node.own], position[node.border] = -1, -1
        if progress and (number + 1) % 32 == 0:
            progress(f"{number + 1} of {len(dissection.nodes)} fronts eliminated")
    return Condensed(stiffness, left[components_of(kept)], dissection, couplings, offsets)


def invert_in_place(matrix: Floats) -> None:
    """Overwrite a symmetric positive definite matrix by its inverse.

    By halves: with W = A^-1 B and C' = C - B^T W, the inverse has C'^-1, -W C'^-1 and
    A^-1 + W C'^-1 W^T.
    """
    n = len(matrix)
    if n <= _SMALL:
        matrix[...] = np.linalg.inv(matrix)
        matrix[...] = 0.5 * (matrix + matrix.T)
        return
    h = n // 2
    a, b, c = matrix[:h, :h], matrix[:h, h:], matrix[h:, h:]
    invert_in_place(a)
    w = a @ b
    for some in _pieces(n - h):
        c[some] -= b[:, some].T @ w
    invert_in_place(c)
    np.matmul(w, c, out=b)
    np.negative(b, out=b)
    for some in _pieces(h):
        a[some] -= b[some] @ w.T
    matrix[h:, :h] = b.T


def _pieces(n: int) -> list[slice]:
    return [slice(begin, min(begin + _ROWS, n)) for begin in range(0, n, _ROWS)]


def _blocks_of(matrix: Floats) -> Floats:
    """A view with the 3 x 3 blocks last."""
    rows, columns = matrix.shape
    return matrix.reshape(rows // 3, 3, columns // 3, 3).transpose(0, 2, 1, 3)


# Nested dissection: in which order points are eliminated, and how large every front is.
#
# George 1973, "Nested dissection of a regular finite element mesh": halves that do not touch are
# eliminated first, then the points between them. Halves are found by coordinates, neighbours by the
# matrix' own graph, so that the wider graph of the smoothed element needs nothing more. With the
# multifrontal method (Duff and Reid 1983) all arithmetic is in dense fronts, one for each node of
# the tree. Retained points are never eliminated: they are on the border of the last fronts.


_LEAF = 48  # points that are not halved any more
_REAL = 8  # bytes


@dataclass(frozen=True, eq=False)
class Graph:
    """Graph of the points of a matrix of 3 x 3 blocks, in compressed rows of ascending columns."""

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
    """One front: points eliminated together, `own`, and those eliminated later that they act on.

    `border` is ascending; `children` are the nodes before it that add to its front.
    """

    own: Indices
    border: Indices
    children: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Dissection:
    """Nodes in the order of elimination, children before parents; retained points as given."""

    nodes: tuple[Node, ...]
    kept: Indices

    @property
    def operations(self) -> float:
        """Floating-point operations of elimination and of inverting the retained matrix."""
        sizes = ((3.0 * len(n.own), 3.0 * len(n.border)) for n in self.nodes)
        work = sum(2.0 / 3.0 * a**3 + 2.0 * a**2 * b + 2.0 * a * b**2 for a, b in sizes)
        return float(work + 4.0 / 3.0 * (3.0 * len(self.kept)) ** 3)

    @property
    def factor_bytes(self) -> int:
        """Memory of the factors from which the eliminated points follow."""
        return sum(_REAL * 9 * len(n.own) * len(n.border) for n in self.nodes)

    @property
    def peak_bytes(self) -> int:
        """Largest memory in use while eliminating and inverting, without the factors."""
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
    """Order points for elimination by their positions [m] and the graph of the matrix."""
    nodes: list[Node] = []
    # 0 for points without a part in it, 1 for those to eliminate, 2 for retained ones.
    state = np.zeros(len(points), dtype=np.int8)
    state[eliminated], state[kept] = 1, 2
    for part in _parts(graph, state):
        _dissect(points, graph, part, state, nodes)
    return Dissection(tuple(nodes), kept)


def _parts(graph: Graph, state: NDArray[np.int8]) -> Iterator[Indices]:
    """Connected components of the graph without the retained points."""
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
