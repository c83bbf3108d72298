"""The style of every plot, and figures of lines, by which studies plot numbers."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib as mpl
from markupsafe import escape
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from palpate.meshes.arrays import Points

BLUE, RED, OCHRE, GREEN, PURPLE, GREY, PINK, BROWN = COLOURS = (
    "#2f6f8f", "#b5332e", "#c98a12", "#2f8f4e", "#6b4c9a", "#4d4d4d", "#d0679b", "#8a5a2b",
)  # fmt: skip


mpl.use("Agg")


@dataclass(frozen=True)
class Medium:
    """The medium of a figure: its width [inches], and the size of its text [points]."""

    width: float
    font: float

    @property
    def row(self) -> float:
        """Height of its lines of text, relative to the page's."""
        return self.font / PAGE.font


PAGE = Medium(8.4, 10.0)


# A column of a journal is 88 mm wide.
COLUMN = Medium(3.46, 7.0)


def plot_style(medium: Medium = PAGE) -> AbstractContextManager[None]:
    """A style in which text stays text, with its font embedded in a PDF."""
    return mpl.rc_context(
        {
            "font.size": medium.font,
            "svg.fonttype": "none",
            "svg.hashsalt": "palpate",  # the same figure gets the same identifiers
            "pdf.fonttype": 42,
            "font.family": "sans-serif",
        }
    )


def tidy(axes: mpl.axes.Axes) -> None:
    """Draw a light grid, and axis lines on two sides only."""
    axes.grid(color="#dddddd", lw=0.6)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def figure_svg(figure: mpl.figure.Figure, title: str = "") -> str:
    """A figure as an <svg> element without date or XML header; the figure is closed.

    Without a title screen readers read the words of the figure one by one.
    """
    text = io.StringIO()
    figure.savefig(
        text, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type"))
    )
    pyplot.close(figure)
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    return svg.replace("<svg", f'<svg role="img" aria-label="{escape(title)}"', 1) if title else svg


@dataclass(frozen=True)
class Figure:
    """A drawing as an <svg> element, and a caption."""

    svg: str
    caption: str


@dataclass(frozen=True)
class Line:
    """A line through points (x, y), in matplotlib's style, of a width [points].

    Without a label there is no entry in the legend; without a colour it takes the next one.
    """

    x: Sequence[float] | Points
    y: Sequence[float] | Points
    label: str = ""
    style: str = "-o"
    colour: str | None = None
    width: float = 1.3
    alpha: float = 1.0


@dataclass(frozen=True)
class Panel:
    """Lines in one pair of axes, in this order.

    `log` names the axes that are logarithmic: "", "x", "y" or "xy". Dotted lines mark `levels` of
    y, with a text each at their right end where they are a mapping, and `positions` of x, with the
    text along its line; `band` is grey, on y; `notes` are texts at (x, y), `ticks` at values of x,
    `y_ticks` of y. An end of a range that is None is what the lines need. What `is_to_scale` has
    one scale for x and y.
    """

    lines: Sequence[Line]
    x: str
    y: str = ""
    title: str = ""
    log: str = ""
    levels: Sequence[float] | Mapping[float, str] = ()
    positions: Mapping[float, str] = field(default_factory=dict)
    band: tuple[float, float] | None = None
    notes: Sequence[tuple[float, float, str]] = ()
    ticks: Mapping[float, str] | None = None
    y_ticks: Mapping[float, str] | None = None
    x_range: tuple[float | None, float | None] = (None, None)
    y_range: tuple[float | None, float | None] = (None, None)
    is_to_scale: bool = False


