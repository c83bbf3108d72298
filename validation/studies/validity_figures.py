"""Figures of the validity map."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from palpate.meshes.arrays import Points
from palpate.validation.report.plots import figure_svg
from palpate.validation.report.study_page import StudyFigure
from palpate.validation.studies.study_folder import paper_style
from palpate.validation.studies.validity_bending import LIMITS, BendingLimit, BendingPoint
from palpate.validation.studies.validity_modes import Mode, ModePoint

_ERROR = "#1f4e79"
_VOLUME = "#b5332e"
_LOST = "#3a3a3a"


def draw_map(
    points: Sequence[BendingPoint],
    limits: Sequence[BendingLimit],
    *,
    poissons_ratio: float,
    slenderness: float,
) -> StudyFigure:
    """Two cuts through the map: over slenderness, and over Poisson's ratio."""
    from matplotlib import pyplot

    by_nu = [p for p in points if p.poissons_ratio == poissons_ratio]
    by_length = [p for p in points if p.slenderness == slenderness]
    loads = sorted({p.deflection for p in points})
    with paper_style():
        figure, axes = pyplot.subplots(1, 2, figsize=(10.0, 4.6), sharey=True)
        _cut(
            axes[0],
            by_nu,
            loads,
            lambda p: p.slenderness,
            [(m.slenderness, m.deflection) for m in limits if m.poissons_ratio == poissons_ratio],
        )
        axes[0].set_xscale("log", base=2)
        axes[0].xaxis.set_major_formatter(lambda x, _: f"{x:g}")
        axes[0].set_xlabel(f"slenderness L/h (Poisson's ratio {poissons_ratio:g})")
        axes[0].set_ylabel("load: tip deflection by linear strain over L")
        _cut(
            axes[1],
            by_length,
            loads,
            lambda p: p.poissons_ratio,
            [(m.poissons_ratio, m.deflection) for m in limits if m.slenderness == slenderness],
        )
        axes[1].set_xlabel(f"Poisson's ratio (L/h = {slenderness:g})")
        filled = axes[0].collections[0]
        axes[0].set_ylim(loads[0], loads[-1])
        handles = [
            mpl.lines.Line2D([], [], color=_ERROR, lw=1.8, label="displacement 1, 5, 10 %"),
            mpl.lines.Line2D(
                [], [], color=_VOLUME, lw=1.8, ls="--", label="volume 1, 5, 10 % of the rest volume"
            ),
            mpl.lines.Line2D(
                [], [], color=_LOST, lw=2.2, marker="s", ms=4, label="equilibrium ends (StVK)"
            ),
        ]
        figure.legend(handles=handles, loc="upper center", ncols=3, frameon=False)
        figure.tight_layout(rect=(0.0, 0.0, 0.9, 0.94))
        bar = figure.colorbar(filled, cax=figure.add_axes((0.915, 0.16, 0.016, 0.72)))
        bar.set_label("displacement error of linear strain")
        bar.set_ticks([0.005, 0.01, 0.05, 0.1, 0.5], labels=["0.5 %", "1 %", "5 %", "10 %", "50 %"])
        bar.minorticks_off()
        return StudyFigure(
            figure_svg(figure),
            "A bar bent by a load at its tip. Below a line the error of linear strain against "
            "Green strain is smaller than its label. Hatched: fastsim finds no "
            "equilibrium on this mesh; on finer ones the corner of the clamp gives way earlier.",
        )


def _cut(
    axes: Axes,
    points: Sequence[BendingPoint],
    y: Sequence[float],
    place: Callable[[BendingPoint], float],
    lost: Sequence[tuple[float, float | None]],
) -> None:
    x = sorted({place(p) for p in points})
    table = {(place(p), p.deflection): p for p in points}

    def grid(error: Callable[[BendingPoint], float]) -> Points:
        rows = [[error(table[a, b]) if (a, b) in table else math.nan for a in x] for b in y]
        logarithms: Points = np.log10(np.maximum(np.array(rows), 1e-12))
        return logarithms

    displacement = grid(lambda p: p.displacement_error)
    axes.contourf(
        x, y, 10.0 ** _continued(displacement, np.log10(y)), np.geomspace(0.005, 0.5, 9),
        cmap="Blues", extend="both", norm=mpl.colors.LogNorm(0.003, 1.2),
    )  # fmt: skip
    for values, colour, style in (
        (displacement, _ERROR, "solid"),
        (grid(lambda p: p.volume_error), _VOLUME, "dashed"),
    ):
        lines = axes.contour(
            x, y, values, np.log10(LIMITS), colors=colour, linestyles=style, linewidths=1.8
        )
        part = 0.25 if style == "solid" else 0.7
        middle = (
            x[0] ** (1.0 - part) * x[-1] ** part if x[0] > 0.0 else x[0] + part * (x[-1] - x[0])
        )
        for level, limit in zip(lines.levels, LIMITS, strict=True):
            column = values[:, int(np.argmin(np.abs(np.array(x) - middle)))]
            height = 10.0 ** float(np.interp(level, column, np.log10(y)))
            axes.text(
                middle, height, f"{100 * limit:g} %", color=colour, fontsize=9,
                ha="center", va="center",
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.85},
            )  # fmt: skip
    there = [(a, b) for a, b in lost if b is not None]
    ends = [end for _, end in there]
    # What is coloured above the last equilibrium is nothing: hidden.
    axes.fill_between(
        [a for a, _ in there], ends, 1e3, facecolor="white", edgecolor="#bbbbbb", hatch="///", lw=0
    )
    axes.plot([a for a, _ in there], ends, "-s", color=_LOST, lw=2.2, ms=4)
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


