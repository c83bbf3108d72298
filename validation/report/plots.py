"""Plots as SVG text: fit for the page and for a paper."""

from __future__ import annotations

import io
import math
from contextlib import AbstractContextManager

import matplotlib as mpl
from matplotlib import pyplot

from palpate.validation.evidence.error_budget import DISCRETISATION, MODEL, TIME, Budget
from palpate.validation.evidence.remainder import SOLVER
from palpate.validation.judging.outputs import check_name
from palpate.validation.judging.results import CaseResult
from palpate.validation.states import Verdict

mpl.use("Agg")
_COLOUR = {
    Verdict.PASSED: "#2f8f4e",
    Verdict.FAILED: "#b5332e",
    Verdict.INCONCLUSIVE: "#c98a12",
    Verdict.SKIPPED: "#888888",
}


def plot_style() -> AbstractContextManager[None]:
    """Figures whose text stays text."""
    return mpl.rc_context({"font.size": 10, "svg.fonttype": "none", "font.family": "sans-serif"})


def tidy(axes: mpl.axes.Axes) -> None:
    """A light grid, and lines on two sides only."""
    axes.grid(color="#dddddd", lw=0.6)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def checks_svg(result: CaseResult) -> str:
    """Each check's error, its bar and its limit on one logarithmic axis."""
    rows = [c for c in result.checks if c.against != "candidate" and c.value is not None]
    if not rows:
        return ""
    with plot_style():
        figure, axes = pyplot.subplots(figsize=(8.4, 0.9 + 0.34 * len(rows)))
        for place, check in enumerate(reversed(rows)):
            value = max(check.value or 0.0, 1e-17)
            bar = check.reference_error if math.isfinite(check.reference_error) else 0.0
            colour = _COLOUR[check.verdict]
            axes.plot(
                [value, max(value + bar, value)], [place, place], color=colour, lw=3, alpha=0.4
            )
            axes.plot(value, place, "o", color=colour, ms=6)
            axes.plot([check.limit] * 2, [place - 0.32, place + 0.32], color="black", lw=1.6)
        axes.set_yticks(range(len(rows)), [check_name(c) for c in reversed(rows)])
        axes.set_xscale("log")
        axes.set_ylim(-0.6, len(rows) - 0.4)
        axes.set_xlabel("relative error: dot; reference's error bar: line; limit: black tick")
        tidy(axes)
        figure.tight_layout()
        return figure_svg(figure)


def figure_svg(figure: mpl.figure.Figure) -> str:
    """A figure as an <svg> element without date or XML header; the figure is closed."""
    text = io.StringIO()
    figure.savefig(
        text, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type"))
    )
    pyplot.close(figure)
    svg = text.getvalue()
    return svg[svg.index("<svg") :]


def budget_svg(budgets: list[Budget]) -> str:
    """Bars of the terms, signed, in per cent of the truth; a tick marks the total."""
    if not budgets:
        return ""
    colours = {MODEL: "#b5332e", DISCRETISATION: "#2f6f8f", TIME: "#c98a12"}
    labelled: set[str] = set()
    figure, axes = pyplot.subplots(figsize=(8.4, 1.2 + 0.62 * len(budgets)))
    for place, budget in enumerate(reversed(budgets)):
        scale = (abs(budget.truth) or 1.0) / 100.0
        up = down = 0.0
        rest = "#2f8f4e" if budget.rest == SOLVER else "#6b3fa0"
        for name, colour in (colours | {budget.rest: rest, "interaction": "#999999"}).items():
            value = budget.interaction if name == "interaction" else budget.terms.get(name)
            width = (value or 0.0) / scale
            start = up if width >= 0.0 else down
            label = name.partition(":")[0]
            axes.barh(
                place, width, left=start, height=0.5, color=colour,
                label=None if label in labelled else label,
            )  # fmt: skip
            labelled.add(label)
            up, down = (up + width, down) if width >= 0.0 else (up, down + width)
        axes.plot([budget.total / scale] * 2, [place - 0.36, place + 0.36], color="black", lw=2)
    names = [f"{b.quantity}\n{b.candidate}" for b in reversed(budgets)]
    axes.set_yticks(range(len(budgets)), names, fontsize=8)
    axes.axvline(0.0, color="black", lw=0.8)
    axes.set_xlabel("error in per cent of the truth; black tick: total")
    tidy(axes)
    axes.legend(frameon=False, fontsize=8, ncol=5, loc="lower center", bbox_to_anchor=(0.45, 1.0))
    figure.tight_layout()
    return figure_svg(figure)
