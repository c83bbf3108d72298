"""The mesh of a case: read, or a closed surface filled as the [mesh] table asks."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

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
from palpate.fastsim.nested_bodies import CrossingBodiesError, mesh_bodies
from palpate.fastsim.surface_remesher import remesh_surface, require_no_self_intersection
from palpate.meshes.arrays import Indices
from palpate.meshes.errors import InputError, MeshError
from palpate.meshes.files import read_mesh
from palpate.meshes.gmsh_mesher import mesh_with_gmsh
from palpate.meshes.problem import Material
from palpate.meshes.repair.choices import RepairChoices
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import SurfaceError, TriSurface
from palpate.validation.case.geometry import (
    MOST_CELLS,
    LoadedSurface,
    advised,
    build_shape,
    crossing_message,
    inside_folder,
    load_surface,
    require_countable,
)

if TYPE_CHECKING:
    from palpate.validation.case.body_schema import GeometrySpec, GradeSpec, MeshSpec
    from palpate.validation.case.schema import CaseSpec
    from palpate.validation.conversions import Conversions

# The group of what lies in the body and in no inclusion.
BODY = "body"
# Time limit of gmsh, a process of its own [s].
_GMSH_LIMIT = 300.0
# Pairs of crossing facets that an error names at most.
_MOST_PAIRS = 1000


@dataclass(frozen=True, eq=False)
class BuiltMesh:
    """A mesh and who made it."""

    mesh: TetMesh
    origin: str


@dataclass(frozen=True, kw_only=True)
class Grade:
    """Smaller cells towards a point, a ball of a centre and a radius, or the whole boundary [m]."""

    smallest: float
    growth: float
    point: tuple[float, float, float] | None = None
    ball: tuple[tuple[float, float, float], float] | None = None


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What fills a surface, and how finely, in metres; the keys of [mesh] say what each means."""

    mesher: str = "auto"
    edge_length: float | None = None
    interior: Interior = Interior.UNIFORM
    boundary_distance: float | None = None
    grades: Sequence[Grade] = ()


@dataclass(frozen=True)
class Filling:
    """Settings that are not of the case: progress, time limit [s], and the wanted time step.

    The time began to count at `began`, by the monotonic clock [s]; `target` is a material, and the
    time step that explicit runs want [s], for fastsim's mesher only, as is `lengthens_step`: a
    case's own mesh stays what it was, for its stored references.
    """

    progress: Callable[[str], None] | None = None
    time_limit: float | None = None
    began: float = 0.0
    target: tuple[Material, float] | None = None
    lengthens_step: bool = False

    def time_left(self) -> float | None:
        """Seconds; None is no limit. Raises TimeLimitError where none are left."""
        if self.time_limit is None:
            return None
        left = self.began + self.time_limit - time.monotonic()
        if left <= 0.0:
            raise TimeLimitError(self.time_limit, "preparing the surface")
        return left


def _said(report: MeshingReport) -> str:
    """The facts about a mesh that a user should know besides its size."""
    cut, left = report.boundary_steiner_points, report.slivers_left
    words = f", {cut} point(s) added on the surface's facets" if cut else ""
    words += f", {left} cell(s) with an angle below 10 degrees left" if left else ""
    return words + (" (the work on them is bounded)" if report.is_cut_short else "")


def build_mesh(
    spec: CaseSpec, folder: Path, progress: Callable[[str], None] | None = None
) -> BuiltMesh:
    """Make or read the mesh of a case; `progress` is called with what a mesher does.

    Raises:
        InputError: A file that cannot be read, a surface without a solid, or no mesher manages.
    """
    geometry, units = spec.geometry, spec.units
    plan = _plan_of(spec.mesh, units)
    scale = units.metres(1.0)
    within = {
        f"inclusion {k}": one.surface
        for k, one in enumerate(spec.inclusion, 1)
        if one.surface is not None
    }
    if geometry.mesh is not None:
        if within:
            raise InputError(
                "an inclusion with a surface needs a body with one, or a shape: give a mesh file's "
                "inclusion by a group of its cells"
            )
        path = inside_folder(folder, geometry.mesh)
        read = BuiltMesh(read_mesh(path, scale=scale), f"read from {path.name}")
        return _graded(read, plan.grades)
    if geometry.surface is not None:
        path = inside_folder(folder, geometry.surface)
        wrap = None if geometry.wrap is None else units.metres(geometry.wrap)
        choices = _repair_choices(geometry, units)
        loaded = load_surface(path, scale=scale, repair=choices, wrap=wrap)
    else:
        loaded = LoadedSurface(build_shape(geometry, units), [], {})
    others = {
        name: load_surface(inside_folder(folder, surface), scale=scale)
        for name, surface in within.items()
    }
    built = fill_loaded(loaded, plan, others, Filling(progress))
    notes = [note for one in (loaded, *others.values()) for note in one.notes]
    return BuiltMesh(built.mesh, "; ".join([built.origin, *notes]))


