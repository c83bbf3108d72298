"""Section V: graded meshes. The same result with how many of the cells?

On a body, how many cells does a mesh graded by its own error need for the accuracy of a uniform one
of over 100 000 cells? (How the number of cells grows with resolution, O(n^3) uniform and O(n^2)
graded towards a surface, is a test: tests/fastsim/grading/test_symbolic_cube.py.)
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.contact.static_contact import solve_contact
from palpate.fastsim.grading.graded_mesh import (
    GradedMesh,
    carry_problem,
    estimate_error,
    mark_largest,
)
from palpate.fastsim.mesher import mesh_surface
from palpate.fastsim.statics import solve_static
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.bricks import brick_box, rollers, side, support_of
from palpate.meshes.errors import InputError
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Material, Problem
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.reference.availability import is_available
from palpate.validation.metrics.grid_convergence import SAFETY_FACTOR
from palpate.validation.report.plots import BLUE, RED, Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table
from palpate.validation.states import Progress, Verdict

TITLE = "Graded meshes (section V)"

# Error against cells on one body: a uniform family of meshes and one graded by its own error.
#
# All meshes are bisections of one coarse mesh, so the body and its fixed, pushed and touched parts
# are the same polyhedra in all, and the coarse mesh's points are in all. The truth is P2 on meshes
# graded by the same indicator, three of them, which gives it an error bar.

# Part of the squared error that is refined from one mesh to the next.
PART = 0.2
# The graded mesh compared with the finest uniform one has at most this part of its cells.
PART_OF_CELLS = 1.0 / 5.0
MOST_CELLS = {"uniform": 150_000, "graded": 45_000}


class Scene(NamedTuple):
    """A body under load on its coarse mesh, and the scalar that is judged beside its displacement.

    That is the force on the tool where there is one, and the change of volume where there is none.
    The truth has at most `truth_cells`, and before about `truth_ratio` times fewer.
    """

    title: str
    problem: Problem
    truth_cells: int
    truth_ratio: float

    @property
    def quantity(self) -> str:
        """Name of the scalar."""
        return "contact force" if self.problem.tools else "change of volume"


class Solved(NamedTuple):
    """A solution on one mesh: displacement at the coarse mesh's points [m], scalar [N or -].

    The critical time step [s] is about the rest state.
    """

    cells: int
    displacement: Points
    quantity: float
    critical_time_step: float = math.nan

    @property
    def cost(self) -> float:
        """Cells times steps of a simulated second."""
        return self.cells / self.critical_time_step


class Curves(NamedTuple):
    """Meshes by "uniform" and "graded", from coarse to fine, and the truth on three, likewise."""

    title: str
    quantity: str
    families: Mapping[str, Sequence[Solved]]
    truths: Sequence[Solved]

    @property
    def names(self) -> tuple[str, str]:
        """Of the two errors."""
        return "displacement", self.quantity

    def gaps(self, one: Solved, other: Solved) -> tuple[float, float]:
        """How far two are apart over the truth: relative L2, and the scalar with its sign [-]."""
        truth = self.truths[-1]
        apart = np.linalg.norm(one.displacement - other.displacement)
        scale = np.linalg.norm(truth.displacement)
        return float(apart / scale), (one.quantity - other.quantity) / truth.quantity

    def errors(self, solved: Solved) -> tuple[float, float]:
        """Of displacement and scalar, without sign [-]."""
        displacement, quantity = self.gaps(solved, self.truths[-1])
        return displacement, abs(quantity)

    @property
    def pair(self) -> tuple[Solved, Solved]:
        """The finest uniform mesh, and the finest graded one with at most a fifth of its cells."""
        uniform = self.families["uniform"][-1]
        few = [s for s in self.families["graded"] if s.cells <= PART_OF_CELLS * uniform.cells]
        return uniform, few[-1]

    @property
    def bars(self) -> tuple[float, float]:
        """How far the truth's displacement and scalar may be off, in the errors' units."""
        (u1, q1), (u2, q2) = (self.gaps(b, a) for a, b in pairwise(self.truths))
        return remainder(u1, u2), remainder(abs(q1), abs(q2))


def follow(scene: Scene, progress: Progress) -> Curves:
    """Solve both families by fastsim, the truth by the reference.

    Raises ReferenceFailedError where FEniCSx is missing or a solve failed.
    """
    first, count = scene.problem, scene.problem.mesh.num_points
    families: dict[str, list[Solved]] = {kind: [] for kind in MOST_CELLS}
    problems: list[Problem] = []
    for kind, found in families.items():
        graded = GradedMesh(first.mesh)
        while True:
            carried = carry_problem(first, graded)
            displacement, quantity = solve(carried)
            body = Body(carried.mesh, first.material)
            step = body.critical_time_step()
            found.append(Solved(len(graded.cells), displacement[:count], quantity, step))
            progress(f"{scene.title}, {kind}: {len(graded.cells)} cells solved by fastsim")
            if kind == "uniform":
                marks = np.ones(len(graded.cells), dtype=bool)
            else:
                problems.append(carried)
                marks = mark_largest(estimate_error(body, displacement), part=PART)
            if len(graded.cells) + 1.5 * marks.sum() > MOST_CELLS[kind]:
                break
            graded.refine(marks)
    truths = []
    for fine in choose_truths(problems, scene.truth_cells, scene.truth_ratio):
        progress(f"{scene.title}, truth: P2 on {fine.mesh.num_cells} graded cells")
        displacement, quantity = solve_truth(fine)
        truths.append(Solved(fine.mesh.num_cells, displacement[:count], quantity))
    return Curves(scene.title, scene.quantity, families, truths)


def solve(problem: Problem) -> tuple[Points, float]:
    """Displacement and the scene's scalar by fastsim."""
    if problem.tools:
        found = solve_contact(problem)
        return found.displacements[-1], float(np.linalg.norm(found.forces[-1, 0]))
    displacement = solve_static(problem).displacement
    moved = signed_volumes(problem.mesh.points + displacement, problem.mesh.cells)
    return displacement, float(moved.sum()) / problem.mesh.volume - 1.0


