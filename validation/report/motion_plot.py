"""A motion over time, where the reference swings most: candidate, references, and what is apart."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Strain
from palpate.validation.judging.results import CaseResult
from palpate.validation.metrics.motion import swinging_most
from palpate.validation.states import State

_MILLI = 1e3


def motion_svg(result: CaseResult) -> str:
    """Displacement over time and its error as SVG text; empty where nothing moves over time."""
    from matplotlib import pyplot

    from palpate.validation.report.plots import figure_svg

    moving = [state for state in result.states if state.trajectory is not None]
    references = [s for s in moving if s.is_reference and s.strain is Strain.GREEN]
    candidates = [s for s in moving if not s.is_reference]
    if not candidates:
        return ""
    # The truth, where there is one, says where to look.
    leading = sorted(references, key=_is_twin) or candidates
    assert leading[0].trajectory is not None
    point, axis = swinging_most(leading[0].trajectory)
    place = ", ".join(f"{x * _MILLI:.4g}" for x in result.problem.mesh.points[point])
    along = ", ".join(f"{a:.2f}" for a in axis)
    with mpl.rc_context({"font.size": 10, "svg.fonttype": "none", "font.family": "sans-serif"}):
        has_tools = bool(result.problem.tools)
        figure, panels = pyplot.subplots(
            2 + has_tools, 1, figsize=(8.4, 4.6 + 1.9 * has_tools), sharex=True,
            height_ratios=(2, 1, 1.4)[: 2 + has_tools],
        )  # fmt: skip
        above, below = panels[:2]
        if has_tools:
            for state in (*references, *candidates):
                _draw_forces(panels[2], state)
            panels[2].set_ylabel("force on tool [N]")
        for state in references:
            is_twin = _is_twin(state)
            times, path = _path(state, point, axis)
            above.plot(
                times, path, color="#888888" if is_twin else "black", lw=3.0 if is_twin else 1.6,
                alpha=0.6 if is_twin else 1.0, label=f"{state.label}, Green strain",
            )  # fmt: skip
        for state in candidates:
            is_green = state.strain is Strain.GREEN
            times, path = _path(state, point, axis)
            name = f"{state.label}, {'Green' if is_green else 'linear'} strain"
            colour = "#2f6f8f" if is_green else "#c98a12"
            above.plot(times, path, color=colour, lw=1.3, ls="-" if is_green else "--", label=name)
            if is_green:
                for other in references:
                    _draw_error(below, state, other, point)
        above.set_ylabel("displacement [mm]")
        below.set_ylabel("error [mm]")
        panels[-1].set_xlabel(f"time [s]; at ({place}) mm along ({along})")
        below.set_yscale("log")
        for axes in panels:
            axes.grid(color="#dddddd", lw=0.6)
            for side in ("top", "right"):
                axes.spines[side].set_visible(False)
            if axes.get_legend_handles_labels()[0]:
                axes.legend(
                    frameon=False, fontsize=8, ncols=4,
                    loc="lower center", bbox_to_anchor=(0.5, 0.98),
                )  # fmt: skip
        figure.tight_layout()
        return figure_svg(figure)


def _is_twin(reference: State) -> bool:
    """Whether a reference is that of the same mesh and steps, not the truth."""
    return reference.degree == 1


def _draw_forces(axes: mpl.axes.Axes, state: State) -> None:
    """Size of the mean force on each tool from output to output."""
    forces = state.tool_forces
    if state.trajectory is None or forces is None or forces.ndim != 3:
        return
    is_green = state.strain is Strain.GREEN
    if state.is_reference:
        style: dict[str, Any] = {"color": "#888888", "lw": 3.0, "alpha": 0.6}
    else:
        colour = "#2f6f8f" if is_green else "#c98a12"
        style = {"color": colour, "lw": 1.3, "ls": "-" if is_green else "--"}
    for number, history in enumerate(np.linalg.norm(forces, axis=2), start=1):
        axes.plot(
            state.trajectory.times[1:], history[1:], **style,
            label=f"tool {number}, {state.label}, {'Green' if is_green else 'linear'} strain",
        )  # fmt: skip


def _path(state: State, point: int, axis: Points) -> tuple[Points, Points]:
    """Times [s] and displacement of the point along the axis [mm]."""
    assert state.trajectory is not None
    path: Points = _MILLI * state.trajectory.displacements[:, point] @ axis
    return state.trajectory.times, path


def _draw_error(axes: mpl.axes.Axes, state: State, other: State, point: int) -> None:
    assert state.trajectory is not None
    assert other.trajectory is not None
    ours, theirs = state.trajectory.displacements, other.trajectory.displacements
    if ours.shape != theirs.shape:
        return
    apart = _MILLI * np.linalg.norm(ours[:, point] - theirs[:, point], axis=1)
    colour = "#888888" if _is_twin(other) else "black"
    shown = np.where(apart > 0.0, apart, np.nan)
    axes.plot(state.trajectory.times, shown, color=colour, lw=1.1, label=f"to {other.label}")
