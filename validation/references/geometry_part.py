"""What the true surface of a case's body would change: the geometry part of its error bars.

A case's truth solves the polyhedron that the case gives. Beside it the true body is solved: the
same cells cut in eight, once as they are and once with the boundary on the true surface, with the
same supports and loads (a force or a moment keeps its size, a pressure or traction its pascals).
All else is alike in the two, so that what they differ by is the surface, however coarse the cells.
Chords leave a gap of second order in the length of an edge, and of the finer body's a quarter is
left, so that the whole is 4/3 of the difference.

Built-in curved shapes know their surface. Of a body from a file nobody does: `[truth] surface`
names a finer one, to which the boundary is moved, or `geometry_distance` says how far the true
surface may be: then the boundary is moved so far out and in, and the larger difference counts.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Load, Traction
from palpate.meshes.face_loads import moment_traction
from palpate.meshes.problem import Problem, Strain
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
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.validation.case import Case
from palpate.validation.case.acting_schema import ForceSpec, LoadSpec, MomentSpec
from palpate.validation.case.geometry import build_shape, inside_folder, load_surface
from palpate.validation.case.units import Units
from palpate.validation.exchange.facets import facet_areas
from palpate.validation.exchange.surface_search import nearest_on_surface
from palpate.validation.metrics import COMPARISONS
from palpate.validation.references.bar_parts import GEOMETRY, PARTS, as_record
from palpate.validation.references.sequences import at_points_of
from palpate.validation.references.sets import ReferenceSet, solve_state
from palpate.validation.states import Progress, State

_WORDS = {
    "cylinder": "a cylinder",
    "sphere": "a sphere",
    "kidney": "a smooth kidney",
    "hollow_sphere": "a thick sphere",
    "hollow_octant": "an eighth of a thick sphere",
    "tube": "a tube",
}
# One over what is left where edges are halved, and what was: chords are of second order.
_OF_CHORDS = 4.0 / 3.0
# Cells of the pair that are still quadratic; of linear ones the relative difference is as good as
# they are stiff, some ten per cent of the part.
_LARGEST_QUADRATIC = 12_000
# Facets of the finer kidney to one of the case's, along an edge.
_FINER = 3.0


@dataclass(frozen=True, eq=False)
class TrueBody:
    """What the true body is, and meshes to hold against each other.

    Attributes:
        of: In words: "a cylinder".
        base: The case's polyhedron.
        others: The same cells with their boundary on the true surface, or as far as it may be.
        factor: What their difference is multiplied by.
    """

    of: str
    base: Problem
    others: tuple[TetMesh, ...]
    factor: float = 1.0


def with_geometry(
    case: Case, references: ReferenceSet, progress: Progress, *, strains: Collection[Strain]
) -> ReferenceSet:
    """References whose bars have a geometry part, where the case's body has a true surface.

    Args:
        case: Statics without tools; of others nothing is told.
        references: Of the case, with a truth and bars.
        progress: Called with one line for each solve.
        strains: Of the truths that are told of.

    Raises:
        InputError: A surface of `[truth]` that cannot be used, or a mesh too coarse for its own.
    """
    body = true_body(case) if case.problem.time is None and not case.problem.tools else None
    asked = [s for s in Strain if s in strains and references.truth(s) is not None]
    if body is None or not asked:
        return references
    parts = {place: references.bar_parts(*place) for place in references.bars if place[1] in asked}
    remarks = list(references.remarks)
    degree = 2 if body.base.mesh.num_cells <= _LARGEST_QUADRATIC else 1
    for strain in asked:
        try:
            found = _differences(case, body, strain, degree, progress)
        except ReferenceUnavailableError:
            raise
        except ReferenceFailedError as error:
            found = dict.fromkeys(COMPARISONS, math.inf)
            remarks.append(f"What {body.of} adds ({strain} strain) is not known: {error}.")
        parts |= {
            (m, s): dataclasses.replace(one, geometry=found[m])
            for (m, s), one in parts.items()
            if s is strain and m in found
        }
    rows = {**dict(references.provenance.get(PARTS, {})), **as_record(parts)}
    told: dict[str, Any] = {"of": body.of, "cells": body.base.mesh.num_cells, "degree": degree}
    return dataclasses.replace(
        references,
        provenance={**references.provenance, PARTS: rows, GEOMETRY: told},
        remarks=tuple(remarks),
    )


def shape_of(references: ReferenceSet) -> str:
    """What the case's mesh is a polyhedron of, in words; empty where nothing is kept of it."""
    told = references.provenance.get(GEOMETRY)
    return str(told.get("of", "")) if isinstance(told, dict) else ""


def polyhedron_note(case: Case) -> str:
    """That what a polyhedron leaves out of a curved body is in no bar; empty where it is told.

    Nobody knows the true surface of a body from a file, unless the case tells it. Of motions, and
    where tools press, it is not worked out.
    """
    shape, asked = case.spec.geometry.shape, case.spec.truth
    is_worked_out = case.problem.time is None and not case.problem.tools
    is_told = asked.surface is not None or asked.geometry_distance is not None
    is_known = is_told or shape is not None
    is_flat = shape is not None and shape not in _WORDS
    is_judged = any(spec.against == "truth" for spec in case.checks)
    if not is_judged or is_flat or (is_known and is_worked_out):
        return ""
    remedy = (
        "[truth] surface or geometry_distance in the case tells it"
        if is_worked_out
        else "of motions and under tools it is not worked out: hold the case against itself with a "
        "finer surface"
    )
    return (
        "The truth is that of this polyhedron: what its facets leave out of a curved body is in no "
        f"bar; {remedy}."
    )