def solve_truth(problem: Problem) -> tuple[Points, float]:
    """Displacement and the scene's scalar by the reference's quadratic tetrahedra."""
    from palpate.reference.child import run_task
    from palpate.reference.tasks import StaticTask

    found = run_task(StaticTask(degree=2), problem)
    if problem.tools:
        return found.displacement, float(np.linalg.norm(found.tools[0].forces[-1]))
    return found.displacement, found.volume / problem.mesh.volume - 1.0


def choose_truths(problems: list[Problem], most_cells: int, ratio: float) -> list[Problem]:
    """Three meshes of the family, whose numbers of cells are nearest to a geometric series."""
    cells = np.array([p.mesh.num_cells for p in problems])
    finest = int(np.flatnonzero(cells <= most_cells)[-1])
    wanted = cells[finest] / ratio ** np.array([2.0, 1.0, 0.0])
    return [problems[int(np.abs(np.log(cells / n)).argmin())] for n in wanted]


def cells_for_error(cells: Sequence[int], errors: Sequence[float], wanted: float) -> float:
    """Cells at which a family's error falls to a value: straight lines between logarithms.

    Infinite where it does not fall so far.
    """
    if not wanted >= min(errors):
        return float("inf")
    e = np.log(np.maximum.accumulate(errors[::-1]))
    return float(np.exp(np.interp(np.log(wanted), e, np.log(cells)[::-1])))


def remainder(first: float, second: float) -> float:
    """What is left after two successive changes that shrink like a geometric series.

    second / (first / second - 1), with Roache's factor of safety for three meshes, 1.25.
    Infinite where they do not shrink.
    """
    return SAFETY_FACTOR * second / (first / second - 1.0) if first > second else float("inf")


