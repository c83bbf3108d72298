"""TriSurface, a triangulated surface, and typed errors of surfaces that bound no solid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.meshes.arrays import Indices, Integers, Points, checked_indices, checked_points
from palpate.meshes.errors import MeshError, first_of
from palpate.meshes.triangles import connected_parts, facet_normals


@dataclass(frozen=True, eq=False)
class TriSurface:
    """Triangles on points; arrays are checked, closedness is not (see `surface_checks`).

    Args:
        points: Positions [m], shape (num_points, 3), finite.
        facets: Point indices, shape (num_facets, 3), counter-clockwise seen from outside.

    Raises:
        ShapeError, NonFiniteError, IndexRangeError: The arrays cannot be used.

    >>> import palpate
    >>> corner = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    >>> facets = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    >>> round(6.0 * palpate.TriSurface(corner, facets).volume, 12)
    1.0
    """

    points: Points
    facets: Indices

    def __post_init__(self) -> None:
        points = checked_points(self.points)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "facets", checked_indices(self.facets, 3, len(points), "facets"))

    def __repr__(self) -> str:
        return f"<TriSurface of {len(self.points)} points and {len(self.facets)} facets>"

    @property
    def used_points(self) -> Integers:
        """Numbers of the points that facets use, ascending."""
        return np.flatnonzero(np.bincount(self.facets.ravel(), minlength=len(self.points)))

    @property
    def num_facets(self) -> int:
        """Number of triangles."""
        return len(self.facets)

    @cached_property
    def area_vectors(self) -> Points:
        """Half the cross product of two edges of each facet [m2], shape (num_facets, 3)."""
        return 0.5 * facet_normals(self.points[self.facets])

    @cached_property
    def area(self) -> float:
        """Total area [m2]."""
        return float(np.linalg.norm(self.area_vectors, axis=1).sum())

    @cached_property
    def volume(self) -> float:
        """Volume inside a closed surface by the divergence theorem [m3]; < 0 if turned inward.

        Summed about the centre of the points, so that a far-off origin costs no digits.
        """
        if self.num_facets == 0:
            return 0.0
        centre = self.points.mean(axis=0)
        height = (self.points - centre)[self.facets].mean(axis=1)
        return float(np.einsum("ij,ij->", height, self.area_vectors) / 3.0)


class SurfaceError(MeshError):
    """A surface that bounds no solid; `.facets` holds the guilty facets.

    `.summary` is the message without their numbers, `.surface` the surface with these numbers if
    known, `.done` lists what a repair had done before, `.hint` says what would help.
    """

    def __init__(self, summary: str, facets: Sequence[int] = (), *, detail: str = "") -> None:
        self.facets = [int(i) for i in facets]
        self.summary = summary
        self.surface: TriSurface | None = None
        self.done: list[str] = []
        self.hint = ""
        super().__init__(summary + detail)


class EmptySurfaceError(SurfaceError):
    """A surface without facets."""


class OpenSurfaceError(SurfaceError):
    """Edges with one facet only: `.edges`, pairs of points; `.num_holes` counts their loops."""

    def __init__(self, edges: Sequence[tuple[int, int]], facets: Sequence[int]) -> None:
        self.edges = [(int(a), int(b)) for a, b in edges]
        # Loops of a graph: edges less points plus parts; those that touch count each.
        points, ends = np.unique(np.array(self.edges, dtype=np.int64), return_inverse=True)
        parts = connected_parts(len(points), ends.reshape(-1, 2))
        self.num_holes = len(self.edges) - len(points) + len(np.unique(parts))
        super().__init__(
            f"the surface is open: {self.num_holes} hole(s), {len(self.edges)} edge(s) with one "
            "facet only",
            facets,
            detail=f", at points {first_of(self.edges, 3)}; close the holes",
        )


class FinError(SurfaceError):
    """Sheets that hang on the surface and end free; there is no hole."""

    def __init__(self, facets: Sequence[int], num_fins: int) -> None:
        self.num_fins = num_fins
        summary = f"{num_fins} fin(s) of {len(facets)} facet(s) stand on the surface and end free"
        super().__init__(summary, facets, detail=f": {first_of(list(facets))}; cut them off")


class NonManifoldError(SurfaceError):
    """Edges with more than two facets, or vertices where sheets touch; `.edges`, `.vertices`."""

    def __init__(
        self,
        facets: Sequence[int],
        edges: Sequence[tuple[int, int]] = (),
        vertices: Sequence[int] = (),
    ) -> None:
        self.edges = [(int(a), int(b)) for a, b in edges]
        self.vertices = [int(v) for v in vertices]
        what, which = (
            (f"{len(self.edges)} edge(s) with more than two facets", first_of(self.edges, 3))
            if self.edges
            else (f"{len(self.vertices)} vertex(es) where sheets touch", first_of(self.vertices))
        )
        summary = f"the surface is not manifold: {what}"
        super().__init__(summary, facets, detail=f": {which}; separate the sheets")


class OrientationError(SurfaceError):
    """Facets whose orientation differs from their neighbours', or that all point inwards."""


class DegenerateFacetError(SurfaceError):
    """Facets of zero area or with a repeated point."""

    def __init__(self, facets: Sequence[int]) -> None:
        detail = f": {first_of(list(facets))}; remove or re-mesh them"
        super().__init__(f"{len(facets)} facet(s) of zero area", facets, detail=detail)


class DuplicateFacetError(SurfaceError):
    """The same three points make more than one facet."""

    def __init__(self, facets: Sequence[int]) -> None:
        detail = f": {first_of(list(facets))}; remove copies"
        super().__init__(f"{len(facets)} facet(s) given more than once", facets, detail=detail)


class SelfIntersectionError(SurfaceError):
    """Facets that cut or touch others; `.pairs` holds them."""

    def __init__(self, pairs: Sequence[tuple[int, int]]) -> None:
        self.pairs = [(int(a), int(b)) for a, b in pairs]
        super().__init__(
            f"the surface intersects itself: {len(self.pairs)} pair(s) of facets",
            list(dict.fromkeys(f for pair in self.pairs for f in pair)),
            detail=f", {first_of(self.pairs, 3)}; repair it before meshing",
        )
