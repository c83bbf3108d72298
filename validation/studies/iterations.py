"""Eq. 10: the matrix as printed, K + P(a), beside Newton's tangent and dynamic relaxation.

K + P(a) is the secant matrix of R(a) = (K + P(a)) a, not its derivative, so eq. 9-10 as printed
are a fixed-point iteration: each step gains the same part of a digit, fewer the larger the
displacement, and in large bending none. P(a) is not unique. Here it is the symmetric one,
12 (K + P(a)) = 8 T(0) + 5 T(a) - T(-a) with T = dR/da, so that conjugate gradients apply as the
paper asks; the natural (B_L + B_NL)^T D (B_L + B_NL / 2) is not symmetric.
"""

from __future__ import annotations

import html
import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

from palpate.fastsim.dynamic_relaxation import relax
from palpate.fastsim.errors import RelaxationFailedError
from palpate.fastsim.newton import Iteration, Newton
from palpate.meshes.problem import Problem, Strain
from palpate.validation.case import load_case
from palpate.validation.quoting import csv_text
from palpate.validation.run_folder import RESULTS
from palpate.validation.studies.beam import scaled

CASES = ("kidney", "beam")
FACTORS = (0.1, 0.25, 0.5, 1.0)
TOLERANCE = 1e-10
MOST_ITERATIONS = 80
# Iterations drawn: one that only swings to and fro has shown it by then.
_SHOWN = 55
# Equal to Newton's answer: both are solved to 1e-10.
AGREEMENT = 1e-8


@dataclass(frozen=True)
class Curve:
    """One iteration on one problem.

    Attributes:
        case: Built-in case.
        load_factor: Part of its load, 0 to 1.
        method: "newton", "secant" or "relaxation".
        counts: Iterations, or explicit steps, from 0.
        residuals: Relative residual at each [-].
        cpu_seconds: Of the whole curve.
        converged: Whether the tolerance was reached.
        contraction: Mean factor of the residual over the last five iterations [-].
        difference: Relative L2 distance from Newton's answer [-]; None where there is no answer.
        end: Why it ended.
    """

    case: str
    load_factor: float
    method: str
    counts: tuple[int, ...]
    residuals: tuple[float, ...]
    cpu_seconds: float
    converged: bool
    contraction: float
    difference: float | None
    end: str


def run(folder: Path, progress: Callable[[str], None], console: Console) -> int:
    """Follow every iteration; leave report.html, iterations.svg, iterations.csv, results.json."""
    curves: list[Curve] = []
    for name in CASES:
        for factor in FACTORS:
            progress(f"{name}, {factor:g} of the load")
            curves += follow(name, load_case(name).problem, factor)
    columns = ("case", "load_factor", "method", "count", "relative_residual")
    rows = [
        (c.case, f"{c.load_factor:g}", c.method, count, f"{residual:.6e}")
        for c in curves
        for count, residual in zip(c.counts, c.residuals, strict=True)
    ]
    svg = curves_svg(curves)
    (folder / "iterations.csv").write_text(csv_text(columns, rows), encoding="utf-8")
    (folder / "iterations.svg").write_text(svg, encoding="utf-8")
    (folder / "report.html").write_text(page(curves, svg), encoding="utf-8")
    faults = find_faults(curves)
    text = json.dumps(
        {"study": "iterations", "faults": faults, "curves": [_plain(c) for c in curves]}, indent=1
    )
    (folder / RESULTS).write_text(text + "\n", encoding="utf-8")
    for row in [_COLUMNS, *map(_row, curves)]:
        line = "  ".join(f"{cell:>{w}}" for cell, w in zip(row, _WIDTHS, strict=True))
        console.print(line, markup=False, soft_wrap=True)
    for fault in faults:
        console.print(f"FAILED: {fault}", markup=False, soft_wrap=True)
    return 1 if faults else 0


