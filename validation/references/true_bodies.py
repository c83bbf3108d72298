"""The true body of a case beside its polyhedron: the same cells, with the boundary where it is.

Built-in curved shapes know their surface. Of a body from a file nobody does: `[truth] surface`
names a finer one, to which the boundary is moved, or `geometry_distance` says how far the true
surface may be: then the boundary is moved so far out and in, and the larger difference counts.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Load, Traction
from palpate.meshes.face_loads import moment_traction
from palpate.meshes.problem import Problem
from palpate.meshes.refinement import refine_problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface
from palpate.meshes.true_surfaces import (
    CurvedPart,
    offset_boundary,
    refine_along,
    spherical_parts,
    upright_parts,
)
from palpate.validation.case import Case
from palpate.validation.case.geometry import build_shape, inside_folder, load_surface
from palpate.validation.case.loading_schema import ForceSpec, LoadSpec, MomentSpec
from palpate.validation.case.units import Units
from palpate.validation.exchange.nodal_arrays import facet_areas
from palpate.validation.exchange.point_location import nearest_on_surface

# Names of the true surfaces of built-in shapes that are curved.
CURVED = {
    "cylinder": "a cylinder",
    "sphere": "a sphere",
    "kidney": "a smooth kidney",
    "hollow_sphere": "a thick sphere",
    "hollow_octant": "an eighth of a thick sphere",
    "tube": "a tube",
}
# Chords are of second order: where edges are halved a quarter of the gap is left, so that the whole
# is 4/3 of the difference. P. J. Roache's factor of safety where the order is known (Annu. Rev.
# Fluid Mech. 29 (1997) 123-160) makes a bound of it; linear tetrahedra fall short by up to 15 %.
_SAFETY = 1.25
OF_CHORDS = _SAFETY * 4.0 / 3.0
# Facets of the finer shape to one of the case's, along an edge.
_FINER = 3.0


@dataclass(frozen=True, eq=False)
class TrueBody:
    """The true body, and meshes that are compared with each other.

    Attributes:
        of: Name of the body in words: "a cylinder".
        base: The case's polyhedron.
        others: The same cells with their boundary on the true surface, or as far as it may be.
        factor: Factor of their difference.
    """

    of: str
    base: Problem
    others: tuple[TetMesh, ...]
    factor: float = 1.0


def name_of_body(case: Case) -> str:
    """The surface that the case's mesh approximates; empty where it is flat or nobody knows."""
    spec, asked = case.spec, case.spec.truth
    if asked.geometry_distance is not None:
        return f"a body within {asked.geometry_distance:g} {spec.units.length} of it"
    if asked.surface is not None:
        return f"the surface in {inside_folder(case.folder, asked.surface).name}"
    return CURVED.get(spec.geometry.shape or "", "")


def surface_key(case: Case) -> str:
    """Key of the file that `[truth] surface` names; empty where it names none."""
    name = case.spec.truth.surface
    if name is None:
        return ""
    return hashlib.sha256(inside_folder(case.folder, name).read_bytes()).hexdigest()[:12]


def true_body(case: Case) -> TrueBody | None:
    """The true body of a case; None where its faces are flat, or nobody says what it is.

    Raises:
        InputError: A surface of `[truth]` that cannot be used, or a mesh too coarse for its own.
    """
    spec, units, problem = case.spec, case.spec.units, case.problem
    shape, asked, of = spec.geometry.shape, spec.truth, name_of_body(case)
    if not of:
        return None
    if asked.geometry_distance is not None:
        distance = units.metres(asked.geometry_distance)
        others = tuple(offset_boundary(problem.mesh, sign * distance) for sign in (1.0, -1.0))
        return TrueBody(of, problem, others)
    if asked.surface is not None:
        path = inside_folder(case.folder, asked.surface)
        parts = _along(problem.mesh, load_surface(path, scale=units.metres(1.0)).surface)
    else:
        parts = _own_parts(case, units)
    follows = refine_along(problem.mesh, parts)
    if shape == "kidney":
        follows = with_volume(follows, problem.mesh.volume)
    return TrueBody(of, refine_problem(problem), (follows,), OF_CHORDS)


def with_volume(mesh: TetMesh, volume: float) -> TetMesh:
    """A mesh scaled about its middle to a volume [m3]: every kidney has that of Table I exactly."""
    middle = 0.5 * (mesh.points.min(axis=0) + mesh.points.max(axis=0))
    points = middle + (volume / mesh.volume) ** (1.0 / 3.0) * (mesh.points - middle)
    return TetMesh(points, mesh.cells, mesh.facet_groups, mesh.point_groups)


def _own_parts(case: Case, units: Units) -> list[CurvedPart]:
    """Curved parts of a built-in shape."""
    spec, mesh = case.spec.geometry, case.problem.mesh
    given = [r for r in (spec.radius, spec.inner_radius) if r is not None]
    radii = [units.metres(radius) for radius in given]
    # The mesher put the points of a free boundary near the surface, those of flat faces too.
    if case.spec.mesh.boundary == "kept":
        match spec.shape:
            case "sphere" | "hollow_sphere" | "hollow_octant":
                return spherical_parts(mesh, radii)
            case "cylinder" | "tube":
                return upright_parts(mesh, radii)
    assert spec.edge_length is not None
    finer = spec.model_copy(update={"edge_length": spec.edge_length / _FINER})
    return _along(mesh, build_shape(finer, units))


def _along(mesh: TetMesh, surface: TriSurface) -> list[CurvedPart]:
    """The whole boundary, each point at the nearest point of a surface."""

    def project(positions: Points) -> Points:
        found = nearest_on_surface(positions, surface.points, surface.facets)
        corners = surface.points[surface.facets[found.facets]]
        near: Points = (found.weights[:, :, None] * corners).sum(axis=1)
        return near

    return [CurvedPart(mesh.boundary_facets, project)]


def on_moved(specs: Sequence[LoadSpec], units: Units, problem: Problem, mesh: TetMesh) -> Problem:
    """A problem on the same cells with moved points; tools keep their paths in space.

    Args:
        specs: The loads as the case says them; loads beyond these are weights of masses.
        units: Units of the case.
        problem: The problem with those loads, in their order.
        mesh: Its mesh with moved points.
    """
    loads = [
        _again(spec, units, load, problem.mesh, mesh)
        for spec, load in zip_longest(specs, problem.loads)
    ]
    return dataclasses.replace(problem, mesh=mesh, loads=tuple(loads))


def _again(spec: LoadSpec | None, units: Units, load: Load, old: TetMesh, new: TetMesh) -> Load:
    """A load whose force or moment is the case's on the moved facets too; None is a weight."""
    if isinstance(spec, ForceSpec | None) and isinstance(load, Traction):
        areas = [float(facet_areas(mesh.points, load.facets).sum()) for mesh in (old, new)]
        ratio = areas[0] / areas[1]
        x, y, z = (ratio * t for t in load.traction)
        return dataclasses.replace(load, traction=(x, y, z))
    if isinstance(spec, MomentSpec) and isinstance(load, Traction):
        moment = [units.newtons(m) * units.metres(1.0) for m in spec.moment]
        return moment_traction(new, load.facets, moment, load.amplitude)
    return load
