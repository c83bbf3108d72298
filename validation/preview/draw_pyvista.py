"""Child process: a case by pyvista, off-screen, from two sides. Arguments: fields.npz, folder."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

BODY, HELD, PUSHED, TOOL = "#e3d9d0", "#30558f", "#b5332e", "#c98a12"
_SIZE = (1500, 800)


def main() -> None:
    """Draw case.png."""
    import pyvista

    with np.load(sys.argv[1]) as stored:
        fields = {name: stored[name] for name in stored.files}
    points = fields["points"]
    low, high = points.min(axis=0), points.max(axis=0)
    reach = float((high - low).max())
    everything = [points, fields["starts"] + fields["arrows"], fields["starts"]]
    for number in range(int(fields["num_tools"])):
        everything += [fields[f"tool_{number}_start"], fields[f"tool_{number}_end"]]
    seen = np.vstack(everything)
    plotter = pyvista.Plotter(off_screen=True, shape=(1, 2), window_size=_SIZE, border=False)
    plotter.enable_anti_aliasing("ssaa")
    plotter.enable_depth_peeling()
    for column, side in enumerate(((1.0, -1.3, 0.7), (-1.0, 1.3, -0.7))):
        plotter.subplot(0, column)
        plotter.set_background("white")
        _draw(pyvista, plotter, fields, reach)
        _axes(plotter, fields, low, high, is_labelled=column == 0)
        _look(plotter, seen, np.array(side))
    plotter.subplot(0, 0)
    title = str(fields["title"])
    plotter.add_text(title if len(title) < 80 else title[:77] + "...", font_size=11, color="black")
    size = " x ".join(f"{side:.4g}" for side in high - low)
    plotter.subplot(0, 1)
    plotter.add_text(
        f"{size} {fields['unit']}, from the other side and below", font_size=11, color="black"
    )
    plotter.subplot(0, 0)
    _legend(plotter, fields)
    plotter.screenshot(Path(sys.argv[2]) / "case.png")
    plotter.close()


def _draw(pyvista: Any, plotter: Any, fields: dict[str, Any], reach: float) -> None:
    points = fields["points"]
    kinds = {tuple(row): BODY for row in np.sort(fields["facets"], axis=1).tolist()}
    for name, colour in (("pushed", PUSHED), ("held", HELD)):
        kinds |= dict.fromkeys(map(tuple, np.sort(fields[name], axis=1).tolist()), colour)
    colours = [kinds[tuple(row)] for row in np.sort(fields["facets"], axis=1).tolist()]
    for colour in (BODY, PUSHED, HELD):
        part = fields["facets"][[c == colour for c in colours]]
        if len(part):
            plotter.add_mesh(
                pyvista.PolyData.from_regular_faces(points, part),
                color=colour,
                show_edges=True,
                edge_color="#6e6660",
                line_width=0.6,
                ambient=0.25,
            )
    if len(fields["held_points"]):
        plotter.add_points(
            fields["held_points"], color=HELD, point_size=16, render_points_as_spheres=True
        )
    for start, arrow in zip(fields["starts"], fields["arrows"], strict=True):
        length = float(np.linalg.norm(arrow))
        if length > 0.0:
            shape = pyvista.Arrow(
                start, arrow, scale=length, tip_length=0.3, tip_radius=0.1, shaft_radius=0.035
            )
            plotter.add_mesh(shape, color=PUSHED, ambient=0.4)
    for number in range(int(fields["num_tools"])):
        facets = fields[f"tool_{number}_facets"]
        for name, opacity in (("start", 0.35), ("end", 1.0)):
            tool = pyvista.PolyData.from_regular_faces(fields[f"tool_{number}_{name}"], facets)
            plotter.add_mesh(tool, color=TOOL, opacity=opacity)
        path = fields[f"tool_{number}_path"]
        if np.ptp(path, axis=0).max() > 1e-9 * reach:
            plotter.add_mesh(pyvista.lines_from_points(path), color="black", line_width=3)


def _axes(plotter: Any, fields: dict[str, Any], low: Any, high: Any, *, is_labelled: bool) -> None:
    """Extents of the body with numbers, and which way x, y and z point."""
    if is_labelled:
        unit = fields["unit"]
        plotter.show_bounds(
            bounds=[float(v) for pair in zip(low, high, strict=True) for v in pair],
            xtitle=f"x [{unit}]",
            ytitle=f"y [{unit}]",
            ztitle=f"z [{unit}]",
            location="outer",
            font_size=9,
            n_xlabels=3,
            n_ylabels=3,
            n_zlabels=3,
            fmt="%.4g",
            color="#444444",
        )
    plotter.add_axes(color="black", line_width=3)


def _look(plotter: Any, seen: Any, side: Any) -> None:
    low, high = seen.min(axis=0), seen.max(axis=0)
    centre, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    side /= np.linalg.norm(side)
    place = centre + side * radius * 4.4
    plotter.camera_position = [tuple(place), tuple(centre), (0.0, 0.0, 1.0)]
    plotter.camera.clipping_range = (0.1 * radius, 20.0 * radius)


def _legend(plotter: Any, fields: dict[str, Any]) -> None:
    entries = []
    if len(fields["held"]) or len(fields["held_points"]):
        entries.append(("held", HELD))
    if len(fields["starts"]):
        entries.append(("pushed or pulled; an arrow is the whole force of a load", PUSHED))
    if int(fields["num_tools"]):
        entries.append(("tool, pale where it starts", TOOL))
    for row, (text, colour) in enumerate(entries, 1):
        plotter.add_text(text, position=(6, _SIZE[1] - 30 - 24 * row), font_size=10, color=colour)


if __name__ == "__main__":
    main()
