"""`palpate study`: remake a study of the paper, or one of our own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from palpate.validation.commands.words import Folder, progress_lines
from palpate.validation.studies import STUDIES


def study(
    name: Annotated[
        str,
        typer.Argument(
            help="one of those below",
            autocompletion=lambda incomplete: [s for s in STUDIES if s.startswith(incomplete)],
        ),
    ],
    output: Folder,
    surfaces: Annotated[
        Path | None, typer.Option(help="of organs: a folder of surfaces to try as well")
    ] = None,
) -> None:
    """Remake a study of the paper, or one of what the answers depend on."""
    from palpate.validation.run_folder import run_folder
    from palpate.validation.studies import run_study

    progress = progress_lines()
    with run_folder(output) as fresh:
        code = run_study(name, fresh, progress, Console(highlight=False), surfaces=surfaces)
    print(f"{output / 'report.html'}")
    raise typer.Exit(code)
