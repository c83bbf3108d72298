"""`palpate mesh SURFACE -o MESH`: a closed surface filled with tetrahedra."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.meshes.errors import InputError
from palpate.validation.commands.options import (
    TISSUE,
    Force,
    place_of,
    print_lines,
    progress_lines,
    step_lines,
)
from palpate.validation.quoting import for_terminal

if TYPE_CHECKING:
    from palpate.fastsim.critical_cells import CriticalCells
    from palpate.meshes.repair.choices import RepairChoices

# `--free` is suggested where the step is below this part of that of a regular cell whose edges are
# the surface's mean edge, with this part of it for the distance: of five surfaces below that, all
# had steps 1.8 to 1 000 times as long with it.
_FAR_BELOW, _DISTANCE = 0.1, 0.1
# Step of a regular cell, in edges over the wave speed: half of its facets' altitude.
_REGULAR = 0.25 * math.sqrt(3.0)


class Mesher(StrEnum):
    """The mesher."""

    FASTSIM = "fastsim"
    GMSH = "gmsh"


def mesh(
    surface: Annotated[str, typer.Argument(help="surface file, label image, kidney or phantom")],
    output: Annotated[Path, typer.Option("--output", "-o", help=".vtu, .vtk or .msh")],
    size: Annotated[
        float | None, typer.Option(help="largest edge length inside, in the file's unit")
    ] = None,
    uniform: Annotated[
        bool, typer.Option(help="as fine inside as the surface; else cells grow inwards")
    ] = False,
    mesher: Annotated[Mesher, typer.Option()] = Mesher.FASTSIM,
    unit: Annotated[str, typer.Option(help="unit of file and size: m, cm or mm")] = "mm",
    repair: Annotated[
        bool,
        typer.Option(help="close holes, repair what cuts itself, turn, merge; each is reported"),
    ] = False,
    repair_distance: Annotated[
        float | None, typer.Option(help="how far parts may move; half a mean edge if not given")
    ] = None,
    repair_limit: Annotated[
        float | None, typer.Option(help="most % of a part's volume; 2 if not given, 100 is all")
    ] = None,
    largest_hole: Annotated[
        int | None, typer.Option(help="most edges of a hole that is closed; 100 if not given")
    ] = None,
    smallest_shell: Annotated[
        float | None, typer.Option(help="loose parts shorter than this are dropped")
    ] = None,
    wrap: Annotated[
        float | None, typer.Option(help="a new closed surface around anything, this far at most")
    ] = None,
    free: Annotated[
        float | None, typer.Option(help="how far the boundary may move, in the file's unit")
    ] = None,
    inclusion: Annotated[
        list[str] | None,
        typer.Option(help="NAME=FILE: a surface within, whose cells are a group; repeatable"),
    ] = None,
    label: Annotated[
        list[str] | None,
        typer.Option(help="NUMBER=NAME: a label of a label image, a group of cells; repeatable"),
    ] = None,
    wall: Annotated[
        list[str] | None,
        typer.Option(help="NUMBER=NAME: a label not meshed, whose facets are a group; repeatable"),
    ] = None,
    smallest_island: Annotated[
        int, typer.Option(help="loose parts of a label with fewer voxels are named")
    ] = 27,
    voxel_edge: Annotated[
        float | None,
        typer.Option(help="edge of the voxels that walls of labels are made of, in mm"),
    ] = None,
    time_limit: Annotated[
        float | None, typer.Option(help="seconds, after which there is an error and no file")
    ] = None,
    material: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="E [Pa], nu, density [kg/m3]: the time step is reported for it"),
    ] = None,
    target_step: Annotated[
        float | None, typer.Option(help="time step that explicit runs want, in seconds")
    ] = None,
    grade_to: Annotated[
        tuple[float, float, float] | None, typer.Option(help="point with the smallest cells")
    ] = None,
    smallest: Annotated[float | None, typer.Option(help="edge length there")] = None,
    growth: Annotated[float, typer.Option(help="edge length over distance from it")] = 0.5,
    force: Force = False,
) -> None:
    """Fill a closed surface with tetrahedra, keeping its facets."""
    import numpy as np

    from palpate.fastsim.critical_cells import find_critical_cells
    from palpate.fastsim.mesher import FlatCellError, Interior
    from palpate.fastsim.surface_remesher import mean_edge_length
    from palpate.meshes.errors import InvertedCellError
    from palpate.meshes.files import MESH_SUFFIXES, in_file_unit, write_mesh
    from palpate.meshes.kidney import shape_kidney
    from palpate.meshes.label_images import is_label_image
    from palpate.meshes.problem import Material
    from palpate.meshes.tet_mesh import TetMesh
    from palpate.validation.case.geometry import LoadedSurface, load_surface
    from palpate.validation.case.meshing import Filling, Grade, Plan, fill_loaded
    from palpate.validation.commands.mesh_labels import mesh_label_image
    from palpate.validation.conversions import LENGTH, PlainUnits
    from palpate.validation.output_files import require_outputs

    if is_label_image(surface) or surface == "phantom" or label:
        others = {
            "--size": size, "--repair": repair or None, "--wrap": wrap, "--free": free,
            "--inclusion": inclusion, "--material": material, "--target-step": target_step,
            "--grade-to": grade_to, "--smallest": smallest,
        }  # fmt: skip
        given = [name for name, value in others.items() if value]
        if given or mesher is not Mesher.FASTSIM or unit != "mm":
            raise InputError(
                f"{given[0] if given else '--mesher or --unit'} does not go with a label image: "
                "positions are in mm, the walls stay as they are, by fastsim's mesher"
            )
        mesh_label_image(
            surface, output, label or [], wall or [], smallest_island, voxel_edge, uniform,
            time_limit, force=force,
        )  # fmt: skip
        return
    if voxel_edge is not None or wall:
        given_one = "--wall" if wall else "--voxel-edge"
        raise InputError(f"{given_one} goes with a label image; --size says how large cells are")
    if unit not in LENGTH:
        raise InputError(f"--unit {unit}: use one of {', '.join(LENGTH)}")
    if output.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(f"{output}: unknown kind; use {', '.join(MESH_SUFFIXES)}")
    read = [] if surface == "kidney" else [surface]
    require_outputs({"--output": output}, inputs=read, force=force)
    began = time.monotonic()
    if target_step is not None and (material is None or mesher is not Mesher.FASTSIM):
        raise InputError("--target-step needs --material, and fastsim's mesher")
    if (grade_to is None) != (smallest is None):
        raise InputError("--grade-to and --smallest go together")
    lengths = (
        ("--wrap", wrap),
        ("--size", size),
        ("--free", free),
        ("--smallest", smallest),
        ("--growth", growth),
        ("--time-limit", time_limit),
        ("--target-step", target_step),
    )
    for option, value in lengths:
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{option} {value:g}: needs a finite value above 0")
    scale = LENGTH[unit]
    units = PlainUnits(length=unit)
    say = progress_lines()

    def progress(line: str) -> None:
        say(units.in_case_units(line))

    if surface == "kidney":
        loaded = LoadedSurface(shape_kidney(edge_length=size * scale if size else 0.008), [], {})
    else:
        choices = _choices(
            repair, repair_distance, repair_limit, largest_hole, smallest_shell, scale
        )
        away = None if wrap is None else wrap * scale
        with units.in_own_words():
            loaded = load_surface(
                Path(surface),
                scale=scale,
                repair=choices,
                wrap=away,
                time_limit=time_limit,
                progress=progress,
            )
        for note in loaded.notes:
            progress(note)
    if grade_to is not None and not all(map(math.isfinite, grade_to)):
        raise InputError(f"--grade-to {grade_to}: needs three finite numbers")
    with units.in_own_words():
        within = {
            name: load_surface(path, scale=scale) for name, path in _inclusions(inclusion or [])
        }
    grades = []
    if grade_to is not None and smallest is not None:
        grades = [Grade(smallest=smallest * scale, growth=growth, point=units.lengths(grade_to))]
    # The kidney's surface has that length already, and cells grow inwards from it.
    inner = size if uniform or surface != "kidney" else None
    plan = Plan(
        mesher=mesher.value,
        edge_length=None if inner is None else inner * scale,
        interior=Interior.UNIFORM if uniform else Interior.GRADED,
        boundary_distance=None if free is None else free * scale,
        grades=grades,
    )
    tissue = Material(*(material or TISSUE))
    how = Filling(
        progress=progress,
        time_limit=time_limit,
        began=began,
        lengthens_step=True,
        target=None if target_step is None else (tissue, target_step),
    )
    with units.in_own_words():
        built = fill_loaded(loaded, plan, within, how)
    files = [one.given for one in (loaded, *within.values()) if one.given is not None]
    points = in_file_unit(built.mesh.points, np.vstack(files) if files else None, scale)
    mesh = built.mesh
    try:
        scaled = TetMesh(points, mesh.cells, mesh.facet_groups, cell_groups=mesh.cell_groups)
    except InvertedCellError as error:
        # Positive in metres, and flat by the rounding of the file's coordinates.
        with units.in_own_words():
            flat = FlatCellError(error.cells, mesh.points[mesh.cells[error.cells[0]]].mean(axis=0))
            raise InputError(f"{surface}: {flat}: --free D may replace facets within D") from error
    write_mesh(output, scaled, groups=True)
    origin = units.in_case_units(built.origin)
    critical = find_critical_cells(built.mesh, tissue)
    line = (
        f"{output}: {origin}, smallest dihedral angle {critical.smallest_dihedral_deg:.1f}"
        f" degrees, volume {built.mesh.volume / scale**3:.6g} {unit}3"
    )
    print(for_terminal(line))
    print_lines(step_lines(critical, is_stated=material is not None, scale=scale, unit=unit))
    if target_step is not None:
        print(for_terminal(_verdict_line(critical, target_step, scale, unit)))
    elif free is None:
        edge = mean_edge_length(loaded.surface.points, loaded.surface.facets)
        print_lines(_free_lines(critical, edge, scale, unit))


def _inclusions(given: list[str]) -> list[tuple[str, Path]]:
    """Names and files of NAME=FILE; refuses names given twice, and the body's."""
    found: list[tuple[str, Path]] = []
    for text in given:
        name, equals, path = text.partition("=")
        if not (name and equals and path):
            raise InputError(f"--inclusion {text}: needs NAME=FILE")
        if name == "body" or name in dict(found):
            raise InputError(f"--inclusion {text}: the name {name!r} is taken; use another")
        found.append((name, Path(path)))
    return found


