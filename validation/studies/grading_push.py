"""The kidney pushed on a small patch: error against cells, uniform and graded by error.

All meshes are bisections of one coarse mesh, so the body, the held part and the pushed patch are
the same polyhedra in all, and the coarse mesh's points are in all. The truth is P2 on meshes
graded by the same indicator, three of them, which gives it an error bar.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate.fastsim.grading.carried_problem import carry_problem
from palpate.fastsim.grading.error_indicator import estimate_error, mark_largest
from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.fastsim.mesher import mesh_surface
from palpate.fastsim.statics import solve_static
from palpate.fastsim.time_steps import sharp_critical_time_step
from palpate.meshes.arrays import Points
from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Material, Problem, Strain

COARSE_EDGE = 12e-3  # [m]
PATCH_RADIUS = 14e-3  # [m]: about a fingertip
FORCE = (-0.15, 0.04, -0.06)  # [N]: 1.6 mm deep; not along an axis, so that faults show
MATERIAL = Material(10e3, 0.3)
# Share of the squared error that is refined from one mesh to the next.
SHARE = 0.2
MOST_CELLS = {"uniform": 150_000, "graded": 45_000}
# Graded meshes whose P2 solutions are the truth: three, the finest with at most so many cells, each
# with about so many times the cells of the one before.
TRUTH_CELLS = 32_000
TRUTH_RATIO = 2.2
# The graded mesh compared with the finest uniform one has at most this share of its cells.
SHARE_OF_CELLS = 1.0 / 5.0


@dataclass(frozen=True)
class Point:
    """One mesh of a family.

    Attributes:
        cells: Their number.
        displacement_error: Relative L2 over the coarse mesh's points, against the truth [-].
        volume_error: Of the change of volume, over the true change [-], signed.
        critical_time_step: About the rest state [s].
    """

    cells: int
    displacement_error: float
    volume_error: float
    critical_time_step: float

    @property
    def cost(self) -> float:
        """Cells times steps of a simulated second."""
        return self.cells / self.critical_time_step


@dataclass(frozen=True)
class Pair:
    """The finest uniform mesh, and the finest graded one with at most a fifth of its cells.

    Attributes:
        uniform, graded: Their errors.
        displacement_gap: Relative L2 between the two over the coarse mesh's points [-].
        volume_gap: Between their changes of volume, over the true one [-].
    """

    uniform: Point
    graded: Point
    displacement_gap: float
    volume_gap: float


@dataclass(frozen=True)
class PushCurves:
    """Errors against cells, and how far the truth itself may be off.

    Attributes:
        families: Meshes by "uniform" and "graded", from coarse to fine.
        displacement_bar, volume_bar: Of the truth, in the errors' units [-].
        truth_cells: Of the P2 meshes, from coarse to fine.
        pair: The two meshes that are compared.
    """

    families: dict[str, list[Point]]
    pair: Pair
    displacement_bar: float
    volume_bar: float
    truth_cells: tuple[int, ...]


@dataclass(frozen=True)
class _Answer:
    """A solution where all meshes can be compared."""

    cells: int
    at_coarse_points: Points
    volume_change: float
    critical_time_step: float = float("nan")


def make_problem() -> Problem:
    """The kidney, its lower half held, pushed on a patch of the upper half's side."""
    mesh = mesh_surface(shape_kidney(edge_length=COARSE_EDGE))
    facets = mesh.boundary_facets
    corners = mesh.points[facets]
    held = facets[(corners[:, :, 2] <= 0.0).all(axis=1)]
    middle = mesh.points[np.argmax(mesh.points @ np.array([1.0, 0.0, 0.6]))]
    near = np.linalg.norm(corners.mean(axis=1) - middle, axis=1) < PATCH_RADIUS
    edges = corners[near]
    area = 0.5 * np.linalg.norm(
        np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1
    )
    x, y, z = np.array(FORCE) / area.sum()
    return Problem(
        mesh,
        MATERIAL,
        (Support(np.unique(held), held),),
        (Traction(facets[near], (float(x), float(y), float(z))),),
    )


