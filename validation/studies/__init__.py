"""Studies: of the paper, remade, and of what the results depend on; a file each.

Each is a module with a `TITLE` and three steps that can be tried alone: `compute(progress)`,
everything that takes time; `judge(found)`, claims put to the test, of which the gravest verdict is
the study's; `present(found)`, figures, tables, remarks. The docstring of the module is a heading,
then paragraphs for the page. Nothing heavy is loaded until one is run.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.meshes.errors import InputError
from palpate.validation.states import ExitCode, Progress

if TYPE_CHECKING:
    from rich.console import Console

# Name -> what it shows, a line.
STUDIES = {
    "beam": "Fig. 2: linear strain stretches a beam falsely, Green does not",
    "calibration": "error bars of the truth against known solutions",
    "convergence": "the kidney's order and error bar (GCI) on three meshes",
    "elements": "linear beside smoothed tetrahedra: error against time",
    "frontier": "error over processor time of every simulator that is installed",
    "grading": "section V: graded meshes, the same result with fewer cells",
    "kidney": "Fig. 5 and Table I: original, linear and Green strain",
    "meshing": "Fig. 1: traditional beside improved Delaunay meshing, cut open",
    "sensitivity": "what the inputs are worth beside the mesh: u_val of V&V 20",
    "validity": "where linear strain may stand in for Green strain",
}
# Those that stand elsewhere: with the other simulators, of which studies import nothing.
_ELSEWHERE = {"frontier": "palpate.validation.peers.frontier"}


def load_study(name: str) -> Any:
    """The module of a study.

    Raises:
        InputError: There is none of this name.
    """
    if name not in STUDIES:
        raise InputError(f"no study {name!r}; there are {', '.join(STUDIES)}")
    return importlib.import_module(
        _ELSEWHERE.get(name, f"palpate.validation.studies.{name.replace('-', '_')}")
    )


def run_study(name: str, folder: Path, progress: Progress, console: Console) -> ExitCode:
    """Run a study into an empty folder; findings are printed, the exit code is its verdict.

    Raises:
        InputError: No such study.
    """
    from palpate.validation.report.study_page import leave

    study = load_study(name)
    found = study.compute(progress)
    findings = study.judge(found)
    progress("drawing the report")
    about = (study.__doc__ or "").split("\n\n")[1:]
    return leave(
        folder, console, name=name, title=study.TITLE, about=about, findings=findings,
        page=study.present(found),
    )  # fmt: skip
