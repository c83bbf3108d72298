"""Fig. 2: a beam under its own weight. Linear strain stretches it falsely, Green does not.

The sweep raises the weight from a tenth to all of it and follows the tip and the length of the
middle line, for both strains, by fastsim and by the reference on the same mesh.
"""

from __future__ import annotations

import dataclasses
from itertools import product

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Element, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.transforms import scale_loads
from palpate.reference.availability import is_available
from palpate.validation.case import load_case
from palpate.validation.case.variants import Axis
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.plots import Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table
from palpate.validation.solving import Simulator
from palpate.validation.states import CandidateFailedError, Progress
from palpate.validation.studies.kidney import findings_of, judge_live, page_of
from palpate.validation.studies.sweep import lines_of
from palpate.validation.studies.sweep_runs import Run, solve_row

TITLE = "The beam"

FACTORS = (0.1, 0.25, 0.5, 0.75, 1.0)
AXIS = Axis("part of the weight", FACTORS)


def compute(progress: Progress) -> tuple[CaseResult, list[Run]]:
    """Judge the beam, sweep its load by fastsim, and by the reference where it is.

    Raises CandidateFailedError where one of them has no result under a part of the weight.
    """
    case = load_case("beam")
    row = [((factor,), scale_loads(case.problem, factor)) for factor in FACTORS]
    simulators = (Simulator.FASTSIM, *((Simulator.REFERENCE,) if is_available() else ()))
    runs = [
        run
        for simulator, strain in product(simulators, Strain)
        for run in solve_row(
            [AXIS], row, case.spec.units, simulator, Element.LINEAR, strain, progress=progress
        )
    ]
    for run in runs:
        if run.state is None:
            raise CandidateFailedError(f"{run.who}, {run.strain} strain: {run.trouble}")
    return judge_live("beam", progress), runs


def measure_tip(mesh: TetMesh, displacement: Points) -> tuple[float, float]:
    """Drop of the end [mm], and stretch of the middle line [%]."""
    end = mesh.points[:, 0] == mesh.points[:, 0].max()
    drop = -1e3 * float(displacement[end, 2].mean())
    length = float(np.ptp(mesh.points[:, 0]))
    return drop, (middle_line_length(mesh, displacement) / length - 1.0) * 100.0


def middle_line_length(mesh: TetMesh, displacement: Points, stations: int = 25) -> float:
    """Length [m] of the line through the middles of slices along x, as displaced."""
    x = mesh.points[:, 0]
    positions = np.linspace(x.min(), x.max(), stations)
    middle = 0.5 * (mesh.points.min(axis=0) + mesh.points.max(axis=0))[1:]
    line = []
    for position in positions:
        # A linear fit over a slice gives the mean section even where points lie unevenly.
        near = np.abs(x - position) <= 1.5 * (positions[1] - positions[0])
        basis = np.column_stack(
            [np.ones(near.sum()), x[near] - position, mesh.points[near, 1:] - middle]
        )
        moved = mesh.points[near] + displacement[near]
        line.append(np.linalg.lstsq(basis, moved, rcond=None)[0][0])
    return float(np.linalg.norm(np.diff(np.array(line), axis=0), axis=1).sum())


def judge(found: tuple[CaseResult, list[Run]]) -> list[Finding]:
    """The case's checks."""
    return findings_of(found[0])


def present(found: tuple[CaseResult, list[Run]]) -> Page:
    """The case's report, and the sweep as a table and a figure."""
    result, runs = found
    mesh = load_case("beam").problem.mesh
    measured = {
        (run.values, run.simulator, run.strain): measure_tip(mesh, run.state.displacement)
        for run in runs
        if run.state is not None
    }
    columns = {"load_factor": "g", "strain": "", "simulator": "", "tip_drop_mm": ".3f"}
    table = Table(
        "Load sweep",
        {**columns, "stretch_percent": ".2f"},
        [
            (factor, str(strain), str(simulator), *tip)
            for ((factor,), simulator, strain), tip in measured.items()
        ],
    )

    def panel(k: int, words: str) -> Panel:
        def number(run: Run) -> float | None:
            tip = measured.get((run.values, run.simulator, run.strain))
            return None if tip is None else tip[k]

        return Panel(lines_of([AXIS], runs, number), x=AXIS.key, y=words)

    panels = [panel(0, "tip drop [mm]"), panel(1, "stretch of the middle line [%]")]
    words = "Solid: Green strain; dashed: linear strain. Crosses: the reference on the same mesh."
    figure = line_figure([panels], words, shares_legend=True)
    return dataclasses.replace(page_of(result), tables={"sweep": table}, figures={"sweep": figure})
