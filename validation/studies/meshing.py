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

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from palpate.fastsim.body import Body
from palpate.fastsim.mesher import Lattice, delaunay, mesh_surface
from palpate.meshes.arrays import Points
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Material
from palpate.meshes.quality import dihedral_angles, edge_length_deviation
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.quoting import csv_text
from palpate.validation.report.study_page import (
    Finding,
    StudyFigure,
    StudyTable,
    gravest,
    write_study_page,
)
from palpate.validation.run_folder import RESULTS
from palpate.validation.states import Verdict
from palpate.validation.studies.meshing_picture import draw

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
_CODES = {Verdict.PASSED: 0, Verdict.FAILED: 1, Verdict.INCONCLUSIVE: 3}


@dataclass(frozen=True)
class Measured:
    """What one mesher made of the surface; angles in degrees, lengths over the mean edge."""

    name: str
    points: int
    cells: int
    facets_lost: int
    volume_error: float
    smallest_dihedral_deg: float
    first_percentile_dihedral_deg: float
    share_below_10_deg: float
    largest_edge_length_deviation: float
    critical_time_step: float


def run(folder: Path, progress: Callable[[str], None], console: Console) -> int:
    """Mesh, measure, judge; leave report.html, the figure, a table and results.json."""
    surface = shape_kidney(edge_length=EDGE_LENGTH)
    meshes = make_meshes(surface, progress)
    rows = [measure(name, surface, mesh) for name, mesh in meshes.items()]
    findings = judge(rows)
    table = quality_table(rows)
    text = csv_text(table.columns, table.rows)
    (folder / "quality.csv").write_text(text, encoding="utf-8")
    progress("drawing the meshes cut open")
    shown = [TRADITIONAL, PAPER, OURS]
    figure = StudyFigure(
        draw([(name, meshes[name]) for name in shown]),
        "The same kidney, cut open: cells whose centre lies before the middle plane are taken "
        "away, and the rest are coloured by their smallest dihedral angle (dark: slivers). Below: "
        "all six dihedral angles of every cell; a regular tetrahedron has 70.5 degrees.",
    )
    (folder / "meshes.svg").write_text(figure.svg, encoding="utf-8")
    write_study_page(
        folder / "report.html",
        title="Traditional and improved Delaunay meshing (Fig. 1)",
        about=(__doc__ or "").split("\n\n")[1:],
        findings=findings,
        figures=[figure],
        tables=[table],
    )
    document = {
        "study": "meshing",
        "findings": [asdict(f) for f in findings],
        "meshes": [asdict(row) for row in rows],
    }
    (folder / RESULTS).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    for f in findings:
        console.print(f"{f.verdict}: {f.claim}: {f.found}", markup=False, soft_wrap=True)
    return _CODES[gravest(findings)]


def make_meshes(surface: TriSurface, progress: Callable[[str], None]) -> dict[str, TetMesh]:
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


def winding_numbers(surface: TriSurface, places: Points) -> NDArray[np.float64]:
    """How often a closed, outward surface goes round each place: 1 inside, 0 outside.

    Sum of signed solid angles over 4 pi (van Oosterom and Strackee 1983, The solid angle of a
    plane triangle, eq. 8).

    Args:
        surface: Closed.
        places: Not on the surface [m], shape (n, 3).
    """
    corners = surface.points[surface.facets]
    numbers = []
    for part in np.array_split(places, max(1, len(places) // 200)):
        a, b, c = (corners[None, :, k] - part[:, None] for k in range(3))
        la, lb, lc = (np.linalg.norm(x, axis=2) for x in (a, b, c))
        volume = np.einsum("ijk,ijk->ij", a, np.cross(b, c))
        ab, bc, ca = (np.einsum("ijk,ijk->ij", x, y) for x, y in ((a, b), (b, c), (c, a)))
        angles = 2.0 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
        numbers.append(angles.sum(axis=1) / (4.0 * np.pi))
    return np.concatenate(numbers)


def measure(name: str, surface: TriSurface, mesh: TetMesh) -> Measured:
    """Quality, fidelity and the price in time steps; point numbers are the surface's first."""
    smallest = np.degrees(dihedral_angles(mesh.points, mesh.cells)).min(axis=1)
    given = {tuple(row) for row in np.sort(surface.facets, axis=1).tolist()}
    found = {tuple(row) for row in np.sort(mesh.boundary_facets, axis=1).tolist()}
    return Measured(
        name,
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


def judge(rows: Sequence[Measured]) -> list[Finding]:
    """What the paper claims of its method, and what is claimed of ours."""
    by_name = {row.name: row for row in rows}
    old, left, paper, ours = (by_name[n] for n in (TRADITIONAL, UNCLEANED, PAPER, OURS))

    def verdict(holds: bool) -> Verdict:
        return Verdict.PASSED if holds else Verdict.FAILED

    return [
        Finding(
            "improved meshing keeps the given surface",
            f"{paper.facets_lost} and {ours.facets_lost} facets lost by the paper's recipe and "
            f"palpate, {old.facets_lost} by traditional Delaunay",
            verdict(paper.facets_lost == 0 and ours.facets_lost == 0),
        ),
        Finding(
            "re-meshing slivers makes the mesh more regular",
            f"smallest dihedral angle {left.smallest_dihedral_deg:.2f} degrees before, "
            f"{paper.smallest_dihedral_deg:.1f} after; traditional "
            f"{old.smallest_dihedral_deg:.3f}",
            verdict(
                paper.smallest_dihedral_deg > left.smallest_dihedral_deg
                and paper.smallest_dihedral_deg > old.smallest_dihedral_deg
            ),
        ),
        Finding(
            f"palpate: no angle below {SMALLEST_ANGLE_DEG:g} degrees, 99 % of the cells without "
            f"one below {FIRST_PERCENTILE_DEG:g}",
            f"smallest {ours.smallest_dihedral_deg:.1f}, 1st percentile "
            f"{ours.first_percentile_dihedral_deg:.1f} degrees",
            verdict(
                ours.smallest_dihedral_deg >= SMALLEST_ANGLE_DEG
                and ours.first_percentile_dihedral_deg >= FIRST_PERCENTILE_DEG
            ),
        ),
        Finding(
            "better cells allow longer time steps",
            f"{1e6 * old.critical_time_step:.3g} us traditional, "
            f"{1e6 * left.critical_time_step:.3g} us with slivers left, "
            f"{1e6 * paper.critical_time_step:.3g} us by the paper's recipe, "
            f"{1e6 * ours.critical_time_step:.3g} us by palpate",
            verdict(
                old.critical_time_step < paper.critical_time_step
                and left.critical_time_step < paper.critical_time_step
                and paper.critical_time_step <= ours.critical_time_step
            ),
        ),
    ]


def quality_table(rows: Sequence[Measured]) -> StudyTable:
    """All that was measured."""
    columns = (
        "mesh", "points", "cells", "facets lost", "volume error", "smallest dihedral [deg]",
        "1st percentile [deg]", "cells below 10 deg [%]", "largest edge deviation",
        "critical step [us]",
    )  # fmt: skip
    text = [
        [
            row.name,
            str(row.points),
            str(row.cells),
            str(row.facets_lost),
            f"{row.volume_error:.1e}",
            f"{row.smallest_dihedral_deg:.3g}",
            f"{row.first_percentile_dihedral_deg:.3g}",
            f"{100 * row.share_below_10_deg:.2f}",
            f"{row.largest_edge_length_deviation:.3f}",
            f"{1e6 * row.critical_time_step:.3g}",
        ]
        for row in rows
    ]
    return StudyTable("Meshes of one kidney surface", columns, text)