def true_body(case: Case) -> TrueBody | None:
    """The true body of a case; None where its faces are flat, or nobody says what it is."""
    spec, units, problem = case.spec, case.spec.units, case.problem
    shape, asked = spec.geometry.shape, spec.truth
    if asked.geometry_distance is not None:
        distance = units.metres(asked.geometry_distance)
        others = tuple(offset_boundary(problem.mesh, sign * distance) for sign in (1.0, -1.0))
        of = f"a body within {asked.geometry_distance:g} {units.length} of it"
        return TrueBody(of, problem, others)
    if asked.surface is not None:
        path = inside_folder(case.folder, asked.surface)
        surface = load_surface(path, scale=units.metres(1.0)).surface
        of, parts = f"the surface in {path.name}", _along(problem.mesh, surface)
    elif shape in _WORDS:
        of, parts = _WORDS[shape], _own_parts(case, units)
    else:
        return None
    follows = refine_along(problem.mesh, parts)
    if shape == "kidney":
        follows = with_volume(follows, problem.mesh.volume)
    return TrueBody(of, refine_problem(problem), (follows,), _OF_CHORDS)


def with_volume(mesh: TetMesh, volume: float) -> TetMesh:
    """A mesh scaled about its middle to a volume [m3]: every kidney has that of Table I exactly."""
    middle = 0.5 * (mesh.points.min(axis=0) + mesh.points.max(axis=0))
    points = middle + (volume / mesh.volume) ** (1.0 / 3.0) * (mesh.points - middle)
    return TetMesh(points, mesh.cells, mesh.facet_groups, mesh.point_groups)


def _own_parts(case: Case, units: Units) -> list[CurvedPart]:
    """Of a built-in curved shape."""
    spec, mesh = case.spec.geometry, case.problem.mesh
    given = [r for r in (spec.radius, spec.inner_radius) if r is not None]
    radii = [units.metres(radius) for radius in given]
    match spec.shape:
        case "sphere" | "hollow_sphere" | "hollow_octant":
            return spherical_parts(mesh, radii)
        case "cylinder" | "tube":
            return upright_parts(mesh, radii)
    assert spec.edge_length is not None
    finer = spec.model_copy(update={"edge_length": spec.edge_length / _FINER})
    return _along(mesh, build_shape(finer, units))


def _along(mesh: TetMesh, surface: TriSurface) -> list[CurvedPart]:
    """The whole boundary, each point at the nearest place of a surface."""

    def project(places: Points) -> Points:
        found = nearest_on_surface(places, surface.points, surface.facets)
        corners = surface.points[surface.facets[found.facets]]
        near: Points = (found.weights[:, :, None] * corners).sum(axis=1)
        return near

    return [CurvedPart(mesh.boundary_facets, project)]


def _differences(
    case: Case, body: TrueBody, strain: Strain, degree: int, progress: Progress
) -> dict[str, float]:
    """By metric how far the true body is from the polyhedron, in units of the metric's scale."""

    def solve(problem: Problem) -> State:
        state = solve_state(problem, strain, degree, progress)
        return at_points_of(case.problem.mesh, state, state.label)

    base = solve(body.base)
    found = dict.fromkeys(COMPARISONS, 0.0)
    for mesh in body.others:
        problem = on_moved(case.spec.load, case.spec.units, body.base, mesh)
        other = as_changes(solve(problem), mesh, body.base.mesh)
        for metric, compare in COMPARISONS.items():
            apart = body.factor * compare(case.problem.mesh, other, base).value
            found[metric] = max(found[metric], apart)
    return found


def as_changes(state: State, own: TetMesh, base: TetMesh) -> State:
    """A state whose changes of volume and area are from its own rest, on another body's rest."""
    return dataclasses.replace(
        state,
        volume=base.volume + (state.volume - own.volume),
        surface_area=base.surface_area + (state.surface_area - own.surface_area),
    )


def on_moved(specs: Sequence[LoadSpec], units: Units, problem: Problem, mesh: TetMesh) -> Problem:
    """A problem on the same cells with moved points.

    Args:
        specs: The loads as the case says them.
        units: Of the case.
        problem: With those loads, in their order.
        mesh: Its mesh, moved.
    """
    loads = [
        _again(spec, units, load, problem.mesh, mesh)
        for spec, load in zip(specs, problem.loads, strict=True)
    ]
    return dataclasses.replace(problem, mesh=mesh, loads=tuple(loads))


def _again(spec: LoadSpec, units: Units, load: Load, old: TetMesh, new: TetMesh) -> Load:
    """A load whose force or moment is the case's on the moved facets too."""
    if isinstance(spec, ForceSpec) and isinstance(load, Traction):
        areas = [float(facet_areas(mesh.points, load.facets).sum()) for mesh in (old, new)]
        ratio = areas[0] / areas[1]
        x, y, z = (ratio * t for t in load.traction)
        return dataclasses.replace(load, traction=(x, y, z))
    if isinstance(spec, MomentSpec) and isinstance(load, Traction):
        moment = [units.newtons(m) * units.metres(1.0) for m in spec.moment]
        return moment_traction(new, load.facets, moment, load.amplitude)
    return load
