"""Child process: plainer pictures, where VTK cannot draw, and those for a paper.

Arguments: panels.pickle, folder, form ("png", "pdf" or "svg").
"""

from __future__ import annotations

import pickle
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from mpl_toolkits.mplot3d import proj3d
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from palpate.validation.report.scene import Marks, Panel, Surface, extent

_LIGHT = np.array([0.3, -0.5, 0.8])
# Facets above this are drawn as pixels within a vector figure: no reader opens megabytes of them.
_MOST_FACETS = 20_000


@dataclass(frozen=True)
class _Size:
    """Of a picture: inches of a panel, points of its text, of lines, and pixels to an inch."""

    wide: float
    high: float
    font: float
    line: float
    dpi: int

    @property
    def row(self) -> float:
        """Height of a letter in parts of the picture's."""
        return self.font / (72.0 * self.high)


_SCREEN = _Size(6.2, 7.0, 10.0, 1.0, 110)


def _on_paper(num_panels: int) -> _Size:
    """One column is 88 mm wide, two are 180."""
    wide = 3.46 if num_panels == 1 else 7.09 / num_panels
    return _Size(wide, max(1.25 * wide, 2.2), 7.0 if num_panels < 4 else 6.0, 0.5, 300)


def main() -> None:
    """Draw NAME.png, NAME.pdf or NAME.svg for each picture."""
    mpl.use("Agg")
    from matplotlib import patches, pyplot

    source, folder, form = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]
    # Text stays text: a font that is embedded, or the reader's own.
    mpl.rcParams |= {"pdf.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": "palpate"}
    for name, panels in pickle.loads(source.read_bytes()).items():
        size = _SCREEN if form == "png" else _on_paper(len(panels))
        mpl.rcParams["font.size"] = size.font
        figure = pyplot.figure(figsize=(size.wide * len(panels), size.high), dpi=size.dpi)
        for column, panel in enumerate(panels):
            if _has_axes(panels):  # with room for their numbers
                axes = figure.add_subplot(1, len(panels), column + 1, projection="3d")
            else:
                left, wide = column / len(panels), 1.0 / len(panels)
                place = (left, 6.0 * size.row, wide, 1.0 - 9.5 * size.row)
                axes = figure.add_axes(place, projection="3d")
            _draw(axes, panel, panels, size)
        words = [entry for panel in panels for entry in panel.legend]
        if words:
            handles = [patches.Patch(color=colour, label=label) for label, colour in words]
            figure.legend(handles=handles, loc="lower center", ncols=len(handles), frameon=False)
        date = {"pdf": "CreationDate", "svg": "Date"}.get(form)
        figure.savefig(folder / f"{name}.{form}", metadata={date: None} if date else None)
        pyplot.close(figure)


