"""Error against run time: every simulator that is installed, at several mesh sizes, in one plot.

A soft bar, clamped at one end, is bent by a downward traction on the other until its tip has
sunk by a quarter of its length. The error is the relative L2 distance from quadratic elements on
the finest mesh; the time is processor time of the solve alone, one thread, without start-up and
reading. A simulator with another law keeps the distance of that law however fine its mesh: it is
drawn apart.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from rich.console import Console

from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem, Strain
from palpate.validation.exchange.placement import place
from palpate.validation.exchange.point_location import locate
from palpate.validation.metrics import l2_norm
from palpate.validation.quoting import csv_text
from palpate.validation.report.study_page import (
    Finding,
    StudyFigure,
    StudyTable,
    write_study_page,
)
from palpate.validation.run_folder import RESULTS
from palpate.validation.simulators import CandidateFailedError, adapters
from palpate.validation.simulators.interpreters import interpreter_with
from palpate.validation.simulators.outside import OutsideSimulator
from palpate.validation.states import Verdict

SIZE = (0.08, 0.02, 0.02)
DIVISIONS = (1, 2, 3, 4, 6)
TRACTION = 150.0  # Pa, downward on the free end
TIME_LIMIT = 120.0
STVK = "Saint-Venant-Kirchhoff"
# Largest distance from fastsim on the same mesh, over the largest displacement: seven digits of a
# text file, or a motion that was stopped at a residual of 1e-7.
SAME_MESH = 1e-4
# Adapter, the module its interpreter must have, and its largest number of divisions here.
_ADAPTERS = (
    ("numpy_dense", "numpy", 2),
    ("calculix", "numpy", 6),
    ("felupe_svk", "felupe", 6),
    ("mujoco_flex", "mujoco", 6),
    ("newton_neo_hookean", "newton", 4),
)


@dataclass(frozen=True)
class Row:
    """One simulator on one mesh.

    Attributes:
        tool: Name.
        version: Of the tool.
        law: Material law it declares.
        method: How it solves.
        num_cells: Of the mesh.
        seconds: Processor time of the solve.
        error: Relative L2 distance from the quadratic reference.
        same_mesh: Largest distance from fastsim on the same mesh, over the largest displacement.
    """

    tool: str
    version: str
    law: str
    method: str
    num_cells: int
    seconds: float
    error: float
    same_mesh: float


def make_problem(divisions: int) -> Problem:
    """The bar with `divisions` bricks across and four times as many along."""
    mesh = brick_box((4 * divisions, divisions, divisions), SIZE)
    facets = mesh.boundary_facets
    x = mesh.points[facets][:, :, 0]
    held = facets[(x < 1e-9).all(axis=1)]
    end = facets[(x > SIZE[0] - 1e-9).all(axis=1)]
    support = Support(np.unique(held).astype(np.int32), held)
    load = Traction(end, (0.0, 0.0, -TRACTION))
    return Problem(mesh, Material(2e4, 0.3, 1000.0), (support,), (load,))


def run(folder: Path, progress: Callable[[str], None], console: Console) -> int:
    """Run everything that is installed; leave report.html, frontier.svg, frontier.csv."""
    from palpate.validation.references.sets import solve_state

    problems = {n: make_problem(n) for n in DIVISIONS}
    finest = problems[DIVISIONS[-1]]
    truth = solve_state(finest, Strain.GREEN, 2, progress)
    coarser = solve_state(problems[3], Strain.GREEN, 2, progress)
    at_coarser = _read(finest, truth.displacement, problems[3])
    bar = l2_norm(problems[3].mesh, coarser.displacement - at_coarser)
    bar /= l2_norm(problems[3].mesh, at_coarser)

    rows, missing = [], []
    answers: dict[int, Points] = {}
    for n, problem in problems.items():
        seconds, answers[n] = _time_fastsim(problem)
        error = _error(problem, answers[n], finest, truth.displacement)
        rows.append(
            Row("fastsim", _version(), STVK, "Newton, conjugate gradients", problem.mesh.num_cells,
                seconds, error, 0.0)
        )  # fmt: skip
    for name, module, most in _ADAPTERS:
        interpreter = interpreter_with(module)
        if interpreter is None:
            missing.append(f"{name}: {module} is not installed (PALPATE_BENCH_PYTHON names others)")
            progress(missing[-1])
            continue
        file = Path(adapters.__file__).parent / f"{name}.py"
        simulator = OutsideSimulator(f"{interpreter} {file} {{case}} {{result}}", TIME_LIMIT)
        for n in (n for n in DIVISIONS if n <= most):
            problem = problems[n]
            try:
                answer = simulator.run(problem, Strain.GREEN, progress)
            except CandidateFailedError as failure:
                missing.append(f"{name}, {problem.mesh.num_cells} cells: {failure}")
                progress(missing[-1])
                break
            about, found = answer.result.about, place(answer.result, problem).displacement[0]
            apart = float(np.abs(found - answers[n]).max() / np.abs(answers[n]).max())
            rows.append(
                Row(
                    str(about["tool"]),
                    str(about["version"]),
                    STVK if str(about["law"]).startswith(STVK) else str(about["law"]),
                    str(about.get("method", "Newton, dense matrices")),
                    problem.mesh.num_cells,
                    float(str(about.get("seconds", answer.seconds))),
                    _error(problem, found, finest, truth.displacement),
                    apart,
                )
            )
    return _write(folder, rows, missing, bar, console)


def find_faults(rows: Sequence[Row]) -> list[Finding]:
    """Claims that the figure rests on, each with what was found."""
    findings = []
    same_law = [row for row in rows if row.law == STVK]
    worst = max(same_law, key=lambda row: row.same_mesh)
    findings.append(
        Finding(
            f"simulators of the same law agree on the same mesh to {SAME_MESH:g}",
            f"largest distance {worst.same_mesh:.2g} ({worst.tool}, {worst.num_cells} cells)",
            Verdict.PASSED if worst.same_mesh <= SAME_MESH else Verdict.FAILED,
        )
    )
    for tool in dict.fromkeys(row.tool for row in same_law):
        errors = [row.error for row in same_law if row.tool == tool]
        is_falling = all(b < a for a, b in pairwise(errors))
        findings.append(
            Finding(
                f"{tool}: a finer mesh is nearer to the reference",
                " > ".join(f"{error:.3f}" for error in errors),
                Verdict.PASSED if is_falling else Verdict.FAILED,
            )
        )
    for row in (r for r in rows if r.law != STVK):
        findings.append(
            Finding(
                f"{row.tool} ({row.law}), {row.num_cells} cells: another law, judged apart",
                f"model term {100 * row.same_mesh:.1f} % of the largest displacement, on this mesh",
                Verdict.PASSED,
            )
        )
    return findings


def frontier_svg(rows: Sequence[Row], bar: float) -> str:
    """Error over processor time, a line for each tool; another law dashed."""
    from matplotlib import pyplot

    from palpate.validation.report.plots import figure_svg

    figure, axes = pyplot.subplots(figsize=(8.0, 5.2))
    for tool in dict.fromkeys(row.tool for row in rows):
        of = [row for row in rows if row.tool == tool]
        axes.loglog(
            [row.seconds for row in of],
            [row.error for row in of],
            "-o" if of[0].law == STVK else "--s",
            lw=2.2 if tool == "fastsim" else 1.2,
            ms=5,
            label=f"{tool} {of[0].version}" + ("" if of[0].law == STVK else f", {of[0].law}"),
        )
        for row in (of[0], of[-1]):
            axes.annotate(
                f"{row.num_cells}", (row.seconds, row.error), (4, 4), textcoords="offset points",
                fontsize=7,
            )  # fmt: skip
    axes.axhline(bar, color="black", lw=0.8, ls=":")
    axes.set_xlabel("processor time of the solve [s], one thread")
    axes.set_ylabel("relative L2 error against quadratic elements")
    axes.set_title("Error against run time; numbers are cells", fontsize=10)
    axes.grid(color="#dddddd", lw=0.6, which="both")
    axes.legend(frameon=False, fontsize=8)
    figure.tight_layout()
    return figure_svg(figure)


def _write(
    folder: Path, rows: Sequence[Row], missing: Sequence[str], bar: float, console: Console
) -> int:
    svg = frontier_svg(rows, bar)
    findings = find_faults(rows)
    (folder / "frontier.svg").write_text(svg, encoding="utf-8")
    text = csv_text(list(asdict(rows[0])), (asdict(row).values() for row in rows))
    (folder / "frontier.csv").write_text(text, encoding="utf-8")
    columns = ["tool", "version", "law", "method", "cells", "seconds", "error", "same mesh"]
    table = [
        [r.tool, r.version, r.law, r.method, str(r.num_cells), f"{r.seconds:.3g}",
         f"{r.error:.4f}", f"{r.same_mesh:.2g}"]
        for r in rows
    ]  # fmt: skip
    write_study_page(
        folder / "report.html",
        title="Error against run time",
        about=[*(__doc__ or "").split("\n\n"), *(f"Left out: {line}" for line in missing)],
        findings=findings,
        figures=[
            StudyFigure(
                svg,
                "Lower left is better. The dotted line is the reference's own change when its mesh "
                "is halved: errors near it say nothing. Dashed: another material law.",
            )
        ],
        tables=[StudyTable("Every run", columns, table)],
    )
    text = json.dumps(
        {
            "study": "frontier",
            "reference_change": bar,
            "rows": [asdict(row) for row in rows],
            "left_out": list(missing),
        },
        indent=1,
    )
    (folder / RESULTS).write_text(text + "\n", encoding="utf-8")
    for line in table:
        console.print("  ".join(line), markup=False, soft_wrap=True)
    for finding in findings:
        console.print(f"{finding.verdict}: {finding.claim}: {finding.found}", markup=False)
    return 1 if any(f.verdict is Verdict.FAILED for f in findings) else 0


def _error(problem: Problem, displacement: Points, finest: Problem, truth: Points) -> float:
    read = _read(problem, displacement, finest)
    return l2_norm(finest.mesh, read - truth) / l2_norm(finest.mesh, truth)


def _read(problem: Problem, displacement: Points, other: Problem) -> Points:
    mesh = problem.mesh
    return locate(mesh.points, mesh.cells, other.mesh.points).read(mesh.cells, displacement)


def _time_fastsim(problem: Problem) -> tuple[float, Points]:
    best, displacement = float("inf"), np.zeros_like(problem.mesh.points)
    for _ in range(3):
        start = time.process_time()
        displacement = solve_static(problem).displacement
        best = min(best, time.process_time() - start)
    return best, displacement


def _version() -> str:
    from importlib import metadata

    try:
        return metadata.version("palpate")
    except metadata.PackageNotFoundError:
        return f"of these sources, Python {sys.version_info.major}.{sys.version_info.minor}"
