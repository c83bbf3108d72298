"""`palpate cases|init|schema|check|import|export`: case files before anything is solved."""

from __future__ import annotations

import json
import shutil
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from palpate.meshes.errors import InputError
from palpate.validation.commands.options import (
    Force,
    OneCase,
    StrainOfCase,
    print_lines,
    progress_lines,
)
from palpate.validation.importing.model import UnitSystem
from palpate.validation.output_files import OutputError, input_files, require_outputs

if TYPE_CHECKING:
    from palpate.validation.case import Case

_CaseFile = Annotated[Path, typer.Option("--output", "-o", help="the case file, .toml")]


def cases() -> None:
    """List the built-in cases, one line each."""
    from palpate.validation.case import builtin_cases, load_case

    print_lines(f"{name:12} {load_case(name).title}" for name in builtin_cases())


def init(
    output: _CaseFile,
    surface: Annotated[
        Path | None, typer.Argument(help="a surface or mesh file beside it; a box without one")
    ] = None,
    unit: Annotated[
        str | None, typer.Option(help="of the file: m, cm or mm; without it mm is guessed")
    ] = None,
    repair: Annotated[bool, typer.Option(help="merge near points, turn, close holes")] = False,
    copy: Annotated[
        bool, typer.Option("--copy", help="copy the file to beside the case, from anywhere")
    ] = False,
    force: Force = False,
) -> None:
    """Write a case file to start from: every key with what it means, loads guessed and marked."""
    from palpate.meshes.fingerprint import file_hash
    from palpate.meshes.temporaries import atomic_path, write_text_atomically
    from palpate.validation.case import load_case, require_case_name
    from palpate.validation.case.writing import first_case
    from palpate.validation.report.preview import unusual_size

    if output.suffix != ".toml":
        raise InputError(f"{output}: a case file needs the ending .toml")
    require_case_name(output)
    require_outputs({"--output": output}, inputs=[] if surface is None else [surface], force=True)
    _require_new(output, force=force)
    beside = None
    if copy and surface is not None:
        there = output.parent / surface.name
        if not there.exists():
            beside = _copied(surface, there)
        elif surface.exists() and file_hash(surface) != file_hash(there):
            raise OutputError(there, "is there already; rename one of the two")
        surface = there
    make = partial(first_case, surface, target=output, unit=unit, repair=repair)
    before = output.read_bytes() if output.exists() else None
    try:
        write_text_atomically(output, make())
        progress = progress_lines()
        progress("meshing and solving once, for a load of the size that it says")
        loaded = load_case(output)
        try:
            mesh = loaded.build(progress).mesh
        except InputError:  # a case of it would be of no use
            if before is None:
                output.unlink()
            else:
                with atomic_path(output) as whole:
                    whole.write_bytes(before)
            raise
        factor = _factor_of_guess(loaded)
    except InputError:
        if beside is not None:
            beside.unlink()
        raise
    if factor is not None:
        write_text_atomically(output, make(factor=factor))
    if unit is None and surface is not None:
        print_lines((f"{odd} say --unit" for odd in unusual_size(mesh, "mm")), "warning: ")
    print(f"{output}: look at what is marked GUESS, then: palpate check {output}")


def schema(
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help=".json; printed where not given")
    ] = None,
    force: Force = False,
) -> None:
    """Write the keys of a case file as a JSON Schema, for editors."""
    from palpate.meshes.own_files import MARK, write_own_text
    from palpate.validation.case.schema_keys import editor_schema

    require_outputs({"--output": output}, force=force)
    text = json.dumps({"$comment": MARK, **editor_schema()}, indent=2, ensure_ascii=False) + "\n"
    if output is None:
        print(text, end="")
        return
    write_own_text(output, text)
    print(f"{output}: in a case file, first line: #:schema ./{output.name}")


def check(
    case: OneCase,
    picture: Annotated[
        Path | None, typer.Option(help=".png of body, inclusions, supports, loads and tools")
    ] = None,
    force: Force = False,
) -> None:
    """Read and mesh a case; say sizes, loads, what it will cost, and what looks wrong."""
    from palpate.validation.case import load_case

    if picture is not None and picture.suffix.lower() != ".png":
        raise InputError(f"--picture {picture}: name a file with .png")
    loaded = load_case(case)
    require_outputs({"--picture": picture}, inputs=input_files([loaded]), force=force)
    progress = progress_lines()
    progress(f"reading and meshing {loaded.name}")
    loaded.build(progress)
    _print_preview(loaded)
    if picture is not None:
        from palpate.validation.report.pictures import draw_case

        draw_case(loaded, picture)
        print(f"{picture}: body, inclusions, supports, loads and tools")


def import_model(
    model: Annotated[Path, typer.Argument(help=".feb, .inp (Abaqus, CalculiX) or MuJoCo's .xml")],
    output: _CaseFile,
    units: Annotated[
        UnitSystem | None, typer.Option(help="of the file: length, force, stress")
    ] = None,
    force: Force = False,
) -> None:
    """Make a case of another simulator's model, or say which line of it no case can hold."""
    from palpate.validation.case import load_case, require_case_name
    from palpate.validation.importing import import_model as make_case

    require_case_name(output)
    mesh = output.with_suffix(".msh")
    require_outputs({"--output": output, "its mesh": mesh}, inputs=[model], force=True)
    _require_new(output, mesh, force=force)
    imported = make_case(model, output, units)
    print_lines(imported.notes, "note: ")
    print_lines(imported.ignored, "left out: ")
    _print_preview(load_case(output))
    print(f"{output} and {mesh.name}: look at what is marked GUESS, then: palpate report {output}")


def export(
    case: OneCase,
    output: Annotated[Path, typer.Option("--output", "-o", help="folder")],
    strain: StrainOfCase = None,
    force: Force = False,
) -> None:
    """Write a case as a folder that other simulators can read: case.json, rest.vtu, rest.npz."""
    from palpate.validation import api

    loaded = api.load_case(case)
    used = strain or loaded.strain
    api.export(loaded, output, strain=used, force=force)
    print(f"{output}: {loaded.problem.mesh.num_points} points, {used} strain; see case.json")


def _copied(source: Path, target: Path) -> Path:
    """Copy a file, whole or not at all."""
    from palpate.meshes.temporaries import atomic_path

    try:
        with atomic_path(target) as path:
            shutil.copyfile(source, path)
    except OSError as error:
        raise InputError(f"{source}: cannot be copied to {target}: {error.strerror}") from None
    return target


def _factor_of_guess(case: Case) -> float | None:
    """By how much the guessed load is to be multiplied; None where the case cannot be solved."""
    from palpate.validation import api
    from palpate.validation.case.writing import STRETCH

    try:
        moved = api.solve(case.problem, strain="linear").max_displacement
    except (InputError, api.CandidateFailedError) as error:
        print_lines(
            [f"warning: the load is guessed from a bar, for the case is not solved: {error}"]
        )
        return None
    length = float(np.ptp(case.problem.mesh.points, axis=0).max())
    return STRETCH * length / moved if moved > 0.0 else None


def _require_new(*paths: Path, force: bool) -> None:
    """Refuse files that are there, palpate's own included: a case is edited once it is written."""
    for path in paths:
        if path.exists() and not force:
            raise OutputError(path, "is there already; name another file, or say --force")


def _print_preview(case: Case) -> None:
    """Print what a case is and will cost, and what looks wrong in it."""
    from palpate.validation.report.preview import describe_case

    look = describe_case(case)
    print_lines(look.lines)
    print_lines(look.warnings, "warning: ")
