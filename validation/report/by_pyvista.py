"""Child process: pictures by pyvista, off-screen. Arguments: panels.pickle, folder, "png"."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyvista

from palpate.validation.report.scene import Marks, Panel, Surface, extent

_SIZE = (680, 780)
# Of each of many panels, whose words must be read when they stand side by side on a page.
_MANY, _SMALL = 4, (480, 560)
_EDGES = "#6e6660"


def main() -> None:
    """Draw NAME.png for each picture."""
    source, folder = Path(sys.argv[1]), Path(sys.argv[2])
    for name, panels in pickle.loads(source.read_bytes()).items():
        width, height = _size(panels)
        size = (width * len(panels), height)
        plotter = pyvista.Plotter(
            off_screen=True, shape=(1, len(panels)), window_size=size, border=False
        )
        plotter.enable_anti_aliasing("ssaa")
        plotter.enable_depth_peeling()
        for column, panel in enumerate(panels):
            plotter.subplot(0, column)
            _draw(plotter, panel, panels)
        plotter.screenshot(folder / f"{name}.png")
        plotter.close()


def _size(panels: Sequence[Panel]) -> tuple[int, int]:
    return _SIZE if len(panels) < _MANY else _SMALL


def _draw(plotter: Any, panel: Panel, panels: Sequence[Panel]) -> None:
    plotter.set_background("white")
    for surface in panel.surfaces:
        _add_surface(plotter, surface)
    for marks in panel.marks:
        _add_marks(plotter, marks)
    title = panel.title if len(panel.title) < 80 else panel.title[:77] + "..."
    height = _size(panels)[1]
    # At a place, not in a corner: words in corners shrink with the panel.
    where = {} if height == _SIZE[1] else {"position": (8, height - 32)}
    plotter.add_text(title, font_size=11 if not where else 10, color="black", **where)
    for row, (words, colour) in enumerate(panel.legend, 1):
        place = (6, height - 30 - 24 * row)
        plotter.add_text(words, position=place, font_size=10, color=colour)
    if panel.unit:
        titles = {f"{axis}title": f"{axis} [{panel.unit}]" for axis in "xyz"}
        numbers = {f"n_{axis}labels": 3 for axis in "xyz"}
        body = panel.surfaces[0].points
        plotter.show_bounds(
            bounds=_bounds(body.min(axis=0), body.max(axis=0)),
            location="outer", font_size=9, fmt="%.4g", color="#444444", **titles, **numbers,
        )  # fmt: skip
    plotter.add_axes(color="black", line_width=3)
    # Along y the body stands upright; looked at from above, y points up.
    up = (0.0, 1.0, 0.0) if abs(panel.side[2]) > 0.9 else (0.0, 0.0, 1.0)
    plotter.enable_parallel_projection()
    plotter.view_vector(panel.side, up, render=False)
    plotter.reset_camera(render=False, bounds=_bounds(*extent(panels)))


def _bounds(low: Any, high: Any) -> list[float]:
    return [float(value) for pair in zip(low, high, strict=True) for value in pair]


def _add_surface(plotter: Any, surface: Surface) -> None:
    body = pyvista.PolyData.from_regular_faces(surface.points, surface.facets)
    if surface.is_wireframe:
        wires = plotter.add_mesh(
            body, style="wireframe", color=surface.colour, opacity=surface.opacity, line_width=1.5
        )
        # Before the facets in whose plane they lie.
        wires.mapper.SetResolveCoincidentTopologyToPolygonOffset()
        wires.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(-2.0, -2.0)
        wires.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(-2.0, -2.0)
        return
    if surface.values is None:
        look: dict[str, Any] = {"color": surface.colour}
    else:
        body[surface.values_name] = surface.values
        look = {
            "scalars": surface.values_name,
            "cmap": surface.colours,
            "clim": (0.0, surface.largest),
            "scalar_bar_args": _bar(surface.values_name),
        }
    look["ambient"] = 0.25
    if surface.opacity == 1.0:
        look |= {"show_edges": True, "edge_color": _EDGES, "line_width": 0.6}
    plotter.add_mesh(body, opacity=surface.opacity, **look)


def _add_marks(plotter: Any, marks: Marks) -> None:
    if marks.is_path:
        if np.ptp(marks.points, axis=0).any():
            lines = pyvista.lines_from_points(marks.points)
            plotter.add_mesh(lines, color=marks.colour, line_width=3)
        return
    if marks.vectors is None:
        plotter.add_points(
            marks.points, color=marks.colour, point_size=16, render_points_as_spheres=True
        )
        return
    for start, arrow in zip(marks.points, marks.vectors, strict=True):
        length = float(np.linalg.norm(arrow))
        if length > 0.0:
            shape = pyvista.Arrow(
                start, arrow, scale=length, tip_length=0.3, tip_radius=0.1, shaft_radius=0.035
            )
            plotter.add_mesh(shape, color=marks.colour, ambient=0.4)


def _bar(title: str) -> dict[str, Any]:
    """A colour bar below the body, clear of it."""
    places = {"position_x": 0.2, "position_y": 0.03, "width": 0.6, "height": 0.09}
    fonts = {"title_font_size": 18, "label_font_size": 15, "n_labels": 4, "fmt": "%.3g"}
    return {"title": f"{title}\n", "vertical": False, "color": "black", **places, **fonts}


if __name__ == "__main__":
    main()
