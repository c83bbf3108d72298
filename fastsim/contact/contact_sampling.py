"""Where the surface is kept out of a tool: at vertices, or over facets by dual shape functions.

The surface is a set of patches: single vertices, or facets. A patch of rest area A has corners k
and points q, with shape functions beta_qk, dual ones psi_qk and weights w_q of the area; each
corner that is not fixed along all axes has a constraint i, and a_i is its part of the area:

    x_q = sum_k beta_qk x_k,     g_i = sum_q s_qi g(x_q),     s_qi = A w_q psi_qi / a_i,
    f_q = (sum_i s_qi N_i) n(x_q),     F_k = sum_q beta_qk f_q,

with normal forces N_i = a_i p_i [N]. A vertex alone has one point and beta = psi = w = 1; for
facets see `ContactRule`. As the sum over q of s_qi beta_qk is 1 for k = i and else 0, an average of
positions is the position of the vertex itself. The gradient of g_i reaches all corners of its
patches, so that vertices two edges apart act on each other.

The penalty over facets is integrated: each point is a constraint of its own with the area A w_q and
s = 1, so that it never pulls.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.body import Body
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.rigid_tool import ContactRule


def _points_of_facets() -> Floats:
    """Barycentric coordinates of three points in each quarter of a triangle, shape (12, 3)."""
    corners, halves = np.eye(3), 0.5 * (1.0 - np.eye(3))
    quarters = [halves, *([corners[k], halves[k - 1], halves[k - 2]] for k in range(3))]
    third = np.full((3, 3), 1.0 / 6.0) + 0.5 * np.eye(3)
    return np.concatenate([third @ np.array(quarter) for quarter in quarters])


_SHAPES = {ContactRule.VERTICES: np.ones((1, 1)), ContactRule.FACETS: _points_of_facets()}
_DUALS = {
    ContactRule.VERTICES: np.ones((1, 1)),
    ContactRule.FACETS: 4.0 * _points_of_facets() - 1.0,
}


class ContactSampling:
    """Points of the surface at which gaps are taken, and how they form those of the constraints.

    Args:
        rule: At vertices or over facets.
        rest: Points of the mesh [m], shape (num_points, 3).
        facets: That may touch, shape (m, 3).
        vertices: That are not fixed along all axes, ascending, shape (n,).
        areas: a_i of each [m2], shape (n,).
        is_integrated: Whether each point of a facet is a constraint of its own.

    Attributes:
        areas: Of the constraints [m2], shape (n,).
        patches: Corners of the patches, shape (m, 1) or (m, 3).
        patch_areas: Rest areas of the patches [m2], shape (m,).
        shape_functions: Of the corners at the points of a patch, shape (points, 1) or (points, 3).
        shares: s_qi of each patch, point and constraint, shape (m, points, own).
    """

    def __init__(
        self,
        rule: ContactRule,
        rest: Points,
        facets: Indices,
        vertices: Indices,
        areas: Floats,
        *,
        is_integrated: bool,
    ) -> None:
        self._rest, self._vertices = rest, vertices
        count = len(vertices)
        number = np.full(len(rest), count)
        number[vertices] = np.arange(count)
        if rule is ContactRule.VERTICES:
            patches, sizes = vertices[:, None], areas
        else:
            patches = facets[(number[facets] < count).any(axis=1)]
            a, b, c = rest[patches].transpose(1, 0, 2)
            sizes = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        self.patches, self.patch_areas, self.areas = patches, sizes, areas
        self.shape_functions = _SHAPES[rule]
        # Constraints of each patch; at corners without one the number n.
        self._number = number[patches]
        share = (sizes[:, None] / np.append(areas, np.inf)[self._number])[:, None, :]
        self.shares: Floats = share * (_DUALS[rule] / len(self.shape_functions))
        if is_integrated:
            self.areas = np.repeat(sizes / len(self.shape_functions), len(self.shape_functions))
            self._number = np.arange(len(self.areas)).reshape(
                len(patches), len(self.shape_functions)
            )
            self.shares = np.broadcast_to(
                np.eye(len(self.shape_functions)),
                (len(patches), *self.shape_functions.shape[:1] * 2),
            )

    @property
    def rest_corners(self) -> Points:
        """Corners of the patches at rest [m], shape (m, 1, 3) or (m, 3, 3)."""
        corners: Points = self._rest[self.patches]
        return corners

    @property
    def constraints(self) -> Indices:
        """Numbers of the constraints of each patch, shape (m, own); -1 for none."""
        number = np.where(self._number < len(self.areas), self._number, -1)
        return number.astype(np.int32)

    def positions(self, displacement: Points) -> Points:
        """The points as displaced [m], shape (number of points, 3)."""
        corners = self._rest[self.patches] + displacement[self.patches]
        positions: Points = (self.shape_functions @ corners).reshape(-1, 3)
        return positions

    def averaged(self, values: Floats) -> Floats:
        """Sums of s_qi times values of the points: of each constraint, shape (n, ...)."""
        parts = self.shares.transpose(0, 2, 1) @ self._of_patches(values)
        sums = _sums(self._number, parts, len(self.areas) + 1)
        return sums[:-1].reshape(len(self.areas), *values.shape[1:])

    def spread(self, values: Floats) -> Floats:
        """Sums of s_qi times values of the constraints: of each point, shape (m, ...)."""
        padded = np.concatenate([values, np.zeros((1, *values.shape[1:]))])
        rows = padded[self._number].reshape(*self._number.shape, math.prod(values.shape[1:]))
        count = self.shares.shape[0] * self.shares.shape[1]
        spread: Floats = (self.shares @ rows).reshape(count, *values.shape[1:])
        return spread

    def add_to(self, force: Points, vectors: Points) -> None:
        """Add forces on the points [N], shape (m, 3), to those of the mesh's points."""
        np.add.at(force, self.patches, self.shape_functions.T @ self._of_patches(vectors))

    def extend_pattern(self, body: Body) -> None:
        """Add the pairs of vertices that act on each other to the pattern of the body's matrix."""
        body.core.extend_pattern(self._pairs.rows, self._pairs.columns)

    def add_tangent(
        self, body: Body, weights: Floats, normals: Points, bends: Floats, own: Floats
    ) -> None:
        """Add to the body's matrix, which is assembled, and its pattern extended.

        Args:
            body: The body.
            weights: Stiffness of each constraint along its gap [N/m], 0 where it is not active,
                shape (n,).
            normals: Gradients of the gaps of the points, shape (m, 3).
            bends: Stiffnesses of the points [N/m], shape (m, 3, 3).
            own: Stiffnesses of the vertices of the constraints [N/m], shape (n, 3, 3).
        """
        pairs, shape = self._pairs, self.shape_functions
        bent, padded = self._of_patches(bends), np.append(weights, 0.0)
        near = padded[self._number].any(axis=1) | bent.any(axis=(1, 2))
        parts = np.einsum(
            "mqk,ql,mqj->mklj", self.shares[near], shape, self._of_patches(normals)[near]
        )
        gradients = _sums(pairs.entry[near], parts, len(pairs.of))
        stiff = padded[pairs.of[pairs.first]]
        active = np.flatnonzero(stiff)
        left, right = gradients[pairs.first[active]], gradients[pairs.second[active]]
        products = stiff[active, None, None] * (left[:, :, None] * right[:, None])
        blocks = _sums(pairs.slot[active], products.reshape(-1, 9), len(pairs.rows))
        np.add.at(
            blocks, pairs.between[near], np.einsum("qk,ql,mqj->mklj", shape, shape, bent[near])
        )
        some = np.flatnonzero(blocks.any(axis=1))
        body.core.add_blocks(pairs.rows[some], pairs.columns[some], blocks[some])
        if own.any():
            body.core.add_blocks(self._vertices, self._vertices, own.reshape(-1, 9))

    def _of_patches(self, values: Floats) -> Floats:
        """Values of the points, patch by patch: shape (patches, points of one, components)."""
        size = math.prod(values.shape[1:])
        rows: Floats = values.reshape(len(self.patches), len(self.shape_functions), size)
        return rows

    @cached_property
    def _pairs(self) -> _Pairs:
        number, patches, count = self._number, self.patches, len(self._rest)
        keys = number[:, :, None] * count + patches[:, None, :]
        entries, entry = np.unique(keys, return_inverse=True)
        of, vertex = np.divmod(entries, count)
        # Of the constraints' own entries; those of corners without one come last.
        own = of[of < len(self.areas)]
        sizes = np.bincount(own, minlength=1)
        start = np.cumsum(sizes) - sizes
        first = np.repeat(np.arange(len(own)), sizes[own])
        begin = np.cumsum(sizes[own]) - sizes[own]
        second = start[own[first]] + np.arange(len(first)) - begin[first]
        slots, slot = np.unique(vertex[first] * count + vertex[second], return_inverse=True)
        rows, columns = (x.astype(np.int32) for x in np.divmod(slots, count))
        between = np.searchsorted(
            slots, patches[:, :, None].astype(np.int64) * count + patches[:, None]
        )
        return _Pairs(entry.reshape(keys.shape), of, first, second, slot, between, rows, columns)


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Which vertices act on each other.

    Attributes:
        entry: Entry of a patch's constraint k for the vertex at its corner l, (patches, k, l).
        of: Constraint of each entry.
        first, second: Two entries of one constraint, for every such pair.
        slot: Block of each pair.
        between: Block of corners k and l of each patch, shape (patches, k, l).
        rows, columns: Vertices of each block.
    """

    entry: NDArray[np.int64]
    of: NDArray[np.int64]
    first: NDArray[np.int64]
    second: NDArray[np.int64]
    slot: NDArray[np.int64]
    between: NDArray[np.int64]
    rows: Indices
    columns: Indices


def _sums(index: NDArray[np.int64], rows: Floats, count: int) -> Floats:
    """Sums of rows, shape (*index.shape, components), with the same index: (count, components)."""
    sums = np.zeros((count, rows.shape[-1]))
    np.add.at(sums, index, rows)
    return sums
