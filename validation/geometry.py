"""From a case's geometry to a mesh: a shape, a surface or a mesh file."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from palpate.meshes.errors import InputError, MeshError, SurfaceError
from palpate.meshes.files import read_mesh, read_surface
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.shapes import shape_beam, shape_box, shape_cylinder, shape_sphere
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.surface_repair import repair_surface
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.case_schema import CaseSpec, GeometrySpec, MeshSpec
from palpate.validation.units import Units


@dataclass(frozen=True, eq=False)
class BuiltMesh:
    """A mesh and who made it."""

    mesh: TetMesh
    origin: str


def build_mesh(spec: CaseSpec, folder: Path) -> BuiltMesh:
    """Make or read the mesh of a case.

    Raises:
        InputError: A file that cannot be read, a surface that bounds no solid, or no mesher
            that manages.
    """
    from palpate.validation.case import inside_folder

    geometry, units = spec.geometry, spec.units
    scale = units.metres(1.0)
    if geometry.mesh is not None:
        path = inside_folder(folder, geometry.mesh)
        return BuiltMesh(read_mesh(path, scale=scale), f"read from {path.name}")
    if geometry.surface is not None:
        path = inside_folder(folder, geometry.surface)
        surface, notes = load_surface(path, scale=scale, repair=geometry.repair)
    else:
        surface, notes = build_shape(geometry, units), []
    built = fill(surface, spec.mesh, units)
    return BuiltMesh(built.mesh, "; ".join([built.origin, *notes]))


def load_surface(path: Path, *, scale: float, repair: bool = False) -> tuple[TriSurface, list[str]]:
    """Read a surface that bounds a solid, mended first where that is asked for.

    Args:
        path: The surface file; named in every message.
        scale: Metres per unit of the file.
        repair: Merge near points, turn facets round, close small holes.

    Returns:
        The surface, and lines on what was found or done.

    Raises:
        InputError: It cannot be read, or bounds no solid.
    """
    notes: list[str] = []
    surface = read_surface(path, scale=scale, tell=notes.append)
    try:
        if repair:
            surface, report = repair_surface(surface)
            notes = [*(n for n in notes if "without a facet" in n), *report.lines()]
        shells = require_closed(surface)
    except SurfaceError as error:
        error.args = (f"{path.name}: {'; '.join([*notes, str(error)])}",)
        raise
    if len(shells) > 1:
        kinds = Counter(str(shell.kind) for shell in shells)
        notes.append(
            f"{len(shells)} shells: " + ", ".join(f"{n} {kind}" for kind, n in kinds.items())
        )
    return surface, notes


def build_shape(geometry: GeometrySpec, units: Units) -> TriSurface:
    """The surface of a built-in shape; the schema has checked that its parameters are there."""

    def metres(value: float | None) -> float:
        return units.metres(cast(float, value))

    edge = metres(geometry.edge_length)
    match geometry.shape:
        case "box":
            x, y, z = (units.metres(s) for s in geometry.size or (1.0, 1.0, 1.0))
            return shape_box((x, y, z), edge_length=edge)
        case "beam":
            return shape_beam(
                metres(geometry.length),
                metres(geometry.width),
                metres(geometry.height),
                edge_length=edge,
            )
        case "cylinder":
            return shape_cylinder(
                metres(geometry.radius), metres(geometry.height), edge_length=edge
            )
        case "sphere":
            return shape_sphere(metres(geometry.radius), edge_length=edge)
        case _:
            return shape_kidney(edge_length=edge)


def fill(surface: TriSurface, spec: MeshSpec, units: Units) -> BuiltMesh:
    """Fill a surface: by the mesher asked for, or fastsim's first and gmsh's otherwise."""
    size = units.metres(spec.edge_length) if spec.edge_length is not None else None
    if spec.boundary_distance is not None:
        from palpate.fastsim.surface_remesher import remesh_surface

        surface, report = remesh_surface(
            surface, distance=units.metres(spec.boundary_distance), edge_length=size
        )
        kept = spec.model_copy(update={"boundary": "kept", "boundary_distance": None})
        built = fill(surface, kept, units)
        return BuiltMesh(built.mesh, f"{built.origin}; {report.line()}")
    refusal = ""
    if spec.mesher in ("auto", "fastsim"):
        from palpate.fastsim.mesher import MeshingError, mesh_surface

        try:
            mesh = mesh_surface(surface, edge_length=size)
            return BuiltMesh(mesh, f"meshed by fastsim: {mesh.num_cells} cells")
        except MeshingError as error:
            if spec.mesher == "fastsim":
                raise
            refusal = str(error)
    from palpate.meshes.gmsh_mesher import mesh_with_gmsh

    try:
        mesh = mesh_with_gmsh(surface, edge_length=size)
    except MeshError as error:
        if refusal and not isinstance(error, SurfaceError):
            raise InputError(
                f"neither mesher manages: fastsim: {refusal}; gmsh: {error}"
            ) from error
        raise
    why = f" (fastsim's mesher did not manage: {refusal})" if refusal else ""
    return BuiltMesh(mesh, f"meshed by gmsh: {mesh.num_cells} cells{why}")
