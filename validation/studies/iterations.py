"""Eq. 10: the matrix as printed, K + P(a), beside Newton's tangent and dynamic relaxation.

K + P(a) is the secant matrix of R(a) = (K + P(a)) a, not its derivative, so eq. 9-10 as printed
are a fixed-point iteration: each step gains the same part of a digit, fewer the larger the
displacement, and in large bending none. P(a) is not unique. Here it is the symmetric one,
12 (K + P(a)) = 8 T(0) + 5 T(a) - T(-a) with T = dR/da, so that conjugate gradients apply as the
paper asks; the natural (B_L + B_NL)^T D (B_L + B_NL / 2) is not symmetric.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from palpate.fastsim.dynamic_relaxation import relax
from palpate.fastsim.errors import RelaxationFailedError
from palpate.fastsim.newton import Iteration, Newton
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.transforms import scale_loads
from palpate.validation.case import load_case
from palpate.validation.report.plots import BLUE, GREEN, RED, Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress
from palpate.validation.studies.study import Study

CASES = ("kidney", "beam")
FACTORS = (0.1, 0.25, 0.5, 1.0)
TOLERANCE = 1e-10
MOST_ITERATIONS = 80
RELAXATION = "relaxation"
# Iterations drawn: one that only swings to and fro has shown it by then.
_SHOWN = 55
# Equal to Newton's answer: both are solved to 1e-10.
AGREEMENT = 1e-8
_COLOURS = {Iteration.NEWTON: BLUE, Iteration.SECANT: RED, RELAXATION: GREEN}


@dataclass(frozen=True)
class Curve:
    """One iteration on one problem: relative residuals at `counts` iterations or explicit steps.

    `cpu_seconds` are of the whole curve; `difference` is the relative L2 distance from Newton's
    answer, None where there is no answer; `end` says why it ended.
    """

    case: str
    load_factor: float
    method: str
    counts: tuple[int, ...]
    residuals: tuple[float, ...]
    cpu_seconds: float
    converged: bool
    difference: float | None
    end: str

    @property
    def contraction(self) -> float:
        """Mean factor of the residual over the last five iterations [-]."""
        last = self.residuals[-6:]
        return float((last[-1] / last[0]) ** (1.0 / (len(last) - 1))) if len(last) > 1 else 1.0


def compute(progress: Progress) -> list[Curve]:
    """Follow every iteration."""
    curves: list[Curve] = []
    for name in CASES:
        for factor in FACTORS:
            progress(f"{name}, {factor:g} of the load")
            curves += follow(name, load_case(name).problem, factor)
    return curves


def follow(name: str, problem: Problem, factor: float) -> list[Curve]:
    """Newton, the secant iteration as printed, and at the full load dynamic relaxation."""
    given = scale_loads(problem, factor)
    exact: Points | None = None
    curves = []
    for method in (Iteration.NEWTON, Iteration.SECANT, *([RELAXATION] if factor == 1.0 else [])):
        start = time.process_time()
        found, history, end = _relax(given) if method == RELAXATION else _iterate(given, method)
        seconds = time.process_time() - start
        exact = found if method == Iteration.NEWTON else exact
        difference = None
        if found is not None and exact is not None:
            difference = float(np.linalg.norm(found - exact) / np.linalg.norm(exact))
        counts, residuals = zip((0, 1.0), *history, strict=True)
        curves.append(
            Curve(name, factor, str(method), counts, residuals, seconds, found is not None,
                  difference, end)
        )  # fmt: skip
    return curves


# An answer or None, (count, relative residual) on the way, and why it ended.
_Way = tuple[Points | None, Sequence[tuple[int, float]], str]


def _iterate(problem: Problem, method: str) -> _Way:
    # Eq. 9-10 as printed have no line search: neither has the secant iteration here.
    guarded = method == Iteration.NEWTON
    solver = Newton(
        problem, Strain.GREEN, TOLERANCE, MOST_ITERATIONS, Iteration(method), is_guarded=guarded
    )
    outcome = solver.solve(np.zeros_like(problem.mesh.points), 1.0)
    history = [r for r in outcome.history if math.isfinite(r)]
    return outcome.displacement, list(enumerate(history, 1)), outcome.reason or "converged"


def _relax(problem: Problem) -> _Way:
    try:
        result = relax(problem, relative_tolerance=TOLERANCE)
    except RelaxationFailedError as error:
        return None, (), error.reason
    return result.displacement, result.history, "converged"


def judge(curves: Sequence[Curve]) -> list[Finding]:
    """Newton and relaxation answer, and nobody gives two answers; as printed it may fail."""
    lost, apart = [], []
    for c in curves:
        place = f"{c.case} at {c.load_factor:g} of the load: {c.method}"
        if not c.converged and c.method != Iteration.SECANT:
            lost.append(f"{place} did not converge ({c.end})")
        if c.converged and not (c.difference is not None and c.difference <= AGREEMENT):
            apart.append(f"{place} is {c.difference} from Newton's answer")
    return [
        judged("Newton's method and relaxation converge at every load", *_told(lost)),
        judged(f"whoever converges finds Newton's answer, within {AGREEMENT:g}", *_told(apart)),
    ]


def _told(faults: Sequence[str]) -> tuple[str, bool]:
    return "; ".join(faults) or "all of them", not faults


def present(curves: Sequence[Curve]) -> Page:
    """Residuals over iterations and over time, how each curve ended, and every residual."""
    ends = Table(
        "How each iteration ended",
        {"case": "", "load": "g", "method": "", "count": "d", "residual": ".1e",
         "per count": ".3g", "cpu [s]": ".3f", "end": ""},
        [
            (c.case, c.load_factor, c.method, c.counts[-1], c.residuals[-1], c.contraction,
             c.cpu_seconds, c.end)
            for c in curves
        ],
    )  # fmt: skip
    every = Table(
        "Every residual",
        {"case": "", "load_factor": "g", "method": "", "count": "d", "relative_residual": ".6e"},
        [
            (c.case, c.load_factor, c.method, count, residual)
            for c in curves
            for count, residual in zip(c.counts, c.residuals, strict=True)
        ],
        is_shown=False,
    )
    return Page(figures={"iterations": draw(curves)}, tables={"ends": ends, "iterations": every})


def draw(curves: Sequence[Curve]) -> Figure:
    """Above: residual over iterations at each load; below: over CPU time at the full load."""
    shades = dict(zip(FACTORS, (0.35, 0.5, 0.7, 1.0), strict=True))

    def lines(c: Curve, x: Sequence[float], label: str = "", shade: float = 1.0) -> list[Line]:
        colour = _COLOURS[c.method]
        found = [Line(x, c.residuals[-len(x) :], label=label, colour=colour, alpha=shade)]
        if not c.converged:
            found.append(Line(x[-1:], c.residuals[-1:], style="x", colour=colour))
        return found

    above, below = [], []
    for case in dict.fromkeys(c.case for c in curves):
        mine = [c for c in curves if c.case == case]
        iterated = [c for c in mine if c.method != RELAXATION]
        shown = [(min(c.counts[-1], _SHOWN), c) for c in iterated]
        above.append(
            Panel(
                [*chain(*(lines(c, c.counts, "", shades[c.load_factor]) for c in iterated))],
                notes=[
                    (n, c.residuals[n], f"{c.load_factor:g}")
                    for n, c in shown
                    if c.method == Iteration.SECANT
                ],
                title=f"{case}: Newton blue, eq. 10 as printed red; part of the load",
                x="iterations", y="relative residual", log="y", levels=(TOLERANCE,),
                x_range=(-1, 1.08 * max(n for n, _ in shown)),
            )
        )  # fmt: skip
        whole = [c for c in mine if c.load_factor == 1.0]
        timed = []
        for c in whole:
            unit = "steps" if c.method == RELAXATION else "iterations"
            times = [1e3 * c.cpu_seconds * n / max(c.counts[-1], 1) for n in c.counts[1:]]
            timed += lines(c, times, f"{c.method}, {c.counts[-1]} {unit}")
        below.append(
            Panel(
                timed, title=f"{case}, full load", levels=(TOLERANCE,), log="xy",
                x="CPU time [ms], one thread, evenly spread", y="relative residual",
            )
        )  # fmt: skip
    return line_figure(
        [above, below],
        "A cross marks an iteration that ended without an answer; the dotted line is the "
        f"tolerance, {TOLERANCE:g}.",
        shares_legend=False,
    )


STUDY = Study("Eq. 10 as printed, and Newton's method", __doc__, compute, judge, present)
