"""Child process: plainer pictures by matplotlib, where VTK cannot draw."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

from palpate.validation.report.pictures import GREEN, GREY, view_axis


def main() -> None:
    """Draw states.png."""
    mpl.use("Agg")
    from matplotlib import pyplot
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    source, folder = Path(sys.argv[1]), Path(sys.argv[2])
    with np.load(source) as stored:
        fields = {name: stored[name] for name in stored.files}
    points, facets = fields["points"], fields["facets"]
    strains = [s for s in ("linear", "green") if f"u_{s}" in fields]
    moved = [points + fields[f"u_{s}"] for s in strains]
    everything = np.vstack([points, *moved])
    low, high = everything.min(axis=0), everything.max(axis=0)
    largest = max((float(np.linalg.norm(m - points, axis=1).max()) for m in moved), default=1.0)
    angle = {0: 0, 1: -90, 2: -90}[view_axis(points, moved)]
    figure = pyplot.figure(figsize=(5 * (1 + len(strains)), 5.5), dpi=110)
    for column, name in enumerate(["original", *strains]):
        axes = figure.add_subplot(1, 1 + len(strains), column + 1, projection="3d")
        if column == 0:
            axes.add_collection3d(
                Poly3DCollection(points[facets], facecolor=GREY, edgecolor="#8a8a8a", linewidth=0.2)
            )
        else:
            length = np.linalg.norm(moved[column - 1] - points, axis=1)[facets].mean(axis=1)
            colours = mpl.colormaps["viridis"](length / largest)
            axes.add_collection3d(
                Poly3DCollection(moved[column - 1][facets], facecolor=colours, linewidth=0)
            )
            axes.add_collection3d(
                Poly3DCollection(
                    points[facets], facecolor="none", edgecolor=GREEN, linewidth=0.2, alpha=0.5
                )
            )
        for set_limits, a, b in zip(
            (axes.set_xlim, axes.set_ylim, axes.set_zlim), low, high, strict=True
        ):
            set_limits(a, b)
        axes.set_box_aspect(tuple(np.maximum(high - low, 1e-9)))
        axes.view_init(elev=8, azim=angle)
        axes.set_title(name)
        axes.set_axis_off()
    figure.savefig(folder / "states.png")


if __name__ == "__main__":
    main()
