"""Surfaces that push each other away: bodies that touch, and a body folded onto itself.

Every boundary vertex within a thickness d of a facet is pushed from the facet's nearest point,

    energy = k/2 sum_v A_v (d - g_v)^2,   g_v = distance of vertex v from its nearest facet,

with k in Pa/m and A_v a third of the adjacent facets' rest area, as for rigid tools. The force is
the energy's negative gradient: what the vertex gets, the facet's corners give, by the weights of
the nearest point, so momentum and moment of momentum are kept exactly. Taking the nearest facet
alone makes the distance continuous where a vertex slides from one facet to the next.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.fastsim.collision.surface_detection import VertexFacetDetector
from palpate.meshes.arrays import Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.tet_mesh import TetMesh

# Pairs of one body that lie this near at rest, in thicknesses, are neighbours and no contact.
_NEAR_AT_REST = 2.0


@dataclass(frozen=True, eq=False)
class SurfaceForces:
    """What surfaces do to each other.

    Attributes:
        force: On each point [N], sum and moment zero, shape (num_points, 3).
        energy: Stored between the surfaces [J].
        vertices: Boundary points that are pushed, ascending, shape (n,).
        facets: The nearest facet of each, a row of the mesh's `boundary_facets`, shape (n,).
        gaps: Their distances [m], 0 to the thickness, shape (n,).
    """

    force: Points
    energy: float
    vertices: Indices
    facets: Indices
    gaps: Points


class SurfaceContact:
    """Contact of the bodies of one mesh with each other and with themselves.

    Args:
        mesh: All bodies; those without a common point are apart.
        thickness: Distance d below which surfaces push [m], > 0; less than half the smallest
            edge, or neighbours push.
        stiffness: k [Pa/m], > 0; Young's modulus over an edge length is about as stiff as the
            bodies, and k d is the largest pressure that is borne.
        num_threads: Of the detection, at least 1.

    Note:
        Distances have no sign: a vertex that gets through is pushed out on the far side (see
        `largest_step`, and bear no more than k d). Edges that cross far from all vertices are not
        seen: facets must not be much larger than the features that touch.
    """

    def __init__(
        self, mesh: TetMesh, *, thickness: float, stiffness: float, num_threads: int = 1
    ) -> None:
        for name, value in (("thickness", thickness), ("stiffness", stiffness)):
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"{name} = {value}; it must be finite and above 0")
        surface = mesh.surface()
        self._facets = mesh.boundary_facets
        self._thickness = thickness
        self._stiffness = stiffness
        self._area = np.zeros(mesh.num_points)
        thirds = np.linalg.norm(surface.area_vectors, axis=1) / 3.0
        np.add.at(self._area, self._facets.ravel(), np.repeat(thirds, 3))
        self._detector = VertexFacetDetector(surface, num_threads=num_threads)
        body = bodies_of(mesh)
        near = self._detector.find(_NEAR_AT_REST * thickness, mesh.points)
        is_own = body[near.vertices] == body[self._facets[near.facets, 0]]
        self._neighbours = np.sort(self._keys(near.vertices, near.facets)[is_own])

    @property
    def largest_step(self) -> float:
        """How far points may move in a step so that no vertex passes a facet unseen [m].

        Half the thickness: two points that come towards each other from further than d apart have
        then not met.
        """
        return 0.5 * self._thickness

    def forces(self, points: Points) -> SurfaceForces:
        """Forces where the bodies are now.

        Args:
            points: [m], shape (num_points, 3).

        Raises:
            InputError: Wrong shape.
            NonFiniteError: A point is NaN or infinite.
        """
        points = np.ascontiguousarray(points, dtype=np.float64)
        found = self._detector.find(self._thickness, points)
        keys = self._keys(found.vertices, found.facets)
        kept = np.flatnonzero(~np.isin(keys, self._neighbours))
        # The nearest facet of each vertex; of equally near ones that with the lowest number.
        order = np.lexsort((found.facets[kept], found.distances[kept], found.vertices[kept]))
        kept = kept[order]
        vertices, first = np.unique(found.vertices[kept], return_index=True)
        kept = kept[first]
        facets, weights, gaps = found.facets[kept], found.weights[kept], found.distances[kept]
        corners = points[self._facets[facets]]
        away = points[vertices] - np.einsum("ik,ikx->ix", weights, corners)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        # On the facet itself: along its outward normal.
        away = np.where(gaps[:, None] > 0.0, away, normal)
        length = np.linalg.norm(away, axis=1)
        away /= np.where(length > 0.0, length, 1.0)[:, None]
        depth = self._thickness - gaps
        push = (self._stiffness * self._area[vertices] * depth)[:, None] * away
        force = np.zeros_like(points)
        np.add.at(force, vertices, push)
        np.add.at(force, self._facets[facets], -weights[:, :, None] * push[:, None, :])
        energy = 0.5 * self._stiffness * float((self._area[vertices] * depth**2).sum())
        return SurfaceForces(force, energy, vertices, facets, gaps)

    def _keys(
        self, vertices: Indices, facets: Indices
    ) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        keys: np.ndarray[tuple[int], np.dtype[np.int64]] = (
            vertices.astype(np.int64) * len(self._facets) + facets
        )
        return keys


def bodies_of(mesh: TetMesh) -> Indices:
    """The body of each point: the lowest point that cells join it to, shape (num_points,)."""
    body = np.arange(mesh.num_points, dtype=np.int32)
    while True:
        lowest = body[mesh.cells].min(axis=1)
        joined = body.copy()
        np.minimum.at(joined, mesh.cells.ravel(), np.repeat(lowest, 4))
        joined = joined[joined]  # as far as is known by now
        if np.array_equal(joined, body):
            return body
        body = joined
