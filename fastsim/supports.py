"""Supports: the fixed components of points, and their displacements by each support's factor.

A point on slanted planes is fixed along their normals only. It has axes of its own, the first of
which are fixed: components of such points are along these, of all others along x, y, z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.boundary_conditions import Rotation, Support
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem

# Two unit normals that differ by less than this count as one.
_PARALLEL = 1e-8


@dataclass(frozen=True, eq=False)
class SlantedPoints:
    """Points that a support fixes along a normal, with axes of their own.

    Attributes:
        points: Their numbers, shape (n,), sorted.
        axes: Unit vectors as rows, shape (n, 3, 3); the first `rank` span the fixed directions.
        rank: How many components are fixed, shape (n,), 1 to 3.
        weights: Components from the displacements along the supports' directions, (n, 3, 3).
        supports: Numbers of these supports, -1 for none, shape (n, 3).
        directions: Directions along which they fix the point, shape (n, 3, 3).
    """

    points: Indices
    axes: Floats
    rank: NDArray[np.int64]
    weights: Floats
    supports: NDArray[np.int64]
    directions: Floats

    def to_local(self, vectors: Points) -> Points:
        """The vectors with components along these points' own axes, a copy."""
        return self._turned(vectors, self.axes)

    def to_global(self, vectors: Points) -> Points:
        """The vectors with components along x, y, z, from the points' own axes."""
        return self._turned(vectors, self.axes.transpose(0, 2, 1))

    def _turned(self, vectors: Points, by: Floats) -> Points:
        turned = vectors.copy()
        turned[self.points] = np.einsum("nij,nj->ni", by, vectors[self.points])
        return turned


