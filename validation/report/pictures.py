"""Pictures of the deformed body, drawn in a process of their own.

VTK ends the process where graphics libraries are missing, so the parent only looks at what
files are there afterwards, and draws with matplotlib instead when there are none.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.problem import Strain
from palpate.meshes.supervised import run_supervised
from palpate.meshes.temporaries import scratch_folder
from palpate.validation.judging.results import CaseResult

PANEL = (620, 720)
GREEN, RED, GREY = "#2f8f4e", "#b5332e", "#d9d9d9"


def draw_pictures(result: CaseResult, folder: Path, time_limit: float = 180.0) -> dict[str, Path]:
    """Draw the states and the errors of a case.

    Returns:
        Path of each picture that came about, by name ("states", "errors"); none is required.
    """
    modules = [f"palpate.validation.report.draw_{by}" for by in ("pyvista", "matplotlib")]
    made = {}
    for stem, picture in draw_in_child(_arrays(result), modules, time_limit).items():
        made[stem] = folder / f"{stem}.png"
        made[stem].write_bytes(picture)
    return made


def draw_in_child(
    arrays: Mapping[str, NDArray[Any]], modules: Sequence[str], time_limit: float = 180.0
) -> dict[str, bytes]:
    """Let the first module that can draw pictures.

    Args:
        arrays: What a module reads, from the file that is its first argument; its second is the
            folder for what it draws.
        modules: In the order in which they are tried.
        time_limit: Of each [s].

    Returns:
        Every .png by its name without the end; none where no module managed.
    """
    with scratch_folder("pictures") as scratch:
        source = scratch / "fields.npz"
        np.savez(source, **arrays)
        for module in modules:
            try:
                done = run_supervised(
                    [sys.executable, "-m", module, source, scratch],
                    time_limit=time_limit,
                    env={**os.environ, "PYVISTA_OFF_SCREEN": "true"},
                )
            except (subprocess.SubprocessError, OSError):
                continue
            made = {path.stem: path.read_bytes() for path in sorted(scratch.glob("*.png"))}
            if done.returncode == 0 and made:
                return made
    return {}


def _arrays(result: CaseResult) -> dict[str, NDArray[Any]]:
    """What a picture needs, in millimetres: the boundary, its states, the errors."""
    mesh = result.problem.mesh
    arrays: dict[str, NDArray[Any]] = {
        "points": mesh.points * 1e3,
        "facets": mesh.boundary_facets,
        "held": _facets([s.facets for s in result.problem.supports]),
        "pushed": _facets([getattr(load, "facets", None) for load in result.problem.loads]),
    }
    for strain in Strain:
        state = result.state(result.candidates[0].name, strain)
        if state is not None:
            arrays[f"u_{strain}"] = state.displacement * 1e3
    for name, field in result.error_fields.items():
        arrays[f"error_{name}"] = field * 1e3
    return arrays


def _facets(parts: list[Any]) -> NDArray[Any]:
    known = [part for part in parts if part is not None and len(part)]
    return np.vstack(known) if known else np.zeros((0, 3), dtype=np.int32)


def view_axis(points: NDArray[Any], moved: list[NDArray[Any]]) -> int:
    """The axis to look along: the one in which body and motion reach least."""
    everything = np.vstack([points, *moved])
    return int(np.argmin(np.ptp(everything, axis=0)))
