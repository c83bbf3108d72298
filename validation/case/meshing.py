"""From a closed surface to a mesh, as the case's [mesh] table asks."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.fastsim._core import SurfaceDistance
from palpate.fastsim.critical_cells import mesh_to_time_step
from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.fastsim.grading.size_fields import (
    SizeField,
    distance_to_ball,
    distance_to_facets,
    distance_to_points,
    grow_with_distance,
    refine_to_size,
)
from palpate.fastsim.mesher import (
    Boundary,
    Interior,
    MeshingError,
    MeshingReport,
    TimeLimitError,
    largest_edge,
    mesh_surface,
)
from palpate.fastsim.nested_bodies import mesh_bodies
from palpate.fastsim.surface_remesher import remesh_surface
from palpate.meshes.arrays import Indices, Points
from palpate.meshes.errors import InputError, MeshError, SurfaceError
from palpate.meshes.gmsh_mesher import mesh_with_gmsh
from palpate.meshes.problem import Material
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.case.body_schema import GradeSpec, MeshSpec
from palpate.validation.case.units import Units

MOST_CELLS = 2_000_000
# The group of what lies in the body and in no inclusion.
BODY = "body"
# Of gmsh, a process of its own [s].
_GMSH_LIMIT = 300.0
# Of a box around the body, which may be mostly empty.
_MOST_CELLS_OF_BOX, _MOST_FACETS_OF_BOX = 10 * MOST_CELLS, MOST_CELLS
# Regular tetrahedra of edge h fill 6 sqrt(2) to h^3, regular triangles 4 / sqrt(3) to h^2.
_CELLS_PER_CUBE, _FACETS_PER_SQUARE = 8.49, 2.31


@dataclass(frozen=True, eq=False)
class BuiltMesh:
    """A mesh and who made it."""

    mesh: TetMesh
    origin: str


@dataclass(frozen=True)
class Filling:
    """What is not the case's: who waits, until when, and for what time step.

    Attributes:
        progress: Called with a line for each stage.
        time_limit: Seconds; None is no limit.
        began: When they began to count, by the monotonic clock [s].
        target: A material, and the time step that explicit runs want [s]; fastsim's mesher only.
    """

    progress: Callable[[str], None] | None = None
    time_limit: float | None = None
    began: float = 0.0
    target: tuple[Material, float] | None = None

    def time_left(self) -> float | None:
        """Seconds; None is no limit.

        Raises:
            TimeLimitError: None are left.
        """
        if self.time_limit is None:
            return None
        left = self.began + self.time_limit - time.monotonic()
        if left <= 0.0:
            raise TimeLimitError(self.time_limit, "preparing the surface")
        return left


def _said(report: MeshingReport) -> str:
    """What a user should know of a mesh besides its size."""
    cut, left = report.boundary_steiner_points, report.slivers_left
    words = f", {cut} point(s) added on the surface's facets" if cut else ""
    words += f", {left} cell(s) with an angle below 10 degrees left" if left else ""
    return words + (" (the work on them is bounded)" if report.is_cut_short else "")


def require_countable(extents: Sequence[float], edge_length: float) -> None:
    """Refuse a size that asks for more cells or facets than anybody can hold, before any is made.

    Args:
        extents: Of a box around the body [m], three.
        edge_length: [m], > 0.

    Raises:
        InputError: More than 20 million cells, or 2 million facets.
    """
    a, b, c = (max(x / edge_length, 1.0) for x in extents)
    cells, facets = _CELLS_PER_CUBE * a * b * c, 2.0 * _FACETS_PER_SQUARE * (a * b + b * c + c * a)
    if not (cells <= _MOST_CELLS_OF_BOX and facets <= _MOST_FACETS_OF_BOX):
        raise InputError(
            f"edge_length = {edge_length:g} m asks for some {cells:.0e} cells and {facets:.0e} "
            f"facets in a box of {max(extents):g} m; take a larger one"
        )


def fill(
    surface: TriSurface,
    spec: MeshSpec,
    units: Units,
    groups: Mapping[str, Sequence[int]] | None = None,
    how: Filling | None = None,
) -> BuiltMesh:
    """Fill a surface: better facets first, where asked for.

    A mesh that keeps its facets is graded by bisection afterwards; with a free boundary fastsim's
    mesher makes it graded from the start.

    Args:
        surface: Bounds a solid [m].
        spec: Who fills it, and how finely.
        units: Of the lengths in `spec`.
        groups: Facets of the surface by name; in the mesh the same names have the facets of its
            boundary that lie there, whatever became of the given ones.
        how: What is not the case's: who waits, and for what step.

    Raises:
        InputError: A surface that bounds no solid, no mesher that manages, too many cells, or no
            time left.
    """
    how = how or Filling()
    try:
        built = _filled(surface, spec, units, how)
    except TimeLimitError as error:
        # Of what was left of it, so far.
        raise TimeLimitError(how.time_limit or error.time_limit, error.stage) from error
    if not groups:
        return built
    return BuiltMesh(_with_groups(built.mesh, surface, groups), built.origin)


def _with_groups(
    mesh: TetMesh, surface: TriSurface, groups: Mapping[str, Sequence[int]]
) -> TetMesh:
    named = {**mesh.facet_groups, **groups_by_place(mesh, surface, groups)}
    return TetMesh(mesh.points, mesh.cells, named, mesh.point_groups, mesh.cell_groups)


def fill_bodies(
    surfaces: Mapping[str, TriSurface],
    spec: MeshSpec,
    units: Units,
    groups: Mapping[str, Sequence[int]],
    how: Filling | None = None,
) -> BuiltMesh:
    """Fill a body and the surfaces in it, or beside it, with one mesh that has all their facets.

    Args:
        surfaces: By name [m], the body first; the names are groups of cells afterwards.
        spec: Who fills it, and how finely; facets are kept.
        units: Of the lengths in `spec`.
        groups: Facets of the body by name; see `fill`.
        how: Who waits, and until when; without a target.

    Raises:
        InputError: As `fill`; and surfaces that cut each other, or keys that inclusions do not
            go with.
    """
    if spec.boundary_distance is not None or spec.grade or spec.mesher == "gmsh":
        raise InputError(
            "surfaces of inclusions are kept as they are, by fastsim's mesher: a free boundary, "
            "grades and gmsh do not go with them"
        )
    wish = how or Filling()
    if wish.target is not None:
        raise InputError("a target for the time step does not go with inclusions")
    size = units.metres(spec.edge_length) if spec.edge_length is not None else None
    body = surfaces[BODY]
    if size is not None:
        require_countable([float(x) for x in np.ptp(body.points, axis=0)], size)

    def make(region: TriSurface, report: Callable[[MeshingReport], None]) -> TetMesh:
        return mesh_surface(
            region,
            edge_length=size,
            interior=Interior(spec.interior),
            time_limit=wish.time_left(),
            progress=wish.progress,
            report=report,
        )

    try:
        mesh = mesh_bodies(surfaces, make=make)
    except TimeLimitError as error:
        raise TimeLimitError(wish.time_limit or error.time_limit, error.stage) from error
    if groups:
        mesh = _with_groups(mesh, body, groups)
    cells = ", ".join(f"{len(rows)} of {name}" for name, rows in mesh.cell_groups.items())
    return BuiltMesh(mesh, f"meshed by fastsim: {mesh.num_cells} cells, {cells}")


def groups_by_place(
    mesh: TetMesh, surface: TriSurface, groups: Mapping[str, Sequence[int]]
) -> dict[str, Indices]:
    """Boundary facets of a mesh whose centres lie nearer to a group's facets than to all others.

    Args:
        mesh: Of the surface, facets kept, cut or replaced nearby.
        surface: [m].
        groups: Its facets by name.
    """
    centres = mesh.points[mesh.boundary_facets].mean(axis=1)
    found = {}
    for name, rows in groups.items():
        is_one = np.zeros(surface.num_facets, dtype=bool)
        is_one[list(rows)] = True
        near = SurfaceDistance(surface.points, surface.facets[is_one]).distances(centres)
        if is_one.all():
            found[name] = mesh.boundary_facets
            continue
        other = SurfaceDistance(surface.points, surface.facets[~is_one]).distances(centres)
        found[name] = mesh.boundary_facets[near < other]
    return found


def _filled(surface: TriSurface, spec: MeshSpec, units: Units, how: Filling) -> BuiltMesh:
    size = units.metres(spec.edge_length) if spec.edge_length is not None else None
    if size is not None:
        require_countable([float(x) for x in np.ptp(surface.points, axis=0)], size)
    done = []
    if spec.boundary_distance is not None:
        if spec.grade and spec.mesher != "gmsh":
            return _fill_graded(surface, spec, units, size, how)
        surface, report = remesh_surface(
            surface, distance=units.metres(spec.boundary_distance), edge_length=size
        )
        done.append(report.line())
        # That was the surface's length; a graded interior grows from there.
        size = None if spec.interior == "graded" else size
    built = _fill_kept(surface, spec, size, how)
    mesh = built.mesh
    if spec.grade:
        mesh = grade(mesh, spec.grade, units)
        done.append(f"graded to {mesh.num_cells} cells")
    return BuiltMesh(mesh, "; ".join([built.origin, *done]))


def _fill_graded(
    surface: TriSurface, spec: MeshSpec, units: Units, size: float | None, how: Filling
) -> BuiltMesh:
    """Facets and cells as small as the grades ask, made at once."""
    assert spec.boundary_distance is not None
    done: list[MeshingReport] = []
    mesh = mesh_surface(
        surface,
        edge_length=size,
        size_field=_size_field(surface, spec.grade, units),
        boundary=Boundary.FREE,
        boundary_distance=units.metres(spec.boundary_distance),
        time_limit=how.time_left(),
        progress=how.progress,
        report=done.append,
    )
    remesh = done[0].remesh
    assert remesh is not None
    return BuiltMesh(mesh, f"meshed by fastsim, graded: {mesh.num_cells} cells; {remesh.line()}")


def grade(mesh: TetMesh, grades: Sequence[GradeSpec], units: Units) -> TetMesh:
    """Refine by bisection until every grade's sizes are met."""
    graded = GradedMesh(mesh)
    refine_to_size(graded, _size_field(mesh.surface(), grades, units), max_cells=MOST_CELLS)
    return graded.mesh