def _plan_of(spec: MeshSpec, units: Conversions) -> Plan:
    def grade(one: GradeSpec) -> Grade:
        ball, point = one.ball, one.point
        return Grade(
            smallest=units.metres(one.smallest),
            growth=one.growth,
            point=None if point is None else units.lengths(point),
            ball=None if ball is None else (units.lengths(ball.center), units.metres(ball.radius)),
        )

    edge, distance = spec.edge_length, spec.boundary_distance
    return Plan(
        mesher=spec.mesher,
        edge_length=None if edge is None else units.metres(edge),
        interior=Interior(spec.interior),
        boundary_distance=None if distance is None else units.metres(distance),
        grades=[grade(one) for one in spec.grade],
    )


def _repair_choices(geometry: GeometrySpec, units: Conversions) -> RepairChoices | None:
    if not geometry.repair:
        return None
    given = geometry.repair_distance
    return RepairChoices(
        distance=None if given is None else units.metres(given),
        limit=geometry.repair_limit,
        largest_hole=geometry.largest_hole,
        smallest_shell=units.metres(geometry.smallest_shell),
    )


def fill_loaded(
    loaded: LoadedSurface,
    plan: Plan,
    inclusions: Mapping[str, LoadedSurface] | None = None,
    how: Filling | None = None,
) -> BuiltMesh:
    """Fill a surface with tetrahedra: better facets first, where asked for.

    A mesh with the given facets is graded by bisection afterwards; with a free boundary fastsim's
    mesher makes it graded from the start. With inclusions, surfaces in the body or beside it, one
    mesh has the facets of all, and groups of cells by their names. Groups of the surface's facets
    become those of the boundary's facets that lie there, whatever became of the given ones.

    Raises:
        InputError: A surface that bounds no solid, surfaces that cut each other, no mesher that
            manages, too many cells, keys that do not go with inclusions, or no time left. What is
            wrong with a file is said by its numbers.
    """
    how = how or Filling()
    # A free boundary has facets of its own.
    is_as_given = loaded.is_as_given and plan.boundary_distance is None
    path = None if inclusions else loaded.path
    try:
        with advised(path, loaded.surface, is_as_given=is_as_given):
            if inclusions:
                built = _fill_bodies({BODY: loaded, **inclusions}, plan, how)
            else:
                built = _fill(loaded.surface, plan, how)
    except TimeLimitError as error:
        # The error has the time that was left; the user knows the limit of all.
        raise TimeLimitError(how.time_limit or error.time_limit, error.stage) from error
    if not loaded.groups:
        return built
    mesh = built.mesh
    named = {**mesh.facet_groups, **_groups_by_position(mesh, loaded.surface, loaded.groups)}
    mesh = TetMesh(mesh.points, mesh.cells, named, mesh.point_groups, mesh.cell_groups)
    return BuiltMesh(mesh, built.origin)


