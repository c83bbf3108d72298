"""`palpate bench steps`: explicit steps of the same body, ours beside a NumPy loop."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.dynamics import Precision, simulate
from palpate.fastsim.forces import assemble_internal_force
from palpate.fastsim.time_steps import sharp_critical_time_step
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.problem import Material, Problem, TimeSpan
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.benchmarks.bodies import brick_box

SIZES = {6_000: (40, 5, 5), 58_080: (80, 11, 11), 600_000: (160, 25, 25)}
TISSUE = Material(1e4, 0.45, 1000.0)
MASS_DAMPING = 5.0  # [1/s]
CELL_STEPS = 4e7  # work of one timing
REPEATS = 3

Row = dict[str, Any]


def bench_steps(
    *,
    sizes: Sequence[int] = tuple(SIZES),
    threads: Sequence[int] = (1, 2),
    progress: Callable[[str], None] | None = None,
) -> list[Row]:
    """Time the shipped step, with support, weight and damping, best of three runs.

    Args:
        sizes: Numbers of cells, keys of `SIZES`.
        threads: Numbers of threads for our own step.
        progress: Called with one line per row.

    Returns:
        Rows with tool, size [cells], threads, precision, seconds per step, rate
        [million cells x steps per second] and the relative error of the force.
    """
    rows = []
    for size in sizes:
        mesh = brick_box(SIZES[size], (4.0, 1.0, 1.0), ragged=0.15)
        for precision in Precision:
            for count in threads:
                rows.append(_time_ours(mesh, precision, count))
                if progress:
                    progress(_line(rows[-1]))
        rows.append(_time_numpy(mesh))
        if progress:
            progress(_line(rows[-1]))
    return rows


def _row(tool: str, mesh: TetMesh, threads: int, precision: str, seconds: float) -> Row:
    return {
        "tool": tool,
        "version": _core.__version__ if tool == "palpate" else np.__version__,
        "size": mesh.num_cells,
        "threads": threads,
        "precision": precision,
        "seconds": seconds,
        "rate": mesh.num_cells / seconds / 1e6,
        "rate_unit": "million cells x steps per second",
    }


def _line(row: Row) -> str:
    return (
        f"{row['tool']:8} {row['size']:7d} cells  {row['precision']}  {row['threads']} thread(s)"
        f"  {row['rate']:8.1f} {row['rate_unit']}"
    )


def _time_ours(mesh: TetMesh, precision: Precision, threads: int) -> Row:
    """Two runs of different length: their difference is free of the set-up."""
    held = np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32)
    step = 0.8 * sharp_critical_time_step(mesh, TISSUE)
    many = max(20, int(CELL_STEPS / mesh.num_cells))

    def seconds(num_steps: int) -> float:
        span = TimeSpan(num_steps * step, step * (1 + 1e-9), MASS_DAMPING, 1)
        load = (BodyForce((0.0, 0.0, -100.0)),)
        problem = Problem(mesh, TISSUE, (Support(held),), load, span)
        start = time.perf_counter()
        simulate(problem, precision=precision, num_threads=threads)
        return time.perf_counter() - start

    best = min(seconds(many + 1) for _ in range(REPEATS)) - min(seconds(1) for _ in range(REPEATS))
    row = _row("palpate", mesh, threads, precision.value, best / many)
    row["instruction_set"] = _core.widest_instruction_set().name
    return row


def _time_numpy(mesh: TetMesh) -> Row:
    """The same force, vectorised over cells, and the same update."""
    u = 1e-3 * np.random.default_rng(1).standard_normal(mesh.points.shape)
    corners = mesh.points[mesh.cells]
    gradients = np.linalg.inv(corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    E, nu = TISSUE.youngs_modulus, TISSUE.poissons_ratio
    lmbda, mu = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))

    def force(displacement: Points) -> Points:
        at = displacement[mesh.cells]
        H = (at[:, 1:] - at[:, :1]).transpose(0, 2, 1) @ gradients
        strain = 0.5 * (H + H.transpose(0, 2, 1) + H.transpose(0, 2, 1) @ H)
        trace = np.trace(strain, axis1=1, axis2=2)
        S = 2.0 * mu * strain + lmbda * trace[:, None, None] * np.eye(3)
        P = (H + np.eye(3)) @ S * volumes[:, None, None]
        nodal = gradients @ P.transpose(0, 2, 1)
        nodal = np.concatenate([-nodal.sum(axis=1, keepdims=True), nodal], axis=1)
        flat = mesh.cells.ravel()
        out: Points = np.stack(
            [
                np.bincount(flat, nodal[:, :, j].ravel(), minlength=mesh.num_points)
                for j in range(3)
            ],
            axis=1,
        )
        return out

    plain = assemble_internal_force(mesh, u, material=TISSUE)
    error = float(np.abs(force(u) - plain).max() / np.abs(plain).max())
    increment = np.zeros_like(u)
    num_steps = max(2, int(0.1 * CELL_STEPS / mesh.num_cells / 10))
    start = time.perf_counter()
    for _ in range(num_steps):
        increment = 0.999 * increment - 1e-12 * force(u)
        u = u + increment
    row = _row("numpy", mesh, 1, "float64", (time.perf_counter() - start) / num_steps)
    row["relative_force_error"] = error
    return row
