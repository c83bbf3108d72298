"""Errors that say which input cannot be used, with the data that shows it.

Every class derives from InputError; the command line turns it into exit code 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from palpate.meshes.tri_surface import TriSurface


def _first(items: Sequence[object], limit: int = 5) -> str:
    """Show the first few entries of a list of guilty things."""
    shown = ", ".join(str(item) for item in items[:limit])
    return shown if len(items) <= limit else f"{shown} and {len(items) - limit} more"


def _count_loops(edges: Sequence[tuple[int, int]]) -> int:
    """Loops of a graph: edges less points plus connected parts; two that touch are two."""
    parent: dict[int, int] = {}

    def root(v: int) -> int:
        while parent.setdefault(v, v) != v:
            parent[v] = parent[parent[v]]
            v = parent[v]
        return v

    for a, b in edges:
        parent[root(a)] = root(b)
    parts = sum(root(v) == v for v in list(parent))
    return len(edges) - len(parent) + parts


class InputError(ValueError):
    """The input cannot be used; the message names the thing, the value and the remedy.

    >>> import palpate
    >>> try:
    ...     palpate.Material(youngs_modulus=10e3, poissons_ratio=0.5)
    ... except palpate.InputError as error:
    ...     print(str(error)[:20])
    poissons_ratio = 0.5
    """


class FileFormatError(InputError):
    """A file is missing, unreadable, malformed or of an unknown kind; `.path` names it."""

    def __init__(self, path: object, reason: str) -> None:
        self.path = str(path)
        super().__init__(f"{path}: {reason}")


class DisagreeingSupportsError(InputError):
    """Two supports want a point at different places; `.points` and `.supports` (from 1) say which.

    `.time` is when [s]; None in statics.
    """

    def __init__(
        self,
        points: Sequence[int],
        supports: tuple[int, int],
        direction: str,
        wanted: tuple[float, float],
        time: float | None = None,
    ) -> None:
        self.points = [int(i) for i in points]
        self.supports = supports
        self.time = time
        when = "" if time is None else f" at {time:.4g} s"
        super().__init__(
            f"supports {supports[0]} and {supports[1]} disagree at {len(self.points)} point(s), "
            f"{_first(self.points)}: along {direction}{when} one wants {wanted[0]:.6g} m and the "
            f"other {wanted[1]:.6g} m; separate their regions, or hold other components"
        )


class FacetNotOnBoundaryError(InputError):
    """A facet of a support, load or tool inside the body, or given twice; `.rows` says which."""

    def __init__(
        self, what: str, rows: Sequence[int], corners: Sequence[int], *, is_copy: bool = False
    ) -> None:
        self.rows = [int(i) for i in rows]
        fault = (
            "given twice; remove the copies"
            if is_copy
            else "not on the boundary of the mesh; choose boundary facets"
        )
        super().__init__(f"{what}: {len(self.rows)} facet(s), first {list(corners)}, {fault}")


class MeshError(InputError):
    """A mesh or surface that cannot be used."""


class ShapeError(MeshError):
    """An array has the wrong shape or kind of number."""


class NonFiniteError(MeshError):
    """A coordinate is NaN or infinite; `.points` holds the indices of the points."""

    def __init__(self, points: Sequence[int]) -> None:
        self.points = [int(i) for i in points]
        super().__init__(
            f"{len(self.points)} point(s) with a coordinate that is NaN or infinite: "
            f"{_first(self.points)}; repair or drop them"
        )


class IndexRangeError(MeshError):
    """A cell or facet names a point that does not exist; `.rows` holds the guilty rows."""

    def __init__(self, what: str, rows: Sequence[int], num_points: int) -> None:
        self.rows = [int(i) for i in rows]
        super().__init__(
            f"{len(self.rows)} {what} name a point outside 0..{num_points - 1}: "
            f"{_first(self.rows)}; the file is damaged or numbered from one"
        )


class InvertedCellError(MeshError):
    """Cells of zero or negative volume; `.cells` and `.signed_volumes` hold them."""

    def __init__(self, cells: Sequence[int], signed_volumes: Sequence[float]) -> None:
        self.cells = [int(i) for i in cells]
        self.signed_volumes = [float(v) for v in signed_volumes]
        worst = min(self.signed_volumes, default=0.0)
        super().__init__(
            f"{len(self.cells)} cell(s) inverted or flat: {_first(self.cells)}; smallest signed "
            f"volume {worst:.3g} m3; re-mesh, or swap two points of each if all are mirrored"
        )


class SurfaceError(MeshError):
    """A surface that bounds no solid; `.facets` holds the guilty facets.

    `.summary` says what is wrong without their numbers, `.surface` is the one that has these
    numbers where it is known, `.done` is what a repair had done before, `.hint` what would help.
    """

    def __init__(
        self, message: str, facets: Sequence[int] = (), *, summary: str | None = None
    ) -> None:
        self.facets = [int(i) for i in facets]
        self.summary = message if summary is None else summary
        self.surface: TriSurface | None = None
        self.done: list[str] = []
        self.hint = ""
        super().__init__(message)


class EmptySurfaceError(SurfaceError):
    """A surface without facets."""


class OpenSurfaceError(SurfaceError):
    """Edges with one facet only: `.edges`, pairs of points; `.num_holes` counts their loops."""

    def __init__(self, edges: Sequence[tuple[int, int]], facets: Sequence[int]) -> None:
        self.edges = [(int(a), int(b)) for a, b in edges]
        self.num_holes = _count_loops(self.edges)
        summary = (
            f"the surface is open: {self.num_holes} hole(s), {len(self.edges)} edge(s) with one "
            "facet only"
        )
        super().__init__(
            f"{summary}, at points {_first(self.edges, 3)}; close the holes",
            facets,
            summary=summary,
        )


class FinError(SurfaceError):
    """Sheets that hang on the surface and end free; there is no hole."""

    def __init__(self, facets: Sequence[int], num_fins: int) -> None:
        self.num_fins = num_fins
        summary = f"{num_fins} fin(s) of {len(facets)} facet(s) stand on the surface and end free"
        super().__init__(
            f"{summary}: {_first(list(facets))}; cut them off", facets, summary=summary
        )


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
            (f"{len(self.edges)} edge(s) with more than two facets", _first(self.edges, 3))
            if self.edges
            else (f"{len(self.vertices)} vertex(es) where sheets touch", _first(self.vertices))
        )
        summary = f"the surface is not manifold: {what}"
        super().__init__(f"{summary}: {which}; separate the sheets", facets, summary=summary)


class OrientationError(SurfaceError):
    """Facets whose orientation differs from their neighbours', or that all point inwards."""


class DegenerateFacetError(SurfaceError):
    """Facets of zero area or with a repeated point."""

    def __init__(self, facets: Sequence[int]) -> None:
        summary = f"{len(facets)} facet(s) of zero area"
        super().__init__(
            f"{summary}: {_first(list(facets))}; remove or re-mesh them", facets, summary=summary
        )


class DuplicateFacetError(SurfaceError):
    """The same three points make more than one facet."""

    def __init__(self, facets: Sequence[int]) -> None:
        summary = f"{len(facets)} facet(s) given more than once"
        super().__init__(
            f"{summary}: {_first(list(facets))}; remove copies", facets, summary=summary
        )


class SelfIntersectionError(SurfaceError):
    """Facets that cut or touch others; `.pairs` holds them."""

    def __init__(self, pairs: Sequence[tuple[int, int]]) -> None:
        self.pairs = [(int(a), int(b)) for a, b in pairs]
        summary = f"the surface intersects itself: {len(self.pairs)} pair(s) of facets"
        super().__init__(
            f"{summary}, {_first(self.pairs, 3)}; repair it before meshing",
            list(dict.fromkeys(f for pair in self.pairs for f in pair)),
            summary=summary,
        )