class FixedPoints:
    """The components of points that the supports of a problem fix.

    Attributes:
        is_free: 1 where free, 0 where fixed, shape (num_points, 3), of the points' own components.
        slanted: Points whose components are not along x, y, z; None without any.

    Raises:
        InputError: A number that is not finite.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        shape = problem.mesh.points.shape
        self.is_free = np.ones(shape, dtype=np.uint8)
        # Which support fixes each component; for slanted points see `slanted`.
        self._holder = np.full(shape, -1)
        for number, support in enumerate(problem.supports):
            given = np.array([support.displacement, support.normal or (0.0, 0.0, 1.0)])
            if not np.isfinite(given).all():
                raise InputError(f"support {number + 1}: its displacement is NaN or infinite")
            if support.normal is None:
                for axis in np.flatnonzero(support.components):
                    points = support.points
                    self.is_free[points, axis] = 0
                    self._holder[points, axis] = number
        self.slanted = self._find_slanted()

    def at(self, factors: float | Sequence[float] | Floats) -> Points:
        """Displacements of the fixed components, 0 for the free ones [m], shape (num_points, 3).

        `factors` are parts of the full size of all supports, or one for each.
        """
        supports = self._problem.supports
        each = np.broadcast_to(np.asarray(factors, dtype=np.float64), len(supports))
        prescribed = np.zeros(self.is_free.shape)
        for number, support in enumerate(supports):
            mine = self.fixed_by(number)
            points = np.flatnonzero(mine.any(axis=1))
            moved = moved_to(support, self._problem.mesh.points[points], float(each[number]))
            prescribed[mine] = moved[mine[points]]
        if self.slanted is not None:
            prescribed[self.slanted.points] = self._slanted_at(self.slanted, each)
        return prescribed

    def fixed_by(self, number: int) -> NDArray[np.bool_]:
        """Which components along x, y, z a support fixes, shape (num_points, 3)."""
        mine: NDArray[np.bool_] = self._holder == number
        return mine

    def to_local(self, vectors: Points) -> Points:
        """Vectors with components along the points' own axes."""
        return vectors if self.slanted is None else self.slanted.to_local(vectors)

    def to_global(self, vectors: Points) -> Points:
        """The vectors with components along x, y, z, from the points' own axes."""
        return vectors if self.slanted is None else self.slanted.to_global(vectors)

    def keep_free(self, vectors: Points) -> Points:
        """Vectors along x, y, z without their fixed components."""
        return self.to_global(np.where(self.is_free != 0, self.to_local(vectors), 0.0))

    def keep_held(self, vectors: Points) -> Points:
        """Vectors along x, y, z without their free components."""
        return vectors - self.keep_free(vectors)

    def _find_slanted(self) -> SlantedPoints | None:
        supports = self._problem.supports
        slanting = [number for number, s in enumerate(supports) if s.normal is not None]
        wanted: dict[int, list[tuple[int, Floats]]] = {}
        for number in slanting:
            support = supports[number]
            normal = np.array(support.normal) / np.linalg.norm(np.array(support.normal))
            for point in support.points.tolist():
                wanted.setdefault(point, []).append((number, normal))
        if not wanted:
            return None
        points = np.array(sorted(wanted), dtype=np.int32)
        n = len(points)
        found = SlantedPoints(
            points,
            np.zeros((n, 3, 3)),
            np.zeros(n, dtype=np.int64),
            np.zeros((n, 3, 3)),
            np.full((n, 3), -1),
            np.zeros((n, 3, 3)),
        )
        for k, point in enumerate(points.tolist()):
            by_axes = [
                (int(self._holder[point, axis]), np.eye(3)[axis])
                for axis in range(3)
                if self._holder[point, axis] >= 0
            ]
            self._orthogonalise(found, k, by_axes + wanted[point])
            self._holder[point] = -1
            self.is_free[point] = np.arange(3) >= found.rank[k]
        return found

    def _orthogonalise(
        self, found: SlantedPoints, k: int, directions: Sequence[tuple[int, Floats]]
    ) -> None:
        """Gram-Schmidt on the directions of a point; those in the span of others add nothing."""
        axes, weights, rank = found.axes[k], found.weights[k], 0
        for number, direction in directions:
            along = axes[:rank] @ direction
            rest = direction - along @ axes[:rank]
            rest -= (axes[:rank] @ rest) @ axes[:rank]
            length = float(np.linalg.norm(rest))
            if rank == 3 or length < _PARALLEL:
                continue
            axes[rank] = rest / length
            # direction = along . axes + length rest: solved for the component along rest.
            weights[rank] = -(along @ weights[:rank]) / length
            weights[rank, rank] = 1.0 / length
            found.supports[k, rank], found.directions[k, rank] = number, direction
            rank += 1
        found.rank[k] = rank
        axes[rank:] = np.linalg.svd(axes[:rank])[2][rank:]

    def _slanted_at(self, slanted: SlantedPoints, factors: Floats) -> Floats:
        asked = np.zeros(slanted.supports.shape)
        positions = self._problem.mesh.points[slanted.points]
        for number, support in enumerate(self._problem.supports):
            mine = slanted.supports == number
            if mine.any():
                moved = moved_to(support, positions, float(factors[number]))
                along = np.einsum("nkj,nj->nk", slanted.directions, moved)
                asked[mine] = along[mine]
        components: Floats = np.einsum("nij,nj->ni", slanted.weights, asked)
        return components


def moved_to(support: Support, points: Points, factor: float) -> Points:
    """Displacements of points of a support at a fraction of its full size [m], shape (n, 3)."""
    moved: Points = np.broadcast_to(factor * np.array(support.displacement), points.shape)
    if support.rotation is None:
        return moved
    across, inward = turning(support.rotation, points)
    angle = factor * support.rotation.angle
    # 1 - cos without its cancellation.
    moved = moved + np.sin(angle) * across + 2.0 * np.sin(0.5 * angle) ** 2 * inward
    return moved


def turning(rotation: Rotation, points: Points) -> tuple[Points, Points]:
    """Rodrigues' formula: k x r and k x (k x r) [m], shape (n, 3) each.

    A turn by theta moves a point at r from the center by sin(theta) times the first and
    1 - cos(theta) times the second.
    """
    axis = np.array(rotation.axis) / np.linalg.norm(np.array(rotation.axis))
    across = np.cross(axis, points - np.array(rotation.center))
    return across, np.cross(axis, across)
