"""Springs over patches of the surface as forces and stiffnesses of points.

With the weight linear on each facet the integrals of `palpate.meshes.spring` are exact:

    f_a = sum_b K_ab (d - u_b),   K_ab = sum over facets of int kappa N_a N_b dA,

by int N_1^i N_2^j N_3^k dA = 2 A i! j! k! / (2 + i + j + k)!: A/10, A/30, A/60 times kappa
where the three corners are all one, two of them one, none. They sum to the stiffness k.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.fastsim import _core
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.spring import Spring
from palpate.meshes.triangles import facet_areas

# int N_a N_b N_c dA over A.
_PARTS = np.array(
    [
        [[{1: 1 / 10, 2: 1 / 30, 3: 1 / 60}[len({a, b, c})] for c in range(3)] for b in range(3)]
        for a in range(3)
    ]
)


class PatchSprings:
    """The springs of a problem, if any, on its mesh with points at rest [m].

    Attributes:
        facets: Facets of all patches, one after the other, shape (m, 3).
        stiffnesses: Between their corners [N/m], shape (m, 9).
        of_facet: Which spring each belongs to, shape (m,).

    Raises:
        InputError: A radius within which no point lies.
    """

    def __init__(self, points: Points, springs: Sequence[Spring]) -> None:
        self._num_points, self._count = len(points), len(springs)
        self.facets: Indices = np.vstack(
            [np.zeros((0, 3), dtype=np.int32), *(spring.facets for spring in springs)]
        ).astype(np.int32)
        kappa = np.vstack([np.zeros((0, 3)), *(spring.densities(points) for spring in springs)])
        areas = facet_areas(points[self.facets])
        K = areas[:, None, None] * np.einsum("abc,mc->mab", _PARTS, kappa)
        self.stiffnesses: Floats = np.ascontiguousarray(K.reshape(-1, 9))
        self.of_facet = np.repeat(np.arange(len(springs)), [len(s.facets) for s in springs])
        self._shares = K.sum(axis=2)  # of the corners: K_a
        self._K = K

    def __len__(self) -> int:
        return self._count

    def force(self, displacement: Points, anchors: Points, factors: Floats) -> Points:
        """Force on the body [N], (num_points, 3), of displacements [m] of points and anchors.

        `factors` are those on their stiffnesses [-], shape (num_springs,).
        """
        apart = anchors[self.of_facet][:, None] - displacement[self.facets]
        at_corners = factors[self.of_facet, None, None] * (self._K @ apart)
        return self._summed(at_corners)

    def resultants(self, displacement: Points, anchors: Points, factors: Floats) -> Points:
        """Whole force of each spring on the body [N], shape (num_springs, 3)."""
        apart = anchors[self.of_facet][:, None] - displacement[self.facets]
        of_facets = np.einsum("ma,maj->mj", self._shares, apart)
        sums = np.zeros((self._count, 3))
        np.add.at(sums, self.of_facet, of_facets)
        return factors[:, None] * sums

    def mean_displacements(self, displacement: Points) -> Points:
        """Weighted mean over each patch [m]: an anchor there exerts no resultant force."""
        sums, whole = np.zeros((self._count, 3)), np.zeros(self._count)
        of_facets = np.einsum("ma,maj->mj", self._shares, displacement[self.facets])
        np.add.at(sums, self.of_facet, of_facets)
        np.add.at(whole, self.of_facet, self._shares.sum(axis=1))
        return sums / whole[:, None]

    def multiply(self, displacement: Points) -> Points:
        """Sum over b of K_ab u_b of all springs at full stiffness [N], shape (num_points, 3)."""
        return self._summed(self._K @ displacement[self.facets])

    def row_sums(self) -> Floats:
        """Row sums of the stiffness of all springs [N/m], shape (num_points,)."""
        found = np.bincount(self.facets.ravel(), self._shares.ravel(), self._num_points)
        return np.asarray(found, dtype=np.float64)

    def add_to(self, core: _core.ElasticBody, factor: float) -> None:
        """Add their stiffness, times a factor, to the core's matrix."""
        if self._count:
            core.add_facet_stiffness(self.facets, factor * self.stiffnesses)

    def _summed(self, at_corners: Floats) -> Points:
        force = np.zeros((self._num_points, 3))
        np.add.at(force, self.facets.ravel(), at_corners.reshape(-1, 3))
        return force
