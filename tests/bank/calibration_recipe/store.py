"""The problems and their answers as the study reads them: an index, and two arrays for each."""

from __future__ import annotations

import json
import tarfile
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calibration_recipe.drawn import Drawn
from palpate.meshes.problem_files import problem_arrays


def write_store(file: Path, problems: Sequence[Drawn]) -> None:
    """Write a .tar.xz, the same bytes for the same problems."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        entries = [write_problem(folder, drawn) for drawn in problems]
        (folder / "index.json").write_text(json.dumps(entries, indent=1), encoding="utf-8")
        with tarfile.open(file, "w:xz", preset=9) as tar:
            for each in sorted(folder.iterdir()):
                tar.add(each, each.name, filter=_without_time)


def write_problem(folder: Path, drawn: Drawn) -> dict[str, Any]:
    """NAME.npz and NAME.answer.npz in a folder; the entry of the index."""
    problem, strain, answer = drawn.make()
    np.savez(folder / f"{drawn.name}.npz", **problem_arrays(problem))
    if answer is not None:
        state, motion = answer.state, answer.state.trajectory
        arrays = {"displacement": state.displacement}
        if motion is not None:
            arrays = {"times": motion.times, "displacements": motion.displacements}
        sizes = np.array([state.volume, state.surface_area])
        np.savez(folder / f"{drawn.name}.answer.npz", sizes=sizes, **arrays)
    return {
        "name": drawn.name,
        "family": drawn.family,
        "is_apart": drawn.is_apart,
        "given": dict(drawn.given),
        "strain": str(strain),
        "doubts": None if answer is None else {k: float(v) for k, v in answer.doubts.items()},
    }


def _without_time(info: tarfile.TarInfo) -> tarfile.TarInfo:
    info.mtime = info.uid = info.gid = 0
    info.uname = info.gname = ""
    return info
