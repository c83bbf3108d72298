"""Fig. 2: a beam under its own weight. Linear strain stretches it falsely, Green does not.

The sweep raises the weight from a tenth to all of it and follows the tip and the length of the
middle line, for both strains, by fastsim (marks) and by the reference on the same mesh (lines).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich.console import Console

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import BodyForce, Load, Traction
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.availability import is_available
from palpate.validation.case import load_case
from palpate.validation.quoting import csv_text
from palpate.validation.references.sets import solve_state
from palpate.validation.simulators import run_fastsim
from palpate.validation.studies.common import code_of, judge_and_report

FACTORS = (0.1, 0.25, 0.5, 0.75, 1.0)


def run(folder: Path, progress: Callable[[str], None], console: Console) -> int:
    """Judge the beam, sweep its load, and leave report.html, sweep.csv and sweep.svg."""
    result = judge_and_report("beam", folder, progress, console)
    rows = sweep(load_case("beam").problem, progress)
    columns = ("load_factor", "strain", "simulator", "tip_drop_mm", "stretch_percent")
    (folder / "sweep.csv").write_text(csv_text(columns, rows), encoding="utf-8")
    (folder / "sweep.svg").write_text(sweep_svg(rows), encoding="utf-8")
    console.print(f"{'load':>6} {'strain':7} {'simulator':14} {'tip drop [mm]':>14} {'stretch':>9}")
    for factor, strain, simulator, drop, stretch in rows:
        console.print(f"{factor:6.2f} {strain:7} {simulator:14} {drop:14.3f} {stretch:8.2f}%")
    return code_of(result)


Row = tuple[float, str, str, float, float]


def sweep(problem: Problem, progress: Callable[[str], None]) -> list[Row]:
    """Tip drop [mm] and stretch of the middle line [%] at each load, strain and simulator."""
    rows: list[Row] = []
    for factor in FACTORS:
        given = scaled(problem, factor)
        for strain in Strain:
            fast = run_fastsim(given, strain, lambda _line: None).displacement
            rows.append((factor, strain.value, "fastsim", *_tip(problem.mesh, fast)))
            if is_available():
                truth = solve_state(given, strain, 1, lambda _line: None).displacement
                rows.append((factor, strain.value, "reference P1", *_tip(problem.mesh, truth)))
        progress(f"load sweep: {factor:g} of the weight done")
    return rows


def scaled(problem: Problem, factor: float) -> Problem:
    """The problem with all its loads multiplied."""
    loads: list[Load] = []
    for load in problem.loads:
        if isinstance(load, BodyForce):
            f = [factor * x for x in load.force_density]
            loads.append(dataclasses.replace(load, force_density=(f[0], f[1], f[2])))
        elif isinstance(load, Traction):
            t = [factor * x for x in load.traction]
            loads.append(dataclasses.replace(load, traction=(t[0], t[1], t[2])))
        else:
            raise ValueError(f"the sweep does not know {type(load).__name__}")
    return dataclasses.replace(problem, loads=tuple(loads))


def middle_line_length(mesh: TetMesh, displacement: Points, stations: int = 25) -> float:
    """Length [m] of the line through the middles of slices along x, as displaced.

    Each station is the mean over the boundary points nearest to it; the rest length is the body's.
    """
    x = mesh.points[:, 0]
    places = np.linspace(x.min(), x.max(), stations)
    width = 1.5 * (places[1] - places[0])
    line = []
    for place in places:
        # A linear fit over a slice gives the mean section even where points lie unevenly.
        near = np.abs(x - place) <= width
        basis = np.column_stack(
            [np.ones(near.sum()), x[near] - place, mesh.points[near, 1:] - _axis(mesh)]
        )
        moved = mesh.points[near] + displacement[near]
        line.append(np.linalg.lstsq(basis, moved, rcond=None)[0][0])
    return float(np.linalg.norm(np.diff(np.array(line), axis=0), axis=1).sum())


def _axis(mesh: TetMesh) -> Points:
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    middle: Points = 0.5 * (low + high)[1:]
    return middle


def _tip(mesh: TetMesh, displacement: Points) -> tuple[float, float]:
    end = mesh.points[:, 0] == mesh.points[:, 0].max()
    drop = -1e3 * float(displacement[end, 2].mean())
    length = float(np.ptp(mesh.points[:, 0]))
    return drop, (middle_line_length(mesh, displacement) / length - 1.0) * 100.0


def sweep_svg(rows: list[Row]) -> str:
    """Tip drop and stretch over load; lines: reference, marks: fastsim."""
    from matplotlib import pyplot

    from palpate.validation.report.plots import figure_svg

    colours = {"linear": "#c98a12", "green": "#b5332e"}
    figure, axes = pyplot.subplots(1, 2, figsize=(9.0, 3.6))
    for panel, (column, label) in zip(
        axes, ((3, "tip drop [mm]"), (4, "stretch of the middle line [%]")), strict=True
    ):
        for strain, colour in colours.items():
            for simulator, style in (("reference P1", "-"), ("fastsim", "o")):
                chosen = [r for r in rows if r[1] == strain and r[2] == simulator]
                panel.plot(
                    [r[0] for r in chosen],
                    [r[column] for r in chosen],
                    style,
                    color=colour,
                    label=f"{strain}, {simulator}",
                )
        panel.set_xlabel("part of the weight")
        panel.set_ylabel(label)
        panel.grid(color="#dddddd", lw=0.6)
    axes[0].legend(frameon=False, fontsize=8)
    figure.tight_layout()
    return figure_svg(figure)
