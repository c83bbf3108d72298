"""Fig. 1: traditional beside improved Delaunay meshing, cut open.

Four meshes of one kidney surface. Traditional: Delaunay cells of the surface's points alone, as
VTK makes them, of which those with their centre inside are kept; what surface comes out is left
to chance. The paper's points (section II, steps 1 to 5: a jittered lattice of cubes inside, the
surface brought back) without its last step, and with it: slivers re-meshed with their neighbours.
And the body-centred lattice that fastsim uses instead of the cubes.

Slivers cost twice: their gradients spoil the strain, and the smallest cell sets the time step of
every explicit run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from palpate.fastsim.body import Body
from palpate.fastsim.mesher import Lattice, delaunay, mesh_surface
from palpate.meshes.arrays import Floats
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Material
from palpate.meshes.quality import dihedral_angles, edge_length_deviation
from palpate.meshes.shells import winding_numbers
from palpate.meshes.tet_mesh import TetMesh, outer_facets
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.report.plots import BLUE, Figure, figure_svg, plot_style
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress

TITLE = "Traditional and improved Delaunay meshing (Fig. 1)"

EDGE_LENGTH = 7e-3  # [m]
# Body-centred cubes hold two points each and are 1 / 0.923 times as wide as the wanted edge; with
# an edge this much longer they hold as many points as the paper's cubes do.
SAME_DENSITY = (2.0 * 0.923**3) ** (1.0 / 3.0)
TISSUE = Material(1e4, 0.45, 1000.0)
# Angles that a mesh for explicit dynamics should keep, and that gmsh with Netgen's optimiser keeps.
SMALLEST_ANGLE_DEG = 15.0
FIRST_PERCENTILE_DEG = 28.0
TRADITIONAL, UNCLEANED, PAPER, OURS = (
    "traditional Delaunay",
    "the paper's points, slivers left",
    "the paper's recipe",
    "palpate",
)


class Measured(NamedTuple):
    """What one mesher made of the surface; angles in degrees, lengths over the mean edge."""

    points: int
    cells: int
    facets_lost: int
    volume_error: float
    smallest_dihedral_deg: float
    first_percentile_dihedral_deg: float
    part_below_10_deg: float
    largest_edge_length_deviation: float
    critical_time_step: float


class Made(NamedTuple):
    """The meshes of a surface, and what was measured of them."""

    meshes: Mapping[str, TetMesh]
    measured: Mapping[str, Measured]


def compute(progress: Progress) -> Made:
    """Mesh and measure."""
    surface = shape_kidney(edge_length=EDGE_LENGTH)
    meshes = make_meshes(surface, progress)
    return Made(meshes, {name: measure(surface, mesh) for name, mesh in meshes.items()})


def make_meshes(surface: TriSurface, progress: Progress) -> dict[str, TetMesh]:
    """The four meshes, with the surface's mean edge as the size of the paper's cubes."""
    corners = surface.points[surface.facets]
    mean_edge = float(np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).mean())
    makers: dict[str, Callable[[], TetMesh]] = {
        TRADITIONAL: lambda: mesh_traditionally(surface),
        UNCLEANED: lambda: mesh_surface(surface, lattice=Lattice.PAPER, improve=False),
        PAPER: lambda: mesh_surface(surface, lattice=Lattice.PAPER),
        OURS: lambda: mesh_surface(surface, edge_length=SAME_DENSITY * mean_edge),
    }
    meshes = {}
    for name, make in makers.items():
        progress(f"meshing {surface.num_facets} facets: {name}")
        meshes[name] = make()
    return meshes


def mesh_traditionally(surface: TriSurface) -> TetMesh:
    """Delaunay cells of the surface's points, those with their centroid inside.

    Neither edges nor facets of the surface are asked for, as in VTK's filter.
    """
    cells, _ = delaunay(surface.points)
    centroids = surface.points[cells].mean(axis=1)
    return TetMesh(surface.points, cells[winding_numbers(surface, centroids) > 0.5])


def measure(surface: TriSurface, mesh: TetMesh) -> Measured:
    """Quality, fidelity and the price in time steps; point numbers are the surface's first."""
    smallest = np.degrees(dihedral_angles(mesh.points, mesh.cells)).min(axis=1)
    given = {tuple(row) for row in np.sort(surface.facets, axis=1).tolist()}
    found = {tuple(row) for row in np.sort(mesh.boundary_facets, axis=1).tolist()}
    return Measured(
        mesh.num_points,
        mesh.num_cells,
        len(given - found),
        abs(float(mesh.volume) / surface.volume - 1.0),
        float(smallest.min()),
        float(np.percentile(smallest, 1.0)),
        float((smallest < 10.0).mean()),
        float(edge_length_deviation(mesh.points, mesh.cells).max()),
        Body(mesh, TISSUE).critical_time_step_bound(),
    )