COARSE_EDGE = 12e-3  # [m]
PATCH_RADIUS = 14e-3  # [m]: about a fingertip
FORCE = (-0.15, 0.04, -0.06)  # [N]: 1.6 mm deep; not along an axis, so that faults show
MATERIAL = Material(10e3, 0.3)
RADIUS, SPHERE_BODY = 0.01, Material(5000.0, 0.3)
DEPTH = 0.05  # radii


def contact_radius(depth: float, radius: float) -> float:
    """Contact radius of Hertz [m], of a sphere in a half space, for small a / R.

    Johnson 1985, "Contact Mechanics", section 4.2.
    """
    return math.sqrt(radius * depth)


# A quarter block of twenty contact radii: the finest uniform mesh has about one edge to a contact
# radius, of the coarsest (each side cut in four) a single point touches.
WIDTH = 20.0 * contact_radius(DEPTH * RADIUS, RADIUS)
_FIRST_BISECTIONS = 6


def quarter_cube(edge: float) -> TetMesh:
    """Six cells around the diagonal of the cube 0 <= x, y <= edge, -edge <= z <= 0 [m]."""
    cube = brick_box((1, 1, 1), (edge, edge, edge))
    return TetMesh(cube.points - [0.0, 0.0, edge], cube.cells)


def sphere_into_block(mesh: TetMesh, depths: Sequence[float]) -> Problem:
    """Sphere above the origin of a quarter block, pressed to depths [radii], the first 0.

    Two sides are planes of symmetry, the bottom does not sink, the outer sides are free. The
    sphere may touch facets of the top within its own radius.
    """
    width = float(mesh.points[:, 0].max())
    supports = rollers(mesh, ((0, 0.0), (1, 0.0), (2, -width)))
    top = side(mesh, 2, 0.0)
    is_near = (np.linalg.norm(mesh.points[top][:, :, :2], axis=2) < RADIUS).any(axis=1)
    times = np.arange(len(depths), dtype=np.float64)
    positions = np.zeros((len(depths), 3))
    positions[:, 2] = RADIUS * (1.0 - np.array(depths))
    tool = RigidTool(SphereShape(RADIUS), ToolPath(times, positions), contact_facets=top[is_near])
    return Problem(mesh, SPHERE_BODY, supports, (), tools=(tool,))


def push_scene() -> Scene:
    """The kidney, its lower half fixed, pushed on a patch of the upper half's side."""
    mesh = mesh_surface(shape_kidney(edge_length=COARSE_EDGE))
    facets = mesh.boundary_facets
    corners = mesh.points[facets]
    foot = support_of(facets[(corners[:, :, 2] <= 0.0).all(axis=1)])
    middle = mesh.points[np.argmax(mesh.points @ np.array([1.0, 0.0, 0.6]))]
    near = np.linalg.norm(corners.mean(axis=1) - middle, axis=1) < PATCH_RADIUS
    a, b, c = corners[near].transpose(1, 0, 2)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    x, y, z = (np.array(FORCE) / area).tolist()
    problem = Problem(mesh, MATERIAL, (foot,), (Traction(facets[near], (x, y, z)),))
    return Scene("kidney pushed on a patch", problem, 32_000, 2.2)


def hertz_scene() -> Scene:
    """A sphere pressed into a quarter block."""
    coarse = GradedMesh(quarter_cube(WIDTH))
    for _ in range(_FIRST_BISECTIONS):
        coarse.refine(np.ones(len(coarse.cells), dtype=bool))
    return Scene("sphere into a block", sphere_into_block(coarse.mesh, (0.0, DEPTH)), 4_000, 1.8)


Found = Mapping[str, Curves]  # by scene


def compute(progress: Progress) -> Found:
    """Solve each scene."""
    if not is_available():
        raise InputError("study grading needs FEniCSx for its truth; see the set-up in README")
    scenes = {"push": push_scene(), "hertz": hertz_scene()}
    return {name: follow(scene, progress) for name, scene in scenes.items()}


def judge(found: Found) -> list[Finding]:
    """What grading saves on each body."""
    return [finding for curves in found.values() for finding in judge_curves(curves)]


