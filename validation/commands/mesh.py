"""`palpate mesh SURFACE -o MESH`: a closed surface filled with tetrahedra."""

from __future__ import annotations

import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from palpate.meshes.errors import InputError
from palpate.validation.commands.words import progress_lines
from palpate.validation.quoting import for_terminal


class Mesher(StrEnum):
    """Who meshes."""

    FASTSIM = "fastsim"
    GMSH = "gmsh"


def mesh(
    surface: Annotated[str, typer.Argument(help="surface file, or kidney")],
    output: Annotated[Path, typer.Option("--output", "-o", help=".vtu, .vtk or .msh")],
    size: Annotated[float | None, typer.Option(help="edge length, in the file's unit")] = None,
    mesher: Annotated[Mesher, typer.Option()] = Mesher.FASTSIM,
    unit: Annotated[str, typer.Option(help="unit of file and size: m, cm or mm")] = "mm",
    repair: Annotated[bool, typer.Option(help="merge near points, turn, close holes")] = False,
    free: Annotated[
        float | None, typer.Option(help="how far the boundary may move, in the file's unit")
    ] = None,
    grade_to: Annotated[
        tuple[float, float, float] | None, typer.Option(help="point with the smallest cells")
    ] = None,
    smallest: Annotated[float | None, typer.Option(help="edge length there")] = None,
    growth: Annotated[float, typer.Option(help="edge length over distance from it")] = 0.5,
) -> None:
    """Fill a closed surface with tetrahedra, keeping its facets."""
    from palpate.meshes.files import MESH_SUFFIXES, write_mesh
    from palpate.meshes.kidney import shape_kidney
    from palpate.meshes.quality import measure_quality
    from palpate.meshes.tet_mesh import TetMesh
    from palpate.validation.case.filling import fill
    from palpate.validation.case.geometry import load_surface
    from palpate.validation.case.geometry_schema import MeshSpec
    from palpate.validation.case.units import LENGTH, Units
    from palpate.validation.output_files import require_outputs

    if unit not in LENGTH:
        raise InputError(f"--unit {unit}: use one of {', '.join(LENGTH)}")
    if output.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(f"{output}: unknown kind; use {', '.join(MESH_SUFFIXES)}")
    require_outputs({"--output": output}, inputs=[] if surface == "kidney" else [surface])
    if (grade_to is None) != (smallest is None):
        raise InputError("--grade-to and --smallest go together")
    lengths = (("--size", size), ("--free", free), ("--smallest", smallest), ("--growth", growth))
    for option, value in lengths:
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{option} {value:g}: needs a finite value above 0")
    scale = LENGTH[unit]
    if surface == "kidney":
        body = shape_kidney(edge_length=size * scale if size else 0.008)
    else:
        body, notes = load_surface(Path(surface), scale=scale, repair=repair)
        for note in notes:
            progress_lines()(note)
    units = Units.model_validate({"length": unit})
    if grade_to is not None and not all(map(math.isfinite, grade_to)):
        raise InputError(f"--grade-to {grade_to}: needs three finite numbers")
    spec = MeshSpec.model_validate(
        {
            "mesher": mesher.value,
            "edge_length": size,
            "boundary": "kept" if free is None else "free",
            "boundary_distance": free,
            "grade": []
            if grade_to is None
            else [{"point": grade_to, "smallest": smallest, "growth": growth}],
        }
    )
    built = fill(body, spec, units)
    quality = measure_quality(built.mesh)
    write_mesh(output, TetMesh(built.mesh.points / scale, built.mesh.cells))
    line = (
        f"{output}: {built.origin}, smallest dihedral angle {quality.smallest_dihedral_deg:.1f}"
        f" degrees, volume {built.mesh.volume:.6g} m3"
    )
    print(for_terminal(line))
