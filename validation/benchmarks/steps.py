"""`palpate bench steps`: explicit steps of one body, ours beside other simulators and loops."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.dynamics import SAFETY, Precision
from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.bricks import brick_box
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Material
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.benchmarks.children import TimedChild, started, take_turns

KIDNEY = 20_000
_box = partial(brick_box, size=(4.0, 1.0, 1.0), ragged=0.15)
# Number of cells (the kidney's about) -> body.
SIZES: dict[int, Callable[[], TetMesh]] = {
    6_000: partial(_box, (40, 5, 5)),
    58_080: partial(_box, (80, 11, 11)),
    600_000: partial(_box, (160, 25, 25)),
    KIDNEY: lambda: mesh_surface(shape_kidney(edge_length=5.15e-3)),
}
TISSUE = Material(1e4, 0.45, 1000.0)
MASS_DAMPING = 5.0  # [1/s]
WEIGHT = (0.0, 0.0, -5.0)  # [N/m3]; the box sinks by about 5 % of its length
CELL_STEPS = 3e7  # work of one of our timings: short ones find the quiet moments of a busy machine
SECONDS = 0.2  # of one of a rival's
TIMINGS = 12  # the first is not counted

# Tool -> how to install it. PALPATE_BENCH_PYTHON may name the interpreter that has it.
RIVALS = {
    "numpy": "pip install numpy",
    "numba": "pip install numba",
    "mujoco": "pip install mujoco",
    "newton": "pip install newton warp-lang",
    "taichi": "pip install taichi",
    "dolfinx": "apt-get install python3-dolfinx, or pip install dolfinx-solver-real",
}
# Released simulators; the others are loops and assemblies that somebody would write.
SIMULATORS = ("mujoco", "newton")
TABLE = (
    "body", "speedup_from_threads", "relative_force_error", "real_time_factor", "peak_memory_mb",
)  # fmt: skip
_FILES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("step_numpy.py", {}),
    ("step_numba.py", {"precision": "float32"}),
    ("step_numba.py", {"precision": "float64"}),
    ("step_mujoco.py", {}),
    ("step_newton.py", {}),
    ("step_taichi.py", {}),
    ("step_dolfinx.py", {}),
)
_EVERY_VERSION = ("step_dolfinx.py",)

Row = dict[str, Any]


def bench_steps(
    *,
    sizes: Sequence[int] = tuple(SIZES),
    threads: Sequence[int] = (1, 2),
    progress: Callable[[str], None] | None = None,
) -> list[Row]:
    """Time whole steps with supports, weight and damping; every tool takes its turn.

    Each tool is set up in a process of its own, then all are timed in turn, and the best timing
    of each counts: seconds of the processor on one thread, of the clock on several.

    Args:
        sizes: Numbers of cells, keys of `SIZES`.
        threads: Numbers of threads for our own step.
        progress: Called with one line per row.

    Returns:
        Rows with tool, body, size [cells], threads, precision, seconds per step, rate
        [million cells x steps per second] and peak_memory_mb. Rivals with our law have
        relative_force_error, of the largest nodal force, at a random displacement of a tenth of
        a cell. Ours have real_time_factor (simulated over spent time), speedup_from_threads and,
        on the kidney, real_time_cells: how many cells of this body would run in real time.
    """
    rows: list[Row] = []
    for size in sizes:
        mesh = SIZES[size]()
        found = _time_all(mesh, threads, progress)
        for row in found:
            row["body"] = "kidney" if size == KIDNEY else "box"
            if size == KIDNEY and row["tool"] == "palpate":
                # Cost grows as n, the stable step shrinks as n^(-1/3).
                row["real_time_cells"] = round(row["size"] * row["real_time_factor"] ** 0.75)
            if progress:
                progress(_line(row))
        rows += found
    return rows


def _body(mesh: TetMesh) -> dict[str, Any]:
    """What every tool is given, as plain arrays."""
    low = mesh.points[:, 0].min()
    length = np.ptp(mesh.points[:, 0])
    held = np.flatnonzero(mesh.points[:, 0] < low + 0.02 * length).astype(np.int32)
    test = np.random.default_rng(1).uniform(-0.1, 0.1, mesh.points.shape)
    test *= (6.0 * mesh.volume / mesh.num_cells) ** (1.0 / 3.0)
    test[held] = 0.0
    mass = Body(mesh, TISSUE).lumped_mass
    return {
        "points": mesh.points,
        "cells": mesh.cells,
        "held": held,
        "youngs_modulus": TISSUE.youngs_modulus,
        "poissons_ratio": TISSUE.poissons_ratio,
        "density": TISSUE.density,
        "time_step": SAFETY * Body(mesh, TISSUE).critical_time_step(),
        "mass_damping": MASS_DAMPING,
        "lumped_mass": mass,
        "force_density": np.array(WEIGHT),
        "external_force": np.outer(mass / TISSUE.density, WEIGHT),
        "test_displacement": test,
    }


def _time_all(
    mesh: TetMesh, threads: Sequence[int], progress: Callable[[str], None] | None
) -> list[Row]:
    body = _body(mesh)
    steps = max(20, int(CELL_STEPS / mesh.num_cells))
    files: list[tuple[str, dict[str, Any]]] = [
        ("palpate_steps.py", body | {"precision": precision.value, "num_threads": count})
        for precision in Precision
        for count in threads
    ]
    files += [(file, body | extra) for file, extra in _FILES]
    plain = Body(mesh, TISSUE).internal_force(body["test_displacement"])
    rows = []
    with started(files, progress, _EVERY_VERSION) as children:
        counts = {id(c): steps if c.is_ours else _count_steps(c) for c in children}
        take_turns(children, TIMINGS, lambda child, _turn: counts[id(child)], progress)
        for child in children:
            rows.append(_row(child, mesh, counts[id(child)]))
            if child.force is not None:
                known = np.isfinite(child.force)
                error = np.abs(child.force - plain)[known].max() / np.abs(plain).max()
                rows[-1]["relative_force_error"] = float(error)
    for row in rows:
        if row["tool"] != "palpate":
            continue
        row["real_time_factor"] = float(body["time_step"]) / row["seconds"]
        alone = [r for r in rows if r["threads"] == 1 and _is_same_but_threads(r, row)]
        if row["threads"] > 1 and alone:
            row["speedup_from_threads"] = alone[0]["wall_seconds"] / row["wall_seconds"]
    return rows


def _count_steps(child: TimedChild) -> int:
    """How many steps last about `SECONDS`, from a few."""
    count = 1
    while (wall := float(child.time(count)["wall"])) < 0.1 * SECONDS:
        count *= 4
    child.answers.clear()
    return max(1, round(count * SECONDS / wall))


def _is_same_but_threads(row: Row, other: Row) -> bool:
    return all(row[key] == other[key] for key in ("tool", "precision"))


def _row(child: TimedChild, mesh: TetMesh, num_steps: int) -> Row:
    wall = child.best("wall") / num_steps
    seconds = wall if child.num_threads > 1 else child.best("processor") / num_steps
    last = child.answers[-1]
    row = {
        "tool": child.about["tool"],
        "version": child.about["version"],
        "size": mesh.num_cells,
        "threads": child.num_threads,
        "precision": child.about["precision"],
        "seconds": seconds,
        "rate": mesh.num_cells / seconds / 1e6,
        "rate_unit": "million cells x steps per second",
        "wall_seconds": wall,
        "peak_memory_mb": last["peak_memory_mb"],
    }
    return row | {k: v for k, v in last.items() if k == "instruction_set"}


def _line(row: Row) -> str:
    return (
        f"{row['tool']:8} {row['size']:7d} cells  {row['precision']}  {row['threads']} thread(s)"
        f"  {row['rate']:8.1f} {row['rate_unit']}"
    )


def summarise(rows: Sequence[Row]) -> list[str]:
    """How many times the best simulator's and the numba loop's rate, and what is real time."""
    lines = []
    for size in dict.fromkeys(row["size"] for row in rows):
        here = [row for row in rows if row["size"] == size]
        for precision in Precision:
            ours = [r for r in here if r["tool"] == "palpate" and r["precision"] == precision]
            alone = next((row for row in ours if row["threads"] == 1), None)
            if alone is None:
                continue
            # Single precision against all simulators, double against those in double.
            rivals = [
                row
                for row in here
                if row["tool"] in SIMULATORS
                and (precision is Precision.SINGLE or row["precision"] == precision)
            ]
            loops = [r for r in here if r["tool"] == "numba" and r["precision"] == precision]
            parts = [
                f"{alone['rate'] / best['rate']:.1f} times {best['tool']}"
                for group in (rivals, loops)
                for best in sorted(group, key=lambda row: -row["rate"])[:1]
            ]
            parts += [
                f"{row['threads']} threads {row['speedup_from_threads']:.2f} times one"
                for row in ours
                if "speedup_from_threads" in row
            ]
            if "real_time_cells" in alone:
                parts.append(f"{alone['real_time_cells']} cells in real time on one core")
            lines.append(f"{alone['body']} of {size} cells, {precision.value}: " + ", ".join(parts))
    return lines
