"""One surface repaired and meshed in a process of its own: what ends that process is told.

python -m palpate.validation.studies.organs.trial GIVEN.npz MADE.npz
"""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.supervised import run_supervised
from palpate.meshes.tri_surface import TriSurface

# The mesher is told to give up by itself after this, by the clock [s].
_MOST_MESHING = 100.0
# Beyond what is allowed a run is ended after this much processor time, and this much by the clock
# for a machine that does other things as well [s].
_MOST_CPU, _MOST_WALL = 120, 1800.0


class Ending(StrEnum):
    """How a trial ended."""

    MESHED = "meshed"
    REFUSED = "refused"
    CRASHED = "crashed"
    OUT_OF_TIME = "out of time"


@dataclass(frozen=True, eq=False)
class Trial:
    """What became of a surface.

    Attributes:
        ending: How it ended.
        said: What was done, or why it was refused.
        mending_cpu, meshing_cpu: Processor time [s].
        mesh_volume: As palpate states it [m3].
        arrays: points and facets of the mended surface, mesh_points and mesh_cells.
    """

    ending: Ending
    said: str
    mending_cpu: float = 0.0
    meshing_cpu: float = 0.0
    mesh_volume: float = 0.0
    arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)


def try_apart(surface: TriSurface, *, distance: float, smallest_shell: float) -> Trial:
    """Repair and mesh a surface in another process.

    Args:
        surface: As given [m].
        distance: How far the repair may move it [m].
        smallest_shell: Loose parts that are shorter are dropped [m].
    """
    with tempfile.TemporaryDirectory(prefix="palpate-organs-") as folder:
        given, made = Path(folder, "given.npz"), Path(folder, "made.npz")
        choices = np.array([distance, smallest_shell])
        np.savez(given, points=surface.points, facets=surface.facets, choices=choices)
        try:
            command: list[str | Path] = [sys.executable, "-m", __name__, given, made]
            done = run_supervised(command, time_limit=_MOST_WALL)
        except subprocess.TimeoutExpired:
            return Trial(Ending.OUT_OF_TIME, f"ended after {_MOST_WALL:g} s")
        of_time = getattr(signal, "SIGXCPU", 0)
        if of_time and done.returncode in (-of_time, 128 + of_time):
            return Trial(Ending.OUT_OF_TIME, f"ended after {_MOST_CPU} s of processor time")
        if done.returncode != 0 or not made.exists():
            last = (done.stderr.strip().splitlines() or ["nothing was said"])[-1]
            return Trial(Ending.CRASHED, f"exit status {done.returncode}: {last}")
        with np.load(made) as found:
            arrays = {name: found[name] for name in found.files if name != "about"}
            about = json.loads(str(found["about"]))
        return Trial(Ending(about.pop("ending")), arrays=arrays, **about)


def attempt(surface: TriSurface, *, distance: float, smallest_shell: float) -> Trial:
    """The same in this process."""
    from palpate.fastsim.mending.mend import mend_surface
    from palpate.fastsim.mesher import mesh_surface
    from palpate.meshes.errors import InputError
    from palpate.meshes.repair.choices import RepairChoices

    start = time.process_time()
    mended_at = start
    try:
        choices = RepairChoices(distance=distance, smallest_shell=smallest_shell)
        mended = mend_surface(surface, choices)
        mended_at = time.process_time()
        mesh = mesh_surface(mended.surface, time_limit=_MOST_MESHING)
    except InputError as error:
        end = time.process_time()
        where = "" if mended_at == start else "mended, but not meshed: "
        mending = (end if mended_at == start else mended_at) - start
        return Trial(Ending.REFUSED, f"{where}{error}", mending, end - start - mending)
    return Trial(
        Ending.MESHED,
        "; ".join(mended.lines) or "nothing to mend",
        mended_at - start,
        time.process_time() - mended_at,
        float(mesh.volume),
        {
            "points": mended.surface.points,
            "facets": mended.surface.facets,
            "mesh_points": mesh.points,
            "mesh_cells": mesh.cells,
        },
    )


def _main(given: str, made: str) -> None:
    with contextlib.suppress(ImportError):  # Windows: the time by the clock alone bounds it
        import resource

        hardest = resource.getrlimit(resource.RLIMIT_CPU)[1]
        resource.setrlimit(resource.RLIMIT_CPU, (_MOST_CPU, hardest))
    with np.load(given) as found:
        surface = TriSurface(found["points"], found["facets"])
        distance, smallest_shell = found["choices"].tolist()
    done = attempt(surface, distance=distance, smallest_shell=smallest_shell)
    about = {
        "ending": done.ending,
        "said": done.said,
        "mending_cpu": done.mending_cpu,
        "meshing_cpu": done.meshing_cpu,
        "mesh_volume": done.mesh_volume,
    }
    np.savez(made, about=np.array(json.dumps(about)), **done.arrays)


if __name__ == "__main__":
    _main(*sys.argv[1:])
