"""Figures of a sweep: what the answer does along the first axis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np

from palpate.meshes.problem import Strain
from palpate.validation.case import Case
from palpate.validation.case.units import LENGTH
from palpate.validation.report.line_plot import paper_style
from palpate.validation.report.plots import figure_svg
from palpate.validation.report.study_page import Figure
from palpate.validation.solving import Simulator
from palpate.validation.sweeps.runs import Run, linear_error
from palpate.validation.sweeps.variants import Axis

_COLOURS = ("#30558f", "#b5332e", "#2f8f4e", "#c98a12", "#6b4c9a", "#4d4d4d")


def sweep_figures(
    axes: Sequence[Axis], runs: Sequence[Run], case: Case, folder: Path
) -> dict[str, Figure]:
    """Displacement, volume, and linear against Green strain; each as NAME.pdf in a folder too."""
    unit = case.spec.units.length
    made: dict[str, tuple[str, Callable[[Run], float | None], str]] = {
        "displacement": (
            f"largest displacement [{unit}]",
            lambda run: run.state.max_displacement / LENGTH[unit] if run.state else None,
            "Largest displacement of a point. Solid: Green strain; dashed: linear strain.",
        ),
        "volume": (
            "volume / its rest volume [-]",
            lambda run: run.state.volume / case.mesh.mesh.volume if run.state else None,
            "Deformed volume. Linear strain swells where a body turns.",
        ),
        "linear-error": (
            "linear - Green, relative [-]",
            lambda run: linear_error(run, runs) if run.strain is Strain.LINEAR else None,
            "What linear strain costs: its displacement less that of Green strain, in L2.",
        ),
    }
    figures = {}
    if any(axis.key.startswith(("geometry.", "mesh.")) for axis in axes):
        del made["volume"]  # there is no one rest volume
    for name, (label, measure, caption) in made.items():
        figures[name] = Figure(_lines(axes, runs, label, measure, folder / name), caption)
    return figures


def _lines(
    axes: Sequence[Axis],
    runs: Sequence[Run],
    label: str,
    measure: Callable[[Run], float | None],
    stem: Path,
) -> str:
    """One figure as SVG text, and as STEM.pdf."""
    from matplotlib import pyplot

    others = list(dict.fromkeys(run.values[1:] for run in runs))
    with paper_style(), mpl.rc_context({"pdf.fonttype": 42}):
        figure, plot = pyplot.subplots(figsize=(6.4, 4.2))
        for number, other in enumerate(others):
            colour = _COLOURS[number % len(_COLOURS)]
            told = ", ".join(f"{a.key} = {v:g}" for a, v in zip(axes[1:], other, strict=True))
            for simulator in dict.fromkeys(run.simulator for run in runs):
                for strain in Strain:
                    wanted = (other, simulator, strain)
                    rows = sorted(
                        (run.values[0], value)
                        for run in runs
                        if (run.values[1:], run.simulator, run.strain) == wanted
                        and (value := measure(run)) is not None
                    )
                    if not rows:
                        continue
                    x, y = np.array(rows).T
                    is_fast = simulator is Simulator.FASTSIM
                    words = [f"{simulator}, {strain}", told]
                    plot.plot(
                        x,
                        y,
                        color=colour,
                        ls=("-" if strain is Strain.GREEN else "--") if is_fast else "none",
                        marker="o" if is_fast else "x",
                        ms=3.5 if is_fast else 7,
                        label="; ".join(word for word in words if word),
                    )
            _mark_ends(plot, runs, other, colour)
        plot.set_xlabel(axes[0].key)
        plot.set_ylabel(label)
        plot.grid(color="#dddddd", lw=0.6)
        for side in ("top", "right"):
            plot.spines[side].set_visible(False)
        plot.legend(frameon=False, fontsize=8)
        figure.tight_layout()
        figure.savefig(stem.with_suffix(".pdf"), metadata={"CreationDate": None})
        return figure_svg(figure)


def _mark_ends(
    plot: mpl.axes.Axes, runs: Sequence[Run], other: tuple[float, ...], colour: str
) -> None:
    """A line where the first value without an answer is."""
    for run in runs:
        if run.values[1:] == other and run.was_tried and run.state is None:
            plot.axvline(run.values[0], color=colour, lw=0.8, ls=":")
            plot.annotate(
                f"no answer, {run.strain}",
                (run.values[0], 0.98),
                xycoords=("data", "axes fraction"),
                rotation=90,
                va="top",
                ha="right",
                fontsize=7,
                color=colour,
            )
