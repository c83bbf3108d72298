"""What a mesh with slivers does to both elements, and how far node pressures can be read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.linalg import norm

from palpate.fastsim.body import Body, lame_parameters
from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InvertedCellError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.quality import measure_quality
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.references.field_truth import FieldTruth
from palpate.validation.report.plots import BLUE, RED, Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Table, judged
from palpate.validation.states import Progress
from palpate.validation.studies.elements.bar import WIDTH, make_bar

DIVISIONS = 8
SLIVER = 5.0  # degrees, the smallest dihedral angle of the distorted mesh


class Distortion(NamedTuple):
    """Both elements on a mesh of bricks, and on the same with its inner points moved.

    Angles are the smallest dihedral ones [degrees]; errors relative L2 distances from the truth,
    regular and distorted.
    """

    poissons_ratio: float
    angles: tuple[float, float]
    linear: tuple[float, float]
    smoothed: tuple[float, float]


class Pressures(NamedTuple):
    """Pressures of smoothed tetrahedra, volumetric part [Pa].

    `at_nodes` is -lmbda theta of each node; `averages` those of the cells, which are means of their
    four nodes, averaged over the cells at the node. `places` are along the axis of the bar [m], and
    the pressures there.
    """

    poissons_ratio: float
    scatter: float
    places: Floats
    at_nodes: Floats
    averages: Floats


def distorted_bar(divisions: int, poissons_ratio: float) -> Problem:
    """Inner points moved as far as leaves a smallest dihedral angle of `SLIVER` or little more."""
    for ragged in np.arange(0.3, 0.0, -0.002):
        try:
            problem = make_bar(divisions, poissons_ratio, ragged=float(ragged))
        except InvertedCellError:
            continue
        if measure_quality(problem.mesh).smallest_dihedral_deg >= SLIVER:
            return problem
    raise AssertionError("bricks as they are have angles of 45 degrees")


def follow_meshes(
    truths: Mapping[float, FieldTruth], progress: Progress, *, divisions: int = DIVISIONS
) -> tuple[list[Distortion], list[Pressures]]:
    """Both elements on both meshes, and the pressures on the regular one."""
    distortions, pressures = [], []
    for nu, truth in truths.items():
        progress(f"distorted mesh, nu = {nu:g}")
        problems = make_bar(divisions, nu), distorted_bar(divisions, nu)
        first, second = (measure_quality(p.mesh).smallest_dihedral_deg for p in problems)
        answers = {e: [solve_static(p, element=e).displacement for p in problems] for e in Element}
        linear, smoothed = (
            [truth.error_of(p.mesh, u) for p, u in zip(problems, answers[e], strict=True)]
            for e in Element
        )
        distortions.append(
            Distortion(nu, (first, second), (linear[0], linear[1]), (smoothed[0], smoothed[1]))
        )
        pressures.append(read_pressures(problems[0], answers[Element.SMOOTHED][0]))
    return distortions, pressures


def read_pressures(problem: Problem, displacement: Points) -> Pressures:
    """Of an answer of smoothed tetrahedra on a bar."""
    mesh = problem.mesh
    body = Body.of(problem, Strain.GREEN, element=Element.SMOOTHED)
    H = body.displacement_gradients(displacement).reshape(-1, 3, 3)
    # tr E = tr H + H : H / 2.
    trace = np.trace(H, axis1=1, axis2=2) + 0.5 * (H**2).sum(axis=(1, 2))
    volumes = signed_volumes(mesh.points, mesh.cells)

    def at_nodes(of_cells: Floats) -> Floats:
        corners = mesh.cells.ravel()
        weights = np.repeat(volumes, 4)
        sums = np.bincount(corners, weights * np.repeat(of_cells, 4), mesh.num_points)
        found: Floats = sums / np.bincount(corners, weights, mesh.num_points)
        return found

    pressure = -lame_parameters(problem.material)[0] * at_nodes(trace)
    averages = at_nodes(pressure[mesh.cells].mean(axis=1))
    on_axis = (norm(mesh.points[:, 1:] - 0.5 * WIDTH, axis=1) < 1e-9 * WIDTH).nonzero()[0]
    on_axis = on_axis[np.argsort(mesh.points[on_axis, 0])]
    scatter = float(norm(pressure - averages) / norm(averages))
    return Pressures(
        problem.material.poissons_ratio,
        scatter,
        mesh.points[on_axis, 0],
        pressure[on_axis],
        averages[on_axis],
    )


def judge_distortions(distortions: Sequence[Distortion]) -> list[Finding]:
    """Slivers may cost something, but not what smoothing gains."""
    return [
        judged(
            f"nu = {d.poissons_ratio:g}: smoothed tetrahedra with slivers of {d.angles[1]:.1f} "
            "degrees are nearer the truth than linear ones on the regular mesh",
            f"{100 * d.smoothed[1]:.2f} % against {100 * d.linear[0]:.1f} %",
            d.smoothed[1] < d.linear[0],
        )
        for d in distortions
    ]


def distortions_table(distortions: Sequence[Distortion]) -> Table:
    """Errors on both meshes."""
    columns = {"Poisson's ratio": "g", "mesh": "", "smallest dihedral [deg]": ".1f"}
    columns |= {"linear": ".4f", "smoothed": ".4f"}
    rows = [
        (d.poissons_ratio, name, *numbers)
        for d in distortions
        for name, *numbers in zip(
            ("regular", "distorted"), d.angles, d.linear, d.smoothed, strict=True
        )
    ]
    return Table("Errors on a distorted mesh beside the regular one", columns, rows)


def pressures_table(pressures: Sequence[Pressures]) -> Table:
    """How far node pressures scatter about the cells' averages."""
    columns = {"Poisson's ratio": "g", "scatter of node pressures / cell averages": ".3f"}
    rows = [(p.poissons_ratio, p.scatter) for p in pressures]
    return Table("Node pressures: read cell averages instead", columns, rows)


def draw_pressures(pressures: Sequence[Pressures]) -> Figure:
    """Along the axis of the bar, at the largest Poisson's ratio."""
    last = pressures[-1]
    lines = [
        Line(1e3 * last.places, last.at_nodes, label="at nodes", colour=RED),
        Line(1e3 * last.places, last.averages, label="averages of cells", colour=BLUE),
    ]
    panel = Panel(
        lines,
        x="along the axis [mm]",
        y="pressure [Pa]",
        title=f"Poisson's ratio {last.poissons_ratio:g}",
    )
    return line_figure(
        [[panel]],
        "Node pressures of smoothed tetrahedra may jump from node to node like a checkerboard; "
        "displacements, forces and volumes do not. Read the averages of cells.",
        shares_legend=False,
    )
