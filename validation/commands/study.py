"""`palpate study`: remake a study of the paper, or one of our own."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

from palpate.validation.commands.progress_lines import progress_lines
from palpate.validation.commands.words import Folder


def study(
    name: Annotated[
        str,
        typer.Argument(
            help="meshing, beam, kidney, contact, csm3, grading, iterations, "
            "validity, convergence, sensitivity"
        ),
    ],
    output: Folder,
) -> None:
    """Remake a study of the paper: meshing (Fig. 1), beam (Fig. 2), kidney (Fig. 5, Table I)..."""
    from palpate.validation.run_folder import run_folder
    from palpate.validation.studies import run_study

    progress = progress_lines()
    with run_folder(output) as fresh:
        code = run_study(name, fresh, progress, Console(highlight=False))
    print(f"{output / 'report.html'}")
    raise typer.Exit(code)
