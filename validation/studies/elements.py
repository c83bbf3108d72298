"""Linear and smoothed tetrahedra side by side: which is nearer the truth in the same time?

A soft bar, four times as long as wide, clamped at one end and bent by a traction on the other, at
four Poisson's ratios up to 0.499, on finer and finer meshes. The truth is the reference's quadratic
tetrahedra, from 0.49 on with pressure among the unknowns (linear tetrahedra lock there, and plain
quadratic ones begin to); the error is the relative L2 distance from it, read at its own points.

The time is processor time of fastsim's equilibrium, without start-up. Other simulators that are
installed stand on the same figure, timed by themselves.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import cycle, pairwise
from typing import NamedTuple

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, side, support_of
from palpate.meshes.problem import Element, Material, Problem, Strain
from palpate.reference.result import Formulation
from palpate.validation.references.field_truth import STVK, FieldTruth, time_fastsim
from palpate.validation.references.runs import solve_state
from palpate.validation.report.plots import (
    BLUE,
    BROWN,
    GREEN,
    GREY,
    OCHRE,
    PINK,
    PURPLE,
    RED,
    Figure,
    Line,
    Panel,
    line_figure,
)
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress, Verdict, gravest

TITLE = "Linear and smoothed tetrahedra"

WIDTH = 0.02  # m; four times as long
TRACTION = 60.0  # Pa: the tip sinks by a fifth of the length
RATIOS = (0.3, 0.45, 0.49, 0.499)
# From this Poisson's ratio on the truth has pressure among its unknowns.
NEARLY_INCOMPRESSIBLE = 0.49
# Cells an edge of the bar's section. The linear element, being cheaper, gets one mesh more, so
# that it has as much time; the truth is of degree 2, with its bar from a mesh half as fine.
DIVISIONS = {Element.LINEAR: (2, 4, 8, 12, 16), Element.SMOOTHED: (2, 3, 4, 6, 8, 12)}
# Of rivals with quadratic tetrahedra, which need fewer.
QUADRATIC_DIVISIONS = (1, 2, 3, 4, 6, 8)
TRUTH_DIVISIONS = 8
FEWEST_FOR_RIVALS = 4
# What a smoothed bar of so many cells an edge may be off, by Poisson's ratio.
LIMIT_DIVISIONS = 8
LIMITS = {0.49: 0.05, 0.499: 0.08}
# Of the table of times.
LEVELS = (0.1, 0.05, 0.02, 0.01)
# Number of errors at which two curves are compared, from the largest of LEVELS to the smallest.
_STEPS = 91
OURS = {Element.LINEAR: "fastsim, linear", Element.SMOOTHED: "fastsim, smoothed"}
_COLOURS = {Element.LINEAR: RED, Element.SMOOTHED: BLUE}

Solve = Callable[[Problem, Element], tuple[float, Points]]


class Run(NamedTuple):
    """One solver on one mesh.

    `seconds` is processor time of the solve; `error` the relative L2 distance from the truth.
    """

    poissons_ratio: float
    who: str
    law: str
    divisions: int
    num_cells: int
    seconds: float
    error: float


class Found(NamedTuple):
    """Every run.

    `truth_changes` says how far each truth moves when its mesh is halved, by Poisson's ratio;
    `left_out` which rivals were left out, and why.
    """

    runs: Sequence[Run]
    truth_changes: Mapping[float, float]
    left_out: Sequence[str] = ()

    def of(self, poissons_ratio: float, who: str) -> list[Run]:
        """One curve, from the coarsest mesh on."""
        return [r for r in self.runs if (r.poissons_ratio, r.who) == (poissons_ratio, who)]

    @property
    def curves(self) -> list[tuple[float, str]]:
        """Poisson's ratio and solver of every curve."""
        return list(dict.fromkeys((r.poissons_ratio, r.who) for r in self.runs))

    def rivals(self, poissons_ratio: float) -> list[str]:
        """Other simulators at a Poisson's ratio."""
        curves = self.curves
        return [who for nu, who in curves if nu == poissons_ratio and who not in OURS.values()]


def make_bar(
    divisions: int, poissons_ratio: float, *, ragged: float = 0.0, slenderness: int = 1
) -> Problem:
    """The bar with so many bricks across, and along so many that they are as slender as asked."""
    size = (4 * WIDTH, WIDTH, WIDTH)
    along = 4 * divisions // slenderness
    mesh = brick_box((along, divisions, divisions), size, ragged=ragged)
    load = Traction(side(mesh, 0, size[0]), (0.0, 0.0, -TRACTION))
    material = Material(2e4, poissons_ratio, 1000.0)
    return Problem(mesh, material, (support_of(side(mesh, 0, 0.0)),), (load,))


