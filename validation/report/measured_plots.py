"""Markers where they were measured and where they were computed, on the body seen from its side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.case.units import LENGTH
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.plots import BLUE, COLOURS, RED, Figure, Line, Panel, line_figure

_CAPTION = (
    "Markers where they were measured and where they were computed{}, seen along the axis in which "
    "they move least. Grey lines lead there from where the markers were at first."
)


def marker_panel(
    mesh: TetMesh,
    size: float,
    unit: str,
    positions: Points,
    measured: Points,
    computed: Mapping[str, Points],
    title: str,
) -> Panel:
    """Motions of markers beside one another.

    Args:
        mesh: The body at rest.
        size: A unit of length in metres.
        unit: Its name, of all that follows.
        positions: Of the markers at rest, shape (n, 3).
        measured: Their motion, shape (n, 3).
        computed: The same by each of several, with its name.
        title: Of the panel.
    """
    least = int(np.argmin(np.abs(measured).max(axis=0)))
    across, up = (axis for axis in range(3) if axis != least)
    surface = mesh.points[np.unique(mesh.boundary_facets)]
    span = float(np.ptp(surface[:, least]))
    side = surface[surface[:, least] <= surface[:, least].min() + 1e-6 * span] / size
    if len(side) < 3:  # no plane side: all of the surface
        side = surface / size

    def dots(points: Points, label: str, style: str, colour: str) -> Line:
        return Line(points[:, across], points[:, up], label, style, colour)

    ways = [
        Line([a[across], b[across]], [a[up], b[up]], "", "-", "#999999")
        for a, b in zip(positions, positions + measured, strict=True)
    ]
    colours = [BLUE, *COLOURS[2:]]
    return Panel(
        [
            dots(side, "side of the body at rest", ".", "#cccccc"),
            *ways,
            *(
                dots(positions + moved, f"computed, {name}" if name else "computed", "o", colour)
                for (name, moved), colour in zip(computed.items(), colours, strict=False)
            ),
            dots(positions + measured, "measured", "x", RED),
        ],
        x=f"{'xyz'[across]} [{unit}]",
        y=f"{'xyz'[up]} [{unit}]",
        title=title,
        is_to_scale=True,
    )


def marker_figure(panels: Sequence[Panel], by_whom: str = "") -> Figure:
    """Panels of markers side by side."""
    return line_figure([panels], _CAPTION.format(by_whom), shares_legend=True)


def measured_figure(result: CaseResult) -> Figure | None:
    """Every measurement of markers of a judged case; None where it has none."""
    known = [values for values in result.measured if len(values.positions)]
    if not known:
        return None
    panels = []
    for name in dict.fromkeys(values.name for values in known):
        alike = [values for values in known if values.name == name]
        first = alike[0]
        panels.append(
            marker_panel(
                result.problem.mesh,
                LENGTH[first.unit],
                first.unit,
                first.positions,
                first.measured.reshape(-1, 3),
                {values.candidate: values.computed.reshape(-1, 3) for values in alike},
                name,
            )
        )
    return marker_figure(panels)