def follow(name: str, problem: Problem, factor: float) -> list[Curve]:
    """Newton, the secant iteration as printed, and at the full load dynamic relaxation."""
    given = scaled(problem, factor)
    newton, answer = _iterate(name, given, factor, Iteration.NEWTON, None)
    curves = [newton, _iterate(name, given, factor, Iteration.SECANT, answer)[0]]
    if factor == 1.0:
        curves.append(_relax(name, given, answer))
    return curves


def find_faults(curves: Sequence[Curve]) -> list[str]:
    """What would contradict the study: no answer from Newton or relaxation, or two answers."""
    faults = []
    for c in curves:
        place = f"{c.case} at {c.load_factor:g} of the load: {c.method}"
        if not c.converged and c.method != "secant":
            faults.append(f"{place} did not converge ({c.end})")
        if c.converged and not (c.difference is not None and c.difference <= AGREEMENT):
            faults.append(f"{place} is {c.difference} from Newton's answer")
    return faults


def _iterate(
    name: str,
    problem: Problem,
    factor: float,
    iteration: Iteration,
    answer: np.ndarray[tuple[int, ...], np.dtype[np.float64]] | None,
) -> tuple[Curve, np.ndarray[tuple[int, ...], np.dtype[np.float64]] | None]:
    # Eq. 9-10 as printed have no line search: neither has the secant iteration here.
    guarded = iteration is Iteration.NEWTON
    solver = Newton(
        problem, Strain.GREEN, TOLERANCE, MOST_ITERATIONS, iteration, is_guarded=guarded
    )
    start = time.process_time()
    outcome = solver.solve(np.zeros_like(problem.mesh.points), 1.0)
    seconds = time.process_time() - start
    found = outcome.displacement
    reference = found if iteration is Iteration.NEWTON else answer
    residuals = (1.0, *(r for r in outcome.history if math.isfinite(r)))
    difference = None
    if found is not None and reference is not None:
        difference = float(np.linalg.norm(found - reference) / np.linalg.norm(reference))
    curve = Curve(
        case=name,
        load_factor=factor,
        method=iteration.value,
        counts=tuple(range(len(residuals))),
        residuals=residuals,
        cpu_seconds=seconds,
        converged=found is not None,
        contraction=_contraction(residuals),
        difference=difference,
        end=outcome.reason or "converged",
    )
    return curve, found


def _relax(
    name: str,
    problem: Problem,
    answer: np.ndarray[tuple[int, ...], np.dtype[np.float64]] | None,
) -> Curve:
    start = time.process_time()
    history: tuple[tuple[int, float], ...] = ()
    difference, end = None, "converged"
    try:
        result = relax(problem, relative_tolerance=TOLERANCE)
    except RelaxationFailedError as error:
        end = error.reason
    else:
        history = result.history
        if answer is not None:
            error_norm = np.linalg.norm(result.displacement - answer)
            difference = float(error_norm / np.linalg.norm(answer))
    residuals = (1.0, *(r for _, r in history))
    return Curve(
        case=name,
        load_factor=1.0,
        method="relaxation",
        counts=(0, *(n for n, _ in history)),
        residuals=residuals,
        cpu_seconds=time.process_time() - start,
        converged=bool(history),
        contraction=_contraction(residuals),
        difference=difference,
        end=end,
    )


def _contraction(residuals: Sequence[float]) -> float:
    last = residuals[-6:]
    return (last[-1] / last[0]) ** (1.0 / (len(last) - 1)) if len(last) > 1 else 1.0


def _plain(curve: Curve) -> dict[str, object]:
    return asdict(curve)


_COLUMNS = ("case", "load", "method", "count", "residual", "per count", "cpu [s]", "end")
_WIDTHS = (7, 5, 10, 6, 9, 9, 8, 0)


