"""Child process: a case by matplotlib, where VTK cannot draw. Arguments: fields.npz, folder."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from palpate.validation.preview.draw_pyvista import BODY, HELD, PUSHED, TOOL


def main() -> None:
    """Draw case.png."""
    mpl.use("Agg")
    from matplotlib import patches, pyplot

    with np.load(sys.argv[1]) as stored:
        fields = {name: stored[name] for name in stored.files}
    figure = pyplot.figure(figsize=(13, 7), dpi=110)
    for column, (azimuth, height) in enumerate(((-52, 25), (128, -25))):
        axes = figure.add_subplot(1, 2, column + 1, projection="3d")
        _draw(axes, fields)
        axes.view_init(elev=height, azim=azimuth)
        axes.set_title("" if column == 0 else "from the other side and below", fontsize=10)
    figure.suptitle(str(fields["title"]), fontsize=11)
    entries = [("held", HELD), ("pushed or pulled; an arrow is the whole force of a load", PUSHED)]
    if int(fields["num_tools"]):
        entries.append(("tool, pale where it starts", TOOL))
    handles = [patches.Patch(color=colour, label=label) for label, colour in entries]
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), frameon=False)
    figure.savefig(Path(sys.argv[2]) / "case.png")


def _draw(axes: Any, fields: dict[str, Any]) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    points, unit = fields["points"], fields["unit"]
    marked: dict[Any, str] = {}
    for name, colour in (("pushed", PUSHED), ("held", HELD)):
        marked |= dict.fromkeys(map(tuple, np.sort(fields[name], axis=1).tolist()), colour)
    rows = np.sort(fields["facets"], axis=1).tolist()
    colours = mpl.colors.to_rgba_array([marked.get(tuple(row), BODY) for row in rows])
    corners = points[fields["facets"]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    light = normals @ np.array([0.3, -0.5, 0.8]) / np.linalg.norm(normals, axis=1)
    colours[:, :3] *= (0.8 + 0.2 * light)[:, None]
    # One collection: only within one are triangles sorted by depth.
    faces, paints = [corners], [colours]
    reached = [points, fields["starts"], fields["starts"] + fields["arrows"]]
    for number in range(int(fields["num_tools"])):
        facets = fields[f"tool_{number}_facets"]
        for name, alpha in (("start", 0.3), ("end", 0.9)):
            placed = fields[f"tool_{number}_{name}"]
            faces.append(placed[facets])
            paints.append(np.tile(mpl.colors.to_rgba(TOOL, alpha), (len(facets), 1)))
            reached.append(placed)
        axes.plot(*fields[f"tool_{number}_path"].T, color="black", lw=1.5)
    for start, arrow in zip(fields["starts"], fields["arrows"], strict=True):
        axes.quiver(*start, *arrow, color=PUSHED, lw=2.5, arrow_length_ratio=0.3)
    if len(fields["held_points"]):
        axes.scatter(*fields["held_points"].T, color=HELD, s=50)
    axes.add_collection3d(
        Poly3DCollection(
            np.concatenate(faces), facecolor=np.vstack(paints), edgecolor="#6e666060", linewidth=0.2
        )
    )
    seen = np.vstack(reached)
    low, high = seen.min(axis=0), seen.max(axis=0)
    for axis, a, b in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{axis}lim")(a, b)
        getattr(axes, f"set_{axis}label")(f"{axis} [{unit}]", fontsize=9)
        getattr(axes, f"{axis}axis").set_major_locator(mpl.ticker.MaxNLocator(4))
    axes.set_box_aspect(tuple(np.maximum(high - low, 1e-9)))
    axes.tick_params(labelsize=8)


if __name__ == "__main__":
    main()
