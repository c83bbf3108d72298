"""A long session holds no more than its last bodies: PETSc gives back what was dropped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem, Strain
from palpate.reference.availability import is_available

if is_available():
    from palpate.reference.statics import find_equilibrium, solve_static

pytestmark = pytest.mark.dolfinx
STATUS = Path("/proc/self/status")
# Matrix and factors of 8 000 quadratic unknowns take about 40 MB.
NUM_BODIES, ONE_BODY = 4, 40.0


def resident() -> float:
    """Memory of this process [MB]."""
    (line,) = (row for row in STATUS.read_text("utf-8").splitlines() if row.startswith("VmRSS"))
    return float(line.split()[1]) / 1024.0


def beam() -> Problem:
    mesh = brick_box((10, 5, 5), (2.0, 1.0, 1.0), ragged=0.2)
    facets = mesh.boundary_facets
    held = facets[(mesh.points[facets][:, :, 0] < 1e-9).all(axis=1)]
    support = Support(np.unique(held).astype(np.int32), held)
    return Problem(mesh, Material(1e4, 0.3, 1000.0), (support,), (BodyForce((0.0, 0.0, -9.8)),))


def solve(problem: Problem, *, is_dropped: bool) -> None:
    if is_dropped:  # matrices and factors that nobody destroys by hand
        find_equilibrium(problem, strain=Strain.LINEAR, degree=2)
    else:
        solve_static(problem, strain=Strain.LINEAR, degree=2)


@pytest.mark.skipif(not STATUS.is_file(), reason="/proc tells a process its memory on Linux only")
@pytest.mark.parametrize("is_dropped", [False, True])
def test_body_after_body_takes_no_more_memory(is_dropped: bool) -> None:
    problem = beam()
    for _ in range(2):
        solve(problem, is_dropped=is_dropped)
    before = resident()
    for _ in range(NUM_BODIES):
        solve(problem, is_dropped=is_dropped)
    assert resident() - before < 0.5 * NUM_BODIES * ONE_BODY
