"""Arguments and options that several verbs share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

OptionalCases = Annotated[
    list[str] | None, typer.Argument(help="built-in names, or paths to .toml files")
]
Folder = Annotated[Path, typer.Option("--output", "-o", help="folder for the results")]
OptionalFile = Annotated[Path | None, typer.Option()]
SimulatorCommand = Annotated[
    str | None, typer.Option(help='judge another simulator: "mysim {case} {result}"')
]
TimeLimit = Annotated[float, typer.Option(help="of the simulator, in seconds")]