def draw_rotation(points: Sequence[BendingPoint], poissons_ratio: float) -> StudyFigure:
    """Error over rotation of the tip, and over strain: only the first falls together."""
    from matplotlib import pyplot

    chosen = [p for p in points if p.poissons_ratio == poissons_ratio]
    lengths = sorted({p.slenderness for p in chosen})
    colours = mpl.colormaps["viridis"](np.linspace(0.0, 0.85, len(lengths)))
    with paper_style():
        figure, axes = pyplot.subplots(1, 2, figsize=(9.6, 4.0), sharey=True)
        for colour, length in zip(colours, lengths, strict=True):
            bar = [p for p in chosen if p.slenderness == length]
            errors = [100.0 * p.displacement_error for p in bar]
            label = f"L/h = {length:g}"
            rotations = [math.degrees(p.tip_rotation) for p in bar]
            axes[0].loglog(rotations, errors, "-o", ms=3, lw=1.2, color=colour, label=label)
            strains = [100.0 * bending_strain(p) for p in bar]
            axes[1].loglog(strains, errors, "-o", ms=3, lw=1.2, color=colour)
        axes[0].set_xlabel("rotation of the tip [degrees]")
        axes[1].set_xlabel("largest bending strain, beam theory [%]")
        axes[0].set_ylabel("displacement error of linear strain [%]")
        axes[0].legend(frameon=False, fontsize=9)
        for panel in axes:
            for limit in LIMITS:
                panel.axhline(100.0 * limit, color="#999999", lw=0.8, ls=":")
            panel.grid(color="#e4e4e4", lw=0.5)
            for axis in (panel.xaxis, panel.yaxis):
                axis.set_major_formatter(lambda v, _: f"{v:g}")
        figure.tight_layout()
        return StudyFigure(
            figure_svg(figure),
            f"The same bars (Poisson's ratio {poissons_ratio:g}). Over the rotation the slender "
            "ones fall on one curve; over the strain they do not: rotation is what linear strain "
            "gets wrong.",
        )


def bending_strain(point: BendingPoint) -> float:
    """Strain at the surface at the clamp by beam theory, M h / (2 E I) [-]."""
    return point.load / (2.0 * point.slenderness)


def draw_modes(points: Sequence[ModePoint], poissons_ratio: float) -> StudyFigure:
    """Error of each mode over what linear strain predicts; lines in closed form where known."""
    from matplotlib import pyplot

    colours = dict(zip(Mode, ("#2f6f8f", "#b5332e", "#c98a12", "#2f8f4e", "#6b4c9a"), strict=True))
    with paper_style():
        figure, axes = pyplot.subplots(1, 2, figsize=(9.6, 4.0))
        for mode, colour in colours.items():
            chosen = [p for p in points if p.mode is mode and p.poissons_ratio == poissons_ratio]
            x = [p.nominal for p in chosen]
            for panel, column, found in (
                (axes[0], 0, [p.displacement_error for p in chosen]),
                (axes[1], 1, [p.volume_error for p in chosen]),
            ):
                exact = [_exact(p)[column] for p in chosen if p.closed_form is not None]
                style = "o" if exact else "-o"
                panel.loglog(x, np.multiply(100.0, found), style, ms=4, color=colour, label=mode)
                if exact:
                    panel.loglog(x, np.multiply(100.0, exact), "-", lw=1.2, color=colour)
        for panel, what in zip(axes, ("displacement [%]", "volume [% of rest]"), strict=True):
            for limit in LIMITS:
                panel.axhline(100.0 * limit, color="#999999", lw=0.8, ls=":")
            panel.set_ylim(bottom=0.03)
            panel.set_xlim(left=0.002)
            panel.set_xlabel("strain, shear or twist [rad] by linear strain")
            panel.set_ylabel(f"error of linear strain, {what}")
            panel.grid(color="#e4e4e4", lw=0.5)
            for axis in (panel.xaxis, panel.yaxis):
                axis.set_major_formatter(lambda v, _: f"{v:g}")
        axes[0].legend(frameon=False, fontsize=8)
        figure.tight_layout()
        return StudyFigure(
            figure_svg(figure),
            f"A block, Poisson's ratio {poissons_ratio:g}. Marks: fastsim; lines through them "
            "without their own points: closed form. Between plates the displacement is largely "
            "prescribed, so shear shows in volume and force rather than in displacement.",
        )


def _exact(point: ModePoint) -> tuple[float, float]:
    assert point.closed_form is not None
    error, linear, green = point.closed_form
    return error, abs(linear - green)