def solve_truth(problem: Problem, progress: Progress) -> FieldTruth:
    """Quadratic tetrahedra, with pressure among the unknowns where nearly incompressible."""
    is_mixed = problem.material.poissons_ratio >= NEARLY_INCOMPRESSIBLE
    form = Formulation.MIXED if is_mixed else Formulation.DISPLACEMENT
    state = solve_state(problem, Strain.GREEN, 2, progress, formulation=form)
    return FieldTruth(problem, state.displacement)


def follow_bars(
    progress: Progress,
    *,
    ratios: Sequence[float] = RATIOS,
    divisions: Mapping[Element, Sequence[int]] = DIVISIONS,
    truth_divisions: int = TRUTH_DIVISIONS,
    solve: Solve = time_fastsim,
) -> Found:
    """Every bar by both elements on their meshes, and by the rivals that are installed.

    The truth's mesh is an even number; `solve` is fastsim's statics with their time, or what is put
    to the test in their place.

    Raises:
        ReferenceFailedError: No FEniCSx, and so no truth.
    """
    # Other simulators are found by name: studies import nothing of them.
    run_installed = importlib.import_module("palpate.validation.peers.frontier").run_installed
    runs: list[Run] = []
    changes: dict[float, float] = {}
    left_out: list[str] = []

    def leave_out(line: str) -> None:
        if line not in left_out:
            left_out.append(line)
            progress(line)

    for nu in ratios:
        truth = solve_truth(make_bar(truth_divisions, nu), progress)
        half = solve_truth(make_bar(truth_divisions // 2, nu), progress)
        changes[nu] = truth.change_of(half)
        plain: dict[int, Points] = {}
        for element, meshes in divisions.items():
            for n in meshes:
                problem = make_bar(n, nu)
                cells = problem.mesh.num_cells
                progress(f"{OURS[element]}, nu = {nu:g}, {cells} cells")
                seconds, u = solve(problem, element)
                error = truth.error_of(problem.mesh, u)
                runs.append(Run(nu, OURS[element], STVK, n, cells, seconds, error))
                if element is Element.LINEAR:
                    plain[n] = u
        # Fewer are nobody's choice.
        rivals = {n: make_bar(n, nu) for n in plain if n >= FEWEST_FOR_RIVALS}
        quadratic = {n: make_bar(n, nu) for n in QUADRATIC_DIVISIONS if n <= max(plain)}
        size = {p.mesh.num_cells: n for n, p in (rivals | quadratic).items()}
        for row in run_installed(rivals, plain, truth, progress, leave_out, quadratic):
            who = f"{row.tool} {row.version}"
            n = size[row.num_cells]
            runs.append(Run(nu, who, row.law, n, row.num_cells, row.seconds, row.error))
    return Found(runs, changes, left_out)


def orders(runs: Sequence[Run]) -> list[float | None]:
    """Observed order in h of each run against the one before it; None for the first."""
    found: list[float | None] = [None]
    for a, b in pairwise(runs):
        found.append(math.log(a.error / b.error) / math.log(b.divisions / a.divisions))
    return found


def seconds_to(runs: Sequence[Run], level: float) -> float | None:
    """Time until the error is at most a level [s], between meshes by powers; None if never."""
    for k, run in enumerate(runs):
        if run.error <= level:
            if k == 0:
                return run.seconds
            before = runs[k - 1]
            part = math.log(before.error / level) / math.log(before.error / run.error)
            return float(before.seconds * (run.seconds / before.seconds) ** part)
    return None


def quickness(other: Sequence[Run], smoothed: Sequence[Run]) -> Mapping[float, float]:
    """How many times as long the other takes as smoothed tetrahedra, at errors from 10 to 1 %.

    Infinite where the other never gets there, 0 where smoothed ones do not; no level to which
    neither gets.
    """
    found = {}
    for level in map(float, np.geomspace(LEVELS[0], LEVELS[-1], _STEPS)):
        theirs, ours = (seconds_to(runs, level) for runs in (other, smoothed))
        if theirs is not None or ours is not None:
            found[level] = 0.0 if ours is None else math.inf if theirs is None else theirs / ours
    return found


def compute(progress: Progress) -> Found:
    """Run everything; raises ReferenceFailedError without FEniCSx, and so without a truth."""
    return follow_bars(progress)


def judge(found: Found) -> list[Finding]:
    """Limits near incompressibility, and who gets to the same error sooner."""
    findings = []
    for nu, change in found.truth_changes.items():
        smoothed = found.of(nu, OURS[Element.SMOOTHED])
        findings += [
            judged(
                f"nu = {nu:g}, {run.divisions} cells an edge: smoothed tetrahedra are within "
                f"{100 * LIMITS[nu]:g} % of the truth",
                f"{100 * run.error:.2f} %, the truth's own change on a halved mesh "
                f"{100 * change:.2f} %",
                run.error <= LIMITS[nu],
            )
            for run in smoothed
            if nu in LIMITS and run.divisions == LIMIT_DIVISIONS
        ]
        for who in (OURS[Element.LINEAR], *found.rivals(nu)):
            times = quickness(found.of(nu, who), smoothed)
            verdicts = [Verdict.PASSED if r > 1.0 else Verdict.FAILED for r in times.values()]
            findings.append(
                Finding(
                    f"nu = {nu:g}: smoothed tetrahedra are quicker than {who} at every error from "
                    f"{100 * LEVELS[0]:g} to {100 * LEVELS[-1]:g} %",
                    _quickness_in_words(times),
                    gravest(verdicts),
                )
            )
    return findings


def _quickness_in_words(times: Mapping[float, float]) -> str:
    """How many times as quick, where it is not so, and who never gets to which errors."""
    both = [ratio for ratio in times.values() if 0.0 < ratio < math.inf]
    parts = []
    if both:
        least, most = (f"{float(f'{r:.2g}'):g}" for r in (min(both), max(both)))
        parts.append(f"{least} to {most} times as quick")
    for words, of in (
        ("not quicker", [level for level, ratio in times.items() if 0.0 < ratio <= 1.0]),
        ("the other never gets to", [level for level, ratio in times.items() if ratio == math.inf]),
        ("they never get to", [level for level, ratio in times.items() if ratio == 0.0]),
    ):
        if of:
            parts.append(f"{words} {100 * max(of):.2g} to {100 * min(of):.2g} %")
    return "; ".join(parts) or "neither gets there"


def present(found: Found) -> Page:
    """Error over processor time, the time to an error, and every run."""
    ratio = {"Poisson's ratio": "g"}
    columns = {"solver": "", "law": "", "cells an edge": "d", "cells": "d", "seconds": ".3g"}
    every = [
        [*run, order]
        for curve in (found.of(*which) for which in found.curves)
        for run, order in zip(curve, orders(curve), strict=True)
    ]
    times = [
        (*which, *(seconds_to(found.of(*which), level) for level in LEVELS))
        for which in found.curves
    ]
    return Page(
        figures={"bar": _draw_bars(found)},
        tables={
            "times": Table(
                "Time to an error, between meshes by powers",
                ratio | {"solver": ""} | {f"seconds to {100 * v:g} %": ".3g" for v in LEVELS},
                times,
            ),
            "bar": Table(
                "Clamped bar, 4 x 1 x 1: every run",
                ratio | columns | {"error": ".4f", "order": ".2f"},
                every,
            ),
        },
        remarks=[f"Left out: {line}" for line in found.left_out],
        numbers={
            "truth_changes": {f"{nu:g}": change for nu, change in found.truth_changes.items()},
            "left_out": found.left_out,
        },
    )


def _draw_bars(found: Found) -> Figure:
    """A panel for each Poisson's ratio."""
    colours = {OURS[element]: colour for element, colour in _COLOURS.items()}
    others = dict.fromkeys(who for nu in found.truth_changes for who in found.rivals(nu))
    colours |= dict(zip(others, cycle((OCHRE, GREEN, PURPLE, GREY, PINK, BROWN)), strict=False))
    panels = []
    for nu, change in found.truth_changes.items():
        lines = []
        for who in (*OURS.values(), *found.rivals(nu)):
            curve = found.of(nu, who)
            is_same = curve[0].law == STVK
            lines.append(
                Line(
                    [run.seconds for run in curve],
                    [run.error for run in curve],
                    label=who if is_same else f"{who}, {curve[0].law}",
                    style="-o" if is_same else "--s",
                    colour=colours[who],
                    width=2.2 if who in OURS.values() else 1.2,
                )
            )
        panels.append(
            Panel(
                lines,
                title=f"Poisson's ratio {nu:g}",
                log="xy",
                levels=(change,),
                x="processor time of the solve [s]",
                y="relative L2 error",
            )
        )
    return line_figure(
        [panels[k : k + 2] for k in range(0, len(panels), 2)],
        "Lower left is better. The dotted line is the truth's own change when its mesh is "
        "halved: errors near it say nothing. Dashed lines: another material law.",
        shares_legend=True,
    )
