"""Fig. 2: a beam under its own weight. Linear strain stretches it falsely, Green does not.

The sweep raises the weight from a tenth to all of it and follows the tip and the length of the
middle line, for both strains, by fastsim (marks) and by the reference on the same mesh (lines).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.transforms import scale_loads
from palpate.reference.availability import is_available
from palpate.validation.candidates.fastsim import run_fastsim
from palpate.validation.case import load_case
from palpate.validation.judging.results import CaseResult
from palpate.validation.references.runs import solve_state
from palpate.validation.report.plots import OCHRE, RED, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table
from palpate.validation.states import Progress, in_silence
from palpate.validation.studies.study import findings_of, judge_live, page_of

TITLE = "The beam"

FACTORS = (0.1, 0.25, 0.5, 0.75, 1.0)


class Row(NamedTuple):
    """Tip drop [mm] and stretch of the middle line [%] under a part of the weight."""

    load_factor: float
    strain: Strain
    simulator: str
    tip_drop: float
    stretch: float


def compute(progress: Progress) -> tuple[CaseResult, list[Row]]:
    """Judge the beam, sweep its load."""
    return judge_live("beam", progress), sweep(load_case("beam").problem, progress)


def sweep(problem: Problem, progress: Progress) -> list[Row]:
    """Each load, strain and simulator."""
    rows: list[Row] = []
    for factor in FACTORS:
        given = scale_loads(problem, factor)
        for strain in Strain:
            answers = {"fastsim": run_fastsim(given, strain, in_silence).displacement}
            if is_available():
                truth = solve_state(given, strain, 1, in_silence)
                answers["reference P1"] = truth.displacement
            for simulator, displacement in answers.items():
                measured = measure_tip(problem.mesh, displacement)
                rows.append(Row(factor, strain, simulator, *measured))
        progress(f"load sweep: {factor:g} of the weight done")
    return rows


def measure_tip(mesh: TetMesh, displacement: Points) -> tuple[float, float]:
    """Drop of the end [mm], and stretch of the middle line [%]."""
    end = mesh.points[:, 0] == mesh.points[:, 0].max()
    drop = -1e3 * float(displacement[end, 2].mean())
    length = float(np.ptp(mesh.points[:, 0]))
    return drop, (middle_line_length(mesh, displacement) / length - 1.0) * 100.0


def middle_line_length(mesh: TetMesh, displacement: Points, stations: int = 25) -> float:
    """Length [m] of the line through the middles of slices along x, as displaced."""
    x = mesh.points[:, 0]
    places = np.linspace(x.min(), x.max(), stations)
    middle = 0.5 * (mesh.points.min(axis=0) + mesh.points.max(axis=0))[1:]
    line = []
    for place in places:
        # A linear fit over a slice gives the mean section even where points lie unevenly.
        near = np.abs(x - place) <= 1.5 * (places[1] - places[0])
        basis = np.column_stack(
            [np.ones(near.sum()), x[near] - place, mesh.points[near, 1:] - middle]
        )
        moved = mesh.points[near] + displacement[near]
        line.append(np.linalg.lstsq(basis, moved, rcond=None)[0][0])
    return float(np.linalg.norm(np.diff(np.array(line), axis=0), axis=1).sum())


def judge(found: tuple[CaseResult, list[Row]]) -> list[Finding]:
    """The case's checks."""
    return findings_of(found[0])


def present(found: tuple[CaseResult, list[Row]]) -> Page:
    """The case's report, and the sweep as a table and a figure."""
    result, rows = found
    columns = {"load_factor": "g", "strain": "", "simulator": "", "tip_drop_mm": ".3f"}
    table = Table("Load sweep", {**columns, "stretch_percent": ".2f"}, rows)

    def lines(measure: Callable[[Row], float]) -> list[Line]:
        chosen = {
            (strain, simulator): [r for r in rows if (r.strain, r.simulator) == (strain, simulator)]
            for strain in Strain
            for simulator in ("reference P1", "fastsim")
        }
        return [
            Line(
                [r.load_factor for r in some],
                [measure(r) for r in some],
                label=f"{strain}, {simulator}",
                style="o" if simulator == "fastsim" else "-",
                colour=OCHRE if strain is Strain.LINEAR else RED,
            )
            for (strain, simulator), some in chosen.items()
            if some
        ]

    panels = [
        Panel(lines(lambda r: r.tip_drop), x="part of the weight", y="tip drop [mm]"),
        Panel(
            lines(lambda r: r.stretch), x="part of the weight", y="stretch of the middle line [%]"
        ),
    ]
    figure = line_figure([panels], "Lines: reference; marks: fastsim.", shares_legend=True)
    return dataclasses.replace(page_of(result), tables={"sweep": table}, figures={"sweep": figure})
