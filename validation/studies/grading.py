"""Section V: graded meshes. The same answer with how many of the cells?

Two questions. How does the number of cells grow with resolution, uniform and graded towards a
surface, an edge, a corner (the paper: O(n^3) becomes O(n^2))? And on a body: how many cells does
a mesh graded by its own error need for the accuracy of a uniform one of over 100 000 cells?
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from palpate.meshes.errors import InputError
from palpate.reference.availability import is_available
from palpate.validation.report.study_page import (
    Finding,
    StudyFigure,
    StudyTable,
    gravest,
    write_study_page,
)
from palpate.validation.results import Verdict
from palpate.validation.run_folder import MARK
from palpate.validation.studies import grading_push as push
from palpate.validation.studies.grading_growth import (
    EXPONENT_TOLERANCE,
    EXPONENTS,
    TARGETS,
    Growth,
    count_cells,
)

_CODES = {Verdict.PASSED: 0, Verdict.FAILED: 1, Verdict.INCONCLUSIVE: 3}
_ERRORS: dict[str, Callable[[push.Point], float]] = {
    "displacement": lambda p: p.displacement_error,
    "change of volume": lambda p: abs(p.volume_error),
}


def run(folder: Path, progress: Callable[[str], None], console: Console) -> int:
    """Count, solve, judge; leave report.html, two figures, two tables and results.json."""
    if not is_available():
        raise InputError("study grading needs FEniCSx for its truth; see the set-up in README")
    growths = []
    for target in TARGETS:
        progress(f"cells graded towards {target}")
        growths.append(count_cells(target))
    curves = push.follow(progress)
    findings = [*judge_growth(growths), *judge_push(curves)]
    tables = [growth_table(growths), push_table(curves)]
    for name, table in zip(("growth", "errors"), tables, strict=True):
        lines = [",".join(row) for row in (table.columns, *table.rows)]
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    figures = draw(growths, curves)
    for name, figure in zip(("growth", "errors"), figures, strict=True):
        (folder / f"{name}.svg").write_text(figure.svg, encoding="utf-8")
    write_study_page(
        folder / "report.html",
        title="Graded meshes (section V)",
        about=(__doc__ or "").split("\n\n")[1:],
        findings=findings,
        figures=figures,
        tables=tables,
    )
    document = {
        "study": "grading",
        "findings": [asdict(f) for f in findings],
        "growth": [{**asdict(g), "exponent": g.exponent} for g in growths],
        "push": asdict(curves),
    }
    (folder / MARK).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    for f in findings:
        console.print(f"{f.verdict}: {f.claim}: {f.found}", markup=False, soft_wrap=True)
    return _CODES[gravest(findings)]


def judge_growth(growths: Sequence[Growth]) -> list[Finding]:
    """The exponents of the paper against those counted."""
    findings = []
    for g in growths:
        expected = EXPONENTS.get(g.target)
        if expected is None:
            continue
        is_near = abs(g.exponent - expected) < EXPONENT_TOLERANCE
        findings.append(
            Finding(
                f"{g.target}: cells grow as n^{expected:g}, within {EXPONENT_TOLERANCE:g}",
                f"n^{g.exponent:.3f} over n = {', '.join(map(str, g.resolutions[-3:]))}",
                Verdict.PASSED if is_near else Verdict.FAILED,
            )
        )
    return findings


def judge_push(curves: push.PushCurves) -> list[Finding]:
    """Is the graded mesh, with a fifth of the cells, at least as near the truth?

    With u and g the two answers, t the truth as computed and t + d the truth:
    |u - t - d|^2 - |g - t - d|^2 = |u - t|^2 - |g - t|^2 - 2 (u - g) . d, and the last term is at
    most twice the gap between the two times the truth's bar.
    """
    pair = curves.pair
    gaps = {
        "displacement": (pair.displacement_gap, curves.displacement_bar),
        "change of volume": (pair.volume_gap, curves.volume_bar),
    }
    findings = []
    for name, error in _ERRORS.items():
        gap, bar = gaps[name]
        uniform, graded = error(pair.uniform), error(pair.graded)
        lead, doubt = uniform**2 - graded**2, 2.0 * gap * bar
        if lead > doubt:
            verdict = Verdict.PASSED
        else:
            verdict = Verdict.FAILED if lead < -doubt else Verdict.INCONCLUSIVE
        needed = push.cells_for_error(curves.families["graded"], error, uniform)
        findings.append(
            Finding(
                f"{name}: {pair.graded.cells} graded cells are as near the truth as "
                f"{pair.uniform.cells} uniform ones",
                f"error {100 * graded:.2f} % against {100 * uniform:.2f} % (truth +- "
                f"{100 * bar:.2f} %, answers {100 * gap:.2f} % apart); {needed:.0f} cells, "
                f"{pair.uniform.cells / needed:.1f} times fewer, would do",
                verdict,
            )
        )
    return findings


def growth_table(growths: Sequence[Growth]) -> StudyTable:
    """Cells by target and resolution."""
    n = growths[0].resolutions
    rows = [[g.target, *map(str, g.cells), f"{g.exponent:.3f}"] for g in growths]
    return StudyTable(
        "Cells of the unit cube", ["graded towards", *(f"n = {k}" for k in n), "exponent"], rows
    )


def push_table(curves: push.PushCurves) -> StudyTable:
    """Every mesh with its errors, critical time step and cost."""
    rows = [
        [
            kind,
            str(p.cells),
            f"{100 * p.displacement_error:.2f}",
            f"{100 * p.volume_error:+.2f}",
            f"{1e6 * p.critical_time_step:.2f}",
            f"{p.cost:.2e}",
        ]
        for kind, family in curves.families.items()
        for p in family
    ]
    columns = ["mesh", "cells", "displacement error [%]", "error of the volume change [%]",
               "critical step [us]", "cells x steps of a second"]  # fmt: skip
    return StudyTable("The kidney pushed on a patch", columns, rows)


def draw(growths: Sequence[Growth], curves: push.PushCurves) -> list[StudyFigure]:
    """Cells over resolution; errors over cells and over cost."""
    from matplotlib import pyplot

    from palpate.validation.report.plots import figure_svg

    figure, axes = pyplot.subplots(figsize=(6.4, 4.2))
    for g in growths:
        axes.loglog(g.resolutions, g.cells, "-o", ms=4, label=f"{g.target}: n^{g.exponent:.2f}")
    axes.set_xticks(growths[0].resolutions, [str(n) for n in growths[0].resolutions])
    axes.set_xlabel("n: cells along the side where they are smallest")
    axes.set_ylabel("cells")
    axes.legend(frameon=False, fontsize=8)
    axes.grid(color="#dddddd", lw=0.6)
    figure.tight_layout()
    growth = StudyFigure(
        figure_svg(figure),
        "Cells of the unit cube against resolution; exponents of the last three.",
    )
    figure, panels = pyplot.subplots(2, 2, figsize=(9.6, 7.4))
    colours = {"uniform": "#2f6f8f", "graded": "#b5332e"}
    bars = (curves.displacement_bar, curves.volume_bar)
    for row, ((name, error), bar) in enumerate(zip(_ERRORS.items(), bars, strict=True)):
        for column, label in enumerate(("cells", "cells x steps of a simulated second")):
            panel = panels[row][column]
            for kind, family in curves.families.items():
                x = [p.cells if column == 0 else p.cost for p in family]
                panel.loglog(
                    x,
                    [100 * error(p) for p in family],
                    "-o",
                    ms=3.5,
                    color=colours[kind],
                    label=kind,
                )
            panel.axhspan(1e-9, 100 * bar, color="#999999", alpha=0.25, lw=0)
            lowest = min(error(p) for family in curves.families.values() for p in family)
            panel.set_ylim(bottom=100 * min(lowest, bar) / 1.5)
            panel.set_xlabel(label)
            panel.set_ylabel(f"error of the {name} [%]")
            panel.grid(color="#dddddd", lw=0.6, which="both", alpha=0.6)
            if column == 0:
                for point in (curves.pair.uniform, curves.pair.graded):
                    panel.axvline(point.cells, color="black", lw=0.8, ls=":")
    panels[0][0].legend(frameon=False)
    figure.tight_layout()
    cells = ", ".join(map(str, curves.truth_cells))
    return [
        growth,
        StudyFigure(
            figure_svg(figure),
            "Error against the truth (P2 on graded meshes of "
            f"{cells} cells; grey: its error bar). Dotted: the two meshes compared. "
            "Right: smaller cells also mean shorter steps, so an explicit run gains less.",
        ),
    ]
