"""Figures of a sweep: what the answer does along the first axis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import cycle, product
from pathlib import Path

from palpate.meshes.problem import Strain
from palpate.validation.case import Case
from palpate.validation.case.units import LENGTH
from palpate.validation.report.plots import COLOURS, Figure, Line, Panel, line_figure
from palpate.validation.solving import Simulator
from palpate.validation.studies.sweep_runs import Run, linear_error
from palpate.validation.studies.sweep_variants import Axis

Measured = Callable[[Run], float | None]


def sweep_figures(
    axes: Sequence[Axis], runs: Sequence[Run], case: Case, folder: Path
) -> dict[str, Figure]:
    """Displacement, volume, and linear against Green strain; each as NAME.pdf in a folder too."""
    unit = case.spec.units.length
    made: dict[str, tuple[str, Measured, str]] = {
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
    if any(axis.key.startswith(("geometry.", "mesh.")) for axis in axes):
        del made["volume"]  # there is no one rest volume
    figures = {}
    for name, (words, measure, caption) in made.items():
        lost = [run for run in runs if run.was_tried and run.state is None]
        panel = Panel(
            _lines(axes, runs, measure),
            # Where the first value without an answer is.
            places={run.values[0]: f"no answer, {run.strain}" for run in lost},
            x=axes[0].key,
            y=words,
        )
        pdf = folder / f"{name}.pdf"
        figures[name] = line_figure([[panel]], caption, shares_legend=False, pdf=pdf)
    return figures


def _lines(axes: Sequence[Axis], runs: Sequence[Run], measure: Measured) -> list[Line]:
    """A colour for each element and values of the other axes; fastsim as lines, others crosses."""
    lines = []
    others = list(dict.fromkeys(run.values[1:] for run in runs))
    elements = list(dict.fromkeys(run.element for run in runs))
    colours = dict(zip(product(others, elements), cycle(COLOURS), strict=False))
    simulators = dict.fromkeys(run.simulator for run in runs)
    for wanted in product(others, elements, simulators, Strain):
        rows = sorted(
            (run.values[0], value)
            for run in runs
            if (run.values[1:], run.element, run.simulator, run.strain) == wanted
            and (value := measure(run)) is not None
        )
        if not rows:
            continue
        other, element, simulator, strain = wanted
        x, y = zip(*rows, strict=True)
        told = [f"{a.key} = {v:g}" for a, v in zip(axes[1:], other, strict=True)]
        style = "-o" if strain is Strain.GREEN else "--o"
        lines.append(
            Line(
                x,
                y,
                label="; ".join([f"{simulator}, {element}, {strain}", *told]),
                style=style if simulator is Simulator.FASTSIM else "x",
                colour=colours[other, element],
            )
        )
    return lines
