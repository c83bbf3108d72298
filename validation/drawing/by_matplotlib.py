"""Child process: plainer pictures, where VTK cannot draw. Arguments: panels.pickle, folder."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from palpate.validation.drawing.scene import Marks, Panel, Surface, extent

_LIGHT = np.array([0.3, -0.5, 0.8])


def main() -> None:
    """Draw NAME.png for each picture."""
    mpl.use("Agg")
    from matplotlib import patches, pyplot

    source, folder = Path(sys.argv[1]), Path(sys.argv[2])
    for name, panels in pickle.loads(source.read_bytes()).items():
        figure = pyplot.figure(figsize=(6.2 * len(panels), 7.0), dpi=110)
        for column, panel in enumerate(panels):
            axes = figure.add_subplot(1, len(panels), column + 1, projection="3d")
            _draw(axes, panel, panels)
        words = [entry for panel in panels for entry in panel.legend]
        if words:
            handles = [patches.Patch(color=colour, label=label) for label, colour in words]
            figure.legend(handles=handles, loc="lower center", ncols=len(handles), frameon=False)
        figure.savefig(folder / f"{name}.png")


def _draw(axes: Any, panel: Panel, panels: Sequence[Panel]) -> None:
    # One collection: only within one are triangles sorted by depth.
    faces = np.concatenate([part.points[part.facets] for part in panel.surfaces])
    paints = np.vstack([_paint(part) for part in panel.surfaces])
    edges = np.concatenate(
        [np.full(len(p.facets), p.colour if p.is_wireframe else "#6e6660") for p in panel.surfaces]
    )
    colours = mpl.colors.to_rgba_array(edges, 0.4)
    axes.add_collection3d(
        Poly3DCollection(faces, facecolor=paints, edgecolor=colours, linewidth=0.2)
    )
    for marks in panel.marks:
        _add_marks(axes, marks)
    low, high = extent(panels)
    for axis, a, b in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{axis}lim")(a, b)
        getattr(axes, f"set_{axis}label")(f"{axis} [{panel.unit}]", fontsize=9)
        getattr(axes, f"{axis}axis").set_major_locator(mpl.ticker.MaxNLocator(4))
    axes.set_box_aspect(tuple(np.maximum(high - low, 1e-9)))
    axes.tick_params(labelsize=8)
    if not panel.unit:
        axes.set_axis_off()
    x, y, z = panel.side
    height, azimuth = np.degrees([np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)])
    axes.view_init(elev=float(height), azim=float(azimuth))
    axes.set_title(panel.title, fontsize=10)


def _paint(surface: Surface) -> Any:
    """Colour of each facet, shaded, (num_facets, 4)."""
    corners = surface.points[surface.facets]
    if surface.is_wireframe:
        return np.zeros((len(corners), 4))
    if surface.values is not None:
        shown = surface.values[surface.facets].mean(axis=1) / (surface.largest or 1.0)
        return mpl.colormaps[surface.colours](shown)
    paint = np.tile(mpl.colors.to_rgba(surface.colour, surface.opacity), (len(corners), 1))
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    paint[:, :3] *= (0.8 + 0.2 * (normals @ _LIGHT) / lengths)[:, None]
    return paint


def _add_marks(axes: Any, marks: Marks) -> None:
    if marks.is_path:
        axes.plot(*marks.points.T, color=marks.colour, lw=1.5)
    elif marks.vectors is None:
        axes.scatter(*marks.points.T, color=marks.colour, s=50)
    else:
        for start, arrow in zip(marks.points, marks.vectors, strict=True):
            axes.quiver(*start, *arrow, color=marks.colour, lw=2.5, arrow_length_ratio=0.3)


if __name__ == "__main__":
    main()
