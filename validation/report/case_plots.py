"""Plots of one judged case, for the page and for a paper: checks, error budget and motion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot
from matplotlib.ticker import MaxNLocator

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Strain
from palpate.validation.judging.error_budget import DISCRETISATION, MODEL, SOLVER, TIME, Budget
from palpate.validation.judging.results import CaseResult
from palpate.validation.metrics.motion import swinging_most
from palpate.validation.report import FigureForm
from palpate.validation.report.answer import check_in_words
from palpate.validation.report.comparisons import STRAIN_NAMES, colours_of, comparisons_of
from palpate.validation.report.pictures import draw_pictures
from palpate.validation.report.plots import (
    COLUMN,
    OCHRE,
    PAGE,
    Medium,
    figure_svg,
    plot_style,
    tidy,
)
from palpate.validation.states import State, Verdict

_COLOUR = {
    Verdict.PASSED: "#2f8f4e",
    Verdict.FAILED: "#b5332e",
    Verdict.INCONCLUSIVE: "#c98a12",
    Verdict.SKIPPED: "#888888",
}


def checks_svg(result: CaseResult) -> str:
    """Error, bar and limit of each check on one logarithmic axis, as SVG; "" without checks."""
    with plot_style():
        figure = checks_figure(result)
        return "" if figure is None else figure_svg(figure, "Errors, error bars and limits")


def checks_figure(result: CaseResult, medium: Medium = PAGE) -> mpl.figure.Figure | None:
    """The same as a figure, within a `plot_style`; None where nothing is compared."""
    rows = [c for c in result.checks if c.against != "candidate" and c.value is not None]
    rows = [c for c in rows if c.unit == "-"]  # lengths and forces have no place on this axis
    if not rows:
        return None
    size, is_page = medium.row, medium is PAGE
    names = [check_in_words(c) for c in reversed(rows)]
    words = ("dot: relative error [-]", "line: reference's error bar", "upright tick: limit")
    small = (1.0 if is_page else 0.8) * medium.font
    if not is_page:  # a column has no room for one line
        names = [name.replace(" (", "\n(") for name in names]
    # By lines of text, each 1.2 of its size high: names that share a row's height overprint.
    of_row = 1.2 * small * (max(name.count("\n") for name in names) + 1) + 0.6 * medium.font
    below = 1.2 * medium.font * ((1 if is_page else len(words)) + 4.0)
    figure, axes = pyplot.subplots(figsize=(medium.width, (len(rows) * of_row + below) / 72.0))
    for position, check in enumerate(reversed(rows)):
        value = max(check.value or 0.0, 1e-17)
        bar = check.reference_error if math.isfinite(check.reference_error) else 0.0
        colour = _COLOUR[check.verdict]
        axes.plot(
            [value, max(value + bar, value)],
            [position, position],
            color=colour,
            lw=3 * size,
            alpha=0.4,
        )
        axes.plot(value, position, "o", color=colour, ms=6 * size)
        axes.plot(
            [check.limit] * 2, [position - 0.32, position + 0.32], color="black", lw=1.6 * size
        )
    axes.set_yticks(range(len(rows)), names, fontsize=small)
    axes.set_xscale("log")
    axes.set_ylim(-0.5, len(rows) - 0.5)
    # From the right end, or long names would push the words out of the picture.
    axes.set_xlabel(("; " if is_page else ";\n").join(words), loc="right")
    tidy(axes)
    figure.tight_layout()
    return figure


def budget_svg(budgets: list[Budget]) -> str:
    """The terms of error budgets as signed bars in per cent of the truth; a tick is the total."""
    if not budgets:
        return ""
    with plot_style():
        return figure_svg(budget_figure(budgets), f"Where the {budgets[0].quantity} is wrong from")


def budget_figure(budgets: list[Budget], medium: Medium = PAGE) -> mpl.figure.Figure:
    """The same as a figure, within a `plot_style`; there is at least one budget."""
    colours = {MODEL: "#b5332e", DISCRETISATION: "#2f6f8f", TIME: "#c98a12"}
    labelled: set[str] = set()
    size = medium.row
    high = (1.2 + 0.62 * len(budgets)) * size
    figure, axes = pyplot.subplots(figsize=(medium.width, high))
    for position, budget in enumerate(reversed(budgets)):
        scale = budget.scale / 100.0
        up = down = 0.0
        rest = "#2f8f4e" if budget.rest == SOLVER else "#6b3fa0"
        for name, colour in (colours | {budget.rest: rest, "interaction": "#999999"}).items():
            value = budget.interaction if name == "interaction" else budget.terms.get(name)
            width = (value or 0.0) / scale
            start = up if width >= 0.0 else down
            label = name.partition(":")[0]
            axes.barh(
                position, width, left=start, height=0.5, color=colour,
                label=None if value is None or label in labelled else label,
            )  # fmt: skip
            labelled |= set() if value is None else {label}
            up, down = (up + width, down) if width >= 0.0 else (up, down + width)
        axes.plot(
            [budget.total / scale] * 2,
            [position - 0.36, position + 0.36],
            color="black",
            lw=2 * size,
        )
    is_page = medium is PAGE
    names = [f"{b.quantity}\n" * is_page + b.candidate for b in reversed(budgets)]
    axes.set_yticks(range(len(budgets)), names, fontsize=8 * size)
    axes.set_axisbelow(True)
    axes.axvline(0.0, color="black", lw=0.8)
    words = ["error [%]", "upright tick: total"]
    # A column has no room for one line.
    axes.set_xlabel("; ".join(words) if is_page else "\n".join([budgets[0].quantity, *words]))
    axes.xaxis.set_major_locator(MaxNLocator(7 if is_page else 4))
    tidy(axes)
    columns = 5 if is_page else 3
    axes.legend(
        frameon=False, fontsize=8 * size, ncol=columns, loc="lower center",
        bbox_to_anchor=(0.45 if is_page else 0.3, 1.0),
    )  # fmt: skip
    figure.tight_layout()
    return figure


def motion_svg(result: CaseResult) -> str:
    """Displacement over time and its error as SVG text; empty where nothing moves over time."""
    with plot_style():
        figure = motion_figure(result)
        return "" if figure is None else figure_svg(figure, "Displacement and error over time")


def motion_figure(result: CaseResult, medium: Medium = PAGE) -> mpl.figure.Figure | None:
    """The same as a figure, within a `plot_style`; None where nothing moves over time."""
    moving = [state for state in result.states if state.trajectory is not None]
    references = [s for s in moving if s.is_reference and s.strain is Strain.GREEN]
    candidates = [s for s in moving if not s.is_reference]
    if not candidates:
        return None
    # The truth, where there is one, decides which point is shown.
    leading = sorted(references, key=_is_on_mesh) or candidates
    assert leading[0].trajectory is not None
    point, axis = swinging_most(leading[0].trajectory)
    size, unit = result.units.of("length")
    position = ", ".join(f"{x / size:.4g}" for x in result.problem.mesh.points[point])
    along = ", ".join(f"{round(a, 2) + 0.0:.2f}" for a in axis)
    has_tools = bool(result.problem.tools)
    row, is_page = medium.row, medium is PAGE
    columns = 1 if not is_page else 4 if len(colours_of(result)) == 1 else 3
    # In a column each entry of a legend takes a line of its own.
    extra = 0 if is_page else len(moving)
    high = (4.6 + 1.9 * has_tools + 0.2 * extra) * row
    figure, panels = pyplot.subplots(
        2 + has_tools, 1, figsize=(medium.width, high), sharex=True,
        height_ratios=(2, 1, 1.4)[: 2 + has_tools],
    )  # fmt: skip
    above, below = panels[:2]
    colours = colours_of(result)
    compared = [
        (result.states[one], result.states[other])
        for shown in comparisons_of(result)
        if shown.strain is Strain.GREEN
        for one, other in shown.pairs
    ]
    for state in (*references, *candidates):
        name = f"{state.label}, {STRAIN_NAMES[state.strain]}"
        style = _style(state, colours, compared)
        above.plot(*_path(state, point, axis, size), **style, label=name)
        if has_tools:
            _draw_forces(panels[2], state, name, style, result.units.of("force")[0])
    # With several candidates, distances from the truth: rounding errors would flatten them.
    true = [pair for pair in compared if not _is_on_mesh(pair[1])] if len(colours) > 1 else []
    for candidate, reference in true or compared:
        _draw_error(below, candidate, reference, point, colours, size)
    above.set_ylabel(f"displacement [{unit}]")
    below.set_ylabel(f"error [{unit}]")
    below.set_yscale("linear" if true else "log")
    if has_tools:
        panels[2].set_ylabel(f"force on tool [{result.units.force}]")
    panels[-1].set_xlabel(
        f"time [s]{'; ' if is_page else chr(10)}at ({position}) {unit} along ({along})"
    )
    for axes in panels:
        tidy(axes)
        # Lines of forces look like those of displacement: one legend serves both.
        is_known_above = axes is not above and axes is not below and len(result.problem.tools) < 2
        if axes.get_legend_handles_labels()[0] and not is_known_above:
            axes.legend(
                frameon=False, fontsize=8 * row, ncols=min(columns, 3),
                loc="lower center", bbox_to_anchor=(0.5, 0.98),
            )  # fmt: skip
    figure.tight_layout()
    return figure


def _is_on_mesh(reference: State) -> bool:
    """Whether a reference has the candidate's mesh and steps, and is not the truth."""
    return reference.degree == 1