def _draw(axes: Any, panel: Panel, panels: Sequence[Panel], size: _Size) -> None:
    axes.set_proj_type("ortho")
    # One collection: only within one are triangles sorted by depth.
    seen = [_seen(part, None if _has_axes(panels) else panel.side) for part in panel.surfaces]
    faces = np.concatenate(
        [part.points[rows] for part, rows in zip(panel.surfaces, seen, strict=True)]
    )
    paints = np.vstack(
        [_paint(part, rows) for part, rows in zip(panel.surfaces, seen, strict=True)]
    )
    edges = np.concatenate(
        [
            np.full(len(rows), part.colour if part.is_wireframe else "#6e6660")
            for part, rows in zip(panel.surfaces, seen, strict=True)
        ]
    )
    colours = mpl.colors.to_rgba_array(edges, 0.4)
    body = Poly3DCollection(faces, facecolor=paints, edgecolor=colours, linewidth=0.2 * size.line)
    body.set_rasterized(len(faces) > _MOST_FACETS)
    axes.add_collection3d(body)
    for marks in panel.marks:
        _add_marks(axes, marks, size.line)
    low, high = extent(panels)
    for axis, a, b in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{axis}lim")(a, b)
        getattr(axes, f"set_{axis}label")(f"{axis} [{panel.unit}]", fontsize=0.9 * size.font)
        getattr(axes, f"{axis}axis").set_major_locator(mpl.ticker.MaxNLocator(4))
    sides = tuple(np.maximum(high - low, 1e-9))
    axes.set_box_aspect(sides)
    axes.tick_params(labelsize=0.8 * size.font)
    if not panel.unit:
        axes.set_axis_off()
    x, y, z = panel.side
    height, azimuth = np.degrees([np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)])
    axes.view_init(elev=float(height), azim=float(azimuth))
    if not _has_axes(panels):
        axes.set_box_aspect(sides, zoom=_zoom(axes, panels))
    letters = int(size.wide * 72.0 / (0.62 * size.font))
    axes.set_title("\n".join(textwrap.wrap(panel.title, letters)), fontsize=size.font)
    for part in panel.surfaces:
        if part.values is not None:
            scale = mpl.cm.ScalarMappable(mpl.colors.Normalize(0.0, part.largest), part.colours)
            above = axes.get_position()
            left, wide = above.x0 + 0.22 * above.width, 0.56 * above.width
            below = axes.figure.add_axes((left, 4.6 * size.row, wide, size.row))
            bar = axes.figure.colorbar(scale, cax=below, orientation="horizontal")
            bar.set_label(part.values_name.strip())
            bar.locator = mpl.ticker.MaxNLocator(3)
            bar.formatter = lambda value, _place: f"{value:.3g}"
            bar.solids.set(rasterized=False, edgecolor="face")
            bar.outline.set_linewidth(0.5 * size.line)
            bar.ax.tick_params(width=0.5 * size.line)
            bar.update_ticks()


def _zoom(axes: Any, panels: Sequence[Panel]) -> float:
    """What makes all that is drawn fill the axes: matplotlib's own leaves half of them empty."""
    points = np.vstack([panel.reached for panel in panels])
    low, high = extent(panels)
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    tools = any(part.is_beside for panel in panels for part in panel.surfaces)
    x, y, _ = proj3d.proj_transform(*(corners if tools else points).T, axes.get_proj())
    limits = axes.viewLim
    fills = [np.abs(x - 0.5 * (limits.x0 + limits.x1)).max() / (0.5 * limits.width)]
    fills.append(np.abs(y - 0.5 * (limits.y0 + limits.y1)).max() / (0.5 * limits.height))
    return float(0.97 / max(fills))


def _has_axes(panels: Sequence[Panel]) -> bool:
    """Whether it is the picture of a case, with sizes; there tools may be planes of two sides."""
    return any(panel.unit for panel in panels)


def _seen(surface: Surface, side: tuple[float, float, float] | None) -> Any:
    """Facets that face the eye; without a side, and of what one sees through, all."""
    if surface.is_wireframe or surface.opacity < 1.0 or side is None:
        return surface.facets
    a, b, c = (surface.points[surface.facets[:, k]] for k in range(3))
    return surface.facets[np.cross(b - a, c - a) @ np.array(side) > 0.0]


def _paint(surface: Surface, rows: Any) -> Any:
    """Colour of each of these facets, shaded, (num_facets, 4)."""
    corners = surface.points[rows]
    if surface.is_wireframe:
        return np.zeros((len(corners), 4))
    if surface.values is not None:
        shown = surface.values[rows].mean(axis=1) / (surface.largest or 1.0)
        return mpl.colormaps[surface.colours](shown)
    paint = np.tile(mpl.colors.to_rgba(surface.colour, surface.opacity), (len(corners), 1))
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    paint[:, :3] *= (0.8 + 0.2 * (normals @ _LIGHT) / lengths)[:, None]
    return paint


def _add_marks(axes: Any, marks: Marks, line: float) -> None:
    if marks.is_path:
        axes.plot(*marks.points.T, color=marks.colour, lw=1.5 * line)
    elif marks.vectors is None:
        axes.scatter(*marks.points.T, color=marks.colour, s=50 * line**2)
    else:
        for start, arrow in zip(marks.points, marks.vectors, strict=True):
            axes.quiver(*start, *arrow, color=marks.colour, lw=2.5 * line, arrow_length_ratio=0.3)


if __name__ == "__main__":
    main()
