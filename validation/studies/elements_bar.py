"""Error of both elements, and of rivals, against time, on a clamped bar bent by its end."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import cycle, groupby, pairwise
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, held, side
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
from palpate.validation.report.study_page import Finding, Table, judged
from palpate.validation.states import Progress, Verdict, gravest

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
# Errors at which two curves are compared, from the largest of them to the smallest.
_STEPS = 91
OURS = {Element.LINEAR: "fastsim, linear", Element.SMOOTHED: "fastsim, smoothed"}


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


class Bars(NamedTuple):
    """Every run; how far each truth moves when its mesh is halved; what was left out and why.

    `truths` are by Poisson's ratio, too.
    """

    runs: Sequence[Run]
    truth_changes: Mapping[float, float]
    left_out: Sequence[str]
    truths: Mapping[float, FieldTruth] = MappingProxyType({})

    def of(self, poissons_ratio: float, who: str) -> list[Run]:
        """One curve, from the coarsest mesh on."""
        return [r for r in self.runs if (r.poissons_ratio, r.who) == (poissons_ratio, who)]


Solve = Callable[[Problem, Element], tuple[float, Points]]


def make_bar(
    divisions: int, poissons_ratio: float, *, ragged: float = 0.0, slenderness: int = 1
) -> Problem:
    """The bar with so many bricks across, and along so many that they are as slender as asked."""
    size = (4 * WIDTH, WIDTH, WIDTH)
    along = 4 * divisions // slenderness
    mesh = brick_box((along, divisions, divisions), size, ragged=ragged)
    load = Traction(side(mesh, 0, size[0]), (0.0, 0.0, -TRACTION))
    material = Material(2e4, poissons_ratio, 1000.0)
    return Problem(mesh, material, (held(side(mesh, 0, 0.0)),), (load,))


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
) -> Bars:
    """Every bar by both elements and by the rivals that are installed.

    Args:
        progress: Called before what takes long.
        ratios: Poisson's ratios.
        divisions: Meshes of each element.
        truth_divisions: Mesh of the truth, an even number.
        solve: fastsim's statics with their time, or what is put to the test in their place.

    Raises:
        ReferenceFailedError: No FEniCSx, and so no truth.
    """
    # Other simulators are found by name: studies import nothing of them.
    run_installed = importlib.import_module("palpate.validation.peers.frontier").run_installed
    runs: list[Run] = []
    changes: dict[float, float] = {}
    truths: dict[float, FieldTruth] = {}
    left_out: list[str] = []

    def leave_out(line: str) -> None:
        if line not in left_out:
            left_out.append(line)
            progress(line)

    for nu in ratios:
        truth = truths[nu] = solve_truth(make_bar(truth_divisions, nu), progress)
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
    return Bars(runs, changes, left_out, truths)


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


def judge_bars(bars: Bars) -> list[Finding]:
    """Limits near incompressibility, and who gets to the same error sooner."""
    findings = []
    for nu in bars.truth_changes:
        smoothed = bars.of(nu, OURS[Element.SMOOTHED])
        for run in smoothed:
            if nu in LIMITS and run.divisions == LIMIT_DIVISIONS:
                findings.append(
                    judged(
                        f"nu = {nu:g}, {run.divisions} cells an edge: smoothed tetrahedra are "
                        f"within {100 * LIMITS[nu]:g} % of the truth",
                        f"{100 * run.error:.2f} %, the truth's own change on a halved mesh "
                        f"{100 * bars.truth_changes[nu]:.2f} %",
                        run.error <= LIMITS[nu],
                    )
                )
        findings += [
            _at_equal_error(nu, who, bars.of(nu, who), smoothed)
            for who in (OURS[Element.LINEAR], *_rivals(bars, nu))
        ]
    return findings


def _rivals(bars: Bars, poissons_ratio: float) -> list[str]:
    there = (r.who for r in bars.runs if r.poissons_ratio == poissons_ratio)
    return [who for who in dict.fromkeys(there) if who not in OURS.values()]


def _at_equal_error(nu: float, who: str, other: Sequence[Run], smoothed: Sequence[Run]) -> Finding:
    """At every error that anybody asks for, and where it is not so."""
    times = quickness(other, smoothed)
    return Finding(
        f"nu = {nu:g}: smoothed tetrahedra are quicker than {who} at every error from "
        f"{100 * LEVELS[0]:g} to {100 * LEVELS[-1]:g} %",
        _in_words(times) if times else "neither gets there",
        gravest([Verdict.PASSED if ratio > 1.0 else Verdict.FAILED for ratio in times.values()]),
    )


def _in_words(times: Mapping[float, float]) -> str:
    """Ratios in words, stretch by stretch of who is quicker."""
    words = []
    for is_quicker, stretch in groupby(times.items(), key=lambda item: item[1] > 1.0):
        levels, ratios = zip(*stretch, strict=True)
        where = f"{100 * levels[0]:.2g} to {100 * levels[-1]:.2g} %"
        known = [ratio for ratio in ratios if math.isfinite(ratio) and ratio > 0.0]
        if not is_quicker:
            shown = [1.0 / ratio for ratio in known]
            word = "slower" if shown else "never there"
        else:
            shown, word = known, "as quick" if known else "the other is never there"
        if shown:
            word = f"{_plainly(min(shown))} to {_plainly(max(shown))} times {word}"
        missing = len(ratios) - len(known)
        if known and missing:
            last = "the other never gets" if is_quicker else "they never get"
            word += f", and below {100 * levels[len(known) - 1]:.2g} % {last} there"
        words.append(f"{where}: {word}")
    return "; ".join(words)


def _plainly(ratio: float) -> str:
    """Two digits, without a power of ten."""
    return f"{float(f'{ratio:.2g}'):g}"


def levels_table(bars: Bars) -> Table:
    """Seconds until each level; nothing where it is not reached."""
    columns = {"Poisson's ratio": "g", "solver": ""}
    columns |= {f"seconds to {100 * level:g} %": ".3g" for level in LEVELS}
    curves = dict.fromkeys((r.poissons_ratio, r.who) for r in bars.runs)
    rows = [
        (nu, who, *(seconds_to(bars.of(nu, who), level) for level in LEVELS)) for nu, who in curves
    ]
    return Table("Time to an error, between meshes by powers", columns, rows)


def bars_table(bars: Bars) -> Table:
    """Every run, with the observed order in h."""
    columns = {"Poisson's ratio": "g", "solver": "", "law": "", "cells an edge": "d"}
    columns |= {"cells": "d", "seconds": ".3g", "error": ".4f", "order": ".2f"}
    rows = []
    for nu, who in dict.fromkeys((r.poissons_ratio, r.who) for r in bars.runs):
        curve = bars.of(nu, who)
        rows += [[*run, order] for run, order in zip(curve, orders(curve), strict=True)]
    return Table("Clamped bar, 4 x 1 x 1: every run", columns, rows)


def draw_bars(bars: Bars) -> Figure:
    """A panel for each Poisson's ratio."""
    colours = {OURS[Element.LINEAR]: RED, OURS[Element.SMOOTHED]: BLUE}
    others = dict.fromkeys(who for nu in bars.truth_changes for who in _rivals(bars, nu))
    colours |= dict(zip(others, cycle((OCHRE, GREEN, PURPLE, GREY, PINK, BROWN)), strict=False))
    panels = []
    for nu, change in bars.truth_changes.items():
        lines = []
        for who in (*OURS.values(), *_rivals(bars, nu)):
            curve = bars.of(nu, who)
            is_ours, is_same = who in OURS.values(), curve[0].law == STVK
            lines.append(
                Line(
                    [run.seconds for run in curve],
                    [run.error for run in curve],
                    label=who if is_same else f"{who}, {curve[0].law}",
                    style="-o" if is_same else "--s",
                    colour=colours[who],
                    width=2.2 if is_ours else 1.2,
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