def _fill_bodies(bodies: Mapping[str, LoadedSurface], plan: Plan, how: Filling) -> BuiltMesh:
    """A body and the surfaces in it, the body first, with all their facets."""
    if plan.boundary_distance is not None or plan.grades or plan.mesher == "gmsh":
        raise InputError(
            "surfaces of inclusions stay as they are, by fastsim's mesher: a free boundary, "
            "grades and gmsh do not go with them"
        )
    if how.target is not None:
        raise InputError("a target for the time step does not go with inclusions")
    size = plan.edge_length
    if size is not None:
        require_countable(np.ptp(bodies[BODY].surface.points, axis=0).tolist(), size)

    def make(region: TriSurface, report: Callable[[MeshingReport], None]) -> TetMesh:
        return mesh_surface(
            region,
            edge_length=size,
            interior=plan.interior,
            time_limit=how.time_left(),
            progress=how.progress,
            report=report,
        )

    try:
        mesh = mesh_bodies({name: body.surface for name, body in bodies.items()}, make=make)
    except CrossingBodiesError as error:
        error.args = (crossing_message(error, bodies),)
        raise
    cells = ", ".join(f"{len(rows)} of {name}" for name, rows in mesh.cell_groups.items())
    return BuiltMesh(mesh, f"meshed by fastsim: {mesh.num_cells} cells, {cells}")


def _fill(surface: TriSurface, plan: Plan, how: Filling) -> BuiltMesh:
    size, distance = plan.edge_length, plan.boundary_distance
    if size is not None:
        require_countable(np.ptp(surface.points, axis=0).tolist(), size)
    done = []
    if distance is not None:
        if plan.grades and plan.mesher != "gmsh":
            # Facets and cells as small as the grades ask, made at once.
            reports: list[MeshingReport] = []
            mesh = mesh_surface(
                surface,
                edge_length=size,
                size_field=_size_field(surface, plan.grades),
                boundary=Boundary.FREE,
                boundary_distance=distance,
                time_limit=how.time_left(),
                progress=how.progress,
                report=reports.append,
            )
            line = reports[0].remesh.line() if reports[0].remesh else ""
            return BuiltMesh(mesh, f"meshed by fastsim, graded: {mesh.num_cells} cells; {line}")
        surface, report = remesh_surface(
            surface, distance=distance, edge_length=size, progress=how.progress
        )
        done.append(report.line())
        # That was the surface's length; a graded interior grows from there.
        size = None if plan.interior is Interior.GRADED else size
    built = _fill_given(surface, plan, size, how)
    built = BuiltMesh(built.mesh, "; ".join([built.origin, *done]))
    return _graded(built, plan.grades)


def _graded(built: BuiltMesh, grades: Sequence[Grade]) -> BuiltMesh:
    """The mesh bisected until it is as fine as every grade asks."""
    if not grades:
        return built
    graded = GradedMesh(built.mesh)
    field = _size_field(built.mesh.surface(), grades)
    refine_to_size(graded, field, max_cells=MOST_CELLS)
    mesh = graded.mesh
    return BuiltMesh(mesh, f"{built.origin}; graded to {mesh.num_cells} cells")


def _size_field(surface: TriSurface, grades: Sequence[Grade]) -> SizeField:
    """The smallest of what the grades ask."""
    fields: list[SizeField] = []
    for one in grades:
        if one.ball is not None:
            distance = distance_to_ball(*one.ball)
        elif one.point is not None:
            distance = distance_to_points(one.point)
        else:
            distance = distance_to_facets(surface)
        fields.append(grow_with_distance(distance, smallest=one.smallest, growth=one.growth))
    return lambda points: np.min([field(points) for field in fields], axis=0)


def _fill_given(surface: TriSurface, plan: Plan, size: float | None, how: Filling) -> BuiltMesh:
    """Fill by the mesher asked for, or by fastsim's first and gmsh's otherwise."""
    refusal = ""
    if plan.mesher in ("auto", "fastsim"):
        try:
            done: list[MeshingReport] = []

            def make(altitude: float) -> TetMesh:
                return mesh_surface(
                    surface,
                    edge_length=size,
                    interior=plan.interior,
                    least_altitude=altitude,
                    lengthens_step=how.lengthens_step,
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
            if plan.mesher == "fastsim":
                raise
            refusal = str(error)
    if size is None and plan.interior is Interior.GRADED:
        size = largest_edge(surface)
    try:
        require_no_self_intersection(
            np.ascontiguousarray(surface.points), surface.facets, most=_MOST_PAIRS
        )
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


def _groups_by_position(
    mesh: TetMesh, surface: TriSurface, groups: Mapping[str, Sequence[int]]
) -> dict[str, Indices]:
    """Boundary facets of a mesh whose centres lie nearer to a group's facets than to all others."""
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