def _row(curve: Curve) -> tuple[str, ...]:
    return (
        curve.case,
        f"{curve.load_factor:g}",
        curve.method,
        str(curve.counts[-1]),
        f"{curve.residuals[-1]:.1e}",
        f"{curve.contraction:.3g}",
        f"{curve.cpu_seconds:.3f}",
        curve.end,
    )


def curves_svg(curves: Sequence[Curve]) -> str:
    """Above: residual over iterations at each load; below: over CPU time at the full load."""
    from matplotlib import pyplot

    from palpate.validation.report.plots import figure_svg

    shades = dict(zip(FACTORS, (0.35, 0.5, 0.7, 1.0), strict=True))
    colours = {"newton": "#2f6f8f", "secant": "#b5332e", "relaxation": "#2f8f4e"}
    figure, panels = pyplot.subplots(2, len(CASES), figsize=(10.0, 7.2), squeeze=False)
    for column, case in enumerate(CASES):
        above, below = panels[0][column], panels[1][column]
        for c in (c for c in curves if c.case == case and c.method != "relaxation"):
            colour, shade = colours[c.method], shades[c.load_factor]
            above.semilogy(c.counts, c.residuals, "-o", ms=2.5, lw=1.2, color=colour, alpha=shade)
            if not c.converged:
                above.semilogy(c.counts[-1], c.residuals[-1], "x", ms=8, color=colour)
            if c.method == "secant":
                shown = min(c.counts[-1], _SHOWN)
                place = (shown, c.residuals[shown])
                above.annotate(
                    f"{c.load_factor:g}", place, (5, 5), textcoords="offset points", color=colour
                )
        above.set_xlim(-1, 1.08 * min(_SHOWN, above.dataLim.x1))
        above.set_title(f"{case}: Newton blue, eq. 10 as printed red; part of the load", fontsize=9)
        above.set_xlabel("iterations")
        for c in (c for c in curves if c.case == case and c.load_factor == 1.0):
            milliseconds = 1e3 * c.cpu_seconds * np.array(c.counts[1:]) / max(c.counts[-1], 1)
            colour, name = colours[c.method], f"{c.method}, {c.counts[-1]} {_unit(c)}"
            below.loglog(
                milliseconds, c.residuals[1:], "-o", ms=2.0, lw=1.2, color=colour, label=name
            )
            if not c.converged:
                below.loglog(milliseconds[-1:], c.residuals[-1:], "x", ms=8, color=colour)
        below.set_title(f"{case}, full load", fontsize=9)
        below.set_xlabel("CPU time [ms], one thread, evenly spread over the count")
        below.legend(frameon=False, fontsize=8)
        for panel in (above, below):
            panel.set_ylabel("relative residual")
            panel.axhline(TOLERANCE, color="black", lw=0.8, ls=":")
            panel.grid(color="#dddddd", lw=0.6)
    figure.tight_layout()
    return figure_svg(figure)


def _unit(curve: Curve) -> str:
    return "steps" if curve.method == "relaxation" else "iterations"


def page(curves: Sequence[Curve], svg: str) -> str:
    """The study as one page without outside parts."""
    rows = "".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in _row(c)) + "</tr>\n"
        for c in curves
    )
    heads = "".join(f"<th>{html.escape(h)}</th>" for h in _COLUMNS)
    words = "".join(f"<p>{html.escape(p)}</p>" for p in (__doc__ or "").split("\n\n"))
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8">'
        "<title>palpate: iterations</title><style>"
        "body{font:15px/1.5 sans-serif;max-width:64rem;margin:2rem auto;padding:0 1rem}"
        "td,th{padding:.15rem .7rem;text-align:right;border-bottom:1px solid #ddd}"
        "svg{max-width:100%;height:auto}</style><h1>Eq. 10 as printed, and Newton's method</h1>"
        f"{words}{svg}<p>A cross marks an iteration that ended without an answer; the dotted line "
        f"is the tolerance, {TOLERANCE:g}.</p><table><tr>{heads}</tr>\n{rows}</table></html>\n"
    )
