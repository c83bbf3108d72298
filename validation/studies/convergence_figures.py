"""Figures of the study of convergence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from palpate.validation.report.plots import figure_svg
from palpate.validation.report.study_page import StudyFigure
from palpate.validation.studies.error_family import ErrorFamily
from palpate.validation.studies.kidney_convergence import QUANTITIES, MeshFamily, StoredTruth
from palpate.validation.studies.study_folder import paper_style

_COLOURS = ("#2f6f8f", "#b5332e", "#c98a12", "#2f8f4e", "#6b4c9a")
_TITLES = {
    "h": "fastsim, manufactured solution",
    "p": "reference, confined column",
    "dt": "fastsim, explicit steps",
}


def draw_families(families: Sequence[ErrorFamily]) -> StudyFigure:
    """Errors over size, a panel each for h, p and dt, with the slope of theory beside them."""
    from matplotlib import pyplot

    kinds = [what for what in _TITLES if any(f.what == what for f in families)]
    with paper_style():
        figure, axes = pyplot.subplots(
            1, len(kinds), figsize=(3.6 * len(kinds), 4.0), squeeze=False
        )
        for panel, what in zip(axes[0], kinds, strict=True):
            chosen = [f for f in families if f.what == what]
            for f, colour in zip(chosen, _COLOURS, strict=False):
                sizes = np.array(f.sizes) / f.sizes[0]
                theory = f.errors[-1] * (sizes / sizes[-1]) ** f.expected_order
                panel.loglog(sizes, theory, "--", lw=0.9, color="#888888")
                label = f"{f.label}: {f.orders[-1]:.2f}"
                panel.loglog(sizes, f.errors, "o-", ms=4, lw=1.3, color=colour, label=label)
            ticks = sorted({round(s / f.sizes[0], 6) for f in chosen for s in f.sizes})
            panel.set_xticks(ticks, [f"1/{round(1 / t)}" if t < 1 else "1" for t in ticks])
            panel.minorticks_off()
            panel.set_xlabel("cell size, coarsest = 1" if what != "dt" else "step, longest = 1")
            panel.set_title(_TITLES[what], fontsize=10)
            low, high = panel.get_ylim()
            panel.set_ylim(low, high * (high / low) ** (0.1 + 0.08 * len(chosen)))
            panel.legend(frameon=False, fontsize=8, loc="upper left")
            panel.grid(color="#e4e4e4", lw=0.5)
        axes[0][0].set_ylabel("relative error")
        figure.tight_layout()
        return StudyFigure(
            figure_svg(figure),
            "Errors against the exact answer (block let go: against a small step). Dashed: the "
            "slope of theory through the finest run; the number is the order observed last.",
        )


def draw_kidney(meshes: MeshFamily, truth: Mapping[str, StoredTruth]) -> StudyFigure:
    """Each number over cell size, with Richardson's value and both error bars."""
    from matplotlib import pyplot

    with paper_style():
        figure, axes = pyplot.subplots(1, len(QUANTITIES), figsize=(12.0, 3.6))
        sizes = np.array([0.5**k for k in range(len(meshes.cells))])
        for panel, (quantity, (name, unit, factor)) in zip(axes, QUANTITIES.items(), strict=True):
            values = np.array([factor * getattr(r, name) for r in meshes.responses])
            found, known = meshes.assess(quantity), truth[quantity]
            panel.axhspan(known.value - known.bar, known.value + known.bar, color="#2f8f4e",
                          alpha=0.15, lw=0)  # fmt: skip
            panel.axhline(known.value, color="#2f8f4e", lw=1.2, label="stored P2, its bar")
            panel.plot(sizes, values, "o-", color="#2f6f8f", ms=4, label="P1 on three meshes")
            if found.extrapolated is not None and found.order is not None:
                h = np.linspace(0.0, 1.0, 60)
                slope = (values[-1] - found.extrapolated) / sizes[-1] ** found.order
                panel.plot(h, found.extrapolated + slope * h**found.order, ":", color="#2f6f8f",
                           lw=1.2)  # fmt: skip
                panel.plot(0.0, found.extrapolated, "s", color="#b5332e", ms=5, clip_on=False,
                           label="Richardson")  # fmt: skip
            if found.error_bar is not None:
                panel.errorbar(sizes[-1], values[-1], found.error_bar, color="#2f6f8f", capsize=4)
            order = "-" if found.order is None else f"{found.order:.2f}"
            panel.set_title(f"{quantity} [{unit}]\nobserved order {order}", fontsize=10)
            panel.set_xlabel("cell size, first mesh = 1")
            panel.set_xlim(-0.06, 1.06)
            panel.set_xticks([0, 0.25, 0.5, 1])
            panel.grid(color="#e4e4e4", lw=0.5)
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=len(labels), frameon=False)
        figure.tight_layout(rect=(0.0, 0.08, 1.0, 1.0))
        return StudyFigure(
            figure_svg(figure),
            f"The kidney on meshes of {', '.join(map(str, meshes.cells))} cells. The dotted line "
            "is the power law through the three; the bar at the finest is its grid convergence "
            "index.",
        )