def follow(progress: Callable[[str], None]) -> PushCurves:
    """Solve both families by fastsim, the truth by the reference, and measure.

    Raises:
        ReferenceFailedError: No truth: FEniCSx is missing or a solve failed.
    """
    problem = make_problem()
    answers: dict[str, list[_Answer]] = {"uniform": [], "graded": []}
    problems: list[Problem] = []
    for kind, found in answers.items():
        graded = GradedMesh(problem.mesh)
        while True:
            carried = carry_problem(problem, graded)
            displacement = solve_static(carried).displacement
            found.append(_answer(problem, carried, displacement, with_step=True))
            progress(f"{kind}: {len(graded.cells)} cells solved by fastsim")
            if kind == "graded":
                problems.append(carried)
            if kind == "uniform":
                marks = np.ones(len(graded.cells), dtype=bool)
            else:
                errors = estimate_error(carried.mesh, displacement, material=MATERIAL)
                marks = mark_largest(errors, share=SHARE)
            if len(graded.cells) + 1.5 * marks.sum() > MOST_CELLS[kind]:
                break
            graded.refine(marks)
    truths = [_solve_truth(problem, fine, progress) for fine in choose_truths(problems)]
    return _measure(answers, truths)


def choose_truths(problems: list[Problem]) -> list[Problem]:
    """Three meshes of the family, whose numbers of cells are nearest to a geometric series."""
    cells = np.array([p.mesh.num_cells for p in problems])
    finest = int(np.flatnonzero(cells <= TRUTH_CELLS)[-1])
    wanted = cells[finest] / TRUTH_RATIO ** np.array([2.0, 1.0, 0.0])
    return [problems[int(np.abs(np.log(cells / n)).argmin())] for n in wanted]


def cells_for_error(family: list[Point], error: Callable[[Point], float], wanted: float) -> float:
    """Cells at which a family's error falls to a value: straight lines between logarithms.

    Infinite where it does not fall so far.
    """
    if not wanted >= min(abs(error(p)) for p in family):
        return float("inf")
    n = np.log([p.cells for p in family])
    e = np.log(np.maximum.accumulate(np.abs([error(p) for p in family])[::-1]))
    return float(np.exp(np.interp(np.log(wanted), e, n[::-1])))


def _answer(
    problem: Problem, carried: Problem, displacement: Points, *, with_step: bool
) -> _Answer:
    mesh = carried.mesh
    step = sharp_critical_time_step(mesh, MATERIAL) if with_step else float("nan")
    return _Answer(
        mesh.num_cells,
        displacement[: problem.mesh.num_points],
        mesh.surface(displacement).volume / mesh.volume - 1.0,
        step,
    )


def _solve_truth(problem: Problem, carried: Problem, progress: Callable[[str], None]) -> _Answer:
    from palpate.reference.child import solve_static_in_child

    progress(f"truth: P2 on {carried.mesh.num_cells} graded cells")
    found = solve_static_in_child(
        carried, strain=Strain.GREEN, degree=2, progress=lambda _line: None
    )
    return _Answer(
        carried.mesh.num_cells,
        found.displacement[: problem.mesh.num_points],
        found.volume / carried.mesh.volume - 1.0,
    )


def _measure(answers: dict[str, list[_Answer]], truths: list[_Answer]) -> PushCurves:
    truth = truths[-1]
    size = float(np.linalg.norm(truth.at_coarse_points))
    families = {
        kind: [
            Point(
                a.cells,
                float(np.linalg.norm(a.at_coarse_points - truth.at_coarse_points)) / size,
                a.volume_change / truth.volume_change - 1.0,
                a.critical_time_step,
            )
            for a in found
        ]
        for kind, found in answers.items()
    }
    first, second = (
        float(np.linalg.norm(b.at_coarse_points - a.at_coarse_points)) / size
        for a, b in pairwise(truths)
    )
    v1, v2 = (
        abs(b.volume_change / truth.volume_change - a.volume_change / truth.volume_change)
        for a, b in pairwise(truths)
    )
    return PushCurves(
        families,
        _pair(answers, families, truth),
        remainder(first, second),
        remainder(v1, v2),
        tuple(t.cells for t in truths),
    )


def _pair(
    answers: dict[str, list[_Answer]], families: dict[str, list[Point]], truth: _Answer
) -> Pair:
    allowed = SHARE_OF_CELLS * families["uniform"][-1].cells
    which = max(k for k, p in enumerate(families["graded"]) if p.cells <= allowed)
    one, other = answers["uniform"][-1], answers["graded"][which]
    gap = float(np.linalg.norm(one.at_coarse_points - other.at_coarse_points))
    return Pair(
        families["uniform"][-1],
        families["graded"][which],
        gap / float(np.linalg.norm(truth.at_coarse_points)),
        abs((one.volume_change - other.volume_change) / truth.volume_change),
    )


def remainder(first: float, second: float) -> float:
    """What is left after two successive changes that shrink like a geometric series.

    second / (first / second - 1), with Roache's factor of safety for three meshes, 1.25.
    Infinite where they do not shrink.
    """
    from palpate.validation.grid_convergence import SAFETY_FACTOR

    return SAFETY_FACTOR * second / (first / second - 1.0) if first > second else float("inf")
