"""Do the truth's error bars keep their word?

Each problem has an answer that is known ten times better than the bar: a closed form, a series, one
or two dimensions solved far better, a manufactured field, or, of slender bars alone, cubic
tetrahedra on meshes graded much further. The truth is found as for a case, stored (adaptive meshes;
of motions three time steps and three meshes) and live (on the spot), and each of its numbers is
held against the answer. A bar covers where it is at least the error. Infinite bars cover nothing
and count as the widest.

Factors and estimators may be chosen by half of the problems. The other half was set apart by the
hash of their names before any factor was chosen; the claims here are of that half alone, and each
run on it is written down in held_out.toml.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.validation.report.plots import Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress
from palpate.validation.studies.calibration.drawn import Drawn, draw_problems
from palpate.validation.studies.calibration.measured import (
    WAYS,
    Number,
    hold_all,
    summarise,
)
from palpate.validation.studies.kept import kept_folder
from palpate.validation.studies.study import Study

LEAST_COVERED, LARGEST_MISS, LARGEST_WIDTH = 0.95, 1.5, 5.0
LOG = Path(__file__).with_name("held_out.toml")


class Found(NamedTuple):
    """Every number, the problems that were run, and the processor time it took [s].

    Numbers that were kept from a run before take none.
    """

    numbers: tuple[Number, ...]
    problems: tuple[Drawn, ...]
    processor_time: float = 0.0


def compute(progress: Progress) -> Found:
    """All problems, stored and live, two at once; what a run before found is kept."""
    problems, begun = draw_problems(), _processor_time()
    jobs = min(2, os.cpu_count() or 1)
    numbers = hold_all(problems, progress, kept=kept_folder("calibration"), jobs=jobs)
    return Found(tuple(numbers), tuple(problems), _processor_time() - begun)


def _processor_time() -> float:
    """Of this process and of its children that have ended [s]."""
    return sum(os.times()[:4])


def judge(found: Found) -> list[Finding]:
    """The three numbers, stored and live, of the half that was set apart."""
    findings = []
    for way in WAYS:
        of = [n for n in found.numbers if n.way == way and n.is_apart]
        s = summarise(of)
        said = f"{s.numbers} numbers, {s.infinite} without a bar, {s.unknown} left out"
        findings += [
            judged(
                f"{way}: bars cover at least {100 * LEAST_COVERED:.0f} % of the numbers",
                f"{100 * s.covered:.1f} % ({said})",
                s.covered >= LEAST_COVERED,
            ),
            judged(
                f"{way}: no error above {LARGEST_MISS:g} times its bar",
                f"at most {s.worst:.2f} times",
                s.worst <= LARGEST_MISS,
            ),
            judged(
                f"{way}: half of the bars are at most {LARGEST_WIDTH:g} times the error",
                f"median {s.width:.1f}",
                s.width <= LARGEST_WIDTH,
            ),
        ]
    return findings


def present(found: Found) -> Page:
    """Bar against error, coverage and sharpness by family, every number, and the log."""
    rows = [
        (family, way, half, *summarise(of))
        for way in WAYS
        for half, is_apart in (("set apart", True), ("open", False))
        for family in (*dict.fromkeys(n.family for n in found.numbers), "all")
        if (
            of := [
                n
                for n in found.numbers
                if n.way == way and n.is_apart == is_apart and family in (n.family, "all")
            ]
        )
    ]
    columns = {"family": "", "truth": "", "half": "", "numbers": "d", "covered": ".3f"}
    columns |= {"worst error / bar": ".2f", "median bar / error": ".1f"}
    columns |= {"without a bar": "d", "left out": "d"}
    every = {"problem": "", "family": "", "set apart": "", "truth": "", "metric": ""}
    every |= {"bar": ".2g", "error": ".2g", "answer known to": ".1g"}
    runs = tomllib.loads(LOG.read_text("utf-8")).get("run", [])
    return Page(
        figures={"calibration": draw(found.numbers)},
        tables={
            "families": Table("By family", columns, rows),
            "runs": Table(
                "Runs on the half that is set apart",
                {"date": "", "version": "", "generation": "d", "truth": "", "families": ""}
                | {"numbers": "d", "covered": ".3f", "worst": ".2f", "width": ".1f"},
                [_of_run(run) for run in runs],
            ),
            "numbers": Table(
                "Every number",
                every,
                [(n[0], n[1], "yes" if n.is_apart else "no", *n[3:]) for n in found.numbers],
                is_shown=False,
            ),
        },
        remarks=[
            "A run on the half that is set apart belongs into held_out.toml.",
            f"Processor time: {found.processor_time / 60.0:.0f} minutes; what was kept took none.",
        ],
        numbers={
            "problems": [problem.name for problem in found.problems],
            "processor_time": found.processor_time,
        },
    )


def _of_run(run: dict[str, Any]) -> tuple[Any, ...]:
    keys = ("version", "generation", "truth", "families", "numbers", "covered", "worst", "width")
    return (str(run["date"]), *(run[key] for key in keys))


def draw(numbers: Sequence[Number]) -> Figure:
    """Error over bar, a panel for each way: what lies above the line is not covered."""
    panels = []
    for way in WAYS:
        of = [n for n in numbers if n.way == way and n.is_known and np.isfinite(n.bar)]
        ends = [1e-6, 1.0]
        lines = [Line(ends, ends, style="-", colour="black", width=0.8)]
        for family in dict.fromkeys(n.family for n in of):
            points = [n for n in of if n.family == family]
            bars = [n.bar for n in points]
            lines.append(Line(bars, [max(n.error, 1e-9) for n in points], style="o", label=family))
        panels.append(Panel(lines, log="xy", title=way, x="error bar [-]", y="true error [-]"))
    return line_figure(
        [panels],
        "Below the line a bar covers; as far below it as the bar is too wide.",
        shares_legend=True,
    )


STUDY = Study("Error bars against known answers", __doc__, compute, judge, present)