def _style(
    state: State, colours: Mapping[str, str], compared: Sequence[tuple[State, State]]
) -> dict[str, Any]:
    """The style of a state's line.

    A candidate has its own colour, another one if it is alone and has linear strain. The truth is
    black; the reference on the same mesh is broad and grey, or has its candidate's colour if many.
    """
    if state.is_reference and not _is_on_mesh(state):
        return {"color": "black", "lw": 1.6}
    if state.is_reference:
        own = [colours[candidate.label] for candidate, other in compared if other is state]
        colour = own[0] if own and len(colours) > 1 else "#888888"
        return {"color": colour, "lw": 3.5, "alpha": 0.35 if len(colours) > 1 else 0.6}
    colour = colours[state.label]
    if state.strain is Strain.GREEN:
        return {"color": colour, "lw": 1.3}
    return {"color": OCHRE if len(colours) == 1 else colour, "lw": 1.3, "ls": "--"}


def _draw_forces(
    axes: mpl.axes.Axes, state: State, name: str, style: Mapping[str, Any], size: float
) -> None:
    """Draw the magnitude of the mean force on each tool from output to output."""
    forces = state.tool_forces
    if state.trajectory is None or forces is None or forces.ndim != 3:
        return
    for number, history in enumerate(np.linalg.norm(forces, axis=2) / size, start=1):
        times = state.trajectory.times[1:]
        axes.plot(times, history[1:], **style, label=f"tool {number}, {name}")


