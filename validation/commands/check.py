"""`palpate check CASE`: what a case is and will cost, before anything is solved."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.validation.commands.words import OneCase, progress_lines


def check(
    case: OneCase,
    picture: Annotated[
        Path | None, typer.Option(help=".png of body, supports, loads and tools")
    ] = None,
) -> None:
    """Read and mesh a case; say sizes, loads, what it will cost, and what looks wrong."""
    from palpate.meshes.errors import InputError
    from palpate.validation.case import load_case
    from palpate.validation.output_files import input_files, require_outputs
    from palpate.validation.quoting import for_terminal
    from palpate.validation.report.preview import look_at

    if picture is not None and picture.suffix.lower() != ".png":
        raise InputError(f"--picture {picture}: name a file with .png")
    loaded = load_case(case)
    require_outputs({"--picture": picture}, inputs=input_files([loaded]))
    progress_lines()(f"reading and meshing {loaded.name}")
    look = look_at(loaded)
    for line in look.lines:
        print(for_terminal(line))
    for warning in look.warnings:
        print(for_terminal(f"warning: {warning}"))
    if picture is not None:
        from palpate.validation.report.pictures import draw_case

        draw_case(loaded, picture)
        print(f"{picture}: body, supports, loads and tools")
