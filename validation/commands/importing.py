"""`palpate import MODEL -o CASE.toml`: a model of another simulator as a case."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.validation.importing.model import UnitSystem


def import_model(
    model: Annotated[Path, typer.Argument(help=".feb, .inp (Abaqus, CalculiX) or MuJoCo's .xml")],
    output: Annotated[Path, typer.Option("--output", "-o", help="the case file, .toml")],
    units: Annotated[
        UnitSystem | None, typer.Option(help="of the file: length, force, stress")
    ] = None,
) -> None:
    """Make a case of another simulator's model, or say which line of it no case can hold."""
    from palpate.validation.case import load_case
    from palpate.validation.importing import import_model as make_case
    from palpate.validation.output_files import OutputError, require_outputs
    from palpate.validation.quoting import for_terminal
    from palpate.validation.report.preview import look_at

    mesh = output.with_suffix(".msh")
    require_outputs({"--output": output, "its mesh": mesh}, inputs=[model])
    for path in (output, mesh):
        if path.exists():
            raise OutputError(path, "is there already; name another file")
    imported = make_case(model, output, units)
    for line in imported.told:
        print(for_terminal(f"note: {line}"))
    for line in imported.ignored:
        print(for_terminal(f"left out: {line}"))
    look = look_at(load_case(output))
    for line in look.lines:
        print(for_terminal(line))
    for warning in look.warnings:
        print(for_terminal(f"warning: {warning}"))
    print(f"{output} and {mesh.name}: look at what is marked GUESS, then: palpate report {output}")