def line_figure(
    rows: Sequence[Sequence[Panel]],
    caption: str,
    *,
    shares_legend: bool,
    pdf: Path | None = None,
) -> Figure:
    """Panels row by row, as many in each; one legend below all, or one in each that has labels.

    `pdf` is where the same figure is written as PDF.
    """
    width = {1: 6.4, 2: 9.6, 3: 11.0}.get(len(rows[0]), 12.0)
    height = min(4.2, 1.1 * width / len(rows[0])) * len(rows) + 0.3 * shares_legend
    with plot_style():
        figure, axes = pyplot.subplots(
            len(rows), len(rows[0]), figsize=(width, height), squeeze=False
        )
        for row, beside in zip(rows, axes, strict=True):
            for panel, position in zip(row, beside, strict=True):
                _draw(position, panel)
                if not shares_legend and any(line.label for line in panel.lines):
                    position.legend(frameon=False, fontsize=8)
        below = 0.0
        if shares_legend:
            found = [position.get_legend_handles_labels() for position in axes.flat]
            labels = {
                lb: h for handles, words in found for h, lb in zip(handles, words, strict=True)
            }
            inches = sum(0.55 + 0.075 * len(label) for label in labels)
            widest = 0.55 + 0.075 * max((len(label) for label in labels), default=0)
            rows_needed = max(math.ceil(inches / width), math.ceil(len(labels) * widest / width))
            columns = math.ceil(len(labels) / rows_needed) if inches > width else len(labels) or 1
            figure.legend(
                labels.values(), labels.keys(), loc="lower center", ncols=columns,
                frameon=False, fontsize=9,
            )  # fmt: skip
            below = 0.26 * -(-len(labels) // columns) / height
        figure.tight_layout(rect=(0.0, below, 1.0, 1.0))
        if pdf is not None:
            with mpl.rc_context({"pdf.fonttype": 42}):  # its text stays text too
                figure.savefig(pdf, metadata={"CreationDate": None})
        return Figure(figure_svg(figure), caption)


def _draw(axes: Axes, panel: Panel) -> None:
    axes.set_prop_cycle(color=COLOURS)
    for line in panel.lines:
        axes.plot(
            line.x, line.y, line.style, label=line.label or None, color=line.colour,
            lw=line.width, ms=8 if line.style == "x" else 4, alpha=line.alpha,
        )  # fmt: skip
    axes.set_xscale("log" if "x" in panel.log else "linear")
    axes.set_yscale("log" if "y" in panel.log else "linear")
    for level in panel.levels:
        axes.axhline(level, color="black", lw=0.8, ls=":")
        words = panel.levels.get(level, "") if isinstance(panel.levels, Mapping) else ""
        axes.annotate(
            words, (1.0, level), (3, 0), xycoords=axes.get_yaxis_transform(),
            textcoords="offset points", ha="left", va="center", fontsize=7,
        )  # fmt: skip
    for position, words in panel.positions.items():
        axes.axvline(position, color="black", lw=0.8, ls=":")
        axes.text(
            position, 0.98, words, transform=axes.get_xaxis_transform(), rotation=90,
            ha="right", va="top", fontsize=7,
        )  # fmt: skip
    if panel.band is not None:
        axes.axhspan(*panel.band, color="#999999", alpha=0.25, lw=0)
    axes.margins(x=0.08 if panel.notes else 0.05)
    for x, y, words in panel.notes:
        axes.annotate(words, (x, y), (4, 4), textcoords="offset points", fontsize=8)
    axes.set_xlim(*panel.x_range)
    axes.set_ylim(*panel.y_range)
    for axis, letter in ((axes.xaxis, "x"), (axes.yaxis, "y")):
        low, high = axis.get_view_interval()
        if letter in panel.log and high <= 1e5 * low:
            axis.set_major_formatter(_plainly)
            axis.set_minor_formatter(_plainly if high <= 10.0 * low else NullFormatter())
    for axis, ticks in ((axes.xaxis, panel.ticks), (axes.yaxis, panel.y_ticks)):
        if ticks is not None:
            axis.set_ticks(list(ticks), list(ticks.values()))
            axis.set_minor_formatter(NullFormatter())
    if panel.is_to_scale:
        axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel(panel.x)
    axes.set_ylabel(panel.y)
    axes.set_title(panel.title, fontsize=10)
    tidy(axes)


def _plainly(value: float, _place: float) -> str:
    return f"{value:g}"
