"""Studies: of the paper, remade, and of what the answers depend on; a file or folder each.

Each has `STUDY`, see `palpate.validation.studies.study`; here they are named, and nothing heavy is
loaded until one is run.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.meshes.errors import InputError
from palpate.validation.states import ExitCode, Progress

if TYPE_CHECKING:
    from rich.console import Console

    from palpate.validation.studies.study import Study

# Name -> what it shows, a line.
STUDIES = {
    "beam": "Fig. 2: linear strain stretches a beam falsely, Green does not",
    "calibration": "error bars of the truth against 68 known answers",
    "contact": "section IV: tools that touch tissue, against Hertz and others",
    "convergence": "orders in h, p and dt, as theory says; the kidney's GCI",
    "csm3": "Turek and Hron's swinging bar, by the implicit reference",
    "elements": "linear beside smoothed tetrahedra: error against time",
    "frontier": "error against run time of every simulator that is installed",
    "grading": "section V: graded meshes, the same answer with fewer cells",
    "half-space": "the truth of a tool against Hertz and the flat punch",
    "hard-loads": "loads up to where the material ends, and who says why",
    "iterations": "eq. 10 as printed beside Newton's tangent and relaxation",
    "kidney": "Fig. 5 and Table I: original, linear and Green strain",
    "meshing": "Fig. 1: traditional beside improved Delaunay meshing, cut open",
    "organs": "spoiled surfaces repaired and meshed, measured by VTK",
    "sensitivity": "what the inputs are worth beside the mesh: u_val of V&V 20",
    "validity": "where linear strain may stand in for Green strain",
}
# Those that stand with the other simulators, of which studies import nothing: found by name.
OF_PEERS = ("frontier",)


def load_study(name: str) -> Study[Any]:
    """A study by its name.

    Raises:
        InputError: There is none of this name.
    """
    if name not in STUDIES:
        raise InputError(f"no study {name!r}; there are {', '.join(STUDIES)}")
    if name in OF_PEERS:
        from palpate.validation.studies.study import Study as Made

        module = importlib.import_module(f"palpate.validation.peers.{name}")
        return Made(module.TITLE, module.__doc__, module.compute, module.judge, module.present)
    module = importlib.import_module(f"palpate.validation.studies.{name.replace('-', '_')}")
    study: Study[Any] = module.STUDY
    return study


def run_study(
    name: str,
    folder: Path,
    progress: Progress,
    console: Console,
    *,
    surfaces: Path | None = None,
) -> ExitCode:
    """Run a study into an empty folder; the exit code is its verdict.

    Args:
        name: Of the study.
        folder: Empty.
        progress: Told what is done.
        console: Where the findings are printed.
        surfaces: Folder of more surfaces, for the study organs.

    Raises:
        InputError: No such study, or one that takes no surfaces.
    """
    study = load_study(name)
    if surfaces is not None:
        if name != "organs":
            raise InputError(f"study {name} takes no surfaces; study organs does")
        from palpate.validation.studies.organs import study_of

        study = study_of(surfaces)
    return study.run(name, folder, progress, console)
