"""The reference as users start it, on one process or under mpirun; the whole command is timed."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from palpate.meshes.problem import Material
from palpate.reference.availability import require_available
from palpate.validation.versions import version_of

# A block of 2 x 1 x 1 m, fixed at one end and bent at the other by about a tenth of its length.
CASE = """schema = 1
title = "A block, pulled and bent"
strain = "green"
[geometry]
mesh = "block.vtu"
[material]
youngs_modulus = {material.youngs_modulus}
poissons_ratio = {material.poissons_ratio}
[[support]]
region = {{ half_space = {{ point = [0.001, 0.0, 0.0], normal = [-1.0, 0.0, 0.0] }} }}
[[load]]
kind = "force"
force = [10.0, 5.0, -5.0]
region = {{ half_space = {{ point = [1.999, 0.0, 0.0], normal = [1.0, 0.0, 0.0] }} }}
"""
_LOOKS = 0.2  # interval at which memory is measured [s]


class Truth:
    """A static solve with quadratic tetrahedra and Green strain, from the case file to the result.

    It reads and checks the mesh, assembles, solves, measures and writes.
    """

    precision = "float64"

    def __init__(self, job: dict[str, Any]) -> None:
        require_available()
        self.version = version_of("palpate")
        self._folder = Path.cwd()
        ranks = int(job["num_threads"])
        mpirun = shutil.which("mpirun")
        if ranks > 1 and mpirun is None:
            raise ValueError("mpirun is not on the path")
        meshio.Mesh(job["points"], [("tetra", job["cells"])]).write(self._folder / "block.vtu")
        material = Material(1000.0, 0.3)
        (self._folder / "block.toml").write_text(CASE.format(material=material), encoding="utf-8")
        self._result = self._folder / "result.vtu"
        self._command = [
            *([str(mpirun), "-n", str(ranks)] if ranks > 1 else []),
            *(sys.executable, "-m", "palpate.validation.cli", "solve", "block.toml"),
            *("--with", "reference", "--degree", "2", "-o", self._result.name),
        ]

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Run the command from its start to its end."""
        # A machine for tests may run everything as root, which only Open MPI has to be allowed.
        allowed = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
        peak = 0.0
        with (
            (self._folder / "log.txt").open("w", encoding="utf-8") as log,
            subprocess.Popen(
                self._command,
                cwd=self._folder,
                env={**os.environ, **allowed},
                stdout=log,
                stderr=subprocess.STDOUT,
            ) as process,
        ):
            while process.poll() is None:
                peak = max(peak, _memory(process.pid))
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(_LOOKS)
        text = (self._folder / "log.txt").read_text("utf-8", errors="replace")
        if process.returncode != 0:
            raise RuntimeError(f"{' '.join(self._command)}: exit {process.returncode}\n{text}")
        moved = np.asarray(meshio.read(self._result).point_data["displacement"])
        self.result = {"displacement": moved}
        return {"iterations": text.count("relative residual") - 1, "peak_memory_mb": peak}


def _memory(process: int) -> float:
    """Resident memory of a process and its children [MB]; shared memory counts for each."""
    try:
        task = Path(f"/proc/{process}")
        pages = int((task / "statm").read_text("ascii").split()[1])
        children = (task / "task" / str(process) / "children").read_text("ascii").split()
    except (OSError, IndexError):  # the process has ended, or this is not Linux
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20 + sum(_memory(int(c)) for c in children)
