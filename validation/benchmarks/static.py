"""`palpate bench static`: equilibria of a beam and of the kidney, ours beside other solvers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from palpate.fastsim.forces import external_force
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem, Strain
from palpate.validation.benchmarks.children import TimedChild, started, take_turns
from palpate.validation.case import load_case

# Degrees of freedom -> bricks of the beam.
BEAMS = {22_143: (60, 10, 10), 115_881: (106, 18, 18)}
KIDNEY = 3_246  # the kidney of Table I
SIZES = (*BEAMS, KIDNEY)
TOLERANCE = 1e-8
LONG = 5.0  # [s]; longer solves are timed twice, others four times

# Tool -> how to install it. PALPATE_BENCH_PYTHON may name the interpreter that has it.
RIVALS = {
    "dolfinx": "apt-get install python3-dolfinx, or pip install dolfinx-solver-real",
    "calculix": "apt-get install calculix-ccx",
    "felupe": "pip install felupe pypardiso",
}
TABLE = (
    "body", "strain", "tip_displacement", "peak_memory_mb", "iterations", "linear_iterations",
    "times_linear",
)  # fmt: skip
_FILES: tuple[str, ...] = ("static_dolfinx.py", "static_calculix.py", "static_felupe.py")
_EVERY_VERSION = ("static_dolfinx.py",)

Row = dict[str, Any]


def beam_problem(size: int) -> Problem:
    """The beam of `bench static`: 1 x 0.1 x 0.1 m, bent by about 4 % of its length."""
    mesh = brick_box(BEAMS[size], (1.0, 0.1, 0.1))
    held = np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32)
    return Problem(
        mesh, Material(1e6, 0.3, 1000.0), (Support(held),), (BodyForce((0.0, 0.0, -300.0)),)
    )


def bench_static(
    *,
    sizes: Sequence[int] = SIZES,
    progress: Callable[[str], None] | None = None,
) -> list[Row]:
    """Time whole static solves to a relative residual of 1e-8, assembly included.

    Each tool runs in a process of its own, on one thread; the tools take turns and the best of
    each counts. dolfinx has its mesh and compiled forms before the clock starts, ours only the
    arrays; CalculiX reads its input file; FElupe factors directly.

    Args:
        sizes: Degrees of freedom, of `SIZES`.
        progress: Called with one line per row.

    Returns:
        Rows with tool, body, strain, size, seconds of the processor, wall_seconds,
        tip_displacement [m] (z, of the same point in every tool), peak_memory_mb of the process,
        solver, iterations, and times_linear: seconds with Green strain over those with linear.
    """
    rows: list[Row] = []
    for size in sizes:
        problem = load_case("kidney").problem if size == KIDNEY else beam_problem(size)
        for strain in (Strain.LINEAR, Strain.GREEN):
            with started(
                [(file, _body(problem, strain)) for file in ("palpate_static.py", *_FILES)],
                progress,
                _EVERY_VERSION,
            ) as children:
                take_turns(children, 4, _count_solves, progress)
                found = [_row(child, problem, strain) for child in children]
            for row in found:
                row["body"] = "kidney" if size == KIDNEY else "beam"
                if progress:
                    progress(_line(row))
            rows += found
    _compare_strains(rows)
    return rows


def _body(problem: Problem, strain: Strain) -> dict[str, Any]:
    """What every tool is given, as plain arrays."""
    load = external_force(problem)
    held = np.unique(np.concatenate([s.points for s in problem.supports]))
    # The farthest loaded point along x, then z: moved much, and the same one for all.
    x, _, z = problem.mesh.points.T
    return {
        "points": problem.mesh.points,
        "cells": problem.mesh.cells,
        "held": held.astype(np.int32),
        "external_force": load,
        "youngs_modulus": problem.material.youngs_modulus,
        "poissons_ratio": problem.material.poissons_ratio,
        "strain": strain.value,
        "relative_tolerance": TOLERANCE,
        "tip": int(np.lexsort((z, x))[-1]),
    }


def _count_solves(child: TimedChild, turn: int) -> int:
    return 1 if turn < 2 or child.best("wall") < LONG else 0


def _row(child: TimedChild, problem: Problem, strain: Strain) -> Row:
    seconds, last = child.best("processor"), child.answers[-1]
    size = 3 * problem.mesh.num_points
    return {
        "tool": child.about["tool"],
        "version": child.about["version"],
        "size": size,
        "threads": 1,
        "precision": child.about["precision"],
        "strain": strain.value,
        "seconds": seconds,
        "rate": size / seconds,
        "rate_unit": "degrees of freedom per second",
        "wall_seconds": child.best("wall"),
        "tip_displacement": last["tip_displacement"],
        "peak_memory_mb": last["peak_memory_mb"],
        "iterations": last["iterations"],
        "linear_iterations": last.get("linear_iterations"),
        "solver": last["solver"],
    }


def _compare_strains(rows: Sequence[Row]) -> None:
    """Green strain's seconds over linear strain's, in the row of Green strain."""
    linear = {(r["tool"], r["version"], r["size"]): r for r in rows if r["strain"] == "linear"}
    for row in rows:
        if row["strain"] == "green":
            partner = linear[row["tool"], row["version"], row["size"]]
            row["times_linear"] = row["seconds"] / partner["seconds"]


def _line(row: Row) -> str:
    return (
        f"{row['tool']:8} {row['size']} dof {row['strain']:7} {row['seconds']:8.2f} s  "
        f"{row['peak_memory_mb']:6.0f} MB  tip {row['tip_displacement']:.9g} m"
    )


def summarise(rows: Sequence[Row]) -> list[str]:
    """How many times quicker than the quickest rival, at what memory, and the same tip or not."""
    lines = []
    for key in dict.fromkeys((row["size"], row["strain"]) for row in rows):
        here = [row for row in rows if (row["size"], row["strain"]) == key]
        ours = next(row for row in here if row["tool"] == "palpate")
        rivals = sorted((r for r in here if r["tool"] != "palpate"), key=lambda row: row["seconds"])
        parts = []
        if rivals:
            best = rivals[0]
            tip = best["tip_displacement"]
            parts = [
                f"{best['seconds'] / ours['seconds']:.1f} times as quick as {best['tool']} "
                f"{best['version']}",
                f"{ours['peak_memory_mb'] / best['peak_memory_mb']:.2f} of its memory",
                f"tips {abs(ours['tip_displacement'] - tip) / abs(tip):.1g} apart",
            ]
        if "times_linear" in ours:
            parts.append(f"Green {ours['times_linear']:.1f} times linear")
        lines.append(f"{ours['body']} of {key[0]} unknowns, {key[1]}: " + ", ".join(parts))
    return lines
