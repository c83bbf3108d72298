"""A motion over time, where the reference swings most: candidate, references, and what is apart."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Strain
from palpate.validation.judging.results import CaseResult
from palpate.validation.metrics.motion import swinging_most
from palpate.validation.report.plots import figure_svg, plot_style, tidy
from palpate.validation.states import State

_MILLI = 1e3


def motion_svg(result: CaseResult) -> str:
    """Displacement over time and its error as SVG text; empty where nothing moves over time."""
    moving = [state for state in result.states if state.trajectory is not None]
    references = [s for s in moving if s.is_reference and s.strain is Strain.GREEN]
    candidates = [s for s in moving if not s.is_reference]
    if not candidates:
        return ""
    # The truth, where there is one, says where to look.
    leading = sorted(references, key=_is_on_mesh) or candidates
    assert leading[0].trajectory is not None
    point, axis = swinging_most(leading[0].trajectory)
    place = ", ".join(f"{x * _MILLI:.4g}" for x in result.problem.mesh.points[point])
    along = ", ".join(f"{a:.2f}" for a in axis)
    has_tools = bool(result.problem.tools)
    with plot_style():
        figure, panels = pyplot.subplots(
            2 + has_tools, 1, figsize=(8.4, 4.6 + 1.9 * has_tools), sharex=True,
            height_ratios=(2, 1, 1.4)[: 2 + has_tools],
        )  # fmt: skip
        above, below = panels[:2]
        for state in (*references, *candidates):
            name = f"{state.label}, {'Green' if state.strain is Strain.GREEN else 'linear'} strain"
            above.plot(*_path(state, point, axis), **_look(state), label=name)
            if has_tools:
                _draw_forces(panels[2], state, name)
            for other in references if not state.is_reference else ():
                if state.strain is Strain.GREEN:
                    _draw_error(below, state, other, point)
        above.set_ylabel("displacement [mm]")
        below.set_ylabel("error [mm]")
        below.set_yscale("log")
        if has_tools:
            panels[2].set_ylabel("force on tool [N]")
        panels[-1].set_xlabel(f"time [s]; at ({place}) mm along ({along})")
        for axes in panels:
            tidy(axes)
            if axes.get_legend_handles_labels()[0]:
                axes.legend(
                    frameon=False, fontsize=8, ncols=4,
                    loc="lower center", bbox_to_anchor=(0.5, 0.98),
                )  # fmt: skip
        figure.tight_layout()
        return figure_svg(figure)


def _is_on_mesh(reference: State) -> bool:
    """Whether a reference is that of the same mesh and steps, not the truth."""
    return reference.degree == 1


def _look(state: State) -> dict[str, Any]:
    """Of a state's line: the reference on the same mesh is broad and grey, the truth black."""
    if state.is_reference:
        is_on_mesh = _is_on_mesh(state)
        colour, width = ("#888888", 3.0) if is_on_mesh else ("black", 1.6)
        return {"color": colour, "lw": width, "alpha": 0.6 if is_on_mesh else 1.0}
    colour, line = ("#2f6f8f", "-") if state.strain is Strain.GREEN else ("#c98a12", "--")
    return {"color": colour, "lw": 1.3, "ls": line}


def _draw_forces(axes: mpl.axes.Axes, state: State, name: str) -> None:
    """Size of the mean force on each tool from output to output."""
    forces = state.tool_forces
    if state.trajectory is None or forces is None or forces.ndim != 3:
        return
    for number, history in enumerate(np.linalg.norm(forces, axis=2), start=1):
        times = state.trajectory.times[1:]
        axes.plot(times, history[1:], **_look(state), label=f"tool {number}, {name}")


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
    colour = "#888888" if _is_on_mesh(other) else "black"
    shown = np.where(apart > 0.0, apart, np.nan)
    axes.plot(state.trajectory.times, shown, color=colour, lw=1.1, label=f"to {other.label}")
