"""`palpate bench static`: a clamped beam bent by its weight, ours beside dolfinx."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.problem import Material, Problem, Strain
from palpate.reference.availability import is_available, versions
from palpate.validation.benchmarks.bodies import brick_box

DIVISIONS = {22_143: (60, 10, 10), 115_881: (106, 18, 18)}
TOLERANCE = 1e-8

Row = dict[str, Any]


def beam_problem(size: int) -> Problem:
    """The beam of `bench static`: 1 x 0.1 x 0.1 m, bent by about 4 % of its length."""
    mesh = brick_box(DIVISIONS[size], (1.0, 0.1, 0.1))
    held = np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32)
    return Problem(
        mesh, Material(1e6, 0.3, 1000.0), (Support(held),), (BodyForce((0.0, 0.0, -300.0)),)
    )


def bench_static(
    *,
    sizes: Sequence[int] = tuple(DIVISIONS),
    progress: Callable[[str], None] | None = None,
) -> list[Row]:
    """Time whole static solves to a relative residual of 1e-8, assembly included.

    Args:
        sizes: Degrees of freedom, keys of `DIVISIONS`.
        progress: Called with one line per row.

    Returns:
        Rows with tool, strain, size, seconds, tip_displacement [m] and, for our own, iterations
        and peak_memory_mb of this process. dolfinx runs in a child process, and its seconds
        include the start of that process (about 1.5 s): compare at the larger size.
    """
    rows: list[Row] = []
    for size in sizes:
        problem = beam_problem(size)
        for strain in (Strain.LINEAR, Strain.GREEN):
            start = time.perf_counter()
            result = solve_static(problem, strain=strain, relative_tolerance=TOLERANCE)
            seconds = time.perf_counter() - start
            row = _row("palpate", _core.__version__, size, strain, seconds)
            row |= {
                "tip_displacement": float(result.displacement[:, 2].min()),
                "iterations": result.iterations,
                "linear_iterations": result.linear_iterations,
                "peak_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
            }
            rows.append(row)
            if is_available():
                rows.append(_time_dolfinx(problem, size, strain))
            if progress:
                for new in rows[-2:]:
                    progress(
                        f"{new['tool']:8} {size} dof {strain.value:7} {new['seconds']:8.2f} s  "
                        f"tip {new['tip_displacement']:.9g} m"
                    )
    return rows


def _row(tool: str, version: str, size: int, strain: Strain, seconds: float) -> Row:
    return {
        "tool": tool,
        "version": version,
        "size": size,
        "threads": 1,
        "precision": "float64",
        "strain": strain.value,
        "seconds": seconds,
        "rate": size / seconds,
        "rate_unit": "degrees of freedom per second",
    }


def _time_dolfinx(problem: Problem, size: int, strain: Strain) -> Row:
    from palpate.reference.child import solve_static_in_child

    start = time.perf_counter()
    result = solve_static_in_child(problem, strain=strain, relative_tolerance=TOLERANCE)
    seconds = time.perf_counter() - start
    row = _row("dolfinx", versions().get("dolfinx", ""), size, strain, seconds)
    row["tip_displacement"] = float(result.displacement[:, 2].min())
    return row