def _size_field(surface: TriSurface, grades: Sequence[GradeSpec], units: Units) -> SizeField:
    """The smallest of what the grades ask."""
    fields: list[SizeField] = []
    for one in grades:
        if one.ball is not None:
            distance = distance_to_ball(units.place(one.ball.center), units.metres(one.ball.radius))
        elif one.point is not None:
            distance = distance_to_points(units.place(one.point))
        else:
            distance = distance_to_facets(surface)
        smallest = units.metres(one.smallest)
        fields.append(grow_with_distance(distance, smallest=smallest, growth=one.growth))

    def size(places: Points) -> Points:
        sizes: Points = np.min([field(places) for field in fields], axis=0)
        return sizes

    return size


def _fill_kept(surface: TriSurface, spec: MeshSpec, size: float | None, how: Filling) -> BuiltMesh:
    """By the mesher asked for, or fastsim's first and gmsh's otherwise."""
    refusal = ""
    if spec.mesher in ("auto", "fastsim"):
        try:
            done: list[MeshingReport] = []

            def make(altitude: float) -> TetMesh:
                return mesh_surface(
                    surface,
                    edge_length=size,
                    interior=Interior(spec.interior),
                    least_altitude=altitude,
                    time_limit=how.time_left(),
                    progress=how.progress,
                    report=done.append,
                )

            if how.target is None:
                mesh = make(0.0)
            else:
                mesh = mesh_to_time_step(*how.target, make, how.progress)
            return BuiltMesh(mesh, f"meshed by fastsim: {mesh.num_cells} cells{_said(done[-1])}")
        except MeshingError as error:
            if spec.mesher == "fastsim":
                raise
            refusal = str(error)
    if size is None and spec.interior == "graded":
        size = largest_edge(surface)
    try:
        mesh = mesh_with_gmsh(
            surface, edge_length=size, time_limit=min(how.time_left() or math.inf, _GMSH_LIMIT)
        )
    except MeshError as error:
        if refusal and not isinstance(error, SurfaceError):
            raise InputError(
                f"neither mesher manages: fastsim: {refusal}; gmsh: {error}"
            ) from error
        raise
    why = f" (fastsim's mesher did not manage: {refusal})" if refusal else ""
    return BuiltMesh(mesh, f"meshed by gmsh: {mesh.num_cells} cells{why}")
