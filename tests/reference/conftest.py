"""Boxes of tetrahedra with named faces, for closed-form states; programs under mpirun."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bank import make_box

from palpate.meshes.tet_mesh import TetMesh


@pytest.fixture
def box() -> Callable[..., TetMesh]:
    return make_box


@pytest.fixture
def mpirun() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Python with some arguments on so many ranks; skipped where there is no mpirun."""
    beside = Path(sys.executable).parent / "mpirun"  # the PyPI wheel brings its own
    found = str(beside) if beside.exists() else shutil.which("mpirun")
    if found is None:
        pytest.skip("mpirun is not on the path")

    def run(num_ranks: int, *arguments: str) -> subprocess.CompletedProcess[str]:
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(str(Path(p).absolute()) for p in sys.path if p),
            "OMP_NUM_THREADS": "1",
            # A test machine may have one core, and run as root. With two, whoever yields while it
            # waits loses its core to another process for a whole slice, at each of thousands of
            # calls.
            "OMPI_ALLOW_RUN_AS_ROOT": "1",
            "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
            "OMPI_MCA_rmaps_base_oversubscribe": "1",
            "OMPI_MCA_mpi_yield_when_idle": str(int(os.cpu_count() == 1)),
        }
        return subprocess.run(
            [
                *([found, "-n", str(num_ranks)] if num_ranks > 1 else []),
                *(sys.executable, "-P", *arguments),
            ],
            env=environment,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )

    return run


@pytest.fixture
def on_one_and_two(mpirun, tmp_path) -> Callable[..., list[dict[str, Any]]]:
    """Arrays that a program stores in its last argument, on one rank and on two."""

    def run(program: str, *arguments: str) -> list[dict[str, Any]]:
        found = []
        for n in (1, 2):
            path = tmp_path / f"{n}.npz"
            done = mpirun(n, "-c", program, *arguments, str(path))
            assert done.returncode == 0, done.stderr
            with np.load(path) as stored:
                found.append(dict(stored))
            assert found[-1].pop("size") == n
        return found

    return run
