"""Surfaces near surfaces: vertices against facets, edges against edges (section IV).

Broad phase: boxes, found through voxels that fit the elements (after Teschner et al. 2003).
Narrow phase: nearest points and exact distances. Both are found anew in each step, and are the
same sets that testing every pair gives.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.collision.detection import at_least_one, shaped_as
from palpate.fastsim.instruction_sets import chosen_instruction_set
from palpate.meshes.arrays import Floats, Indices, Points
from palpate.meshes.errors import InputError
from palpate.meshes.tri_surface import TriSurface


@dataclass(frozen=True, eq=False)
class VerticesNearFacets:
    """Vertices within a distance of facets, by facet, then by vertex.

    Attributes:
        vertices: Point of the intruding surface, shape (n,).
        facets: Facet near it, shape (n,).
        weights: Barycentric weights of the facet's nearest point [-], >= 0, sum 1, shape (n, 3).
        distances: From vertex to facet [m], >= 0, shape (n,).
    """

    vertices: Indices
    facets: Indices
    weights: Floats
    distances: Floats

    def __len__(self) -> int:
        return len(self.vertices)


@dataclass(frozen=True, eq=False)
class EdgesNearEdges:
    """Edges within a distance of edges, by second edge, then by first.

    Attributes:
        first: Edge of the intruding surface, a row of `EdgeEdgeDetector.intruder_edges`, shape
            (n,); on one surface, the edge with the lower number.
        second: Edge of the other surface, a row of `EdgeEdgeDetector.edges`, shape (n,).
        parameters: Of the nearest points along the first and the second edge [-], 0 to 1, shape
            (n, 2).
        distances: Between the edges [m], >= 0, shape (n,).
    """

    first: Indices
    second: Indices
    parameters: Floats
    distances: Floats

    def __len__(self) -> int:
        return len(self.first)


Pairs = TypeVar("Pairs", VerticesNearFacets, EdgesNearEdges)


class _SurfaceDetector(Generic[Pairs]):
    """Two surfaces, or one against itself, and what is found where they are now."""

    _kind: type[Pairs]
    _core: _core.VerticesNearFacets | _core.EdgesNearEdges

    def __init__(self, surface: TriSurface, intruder: TriSurface | None) -> None:
        self._surface = surface
        self._intruder = surface if intruder is None else intruder
        self._is_same = intruder is None

    def find(self, distance: float, points: Points, intruder_points: Points | None = None) -> Pairs:
        """Find all pairs no further apart than a distance.

        Args:
            distance: [m], >= 0.
            points: Of the surface looked at, where it is now [m], shape (num_points, 3).
            intruder_points: Of the other surface [m]; None for the same one.

        Raises:
            InputError: Wrong shape, or a negative or infinite distance.
            NonFiniteError: A point is NaN or infinite.
        """
        here, there = self._arrays(distance, points, intruder_points)
        return self._as_pairs(*self._core.find(there, here, distance))

    def find_candidates(
        self, distance: float, points: Points, intruder_points: Points | None = None
    ) -> Indices:
        """The broad phase alone: pairs whose boxes meet, one grown by the distance.

        Boxes are grown by 64 roundings of the largest coordinate more, so that nothing that
        `find` finds is missed.

        Returns:
            Intruding and other element of each pair, by the other, then by the intruding one,
            shape (n, 2).
        """
        here, there = self._arrays(distance, points, intruder_points)
        return self._core.find_candidates(there, here, distance)

    def find_by_brute_force(
        self,
        distance: float,
        points: Points,
        intruder_points: Points | None = None,
        *,
        only_candidates: bool = False,
    ) -> Pairs:
        """Every element against every other: the oracle of `find`, and of `find_candidates`."""
        here, there = self._arrays(distance, points, intruder_points)
        return self._as_pairs(*self._test_all(here, there, distance, only_candidates))

    def _test_all(
        self, here: Points, there: Points, distance: float, only_candidates: bool
    ) -> tuple[Indices, Points, Points]:
        raise NotImplementedError

    def _as_pairs(self, pairs: Indices, weights: Floats, squared: Floats) -> Pairs:
        return self._kind(pairs[:, 0], pairs[:, 1], weights, np.sqrt(squared))

    def _arrays(
        self, distance: float, points: Points, intruder_points: Points | None
    ) -> tuple[Points, Points]:
        if not (np.isfinite(distance) and distance >= 0.0):
            raise InputError(f"distance = {distance} m; it must be finite and not negative")
        here = shaped_as(self._surface.points, points)
        if intruder_points is None:
            if not self._is_same:
                raise InputError("two surfaces: give the points of the intruder as well")
            return here, here
        if self._is_same:
            raise InputError("one surface against itself has one table of points")
        return here, shaped_as(self._intruder.points, intruder_points)


class VertexFacetDetector(_SurfaceDetector[VerticesNearFacets]):
    """Finds vertices of one surface that come near facets of another, step after step.

    Args:
        surface: Surface whose facets are looked at.
        intruder: Surface whose vertices (those that its facets use) are looked for; None is the
            same surface, where a facet's own corners do not count.
        num_threads: At least 1; they wait between calls. What is found does not depend on it.
    """

    _kind = VerticesNearFacets

    def __init__(
        self, surface: TriSurface, intruder: TriSurface | None = None, *, num_threads: int = 1
    ) -> None:
        super().__init__(surface, intruder)
        self._vertices = np.unique(self._intruder.facets).astype(np.int32)
        self._core = _core.VerticesNearFacets(
            surface.points,
            surface.facets,
            self._vertices,
            self._is_same,
            at_least_one(num_threads),
            chosen_instruction_set(),
        )

    def _test_all(
        self, here: Points, there: Points, distance: float, only_candidates: bool
    ) -> tuple[Indices, Points, Points]:
        facets, same = self._surface.facets, self._is_same
        return _core.find_vertices_near_facets_brute_force(
            there, self._vertices, here, facets, distance, same, only_candidates
        )


class EdgeEdgeDetector(_SurfaceDetector[EdgesNearEdges]):
    """Finds edges of one surface that come near edges of another, step after step.

    Args:
        surface: Surface whose edges are looked at.
        intruder: Surface whose edges are looked for; None is the same surface, where a pair is
            found once, and edges with a common point do not count.
        num_threads: At least 1; they wait between calls. What is found does not depend on it.
    """

    _kind = EdgesNearEdges

    def __init__(
        self, surface: TriSurface, intruder: TriSurface | None = None, *, num_threads: int = 1
    ) -> None:
        super().__init__(surface, intruder)
        self.edges = edges_of(surface)
        self.intruder_edges = self.edges if self._is_same else edges_of(self._intruder)
        self._core = _core.EdgesNearEdges(
            self._intruder.points,
            self.intruder_edges,
            surface.points,
            self.edges,
            self._is_same,
            at_least_one(num_threads),
            chosen_instruction_set(),
        )

    def _test_all(
        self, here: Points, there: Points, distance: float, only_candidates: bool
    ) -> tuple[Indices, Points, Points]:
        given, same = (there, self.intruder_edges, here, self.edges), self._is_same
        return _core.find_edges_near_edges_brute_force(*given, distance, same, only_candidates)


def edges_of(surface: TriSurface) -> Indices:
    """Edges of a surface's facets, each once, lower point first, ascending, shape (n, 2)."""
    ends = np.sort(surface.facets[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges: Indices = np.unique(ends, axis=0).astype(np.int32).reshape(-1, 2)
    return edges
