"""A motion over time, where the reference swings most: candidate, references, and what is apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Strain
from palpate.validation.judging.results import CaseResult
from palpate.validation.metrics.motion import swinging_most
from palpate.validation.report.colours import OCHRE
from palpate.validation.report.looks import STRAIN_NAMES, colours_of, looks_of
from palpate.validation.report.plots import PAGE, Medium, figure_svg, plot_style, tidy
from palpate.validation.states import State

_MILLI = 1e3


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
    # The truth, where there is one, says where to look.
    leading = sorted(references, key=_is_on_mesh) or candidates
    assert leading[0].trajectory is not None
    point, axis = swinging_most(leading[0].trajectory)
    place = ", ".join(f"{x * _MILLI:.4g}" for x in result.problem.mesh.points[point])
    along = ", ".join(f"{round(a, 2) + 0.0:.2f}" for a in axis)
    has_tools = bool(result.problem.tools)
    size, is_page = medium.row, medium is PAGE
    columns = 1 if not is_page else 4 if len(colours_of(result)) == 1 else 3
    # In a column each entry of a legend has a line of its own.
    extra = 0 if is_page else len(moving)
    high = (4.6 + 1.9 * has_tools + 0.2 * extra) * size
    figure, panels = pyplot.subplots(
        2 + has_tools, 1, figsize=(medium.width, high), sharex=True,
        height_ratios=(2, 1, 1.4)[: 2 + has_tools],
    )  # fmt: skip
    above, below = panels[:2]
    colours, looks = colours_of(result), looks_of(result)
    compared = [
        (result.states[one], result.states[other])
        for look in looks
        if look.strain is Strain.GREEN
        for one, other in look.pairs
    ]
    for state in (*references, *candidates):
        name = f"{state.label}, {STRAIN_NAMES[state.strain]}"
        style = _style(state, colours, compared)
        above.plot(*_path(state, point, axis), **style, label=name)
        if has_tools:
            _draw_forces(panels[2], state, name, style)
    # Of several candidates the truth's distances, which rounding errors would flatten.
    true = [pair for pair in compared if not _is_on_mesh(pair[1])] if len(colours) > 1 else []
    for candidate, reference in true or compared:
        _draw_error(below, candidate, reference, point, colours)
    above.set_ylabel("displacement [mm]")
    below.set_ylabel("error [mm]")
    below.set_yscale("linear" if true else "log")
    if has_tools:
        panels[2].set_ylabel("force on tool [N]")
    panels[-1].set_xlabel(f"time [s]{'; ' if is_page else chr(10)}at ({place}) mm along ({along})")
    for axes in panels:
        tidy(axes)
        # Lines of forces look as those of displacement: in a column the first legend tells them.
        is_told_above = not is_page and axes is not above and axes is not below
        if axes.get_legend_handles_labels()[0] and not is_told_above:
            axes.legend(
                frameon=False, fontsize=8 * size, ncols=columns,
                loc="lower center", bbox_to_anchor=(0.5, 0.98),
            )  # fmt: skip
    figure.tight_layout()
    return figure


def _is_on_mesh(reference: State) -> bool:
    """Whether a reference is that of the same mesh and steps, not the truth."""
    return reference.degree == 1


def _style(
    state: State, colours: Mapping[str, str], compared: Sequence[tuple[State, State]]
) -> dict[str, Any]:
    """Of a state's line: a candidate has its colour, with linear strain one of its own if alone.

    The truth is black; the reference on the same mesh is broad and grey, or, where there are
    several, of the colour of its candidate.
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


def _draw_forces(axes: mpl.axes.Axes, state: State, name: str, style: Mapping[str, Any]) -> None:
    """Size of the mean force on each tool from output to output."""
    forces = state.tool_forces
    if state.trajectory is None or forces is None or forces.ndim != 3:
        return
    for number, history in enumerate(np.linalg.norm(forces, axis=2), start=1):
        times = state.trajectory.times[1:]
        axes.plot(times, history[1:], **style, label=f"tool {number}, {name}")


def _path(state: State, point: int, axis: Points) -> tuple[Points, Points]:
    """Times [s] and displacement of the point along the axis [mm]."""
    assert state.trajectory is not None
    path: Points = _MILLI * state.trajectory.displacements[:, point] @ axis
    return state.trajectory.times, path


def _draw_error(
    axes: mpl.axes.Axes, state: State, other: State, point: int, colours: Mapping[str, str]
) -> None:
    assert state.trajectory is not None
    assert other.trajectory is not None
    ours, theirs = state.trajectory.displacements, other.trajectory.displacements
    apart = _MILLI * np.linalg.norm(ours[:, point] - theirs[:, point], axis=1)
    shown = np.where(apart > 0.0, apart, np.nan)
    label = f"to {other.label}" if len(colours) == 1 else f"{state.label} to {other.label}"
    line = "--" if _is_on_mesh(other) else "-"
    axes.plot(state.trajectory.times, shown, line, color=colours[state.label], lw=1.1, label=label)