def judge_curves(curves: Curves) -> list[Finding]:
    """Is the graded mesh, with a fifth of the cells, at least as near the truth?

    With u and g the two solutions, t the truth as computed and t + d the truth:
    |u - t - d|^2 - |g - t - d|^2 = |u - t|^2 - |g - t|^2 - 2 (u - g) . d, and the last term is at
    most twice the gap between the two times the truth's bar.
    """
    one, other = curves.pair
    family = curves.families["graded"]
    gaps, bars = curves.gaps(one, other), curves.bars
    findings = []
    for k, name in enumerate(curves.names):
        uniform, graded = curves.errors(one)[k], curves.errors(other)[k]
        gap, bar = abs(gaps[k]), bars[k]
        lead, doubt = uniform**2 - graded**2, 2.0 * gap * bar
        if lead > doubt:
            verdict = Verdict.PASSED
        else:
            verdict = Verdict.FAILED if lead < -doubt else Verdict.INCONCLUSIVE
        needed = cells_for_error(
            [s.cells for s in family], [curves.errors(s)[k] for s in family], uniform
        )
        findings.append(
            Finding(
                f"{curves.title}, {name}: {other.cells} graded cells are as near the truth "
                f"as {one.cells} uniform ones",
                f"error {100 * graded:.2f} % against {100 * uniform:.2f} % (truth +- "
                f"{100 * bar:.2f} %, results {100 * gap:.2f} % apart); {needed:.0f} cells, "
                f"{one.cells / needed:.1f} times fewer, would do",
                verdict,
            )
        )
    return findings


def present(found: Found) -> Page:
    """Of each scene every mesh."""
    return Page(
        figures={name: draw_curves(curves) for name, curves in found.items()},
        tables={name: curves_table(curves) for name, curves in found.items()},
        numbers={"bars": {name: curves.bars for name, curves in found.items()}},
    )


def curves_table(curves: Curves) -> Table:
    """Every mesh with its errors, critical time step and cost."""
    columns = {"mesh": "", "cells": "d", "displacement error [%]": ".2f"}
    columns |= {f"error of the {curves.quantity} [%]": "+.2f", "critical step [us]": ".2f"}
    rows = []
    for kind, family in curves.families.items():
        for p in family:
            errors = (100 * error for error in curves.gaps(p, curves.truths[-1]))
            rows.append((kind, p.cells, *errors, 1e6 * p.critical_time_step, p.cost))
    return Table(_heading(curves), {**columns, "cells x steps of a second": ".2e"}, rows)


def _heading(curves: Curves) -> str:
    return curves.title[0].upper() + curves.title[1:]


def draw_curves(curves: Curves) -> Figure:
    """Errors over cells and over cost."""
    rows = []
    for k, (name, bar) in enumerate(zip(curves.names, curves.bars, strict=True)):
        errors = {
            kind: [100 * curves.errors(p)[k] for p in family]
            for kind, family in curves.families.items()
        }
        lowest = min(min(each) for each in errors.values())
        panels = []
        for what, words in (("cells", "cells"), ("cost", "cells x steps of a simulated second")):
            lines = [
                Line(
                    [float(getattr(p, what)) for p in curves.families[kind]],
                    errors[kind],
                    label=kind,
                    colour=colour,
                )
                for kind, colour in (("uniform", BLUE), ("graded", RED))
            ]
            panels.append(
                Panel(
                    lines,
                    x=words,
                    y=f"error of the {name} [%]",
                    log="xy",
                    band=(1e-9, 100 * bar),
                    positions={p.cells: "" for p in curves.pair} if what == "cells" else {},
                    y_range=(min(lowest, 100 * bar) / 1.5, None),
                )
            )
        rows.append(panels)
    return line_figure(
        rows,
        f"{_heading(curves)}: error against the truth (P2 on graded meshes of "
        f"{', '.join(str(t.cells) for t in curves.truths)} cells; grey: its error bar). Dotted: "
        "the two meshes compared. Right: smaller cells also mean shorter steps, so an explicit run "
        "gains less.",
        shares_legend=True,
    )
