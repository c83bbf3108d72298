"""Meshes cut open beside each other, with histograms of their dihedral angles."""

from __future__ import annotations

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from palpate.meshes.quality import dihedral_angles
from palpate.meshes.tet_mesh import CELL_FACETS, TetMesh
from palpate.validation.report.line_plot import BLUE, paper_style
from palpate.validation.report.plots import figure_svg

# Light comes from the viewer's upper left.
_LIGHT = np.array([-0.35, -0.80, 0.49])
_LARGEST_COLOURED_DEG = 60.0


def draw(meshes: Mapping[str, TetMesh]) -> str:
    """One column for each mesh: cut by the middle plane of its y axis, and its histogram."""
    from matplotlib import pyplot

    with paper_style():
        size = (3.6 * len(meshes), 8.2)
        figure, axes = pyplot.subplots(
            2, len(meshes), figsize=size, height_ratios=(2.6, 1.0), squeeze=False
        )
        for (name, mesh), above, below in zip(meshes.items(), *axes, strict=True):
            angles = np.degrees(dihedral_angles(mesh.points, mesh.cells))
            _draw_cut(above, mesh, angles.min(axis=1))
            above.set_title(f"{name}\n{mesh.num_cells} cells", fontsize=11)
            below.hist(angles.ravel(), bins=np.arange(0.0, 181.0, 5.0), color=BLUE)
            below.axvline(70.53, color="black", lw=0.8, ls=":")
            below.set_xlim(0.0, 180.0)
            below.set_xticks(range(0, 181, 30))
            below.set_yticks([])
            below.set_xlabel("dihedral angle [degrees]")
            words = f"smallest {angles.min():.3g}\nlargest {angles.max():.4g}"
            below.annotate(
                words, (0.97, 0.93), xycoords="axes fraction", ha="right", va="top", fontsize=9
            )
            below.spines[["top", "right", "left"]].set_visible(False)
        colours = mpl.cm.ScalarMappable(
            mpl.colors.Normalize(0.0, _LARGEST_COLOURED_DEG), mpl.colormaps["viridis"]
        )
        figure.tight_layout(rect=(0.0, 0.0, 0.92, 1.0))
        bar = figure.colorbar(colours, cax=figure.add_axes((0.935, 0.45, 0.014, 0.4)))
        bar.set_label("smallest angle of the cell [degrees]")
        return figure_svg(figure)


def _draw_cut(axes: Axes, mesh: TetMesh, smallest: NDArray[np.float64]) -> None:
    """Cells behind the middle plane, seen along +y; far facets first, back faces left out."""
    from matplotlib.collections import PolyCollection

    middle = 0.5 * (mesh.points[:, 1].min() + mesh.points[:, 1].max())
    kept = np.flatnonzero(mesh.points[mesh.cells].mean(axis=1)[:, 1] > middle)
    facets = mesh.cells[kept][:, CELL_FACETS].reshape(-1, 3)
    owner = np.repeat(kept, 4)
    ordered = np.sort(facets, axis=1)
    _, first, count = np.unique(ordered, axis=0, return_index=True, return_counts=True)
    seen = first[count == 1]  # facets of one kept cell only
    corners = mesh.points[facets[seen]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    facing = normals[:, 1] < 0.0
    corners, normals, owners = corners[facing], normals[facing], owner[seen[facing]]
    order = np.argsort(-corners.mean(axis=1)[:, 1])
    shade = 0.35 + 0.65 * np.clip(normals @ _LIGHT, 0.0, 1.0)
    colours = mpl.colormaps["viridis"](smallest[owners] / _LARGEST_COLOURED_DEG)
    colours[:, :3] *= shade[:, None]
    axes.add_collection(
        PolyCollection(
            list(1e3 * corners[order][:, :, [0, 2]]),
            facecolors=colours[order],
            edgecolors="#202020",
            linewidths=0.25,
            rasterized=True,
        )
    )
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_axis_off()
