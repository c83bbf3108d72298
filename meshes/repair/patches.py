"""Patches of a surface: rings around facets, islands, smoothing, loose parts, orientation."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Integers, Mask, Points
from palpate.meshes.tri_surface import OrientationError
from palpate.meshes.triangles import connected_parts, edge_uses, facet_parts

# Whether points and facets have no crossing at the marked facets.
Fits = Callable[[Points, Indices, Mask], bool]
# An enclosed part is included if it has at most this many times the facets of the rings: the tip
# of a fold, not the rest of an organ.
_MOST_ENCLOSED = 4


def grow(facets: Indices, chosen: Mask, rings: int = 1) -> Mask:
    """Add the facets that have a point in common with the chosen ones, ring by ring."""
    for _ in range(rings):
        is_touched = np.zeros(int(facets.max(initial=-1)) + 1, dtype=bool)
        is_touched[facets[chosen]] = True
        chosen = is_touched[facets].any(axis=1)
    return chosen


def with_enclosed(facets: Indices, chosen: Mask) -> Mask:
    """Add the small islands that chosen facets cut off from the rest of their shell.

    A part that reaches an open rim is no island: the surface may continue there.
    """
    uses = edge_uses(facets)
    pairs = uses.neighbours
    shell = connected_parts(len(facets), pairs)
    apart = chosen[pairs[:, 0]] == chosen[pairs[:, 1]]
    part = connected_parts(len(facets), pairs[apart])
    sizes = np.bincount(part)
    is_rim = np.zeros(len(sizes), dtype=bool)
    is_rim[part[uses.owner[uses.crowd == 1]]] = True
    taken = chosen.copy()
    for number in np.unique(shell[chosen]):
        of_shell = shell == number
        rest = np.unique(part[of_shell & ~chosen])
        if not len(rest):
            continue
        most = _MOST_ENCLOSED * np.count_nonzero(of_shell & chosen)
        largest = rest[np.argmax(sizes[rest])]
        small = [k for k in rest if k != largest and sizes[k] <= most and not is_rim[k]]
        taken |= np.isin(part, small)
    return taken


def inner_points(facets: Indices, chosen: Mask, num_points: int) -> Integers:
    """Points of chosen facets only: those that may move when the patch is replaced."""
    is_inner = np.zeros(num_points, dtype=bool)
    is_inner[facets[chosen]] = True
    is_inner[facets[~chosen]] = False
    return np.flatnonzero(is_inner)


def edges_of(facets: Indices) -> Integers:
    """Undirected edges of facets, shape (num_edges, 2), each once."""
    return edge_uses(facets).edges


class MeanOfNeighbours:
    """Mean of what the points have that each point shares an edge with; 0 where there are none."""

    def __init__(self, facets: Indices, num_points: int) -> None:
        from scipy.sparse import csr_array

        edges = edges_of(facets)
        both = np.vstack([edges, edges[:, ::-1]])
        valence = np.maximum(np.bincount(both[:, 0], minlength=num_points), 1)
        weights = 1.0 / valence[both[:, 0]]
        self._matrix = csr_array((weights, both.T), shape=(num_points, num_points))

    def __call__(self, values: Points) -> Points:
        """Means, shape (num_points, 3)."""
        mean: Points = self._matrix @ values
        return mean


# Smooth patches: some points of a surface are moved so that it bends little, the others are fixed.
# The membrane (order 1) solves L x = 0 at the free points, the thin plate (order 2) makes
# sum |L x|^2 least over the free points and their neighbours, L the mean of a point's neighbours
# less the point (Kobbelt, Campagna, Vorsatz, Seidel 1998, "Interactive multi-resolution modeling on
# arbitrary meshes"). A membrane stays in the hull of its rim; a plate meets its rim tangentially.

# Points up to which the solve is dense; beyond, steps of conjugate gradients.
_MOST_DENSE = 600
_MOST_STEPS = 2000
_TOLERANCE = 1e-8


def fair_points(points: Points, facets: Indices, free: Integers, *, order: int = 2) -> Points:
    """All points [m], the free ones moved to where the surface bends least.

    `facets` are the patch and at least two rings around it; of order 1 it is a membrane, of 2 a
    thin plate.
    """
    moved = points.copy()
    if not len(free):
        return moved
    edges = edges_of(facets)
    is_free = np.zeros(len(points), dtype=bool)
    is_free[free] = True
    is_row = is_free.copy()
    if order == 2:
        near = is_free[edges].any(axis=1)
        is_row[edges[near]] = True
    # One row for each point whose bending counts: the mean of its neighbours less the point.
    both = np.vstack([edges, edges[:, ::-1]])
    both = both[is_row[both[:, 0]]]
    valence = np.bincount(both[:, 0], minlength=len(points)).astype(float)
    rows = np.flatnonzero(is_row)
    number = np.full(len(points), -1)
    number[free] = np.arange(len(free))
    row_of = np.full(len(points), -1)
    row_of[rows] = np.arange(len(rows))
    r = np.concatenate([row_of[both[:, 0]], np.arange(len(rows))])
    c = np.concatenate([both[:, 1], rows])
    w = np.concatenate([1.0 / valence[both[:, 0]], -np.ones(len(rows))])
    is_known = ~is_free[c]
    # About a local origin, so that no digits are lost.
    origin = points[free].mean(axis=0)
    local = points - origin
    right = np.zeros((len(rows), 3))
    np.add.at(right, r[is_known], -w[is_known, None] * local[c[is_known]])
    r, c, w = r[~is_known], number[c[~is_known]], w[~is_known]
    moved[free] = _least_squares(r, c, w, right, len(free), local[free]) + origin
    return moved


def _least_squares(
    r: Integers, c: Integers, w: Floats, right: Points, size: int, start: Points
) -> Points:
    """Solution of min |A x - right|, A given by rows, columns and values."""
    from scipy.sparse import csr_array

    matrix = csr_array((w, (r, c)), shape=(len(right), size))
    if size <= _MOST_DENSE:
        solved: Points = np.linalg.lstsq(matrix.toarray(), right, rcond=None)[0]
        return solved
    # Conjugate gradients on the normal equations, the three coordinates at once.
    x, tiny = start.copy(), np.finfo(float).tiny
    residual = matrix.T @ (right - matrix @ x)
    direction, squared = residual.copy(), np.einsum("ij,ij->j", residual, residual)
    stop = _TOLERANCE**2 * np.maximum(squared, tiny)
    for _ in range(_MOST_STEPS):
        if np.all(squared <= stop):
            break
        image = matrix @ direction
        step = squared / np.maximum(np.einsum("ij,ij->j", image, image), tiny)
        x += step * direction
        residual -= step * (matrix.T @ image)
        new = np.einsum("ij,ij->j", residual, residual)
        direction = residual + new / np.maximum(squared, tiny) * direction
        squared = new
    return x


# Parts below this fraction of the longest side of the largest part are reported to the user.
SMALL = 0.05


def part_sizes(points: Points, facets: Indices) -> tuple[Integers, Floats]:
    """Part of each facet, and the longest side of each part's box [m]."""
    part = facet_parts(facets)
    count = int(part.max(initial=-1)) + 1
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, part, points[facets].min(axis=1))
    np.maximum.at(high, part, points[facets].max(axis=1))
    return part, (high - low).max(axis=1, initial=0.0)


def loose_facets(points: Points, facets: Indices, smallest: float) -> Mask:
    """Facets of parts whose box is shorter than `smallest` [m]; the largest part is never one."""
    part, sizes = part_sizes(points, facets)
    is_small = sizes < smallest
    if len(sizes):
        is_small[np.argmax(sizes)] = False
    return is_small[part]


def orient_parts(facets: Indices) -> tuple[Indices, Mask]:
    """Turn facets so that neighbours agree; the first facet of each part stays as it is."""
    uses = edge_uses(facets)
    # Across an edge with more than two facets it is not known yet which belong together.
    first, second = uses.plain_pairs.T
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
