"""What stands around a body in a report: rigid tools where they are, loads as arrows."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.problem import Problem
from palpate.meshes.rigid_tool import RigidTool
from palpate.validation.report.acting import acting
from palpate.validation.report.picture import force_arrows, spring_arrow, tool_surface
from palpate.validation.report.scene import OCHRE, Surface

_MILLI = 1e3


def tools_around(
    problem: Problem, centre: Points, times: Points | None
) -> list[tuple[Points, Indices, Points]]:
    """Each tool that follows a path, in millimetres from a centre.

    A tool that a force drives is left out: its place is part of the answer, and not stored.

    Args:
        problem: With the tools.
        centre: Of the view [mm], (3,).
        times: Stored times of a motion [s]; None for a state at rest, at the end of the path.

    Returns:
        Points in the tool's frame (n, 3), facets (m, 3), and of each time the rotation matrix's
        nine numbers row by row and the place (num_times, 12).
    """
    reach = float(np.ptp(problem.mesh.points, axis=0).max())
    found = []
    for tool in problem.tools:
        if tool.drive is None:
            own, facets = tool_surface(tool, reach)
            found.append((own * _MILLI, facets, _poses(tool, centre, times)))
    return found


def tools_placed(problem: Problem, *, at_end: bool) -> list[Surface]:
    """The same tools as see-through surfaces of a picture [mm], where they start or end."""
    everything = tools_around(problem, np.zeros(3), None)
    placed = [tool for tool in problem.tools if tool.drive is None]
    found = []
    for (points, facets, last), tool in zip(everything, placed, strict=True):
        pose = last if at_end else _poses(tool, np.zeros(3), np.array(tool.path.times[:1]))
        turn, place = pose[0, :9].reshape(3, 3), pose[0, 9:]
        surface = Surface(points @ turn.T + place, facets, OCHRE, opacity=0.35, is_beside=True)
        found.append(surface)
    return found


def _poses(tool: RigidTool, centre: Points, times: Points | None) -> Points:
    shown = [tool.path.times[-1]] if times is None else times
    poses = [tool.path.pose_at(float(time)) for time in shown]
    return np.array([[*turn.ravel(), *(place * _MILLI - centre)] for place, turn in poses])


def arrows_around(problem: Problem, centre: Points) -> Points:
    """Loads and the ways of springs' anchors as starts and vectors [mm], (num_arrows, 2, 3)."""
    points, scale = problem.mesh.points * _MILLI, 1.0 / _MILLI
    marks = [spring_arrow(spring, points, scale) for spring in problem.springs]
    if problem.loads:
        loads = [acting(problem, load) for load in problem.loads]
        marks.append(force_arrows(points, loads, scale))
    pairs: list[Any] = [
        np.stack([mark.points - centre, mark.vectors], axis=1)
        for mark in marks
        if mark.vectors is not None
    ]
    return np.concatenate(pairs) if pairs else np.zeros((0, 2, 3))