def _choices(
    repair: bool,
    distance: float | None,
    limit: float | None,
    largest_hole: int | None,
    smallest_shell: float | None,
    scale: float,
) -> RepairChoices | None:
    """The permitted repairs, in metres; refuses these options without --repair."""
    from palpate.meshes.repair.choices import LARGEST_HOLE, LIMIT, RepairChoices

    given = {
        "--repair-distance": distance,
        "--repair-limit": limit,
        "--largest-hole": largest_hole,
        "--smallest-shell": smallest_shell,
    }
    alone = [option for option, value in given.items() if value is not None]
    if not repair:
        if alone:
            raise InputError(f"{alone[0]} says what --repair may do; give --repair as well")
        return None
    return RepairChoices(
        distance=None if distance is None else distance * scale,
        limit=LIMIT if limit is None else limit,
        largest_hole=LARGEST_HOLE if largest_hole is None else largest_hole,
        smallest_shell=(smallest_shell or 0.0) * scale,
    )


def _free_lines(critical: CriticalCells, edge: float, scale: float, unit: str) -> Iterator[str]:
    """A line on what lengthens a step that few cells or facets decide; `edge` [m] is the mean."""
    regular = _REGULAR * edge / critical.wave_speed
    if critical.time_step < _FAR_BELOW * regular:
        yield (
            f"the step is {regular / critical.time_step:.2g} times shorter than that of a regular "
            f"cell with the surface's mean edge: --free {_DISTANCE * edge / scale:.2g} may replace "
            f"facets within that distance [{unit}] by better ones, for a longer step"
        )


def _verdict_line(critical: CriticalCells, target: float, scale: float, unit: str) -> str:
    """A line on whether the target step was reached [s], and if not, why."""
    if critical.time_step >= target:
        return f"target step {target:g} s reached"
    if critical.surface_step < target:
        why = (
            f"the facet at {place_of(critical.surface_place, scale)} {unit} forces at most "
            f"{critical.surface_step:.4g} s on any cell behind it: use --free, or a coarser surface"
        )
    else:
        why = (
            "no facet by itself forbids it, but moved, flipped and inserted inner points came no "
            f"further near {place_of(critical.positions[0], scale)} {unit}: use --free, or longer "
            "edges"
        )
    return f"target step {target:g} s not reached ({critical.time_step:.4g} s): {why}"