def judge(made: Made) -> list[Finding]:
    """What the paper claims of its method, and what is claimed of ours."""
    old, left, paper, ours = (made.measured[n] for n in (TRADITIONAL, UNCLEANED, PAPER, OURS))
    names = ("traditional", "with slivers left", "by the paper's recipe", "by palpate")
    steps = zip((old, left, paper, ours), names, strict=True)
    return [
        judged(
            "improved meshing keeps the given surface",
            f"{paper.facets_lost} and {ours.facets_lost} facets lost by the paper's recipe and "
            f"palpate, {old.facets_lost} by traditional Delaunay",
            paper.facets_lost == 0 and ours.facets_lost == 0,
        ),
        judged(
            "re-meshing slivers makes the mesh more regular",
            f"smallest dihedral angle {left.smallest_dihedral_deg:.2f} degrees before, "
            f"{paper.smallest_dihedral_deg:.1f} after; traditional "
            f"{old.smallest_dihedral_deg:.3f}",
            paper.smallest_dihedral_deg
            > max(left.smallest_dihedral_deg, old.smallest_dihedral_deg),
        ),
        judged(
            f"palpate: no angle below {SMALLEST_ANGLE_DEG:g} degrees, 99 % of the cells without "
            f"one below {FIRST_PERCENTILE_DEG:g}",
            f"smallest {ours.smallest_dihedral_deg:.1f}, 1st percentile "
            f"{ours.first_percentile_dihedral_deg:.1f} degrees",
            ours.smallest_dihedral_deg >= SMALLEST_ANGLE_DEG
            and ours.first_percentile_dihedral_deg >= FIRST_PERCENTILE_DEG,
        ),
        judged(
            "better cells allow longer time steps",
            ", ".join(f"{1e6 * one.critical_time_step:.3g} us {name}" for one, name in steps),
            max(old.critical_time_step, left.critical_time_step)
            < paper.critical_time_step
            <= ours.critical_time_step,
        ),
    ]


def present(made: Made) -> Page:
    """Three of the meshes cut open, and all that was measured."""
    columns = {
        "mesh": "", "points": "d", "cells": "d", "facets lost": "d", "volume error": ".1e",
        "smallest dihedral [deg]": ".3g", "1st percentile [deg]": ".3g",
        "cells below 10 deg [%]": ".2f", "largest edge deviation": ".3f",
        "critical step [us]": ".3g",
    }  # fmt: skip
    rows = [
        (name, *m[:6], 100.0 * m.part_below_10_deg, m.largest_edge_length_deviation,
         1e6 * m.critical_time_step)
        for name, m in made.measured.items()
    ]  # fmt: skip
    figure = Figure(
        _draw({name: made.meshes[name] for name in (TRADITIONAL, PAPER, OURS)}),
        "The same kidney, cut open: cells whose centre lies before the middle plane are taken "
        "away, and the rest are coloured by their smallest dihedral angle (dark: slivers). Below: "
        "all six dihedral angles of every cell; a regular tetrahedron has 70.5 degrees.",
    )
    table = Table("Meshes of one kidney surface", columns, rows)
    return Page(figures={"meshes": figure}, tables={"quality": table})


# Light comes from the viewer's upper left.
_LIGHT = np.array([-0.35, -0.80, 0.49])
_LARGEST_COLOURED_DEG = 60.0


def _draw(meshes: Mapping[str, TetMesh]) -> str:
    """One column for each mesh: cut by the middle plane of its y axis, and its histogram."""
    with plot_style():
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


def _draw_cut(axes: Axes, mesh: TetMesh, smallest: Floats) -> None:
    """Cells behind the middle plane, seen along +y; far facets first, back faces left out."""
    middle = 0.5 * (mesh.points[:, 1].min() + mesh.points[:, 1].max())
    behind = np.flatnonzero(mesh.points[mesh.cells].mean(axis=1)[:, 1] > middle)
    seen, row = outer_facets(mesh.cells[behind], mesh.num_points)
    corners = mesh.points[seen]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    facing = normals[:, 1] < 0.0
    corners, normals, owners = corners[facing], normals[facing], behind[row[facing]]
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
