"""Linear and smoothed tetrahedra side by side: which is nearer the truth in the same time?

A soft bar, four times as long as wide, clamped at one end and bent by a traction on the other, at
four Poisson's ratios up to 0.499, on finer and finer meshes. The truth is the reference's quadratic
tetrahedra, from 0.49 on with pressure among the unknowns (linear tetrahedra lock there, and plain
quadratic ones begin to); the error is the relative L2 distance from it, read at its own points.

The time is processor time of fastsim's equilibrium, without start-up. Other simulators that are
installed stand on the same figure, timed by themselves.
"""

from __future__ import annotations

from typing import NamedTuple

from palpate.validation.report.study_page import Finding, Page
from palpate.validation.states import Progress
from palpate.validation.studies.elements.bar import (
    Bars,
    bars_table,
    draw_bars,
    follow_bars,
    judge_bars,
)
from palpate.validation.studies.study import Study


class Found(NamedTuple):
    """What was run."""

    bars: Bars


def compute(progress: Progress) -> Found:
    """Run everything.

    Raises:
        ReferenceFailedError: No FEniCSx, and so no truth.
    """
    return Found(follow_bars(progress))


def judge(found: Found) -> list[Finding]:
    """Limits near incompressibility, and the comparison at equal time."""
    return judge_bars(found.bars)


def present(found: Found) -> Page:
    """Error over processor time, and every run."""
    bars = found.bars
    changes = {f"{nu:g}": change for nu, change in bars.truth_changes.items()}
    return Page(
        figures={"bar": draw_bars(bars)},
        tables={"bar": bars_table(bars)},
        remarks=[
            *(f"Left out: {line}" for line in bars.left_out),
            "CalculiX runs with linear tetrahedra (C3D4): its quadratic C3D10 is not among the "
            "adapters.",
        ],
        numbers={"truth_changes": changes, "left_out": list(bars.left_out)},
    )


STUDY = Study("Linear and smoothed tetrahedra", __doc__, compute, judge, present)
