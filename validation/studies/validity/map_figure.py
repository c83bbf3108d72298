"""Two cuts through the bending map, as contours."""

from __future__ import annotations

import math
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from palpate.meshes.arrays import Points
from palpate.validation.report.line_plot import GREY, RED, paper_style
from palpate.validation.report.plots import figure_svg
from palpate.validation.report.study_page import Figure
from palpate.validation.studies.validity.bending import LIMITS, BendingLimit, BendingPoint

_ERROR = "#1f4e79"


def draw_map(
    points: Sequence[BendingPoint],
    limits: Sequence[BendingLimit],
    poissons_ratio: float,
    *,
    slenderness: float,
) -> Figure:
    """Over slenderness at one Poisson's ratio, and over that at one slenderness."""
    from matplotlib import pyplot

    loads = sorted({p.deflection for p in points})
    with paper_style():
        figure, (left, right) = pyplot.subplots(1, 2, figsize=(10.0, 4.6), sharey=True)
        for axes, along, across, value in (
            (left, "slenderness", "poissons_ratio", poissons_ratio),
            (right, "poissons_ratio", "slenderness", slenderness),
        ):
            _cut(
                axes,
                {
                    (getattr(p, along), p.deflection): p
                    for p in points
                    if getattr(p, across) == value
                },
                loads,
                [
                    (getattr(m, along), m.deflection)
                    for m in limits
                    if getattr(m, across) == value and m.deflection is not None
                ],
            )
        left.set_xscale("log", base=2)
        left.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
        left.set_xlabel(f"slenderness L/h (Poisson's ratio {poissons_ratio:g})")
        left.set_ylabel("load: tip deflection by linear strain over L")
        left.set_ylim(loads[0], loads[-1])
        right.set_xlabel(f"Poisson's ratio (L/h = {slenderness:g})")
        filled = left.collections[0]
        handles = [
            mpl.lines.Line2D([], [], color=colour, ls=style, marker=marker, ms=4, label=label)
            for colour, style, marker, label in (
                (_ERROR, "-", "", "displacement 1, 5, 10 %"),
                (RED, "--", "", "volume 1, 5, 10 % of the rest volume"),
                (GREY, "-", "s", "equilibrium ends (StVK)"),
            )
        ]
        figure.legend(handles=handles, loc="upper center", ncols=3, frameon=False)
        figure.tight_layout(rect=(0.0, 0.0, 0.9, 0.94))
        bar = figure.colorbar(filled, cax=figure.add_axes((0.915, 0.16, 0.016, 0.72)))
        bar.set_label("displacement error of linear strain")
        bar.set_ticks([0.005, 0.01, 0.05, 0.1, 0.5], labels=["0.5 %", "1 %", "5 %", "10 %", "50 %"])
        bar.minorticks_off()
        return Figure(
            figure_svg(figure),
            "A bar bent by a load at its tip. Below a line the error of linear strain against "
            "Green strain is smaller than its label. Hatched: fastsim finds no "
            "equilibrium on this mesh; on finer ones the corner of the clamp gives way earlier.",
        )


def _cut(
    axes: Axes,
    table: dict[tuple[float, float], BendingPoint],
    y: Sequence[float],
    lost: Sequence[tuple[float, float]],
) -> None:
    x = sorted({place for place, _ in table})
    grid = [[table.get((a, b)) for a in x] for b in y]
    displacement, volume = (
        np.log10([[max(getattr(p, name), 1e-12) if p else math.nan for p in row] for row in grid])
        for name in ("displacement_error", "volume_error")
    )
    axes.contourf(
        x, y, 10.0 ** _continued(displacement, np.log10(y)), np.geomspace(0.005, 0.5, 9),
        cmap="Blues", extend="both", norm=mpl.colors.LogNorm(0.003, 1.2),
    )  # fmt: skip
    for values, colour, style, part in (
        (displacement, _ERROR, "solid", 0.25),
        (volume, RED, "dashed", 0.7),
    ):
        axes.contour(
            x, y, values, np.log10(LIMITS), colors=colour, linestyles=style, linewidths=1.8
        )
        middle = (
            x[0] ** (1.0 - part) * x[-1] ** part if x[0] > 0.0 else x[0] + part * (x[-1] - x[0])
        )
        column = values[:, int(np.argmin(np.abs(np.array(x) - middle)))]
        for limit in LIMITS:
            height = 10.0 ** float(np.interp(math.log10(limit), column, np.log10(y)))
            axes.text(
                middle, height, f"{100 * limit:g} %", color=colour, fontsize=9,
                ha="center", va="center",
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.85},
            )  # fmt: skip
    places, ends = [a for a, _ in lost], [b for _, b in lost]
    # What is coloured above the last equilibrium is nothing: hidden.
    axes.fill_between(places, ends, 1e3, facecolor="white", edgecolor="#bbbbbb", hatch="///", lw=0)
    axes.plot(places, ends, "-s", color=GREY, lw=2.2, ms=4)
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(lambda v, _: f"{v:g}")
    axes.set_xlim(x[0], x[-1])


def _continued(values: Points, heights: Points) -> Points:
    """Rows of log error that were not reached, by the slope of the last two reached."""
    filled = values.copy()
    for column in filled.T:
        for k in range(2, len(column)):
            if math.isnan(column[k]):
                slope = (column[k - 1] - column[k - 2]) / (heights[k - 1] - heights[k - 2])
                column[k] = column[k - 1] + slope * (heights[k] - heights[k - 1])
    return filled
