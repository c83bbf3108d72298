"""`palpate init` and `palpate schema`: a first case file, and its keys for editors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer


def init(
    output: Annotated[Path, typer.Option("--output", "-o", help="the case file, .toml")],
    surface: Annotated[
        Path | None, typer.Argument(help="a surface or mesh file beside it; a box without one")
    ] = None,
    unit: Annotated[str, typer.Option(help="of the file: m, cm or mm")] = "mm",
    repair: Annotated[bool, typer.Option(help="merge near points, turn, close holes")] = False,
) -> None:
    """Write a case file to start from: every key with what it means, loads guessed and marked."""
    from palpate.meshes.atomic_write import write_text_atomically
    from palpate.meshes.errors import InputError
    from palpate.validation.case import load_case
    from palpate.validation.case.writing import first_case
    from palpate.validation.output_files import OutputError, require_outputs

    if output.suffix != ".toml":
        raise InputError(f"{output}: a case file needs the ending .toml")
    require_outputs({"--output": output}, inputs=[] if surface is None else [surface])
    if output.exists():
        raise OutputError(output, "is there already; name another file")
    text = first_case(surface, target=output, unit=unit, repair=repair)
    write_text_atomically(output, text)
    load_case(output)
    print(f"{output}: look at what is marked GUESS, then: palpate check {output}")


def schema(
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help=".json; printed where not given")
    ] = None,
) -> None:
    """Write the keys of a case file as a JSON Schema, for editors."""
    from palpate.meshes.atomic_write import write_text_atomically
    from palpate.validation.case.schema_keys import editor_schema
    from palpate.validation.output_files import require_outputs

    require_outputs({"--output": output})
    text = json.dumps(editor_schema(), indent=2, ensure_ascii=False) + "\n"
    if output is None:
        print(text, end="")
        return
    write_text_atomically(output, text)
    print(f"{output}: in a case file, first line: #:schema ./{output.name}")
