"""Plots as SVG text: fit for the page and for a paper."""

from __future__ import annotations

import io
import math

import matplotlib as mpl

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


def checks_svg(result: CaseResult) -> str:
    """Each check's error, its bar and its limit on one logarithmic axis."""
    from matplotlib import pyplot

    rows = [c for c in result.checks if c.against != "candidate" and c.value is not None]
    if not rows:
        return ""
    with mpl.rc_context({"font.size": 10, "svg.fonttype": "none", "font.family": "sans-serif"}):
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
        axes.grid(axis="x", color="#dddddd", lw=0.6)
        for side in ("top", "right", "left"):
            axes.spines[side].set_visible(False)
        figure.tight_layout()
        return figure_svg(figure)


def figure_svg(figure: mpl.figure.Figure) -> str:
    """A figure as an <svg> element without date or XML header; the figure is closed."""
    from matplotlib import pyplot

    text = io.StringIO()
    figure.savefig(
        text, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type"))
    )
    pyplot.close(figure)
    svg = text.getvalue()
    return svg[svg.index("<svg") :]
