"""Boxes of tetrahedra with named faces, for closed-form states; programs under mpirun."""

from __future__ import annotations

import itertools
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.tet_mesh import TetMesh, signed_volumes

FACES = {"x0": (0, 0), "x1": (0, 1), "y0": (1, 0), "y1": (1, 1), "z0": (2, 0), "z1": (2, 1)}


def make_box(counts=(2, 2, 2), size=(1.0, 1.0, 1.0), jitter=0.0) -> TetMesh:
    """Six tetrahedra per brick; inside points moved by `jitter` of a brick, at random."""
    counts = np.asarray(counts)
    axes = [np.linspace(0.0, s, n + 1) for s, n in zip(size, counts, strict=True)]
    points = np.array(list(itertools.product(*axes)))
    strides = np.array([(counts[1] + 1) * (counts[2] + 1), counts[2] + 1, 1])
    cells = []
    for corner in itertools.product(*map(range, counts)):
        for order in itertools.permutations(range(3)):
            walk = [np.array(corner)]
            for axis in order:
                walk.append(walk[-1] + np.eye(3, dtype=int)[axis])
            cells.append([int(strides @ w) for w in walk])
    cells = np.array(cells)
    turned = signed_volumes(points, cells) < 0.0
    cells[turned] = cells[turned][:, [0, 2, 1, 3]]
    inside = np.all((points > 0.0) & (points < np.asarray(size)), axis=1)
    shift = np.random.default_rng(7).uniform(-jitter, jitter, (int(inside.sum()), 3))
    points[inside] += shift * np.asarray(size) / counts
    bare = TetMesh(points, cells)
    facets = bare.boundary_facets
    groups = {
        name: facets[np.all(points[facets][:, :, axis] == end * size[axis], axis=1)]
        for name, (axis, end) in FACES.items()
    }
    return TetMesh(points, cells, facet_groups=groups)


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
