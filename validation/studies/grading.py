"""Section V: graded meshes. The same answer with how many of the cells?

Two questions. How does the number of cells grow with resolution, uniform and graded towards a
surface, an edge, a corner (the paper: O(n^3) becomes O(n^2))? And on a body: how many cells does
a mesh graded by its own error need for the accuracy of a uniform one of over 100 000 cells?
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from palpate.meshes.errors import InputError
from palpate.reference.availability import is_available
from palpate.validation.report.study_page import Finding, StudyFigure, StudyTable
from palpate.validation.states import Verdict
from palpate.validation.studies.grading_curves import Curves, Point, cells_for_error, follow
from palpate.validation.studies.grading_growth import (
    EXPONENT_TOLERANCE,
    EXPONENTS,
    TARGETS,
    Growth,
    count_cells,
)
from palpate.validation.studies.grading_hertz import hertz_scene
from palpate.validation.studies.grading_push import push_scene
from palpate.validation.studies.study_folder import leave_study


def run(folder: Path, progress: Callable[[str], None], console: Console) -> int:
    """Count, solve, judge; leave report.html, figures, tables and results.json."""
    if not is_available():
        raise InputError("study grading needs FEniCSx for its truth; see the set-up in README")
    growths = []
    for target in TARGETS:
        progress(f"cells graded towards {target}")
        growths.append(count_cells(target))
    scenes = {"push": push_scene(), "hertz": hertz_scene()}
    curves = {name: follow(scene, progress) for name, scene in scenes.items()}
    findings = judge_growth(growths)
    for found in curves.values():
        findings += judge_curves(found)
    names = ("growth", *curves)
    tables = [growth_table(growths), *map(curves_table, curves.values())]
    figures = [draw_growth(growths), *map(draw_curves, curves.values())]
    return leave_study(
        folder,
        console,
        name="grading",
        title="Graded meshes (section V)",
        about=(__doc__ or "").split("\n\n")[1:],
        findings=findings,
        figures=dict(zip(names, figures, strict=True)),
        tables=dict(zip(names, tables, strict=True)),
        numbers={
            "growth": [{**asdict(g), "exponent": g.exponent} for g in growths],
            **{name: asdict(found) for name, found in curves.items()},
        },
    )


def errors_of(curves: Curves) -> dict[str, Callable[[Point], float]]:
    """The two errors by name, absolute."""
    return {
        "displacement": lambda p: p.displacement_error,
        curves.quantity: lambda p: abs(p.quantity_error),
    }


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


def judge_curves(curves: Curves) -> list[Finding]:
    """Is the graded mesh, with a fifth of the cells, at least as near the truth?

    With u and g the two answers, t the truth as computed and t + d the truth:
    |u - t - d|^2 - |g - t - d|^2 = |u - t|^2 - |g - t|^2 - 2 (u - g) . d, and the last term is at
    most twice the gap between the two times the truth's bar.
    """
    pair = curves.pair
    gaps = {
        "displacement": (pair.displacement_gap, curves.displacement_bar),
        curves.quantity: (pair.quantity_gap, curves.quantity_bar),
    }
    findings = []
    for name, error in errors_of(curves).items():
        gap, bar = gaps[name]
        uniform, graded = error(pair.uniform), error(pair.graded)
        lead, doubt = uniform**2 - graded**2, 2.0 * gap * bar
        if lead > doubt:
            verdict = Verdict.PASSED
        else:
            verdict = Verdict.FAILED if lead < -doubt else Verdict.INCONCLUSIVE
        needed = cells_for_error(curves.families["graded"], error, uniform)
        findings.append(
            Finding(
                f"{curves.title}, {name}: {pair.graded.cells} graded cells are as near the truth "
                f"as {pair.uniform.cells} uniform ones",
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


def curves_table(curves: Curves) -> StudyTable:
    """Every mesh with its errors, critical time step and cost."""
    rows = [
        [
            kind,
            str(p.cells),
            f"{100 * p.displacement_error:.2f}",
            f"{100 * p.quantity_error:+.2f}",
            f"{1e6 * p.critical_time_step:.2f}",
            f"{p.cost:.2e}",
        ]
        for kind, family in curves.families.items()
        for p in family
    ]
    columns = ["mesh", "cells", "displacement error [%]", f"error of the {curves.quantity} [%]",
               "critical step [us]", "cells x steps of a second"]  # fmt: skip
    return StudyTable(curves.title[0].upper() + curves.title[1:], columns, rows)


def draw_growth(growths: Sequence[Growth]) -> StudyFigure:
    """Cells over resolution."""
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
    return StudyFigure(
        figure_svg(figure),
        "Cells of the unit cube against resolution; exponents of the last three.",
    )


def draw_curves(curves: Curves) -> StudyFigure:
    """Errors over cells and over cost."""
    from matplotlib import pyplot

    from palpate.validation.report.plots import figure_svg

    figure, panels = pyplot.subplots(2, 2, figsize=(9.6, 7.4))
    colours = {"uniform": "#2f6f8f", "graded": "#b5332e"}
    bars = (curves.displacement_bar, curves.quantity_bar)
    for row, ((name, error), bar) in enumerate(zip(errors_of(curves).items(), bars, strict=True)):
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
    return StudyFigure(
        figure_svg(figure),
        f"{curves.title[0].upper()}{curves.title[1:]}: error against the truth (P2 on graded "
        f"meshes of {cells} cells; grey: its error bar). Dotted: the two meshes compared. "
        "Right: smaller cells also mean shorter steps, so an explicit run gains less.",
    )
