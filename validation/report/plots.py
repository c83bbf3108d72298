"""Plots of checks and budgets: as SVG text for the page, and in the width of a paper's column."""

from __future__ import annotations

import io
import math
from contextlib import AbstractContextManager
from dataclasses import dataclass

import matplotlib as mpl
from markupsafe import escape
from matplotlib import pyplot

from palpate.validation.judging.error_budget import DISCRETISATION, MODEL, TIME, Budget
from palpate.validation.judging.outputs import check_name
from palpate.validation.judging.remainder import SOLVER
from palpate.validation.judging.results import CaseResult
from palpate.validation.states import Verdict

mpl.use("Agg")
_COLOUR = {
    Verdict.PASSED: "#2f8f4e",
    Verdict.FAILED: "#b5332e",
    Verdict.INCONCLUSIVE: "#c98a12",
    Verdict.SKIPPED: "#888888",
}


@dataclass(frozen=True)
class Medium:
    """Where a figure is read.

    Attributes:
        width: Of the figure [inches].
        font: Size of its text [points].
    """

    width: float
    font: float

    @property
    def row(self) -> float:
        """Of its lines, against the page's."""
        return self.font / PAGE.font


PAGE = Medium(8.4, 10.0)
# A column of a journal is 88 mm wide.
COLUMN = Medium(3.46, 7.0)


def plot_style(medium: Medium = PAGE) -> AbstractContextManager[None]:
    """Figures whose text stays text, its font embedded in a PDF."""
    return mpl.rc_context(
        {
            "font.size": medium.font,
            "svg.fonttype": "none",
            "svg.hashsalt": "palpate",  # the same names within it for the same figure
            "pdf.fonttype": 42,
            "font.family": "sans-serif",
        }
    )


def tidy(axes: mpl.axes.Axes) -> None:
    """A light grid, and lines on two sides only."""
    axes.grid(color="#dddddd", lw=0.6)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def checks_svg(result: CaseResult) -> str:
    """Each check's error, its bar and its limit on one logarithmic axis; "" without any."""
    with plot_style():
        figure = checks_figure(result)
        return "" if figure is None else figure_svg(figure, "Errors, error bars and limits")


def checks_figure(result: CaseResult, medium: Medium = PAGE) -> mpl.figure.Figure | None:
    """The same as a figure, within a `plot_style`; None where nothing is compared."""
    rows = [c for c in result.checks if c.against != "candidate" and c.value is not None]
    if not rows:
        return None
    size = medium.row
    high = (0.9 + 0.34 * len(rows)) * size
    figure, axes = pyplot.subplots(figsize=(medium.width, high))
    for place, check in enumerate(reversed(rows)):
        value = max(check.value or 0.0, 1e-17)
        bar = check.reference_error if math.isfinite(check.reference_error) else 0.0
        colour = _COLOUR[check.verdict]
        axes.plot(
            [value, max(value + bar, value)], [place, place], color=colour, lw=3 * size, alpha=0.4
        )
        axes.plot(value, place, "o", color=colour, ms=6 * size)
        axes.plot([check.limit] * 2, [place - 0.32, place + 0.32], color="black", lw=1.6 * size)
    names = [check_name(c) for c in reversed(rows)]
    if medium is not PAGE:
        names = [name.replace(" (", "\n(") for name in names]
    axes.set_yticks(
        range(len(rows)), names, fontsize=(1.0 if medium is PAGE else 0.8) * medium.font
    )
    axes.set_xscale("log")
    axes.set_ylim(-0.6, len(rows) - 0.4)
    words = ("relative error: dot", "reference's error bar: line", "limit: upright tick")
    axes.set_xlabel(("; " if medium is PAGE else ";\n").join(words))
    tidy(axes)
    figure.tight_layout()
    return figure


def figure_svg(figure: mpl.figure.Figure, title: str = "") -> str:
    """A figure as an <svg> element without date or XML header; the figure is closed.

    Args:
        figure: To be drawn.
        title: For readers who hear the page; without one its words are read one after another.
    """
    text = io.StringIO()
    figure.savefig(
        text, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type"))
    )
    pyplot.close(figure)
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    return svg.replace("<svg", f'<svg role="img" aria-label="{escape(title)}"', 1) if title else svg


def budget_svg(budgets: list[Budget]) -> str:
    """Bars of the terms, signed, in per cent of the truth; a tick marks the total."""
    if not budgets:
        return ""
    with plot_style():
        return figure_svg(budget_figure(budgets), f"Where the {budgets[0].quantity} is wrong from")


def budget_figure(budgets: list[Budget], medium: Medium = PAGE) -> mpl.figure.Figure:
    """The same as a figure, within a `plot_style`; one budget at least."""
    colours = {MODEL: "#b5332e", DISCRETISATION: "#2f6f8f", TIME: "#c98a12"}
    labelled: set[str] = set()
    size = medium.row
    high = (1.2 + 0.62 * len(budgets)) * size
    figure, axes = pyplot.subplots(figsize=(medium.width, high))
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
        axes.plot(
            [budget.total / scale] * 2, [place - 0.36, place + 0.36], color="black", lw=2 * size
        )
    is_page = medium is PAGE
    names = [f"{b.quantity}\n" * is_page + b.candidate for b in reversed(budgets)]
    axes.set_yticks(range(len(budgets)), names, fontsize=8 * size)
    axes.set_axisbelow(True)
    axes.axvline(0.0, color="black", lw=0.8)
    what = "error" if is_page else f"{budgets[0].quantity}:\nerror"
    axes.set_xlabel(f"{what} in per cent of the truth; upright tick: total")
    tidy(axes)
    columns = 5 if is_page else 3
    axes.legend(
        frameon=False, fontsize=8 * size, ncol=columns, loc="lower center",
        bbox_to_anchor=(0.45 if is_page else 0.3, 1.0),
    )  # fmt: skip
    figure.tight_layout()
    return figure
