"""Studies: of the paper, remade, and of what the answers depend on; one module each."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from palpate.meshes.errors import InputError

STUDIES = (
    "beam",
    "contact",
    "convergence",
    "csm3",
    "frontier",
    "grading",
    "hard-loads",
    "iterations",
    "kidney",
    "meshing",
    "sensitivity",
    "validity",
)


def run_study(name: str, folder: Path, progress: Callable[[str], None], console: Console) -> int:
    """Run a study into an empty folder.

    Returns:
        The exit code: 0 passed, 1 failed, 3 inconclusive.

    Raises:
        InputError: No such study.
    """
    if name not in STUDIES:
        raise InputError(f"no study {name!r}; there are {', '.join(STUDIES)}")
    module = importlib.import_module(f"palpate.validation.studies.{name.replace('-', '_')}")
    code: int = module.run(folder, progress, console)
    return code
