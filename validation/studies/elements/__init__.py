"""Linear and smoothed tetrahedra side by side: which is nearer the truth in the same time?

A soft bar, four times as long as wide, clamped at one end and bent by a traction on the other, at
four Poisson's ratios up to 0.499, on finer and finer meshes. The truth is the reference's quadratic
tetrahedra, from 0.49 on with pressure among the unknowns (linear tetrahedra lock there, and plain
quadratic ones begin to); the error is the relative L2 distance from it, read at its own points.

The time is processor time of fastsim's equilibrium, without start-up. Other simulators that are
installed stand on the same figure, timed by themselves.

Then frequencies: the lowest twenty of the bar, free and clamped, beside quadratic tetrahedra on the
same mesh, both with consistent mass. A free body has six zeros, and a spurious mode would be a
frequency far below the true one.

Then a mesh whose inner points are moved until its smallest dihedral angle is five degrees; and the
pressures of nodes, which may jump from node to node: how far they scatter about the averages of
cells, which are what is to be read.

Last, bars of few cells through the thickness, and cells longer than high: what `palpate check` says
of them before solving is a rule that is held against them here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from palpate.validation.report.study_page import Finding, Page
from palpate.validation.states import Progress
from palpate.validation.studies.elements.bar import (
    Bars,
    bars_table,
    draw_bars,
    follow_bars,
    judge_bars,
    levels_table,
)
from palpate.validation.studies.elements.meshes import (
    Distortion,
    Pressures,
    distortions_table,
    draw_pressures,
    follow_meshes,
    judge_distortions,
    pressures_table,
)
from palpate.validation.studies.elements.modes import (
    NO_SCIPY,
    Modes,
    draw_modes,
    follow_modes,
    judge_modes,
    modes_table,
)
from palpate.validation.studies.elements.thin import (
    Thin,
    draw_thin,
    follow_thin,
    judge_thin,
    thin_table,
)
from palpate.validation.studies.study import Study


class Found(NamedTuple):
    """What was run; no modes where scipy is missing."""

    bars: Bars
    modes: Sequence[Modes] = ()
    distortions: Sequence[Distortion] = ()
    pressures: Sequence[Pressures] = ()
    thin: Sequence[Thin] = ()


def compute(progress: Progress) -> Found:
    """Run everything.

    Raises:
        ReferenceFailedError: No FEniCSx, and so no truth.
    """
    bars = follow_bars(progress)
    thin = follow_thin(bars.truths, progress)
    return Found(bars, follow_modes(progress), *follow_meshes(bars.truths, progress), thin)


def judge(found: Found) -> list[Finding]:
    """Limits near incompressibility, equal errors and times, frequencies, slivers, thin bodies."""
    return [
        *judge_bars(found.bars),
        *judge_modes(found.modes),
        *judge_distortions(found.distortions),
        *judge_thin(found.thin),
    ]


def present(found: Found) -> Page:
    """Error over processor time, every run, frequencies, slivers and pressures."""
    bars, modes = found.bars, found.modes
    changes = {f"{nu:g}": change for nu, change in bars.truth_changes.items()}
    left_out = [*bars.left_out, *([] if modes else [NO_SCIPY])]
    figures = {"bar": draw_bars(bars)}
    tables = {"times": levels_table(bars), "bar": bars_table(bars)}
    if modes:
        figures["modes"] = draw_modes(modes)
        tables["modes"] = modes_table(modes)
    if found.distortions:
        tables["distorted"] = distortions_table(found.distortions)
    if found.pressures:
        figures["pressures"] = draw_pressures(found.pressures)
        tables["pressures"] = pressures_table(found.pressures)
    if found.thin:
        figures["thin"] = draw_thin(found.thin)
        tables["thin"] = thin_table(found.thin)
    return Page(
        figures=figures,
        tables=tables,
        remarks=[f"Left out: {line}" for line in left_out],
        numbers={"truth_changes": changes, "left_out": left_out},
    )


STUDY = Study("Linear and smoothed tetrahedra", __doc__, compute, judge, present)
