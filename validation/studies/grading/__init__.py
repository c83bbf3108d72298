"""Section V: graded meshes. The same answer with how many of the cells?

Two questions. How does the number of cells grow with resolution, uniform and graded towards a
surface, an edge, a corner (the paper: O(n^3) becomes O(n^2))? And on a body: how many cells does
a mesh graded by its own error need for the accuracy of a uniform one of over 100 000 cells?
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from palpate.meshes.errors import InputError
from palpate.reference.availability import is_available
from palpate.validation.report.plots import BLUE, RED, Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress, Verdict
from palpate.validation.studies.grading.curves import (
    Curves,
    cells_for_error,
    follow,
    hertz_scene,
    push_scene,
)
from palpate.validation.studies.grading.growth import (
    EXPONENT_TOLERANCE,
    EXPONENTS,
    TARGETS,
    Growth,
    count_cells,
)
from palpate.validation.studies.study import Study


class Found(NamedTuple):
    """Cells of the cube by target; errors against cells by scene."""

    growths: Sequence[Growth]
    curves: Mapping[str, Curves]


def compute(progress: Progress) -> Found:
    """Count and solve."""
    if not is_available():
        raise InputError("study grading needs FEniCSx for its truth; see the set-up in README")
    growths = []
    for target in TARGETS:
        progress(f"cells graded towards {target}")
        growths.append(count_cells(target))
    scenes = {"push": push_scene(), "hertz": hertz_scene()}
    return Found(growths, {name: follow(scene, progress) for name, scene in scenes.items()})


def judge(found: Found) -> list[Finding]:
    """The paper's exponents, and what grading saves on each body."""
    findings = judge_growth(found.growths)
    for curves in found.curves.values():
        findings += judge_curves(curves)
    return findings


def judge_growth(growths: Sequence[Growth]) -> list[Finding]:
    """The exponents of the paper against those counted."""
    return [
        judged(
            f"{g.target}: cells grow as n^{EXPONENTS[g.target]:g}, within {EXPONENT_TOLERANCE:g}",
            f"n^{g.exponent:.3f} over n = {', '.join(map(str, g.resolutions[-3:]))}",
            abs(g.exponent - EXPONENTS[g.target]) < EXPONENT_TOLERANCE,
        )
        for g in growths
        if g.target in EXPONENTS
    ]


def judge_curves(curves: Curves) -> list[Finding]:
    """Is the graded mesh, with a fifth of the cells, at least as near the truth?

    With u and g the two answers, t the truth as computed and t + d the truth:
    |u - t - d|^2 - |g - t - d|^2 = |u - t|^2 - |g - t|^2 - 2 (u - g) . d, and the last term is at
    most twice the gap between the two times the truth's bar.
    """
    one, other = curves.pair
    findings = []
    measured = zip(one.errors, other.errors, curves.gaps, curves.bars, strict=True)
    for k, (name, (uniform, graded, gap, bar)) in enumerate(
        zip(curves.names, measured, strict=True)
    ):
        lead, doubt = uniform**2 - graded**2, 2.0 * gap * bar
        if lead > doubt:
            verdict = Verdict.PASSED
        else:
            verdict = Verdict.FAILED if lead < -doubt else Verdict.INCONCLUSIVE
        family = curves.families["graded"]
        cells, errors = [p.cells for p in family], [p.errors[k] for p in family]
        needed = cells_for_error(cells, errors, uniform)
        findings.append(
            Finding(
                f"{curves.title}, {name}: {other.cells} graded cells are as near the truth "
                f"as {one.cells} uniform ones",
                f"error {100 * graded:.2f} % against {100 * uniform:.2f} % (truth +- "
                f"{100 * bar:.2f} %, answers {100 * gap:.2f} % apart); {needed:.0f} cells, "
                f"{one.cells / needed:.1f} times fewer, would do",
                verdict,
            )
        )
    return findings


def present(found: Found) -> Page:
    """Cells of the cube, and of each scene every mesh."""
    return Page(
        figures={
            "growth": draw_growth(found.growths),
            **{name: draw_curves(curves) for name, curves in found.curves.items()},
        },
        tables={
            "growth": growth_table(found.growths),
            **{name: curves_table(curves) for name, curves in found.curves.items()},
        },
        numbers={"bars": {name: curves.bars for name, curves in found.curves.items()}},
    )


def growth_table(growths: Sequence[Growth]) -> Table:
    """Cells by target and resolution."""
    columns = {"graded towards": "", **{f"n = {n}": "d" for n in growths[0].resolutions}}
    rows = [(g.target, *g.cells, g.exponent) for g in growths]
    return Table("Cells of the unit cube", {**columns, "exponent": ".3f"}, rows)


def curves_table(curves: Curves) -> Table:
    """Every mesh with its errors, critical time step and cost."""
    columns = {"mesh": "", "cells": "d", "displacement error [%]": ".2f"}
    columns |= {f"error of the {curves.quantity} [%]": "+.2f", "critical step [us]": ".2f"}
    rows = [
        (kind, p.cells, 100 * p.displacement_error, 100 * p.quantity_error,
         1e6 * p.critical_time_step, p.cost)
        for kind, family in curves.families.items()
        for p in family
    ]  # fmt: skip
    return Table(_heading(curves), {**columns, "cells x steps of a second": ".2e"}, rows)


def _heading(curves: Curves) -> str:
    return curves.title[0].upper() + curves.title[1:]


def draw_growth(growths: Sequence[Growth]) -> Figure:
    """Cells over resolution."""
    panel = Panel(
        [Line(g.resolutions, g.cells, label=f"{g.target}: n^{g.exponent:.2f}") for g in growths],
        x="n: cells along the side where they are smallest",
        y="cells",
        log="xy",
        ticks={n: str(n) for n in growths[0].resolutions},
    )
    caption = "Cells of the unit cube against resolution; exponents of the last three."
    return line_figure([[panel]], caption, shares_legend=False)


def draw_curves(curves: Curves) -> Figure:
    """Errors over cells and over cost."""
    rows = []
    for k, (name, bar) in enumerate(zip(curves.names, curves.bars, strict=True)):
        lowest = min(p.errors[k] for family in curves.families.values() for p in family)
        rows.append(
            [
                Panel(
                    [
                        Line(
                            [float(getattr(p, what)) for p in curves.families[kind]],
                            [100 * p.errors[k] for p in curves.families[kind]],
                            label=kind,
                            colour=colour,
                        )
                        for kind, colour in (("uniform", BLUE), ("graded", RED))
                    ],
                    x=words,
                    y=f"error of the {name} [%]",
                    log="xy",
                    band=(1e-9, 100 * bar),
                    places={p.cells: "" for p in curves.pair} if what == "cells" else {},
                    y_range=(100 * min(lowest, bar) / 1.5, None),
                )
                for what, words in (
                    ("cells", "cells"),
                    ("cost", "cells x steps of a simulated second"),
                )
            ]
        )
    return line_figure(
        rows,
        f"{_heading(curves)}: error against the truth (P2 on graded meshes of "
        f"{', '.join(map(str, curves.truth_cells))} cells; grey: its error bar). Dotted: the two "
        "meshes compared. Right: smaller cells also mean shorter steps, so an explicit run gains "
        "less.",
        shares_legend=True,
    )


STUDY = Study("Graded meshes (section V)", __doc__, compute, judge, present)
