"""Error against cells on one body: a uniform family of meshes and one graded by its own error.

All meshes are bisections of one coarse mesh, so the body and its held, pushed and touched parts
are the same polyhedra in all, and the coarse mesh's points are in all. The truth is P2 on meshes
graded by the same indicator, three of them, which gives it an error bar.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.grading.carried_problem import carry_problem
from palpate.fastsim.grading.error_indicator import estimate_error, mark_largest
from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem

# Share of the squared error that is refined from one mesh to the next.
SHARE = 0.2
# The graded mesh compared with the finest uniform one has at most this share of its cells.
SHARE_OF_CELLS = 1.0 / 5.0

# Displacement [m] and the scalar that is judged beside it, in SI units.
Solved = tuple[Points, float]


@dataclass(frozen=True, eq=False)
class Scene:
    """A body under load, and what is asked of it.

    Attributes:
        title: For people.
        quantity: The scalar that is judged: "change of volume", "contact force".
        problem: On the coarse mesh.
        solve: The candidate's answer on a mesh.
        solve_truth: The reference's, quadratic.
        most_cells: Of each family.
        truth_cells: Of the finest mesh that the truth is solved on, at most.
        truth_ratio: Cells of one truth over those of the one before, about.
    """

    title: str
    quantity: str
    problem: Problem
    solve: Callable[[Problem], Solved]
    solve_truth: Callable[[Problem], Solved]
    most_cells: dict[str, int]
    truth_cells: int
    truth_ratio: float


@dataclass(frozen=True)
class Point:
    """One mesh of a family.

    Attributes:
        cells: Their number.
        displacement_error: Relative L2 over the coarse mesh's points, against the truth [-].
        quantity_error: Of the scene's scalar, over the true one [-], signed.
        critical_time_step: About the rest state [s].
    """

    cells: int
    displacement_error: float
    quantity_error: float
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
        quantity_gap: Between their scalars, over the true one [-].
    """

    uniform: Point
    graded: Point
    displacement_gap: float
    quantity_gap: float


@dataclass(frozen=True)
class Curves:
    """Errors against cells, and how far the truth itself may be off.

    Attributes:
        title: Of the scene.
        quantity: Its scalar.
        families: Meshes by "uniform" and "graded", from coarse to fine.
        displacement_bar, quantity_bar: Of the truth, in the errors' units [-].
        truth_cells: Of the P2 meshes, from coarse to fine.
        pair: The two meshes that are compared.
    """

    title: str
    quantity: str
    families: dict[str, list[Point]]
    pair: Pair
    displacement_bar: float
    quantity_bar: float
    truth_cells: tuple[int, ...]


@dataclass(frozen=True)
class _Answer:
    """A solution where all meshes can be compared."""

    cells: int
    at_coarse_points: Points
    quantity: float
    critical_time_step: float = float("nan")


def follow(scene: Scene, progress: Callable[[str], None]) -> Curves:
    """Solve both families by fastsim, the truth by the reference, and measure.

    Raises:
        ReferenceFailedError: No truth: FEniCSx is missing or a solve failed.
    """
    problem = scene.problem
    answers: dict[str, list[_Answer]] = {"uniform": [], "graded": []}
    problems: list[Problem] = []
    for kind, found in answers.items():
        graded = GradedMesh(problem.mesh)
        while True:
            carried = carry_problem(problem, graded)
            solved = scene.solve(carried)
            step = Body(carried.mesh, problem.material).critical_time_step()
            found.append(_answer(problem, carried, solved, step))
            progress(f"{scene.title}, {kind}: {len(graded.cells)} cells solved by fastsim")
            if kind == "graded":
                problems.append(carried)
            if kind == "uniform":
                marks = np.ones(len(graded.cells), dtype=bool)
            else:
                errors = estimate_error(Body(carried.mesh, problem.material), solved[0])
                marks = mark_largest(errors, part=SHARE)
            if len(graded.cells) + 1.5 * marks.sum() > scene.most_cells[kind]:
                break
            graded.refine(marks)
    truths = []
    for fine in choose_truths(problems, scene.truth_cells, scene.truth_ratio):
        progress(f"{scene.title}, truth: P2 on {fine.mesh.num_cells} graded cells")
        truths.append(_answer(problem, fine, scene.solve_truth(fine)))
    return _measure(scene, answers, truths)


def choose_truths(problems: list[Problem], most_cells: int, ratio: float) -> list[Problem]:
    """Three meshes of the family, whose numbers of cells are nearest to a geometric series."""
    cells = np.array([p.mesh.num_cells for p in problems])
    finest = int(np.flatnonzero(cells <= most_cells)[-1])
    wanted = cells[finest] / ratio ** np.array([2.0, 1.0, 0.0])
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
    problem: Problem, carried: Problem, solved: Solved, step: float = float("nan")
) -> _Answer:
    displacement, quantity = solved
    at_coarse_points = displacement[: problem.mesh.num_points]
    return _Answer(carried.mesh.num_cells, at_coarse_points, quantity, step)


def _measure(scene: Scene, answers: dict[str, list[_Answer]], truths: list[_Answer]) -> Curves:
    truth = truths[-1]
    size = float(np.linalg.norm(truth.at_coarse_points))
    families = {
        kind: [
            Point(
                a.cells,
                float(np.linalg.norm(a.at_coarse_points - truth.at_coarse_points)) / size,
                a.quantity / truth.quantity - 1.0,
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
    q1, q2 = (abs((b.quantity - a.quantity) / truth.quantity) for a, b in pairwise(truths))
    return Curves(
        scene.title,
        scene.quantity,
        families,
        _pair(answers, families, truth),
        remainder(first, second),
        remainder(q1, q2),
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
        abs((one.quantity - other.quantity) / truth.quantity),
    )


def remainder(first: float, second: float) -> float:
    """What is left after two successive changes that shrink like a geometric series.

    second / (first / second - 1), with Roache's factor of safety for three meshes, 1.25.
    Infinite where they do not shrink.
    """
    from palpate.validation.metrics.grid_convergence import SAFETY_FACTOR

    return SAFETY_FACTOR * second / (first / second - 1.0) if first > second else float("inf")