def _path(state: State, point: int, axis: Points, size: float) -> tuple[Points, Points]:
    """Times [s] and displacement of the point along the axis [`size` m]."""
    assert state.trajectory is not None
    path: Points = state.trajectory.displacements[:, point] @ axis / size
    return state.trajectory.times, path


def _draw_error(
    axes: mpl.axes.Axes,
    state: State,
    other: State,
    point: int,
    colours: Mapping[str, str],
    size: float,
) -> None:
    assert state.trajectory is not None
    assert other.trajectory is not None
    ours, theirs = state.trajectory.displacements, other.trajectory.displacements
    apart = np.linalg.norm(ours[:, point] - theirs[:, point], axis=1) / size
    shown = np.where(apart > 0.0, apart, np.nan)
    label = f"to {other.label}" if len(colours) == 1 else f"{state.label} to {other.label}"
    line = "--" if _is_on_mesh(other) else "-"
    axes.plot(state.trajectory.times, shown, line, color=colours[state.label], lw=1.1, label=label)


def write_figures(
    result: CaseResult, folder: Path, form: FigureForm, budgets: Sequence[Budget] = ()
) -> list[Path]:
    """Write every figure of a report as NAME-WHAT.pdf or .svg; returns the files.

    Plots of checks, budgets and motions are 88 mm wide, a column; pictures of the body in several
    panels 180 mm, two. Bodies of more than 20 000 facets are pixels within the figure. The same
    results give the same files.
    """
    made = []
    with plot_style(COLUMN):
        figures = {"checks": checks_figure(result, COLUMN), "motion": motion_figure(result, COLUMN)}
        quantities = dict.fromkeys(budget.quantity for budget in budgets)
        for number, quantity in enumerate(quantities, start=1):
            rows = [budget for budget in budgets if budget.quantity == quantity]
            figures[f"budget-{number}"] = budget_figure(rows, COLUMN)
        for name, figure in figures.items():
            if figure is not None:
                path = folder / f"{result.name}-{name}.{form}"
                date = "CreationDate" if form is FigureForm.PDF else "Date"
                figure.savefig(path, metadata={date: None})
                pyplot.close(figure)
                made.append(path)
    return made + list(draw_pictures(result, folder, str(form)).values())
